"""Runs that are killed, interrupted, made side by side, or whose reader goes away; in real processes."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals and forks are of POSIX")


def counted(folder: Path, *words: str) -> dict[str, int]:
    """What tests/killed.py counts."""
    line = [sys.executable, str(TESTS / "killed.py"), str(folder), *words]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_killed_at_any_instant(arm):
    """SIGKILL at random instants: the model is the old or the new one, never half; the run after that succeeds."""
    found = counted(arm, "--trials", "20", "--seed", "1")
    assert found["half"] == 0 and found["old"] + found["new"] == 20
    assert found["over"] < 20 and found["again"] == 0 and found["current"] == 1


def test_interrupted_at_any_instant(arm):
    """Ctrl-C ends a run with code 130 and no traceback, whatever it was at; results as after a kill."""
    found = counted(arm, "--trials", "8", "--seed", "2", "--interrupt")
    assert found["half"] == 0 and found["loud"] == 0 and found["over"] < 8 and found["current"] == 1


def test_two_runs_at_once_do_not_mix(arm):
    """Both succeed, one of the two is the current model, both are kept, each under its number."""
    assert counted(arm, "--trials", "3", "--pairs") == {"failed": 0, "mixed": 0, "models": 6}


@pytest.mark.parametrize("reader", ["head -c 1", "true"])
def test_a_reader_that_goes_away_is_no_fault(arm, reader):
    """A pipe that is closed early ends the command without a word."""
    line = f"{sys.executable} -m pumaid segment '{arm / 'logs'}' --rejects | {reader}"
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=False, cwd=TESTS.parent)
    assert "Traceback" not in done.stderr and "error[" not in done.stderr and "Exception" not in done.stderr


def test_an_interrupt_is_one_line(arm, monkeypatch):
    """The words and the code of a run that Ctrl-C ends."""
    from faulty import invoke

    def interrupted(*words, **more):
        raise KeyboardInterrupt

    monkeypatch.setattr("pumaid.verbs.identify.identify", interrupted)
    found = invoke("identify", str(arm / "logs"))
    assert found.exit_code == 130 and len(found.stderr.strip().splitlines()) == 1 and found.stdout == ""
