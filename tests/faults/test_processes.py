"""Runs that are killed, interrupted, made side by side, or whose reader goes away; in real processes."""

import json
import random
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from functools import partial
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals and forks are of POSIX")

#: Runs that are killed by each signal.
TRIALS = 4


def started(log: Path) -> subprocess.Popen[str]:
    """`identify` of a log in a process of its own."""
    line = [sys.executable, "-m", "pumaid", "identify", str(log)]
    # Where the tests themselves are started in the background, Ctrl-C would be ignored.
    heard = partial(signal.signal, signal.SIGINT, signal.default_int_handler)
    return subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, preexec_fn=heard)


def ended(run: subprocess.Popen[str]) -> tuple[int, str]:
    """Exit code and standard error of a process, once it has ended."""
    _, errors = run.communicate()
    return run.returncode, errors


def is_whole(results: Path) -> bool:
    """Whether every file that a results folder shows is a whole document, and numbers stand once."""
    shown = [path for path in results.rglob("*.json") if not path.name.startswith(".")]
    numbers = [path.name.split("-")[0] for path in (results / "models").glob("[0-9]*.json")]
    assert len(set(numbers)) == len(numbers)
    return all(json.loads(path.read_text())["kind"] == "model" for path in shown)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_killed_at_any_instant(arm, number):
    """At random instants: the model is the old or the new one, never half; Ctrl-C leaves no traceback, and code 130."""
    # The runs identify the first and the second log in turn, so that each has something to change.
    logs, model, rng = sorted((arm / "logs").iterdir()), arm / "results" / "model.json", random.Random(1)
    made, spans, over = [], [], 0
    for log in logs:
        begun = time.monotonic()
        assert ended(started(log))[0] == 0
        spans.append(time.monotonic() - begun)
        made.append(model.read_bytes())
    for _ in range(TRIALS):
        run = started(logs[made[0] == model.read_bytes()])
        time.sleep(min(spans) * rng.uniform(0.2, 0.7))
        run.send_signal(number)
        code, errors = ended(run)
        over += code == 0
        assert code in (0, -number, 128 + number) and "Traceback" not in errors, errors
        assert model.read_bytes() in made and is_whole(arm / "results")
    assert over < TRIALS
    assert ended(started(logs[0]))[0] == 0 and model.read_bytes() == made[0]


def test_two_runs_at_once_do_not_mix(arm):
    """Both succeed, one of the two is the current model, both are kept, each under its number."""
    shutil.rmtree(arm / "results")
    runs = [started(log) for log in (arm / "logs").iterdir()]
    assert [ended(run)[0] for run in runs] == [0, 0]
    assert is_whole(arm / "results") and len(list((arm / "results" / "models").glob("[0-9]*.json"))) == 2


#: A run that reads even these few logs by two processes.
TWO = "from pumaid.preprocessing import ingest; ingest.BYTES_A_PROCESS = 1; from pumaid.__main__ import run; run()"


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="looks for processes as Linux shows them")
def test_no_process_outlives_a_killed_run(arm):
    """SIGKILL while another process reads for it: that one ends, too, and the model stays as it was."""
    logs, model = arm / "logs", (arm / "results" / "model.json").read_bytes()
    for number in range(20):
        for path in sorted(logs.iterdir())[:2]:
            shutil.copy(path, logs / f"{number:02}_{path.name}")
    words = ["identify", str(logs), "--jobs", "2", "--trust", "--results", str(arm / "elsewhere")]
    for delay in (0.02, 0.15):
        with subprocess.Popen([sys.executable, "-c", TWO, *words], stderr=subprocess.DEVNULL) as run:
            children = Path(f"/proc/{run.pid}/task/{run.pid}/children")
            readers: list[str] = []
            while run.poll() is None and not readers:
                with suppress(OSError):
                    readers = children.read_text().split()
            time.sleep(delay)
            run.kill()
        assert readers
        until = time.monotonic() + 20.0
        while any(is_running(pid) for pid in readers):
            assert time.monotonic() < until, "a process is left"
            time.sleep(0.05)
        assert (arm / "results" / "model.json").read_bytes() == model


def is_running(pid: str) -> bool:
    """Whether there is such a process that has not ended."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(sys.platform != "linux", reason="address space is limited as on Linux")
@pytest.mark.parametrize("megabytes", [500, 800])
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
