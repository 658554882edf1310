"""Standard streams that are closed or full, in real processes of a shell."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no /dev/full")


def shell(script: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a line in a folder; ``$P`` is the program."""
    more = {"P": f"{sys.executable} -m pumaid", "PYTHONPATH": str(Path(__file__).parents[2])}
    line = ["bash", "-c", script]
    return subprocess.run(line, cwd=folder, env=os.environ | more, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("streams", [">&-", "2>&-", ">&- 2>&- <&-"])
@pytest.mark.parametrize("words", ["identify logs", "report results/model.json --table csv -o -"])
def test_what_nobody_hears_is_done_all_the_same(arm, words, streams):
    """Closed outputs are as if they led nowhere."""
    done = shell(f"$P {words} {streams}", arm)
    assert done.returncode == 0 and "Traceback" not in done.stderr
    assert json.loads((arm / "results" / "model.json").read_text())["kind"] == "model"


@pytest.mark.parametrize(
    "words",
    ["identify - --recipe recipe.yaml", "compare - logs", "segment logs --recipe -", "init --urdf -", "report - logs"],
)
def test_a_closed_input_is_told(arm, words):
    """It is empty, which one message tells."""
    done = shell(f"$P {words} <&-", arm)
    assert done.returncode == 3 and done.stderr.count("error[") == 1 and "Traceback" not in done.stderr


@pytest.mark.parametrize("words", ["--help", "--version", "plan --help", "segment logs --csv"])
def test_a_full_output_is_one_message(arm, words):
    """Help and version are told as results are."""
    done = shell(f"$P {words} >/dev/full", arm)
    assert done.returncode == 3 and done.stderr.count("error[file-refused]") == 1 and "Traceback" not in done.stderr
    assert "Exception" not in done.stderr
