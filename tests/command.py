"""A command line, as a user types it."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from click.testing import CliRunner, Result

from pumaid.cli import group


def run(*words: object, code: int = 0, **more: Any) -> Result:
    """A command line that ends with `code`; Traceback, if any, is never the answer."""
    found = CliRunner().invoke(group, [str(word) for word in words], prog_name="pumaid", **more)
    assert found.exit_code == code, found.output
    assert "Traceback" not in found.stderr
    return found


def answer(line: str, **more: Any) -> dict[str, Any]:
    """The document that a line prints with ``--json``."""
    return json.loads(run(*line.split(), "--json", **more).stdout)


def shell(script: str, folder: Path | None = None) -> subprocess.CompletedProcess[str]:
    """A line as a user's shell runs it."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    line = ["bash", "-c", script]
    return subprocess.run(
        line, cwd=folder, env={**os.environ, "PATH": path}, capture_output=True, text=True, check=False
    )
