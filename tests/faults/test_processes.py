"""Runs that are killed, interrupted, made side by side, or whose reader goes away; in real processes."""

from __future__ import annotations

import json
import random
import shutil
import subprocess
import sys
import time
from contextlib import suppress
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
    """The word and the code of a run that Ctrl-C ends."""
    from faulty import invoke

    def interrupted(*words, **more):
        raise KeyboardInterrupt

    monkeypatch.setattr("pumaid.estimation.estimate.identify", interrupted)
    found = invoke("identify", str(arm / "logs"))
    assert (found.exit_code, found.stdout) == (130, "") and found.stderr.count("stopped") == 1


#: A run that reads even these few logs by two processes.
TWO = "from pumaid.preprocessing import ingest; ingest.BYTES_A_PROCESS = 1; from pumaid.__main__ import run; run()"


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="looks for processes as Linux shows them")
def test_no_process_outlives_a_killed_run(arm):
    """SIGKILL while another process reads for it: that one ends, too, and the model stays as it was."""
    logs, model = arm / "logs", (arm / "results" / "model.json").read_bytes()
    for number in range(20):
        for path in sorted(logs.iterdir())[:2]:
            shutil.copy(path, logs / f"{number:02}_{path.name}")
    seen, delays = 0, random.Random(3)
    for _ in range(6):
        line = [
            sys.executable,
            "-c",
            TWO,
            "identify",
            str(logs),
            "--jobs",
            "2",
            "--trust",
            "--results",
            str(arm / "elsewhere"),
        ]
        with subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as run:
            children = Path(f"/proc/{run.pid}/task/{run.pid}/children")
            found: list[str] = []
            while run.poll() is None and not found:
                with suppress(OSError):
                    found = children.read_text().split()
            time.sleep(delays.uniform(0.0, 0.2))
            run.kill()
        seen += len(found)
        until = time.monotonic() + 20.0
        while any(is_running(pid) for pid in found):
            assert time.monotonic() < until, "a process is left"
            time.sleep(0.05)
        assert (arm / "results" / "model.json").read_bytes() == model
    assert seen >= 6


def is_running(pid: str) -> bool:
    """Whether there is such a process that has not ended."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(sys.platform != "linux", reason="address space is limited as on Linux")
@pytest.mark.parametrize("megabytes", [500, 600, 800])
def test_without_memory_enough_nothing_is_lost(arm, megabytes):
    """Under a limit of memory a run succeeds, or ends with one message and leaves the old model."""
    import resource

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (megabytes << 20, megabytes << 20))

    before = (arm / "results" / "model.json").read_bytes()
    line = [sys.executable, "-c", TWO, "identify", str(arm / "logs"), "--jobs", "2"]
    done = subprocess.run(line, capture_output=True, text=True, check=False, preexec_fn=limited, timeout=120)
    assert "Traceback" not in done.stderr and done.returncode in (0, 3), done.stderr
    if done.returncode:
        assert done.stderr.count("error[") == 1 and "no-memory" in done.stderr, done.stderr
        assert (arm / "results" / "model.json").read_bytes() == before
