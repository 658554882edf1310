"""The notebook runs from its own folder, cell after cell, and ends with less error."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "notebooks"


@pytest.mark.slow
def test_the_notebook_runs():
    """No cell fails or warns; it stores no outputs; the last cell's two errors fall."""
    cells = json.loads((FOLDER / "first_numbers.ipynb").read_text(encoding="utf-8"))["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    assert [cell["outputs"] for cell in cells if cell["cell_type"] == "code"] == [[]] * len(code)
    line = [sys.executable, "-W", "error", "-c", "\n".join(code)]
    environment = {**os.environ, "MPLBACKEND": "agg"}
    done = subprocess.run(line, cwd=FOLDER, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    *_, before, after = done.stdout.splitlines()
    assert float(after.split()[0]) < 0.9 * float(before.split()[0])
