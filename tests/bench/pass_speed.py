"""What an identification costs beside merely reading its logs, measured in one run; appended to bench/log.csv.

python tests/bench/pass_speed.py [--rows 2 10 50] [--times 5]

Rows are in millions. Processes alternate, and the least time of each counts: what else the machine does only adds.
Longer logs are the same files again under other names (hard links): they take no room on the disk.
"""

from __future__ import annotations

import argparse
import csv
import datetime
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

from pumaid.io.log_writer import write_log
from pumaid.io.recipe import shipped_recipes
from pumaid.simulation import table1
from pumaid.verbs.simulate import simulate

ROOT = Path(__file__).parents[2]
LOG = ROOT / "bench" / "log.csv"
RECIPE = shipped_recipes()["puma560"]
#: Stands for the folder of logs in a command.
LOGS = "LOGS"
#: Twice the paper's experiment takes 2700 s of robot time; at this rate that is two million rows of 19 columns.
RATE = 1500.0

#: A command line; it tells its own peak (what getrusage tells begins at the size of the process that started it), that
#: of the largest process it started (pages that it shares with its parent included), and with what it was loaded, so
#: that loading alone can be timed, too.
COMMAND = """
import pathlib, resource, sys
from pumaid.__main__ import run
told = sys.argv.pop(1)
try:
    run()
except SystemExit as end:
    if end.code:
        raise
peak = int(pathlib.Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0]) // 1024
other = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss // 1024
kind = lambda module: object.__getattribute__(module, "__class__").__name__  # a look at one that waits would load it
names = [name for name, module in sys.modules.items() if name != "__main__" and kind(module) != "_LazyModule"]
pathlib.Path(told).write_text("\\n".join([f"{peak} {other}", *names]))
"""
#: Start-up alone: the same modules as the program loads them, at best (no look for garbage), and nothing of what a
#: process does at its end.
LOAD = """
import gc, importlib, os, pathlib, sys
from contextlib import suppress
gc.disable()
for name in pathlib.Path(sys.argv[1]).read_text().splitlines()[1:]:
    with suppress(ImportError):
        importlib.import_module(name)
os._exit(0)
"""
END = "import os\nos._exit(0)\n"
PARQUET = "import pathlib, sys\nimport pyarrow.parquet as pq\n"
READ_PARQUET = "for path in sorted(pathlib.Path(sys.argv[1]).iterdir()): pq.read_table(path)\n"
CSV = "import pathlib, sys\nimport pyarrow.csv as pc\n"
READ_CSV = "for path in sorted(pathlib.Path(sys.argv[1]).iterdir()): pc.read_csv(path)\n"


@dataclass(frozen=True)
class Cost:
    """Wall and processor seconds of a process."""

    wall: float
    cpu: float

    def beyond(self, start: Cost) -> Cost:
        """Without starting up."""
        return Cost(self.wall - start.wall, self.cpu - start.cpu)


def run(program: str, *words: object) -> Cost:
    """A Python process to its end."""
    begun, before = time.perf_counter(), os.times()
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": ""}
    subprocess.run(
        [sys.executable, "-c", program, *map(str, words)],
        check=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=environment,
    )
    after = os.times()
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return Cost(time.perf_counter() - begun, cpu)


def least(costs: list[Cost]) -> Cost:
    """The least of each."""
    return Cost(min(cost.wall for cost in costs), min(cost.cpu for cost in costs))


def make_logs(folder: Path) -> int:
    """Two million rows as Parquet and as CSV in two folders; returns the rows."""
    truth, rows = table1.puma560(), 0
    logs = simulate(truth.robot, table1.experiment(2), seed=1, truth=truth, rate=RATE)
    for origin, batches in groupby(logs, key=lambda log: log.origin):
        kept = list(batches)
        rows += sum(map(len, kept))
        for ending in ("parquet", "csv"):
            write_log(folder / ending / f"{origin}.{ending}", kept, truth.robot)
    return rows


def repeated(folder: Path, times: int) -> Path:
    """A folder that holds the Parquet files of another so many times."""
    out = folder / f"parquet{times}"
    out.mkdir()
    for number in range(times):
        for path in sorted((folder / "parquet").iterdir()):
            (out / f"{number:03}_{path.name}").hardlink_to(path)
    return out


def measured(
    case: str, logs: Path, rows: int, *, times: int, words: tuple[str, ...], forget: Path | None = None
) -> dict[str, object]:
    """One line of the log: a command, `forget` removed before each run, against reading the same files with pyarrow."""
    told = logs.parent / "told.txt"
    command = (told, *(logs if word == LOGS else word for word in words), "--recipe", RECIPE)
    load, read = (CSV, READ_CSV) if logs.name == "csv" else (PARQUET, READ_PARQUET)
    costs: dict[str, list[Cost]] = {"command": [], "loading": [], "floor": [], "floor loading": []}
    for _ in range(times):
        if forget is not None:
            shutil.rmtree(forget, ignore_errors=True)
        costs["command"].append(run(COMMAND, *command))
        costs["loading"].append(run(LOAD, told))
        costs["floor"].append(run(load + read, logs))
        costs["floor loading"].append(run(load + END))
    best = {name: least(one) for name, one in costs.items()}
    own, floor = best["command"].beyond(best["loading"]), best["floor"].beyond(best["floor loading"])
    return {
        "case": case,
        "rows": rows,
        "seconds": f"{own.wall:.2f}",
        "start-up": f"{best['loading'].wall:.2f}",
        "pyarrow": f"{floor.wall:.2f}",
        "ratio": f"{own.wall / floor.wall:.2f}",
        "processor": f"{own.cpu:.2f}",
        "pyarrow's": f"{floor.cpu:.2f}",
        "its ratio": f"{own.cpu / floor.cpu:.2f}",
        "peak MiB": told.read_text().split()[0],
        "load": f"{os.getloadavg()[0]:.1f}",
        "peak of another MiB": told.read_text().split()[1],
    }


def lines(folder: Path, millions: list[int], times: int) -> Iterator[dict[str, object]]:
    """Every case in turn."""
    os.environ["PUMAID_CACHE"] = str(folder / "cache")
    rows, fresh = make_logs(folder), ("--no-cache", "--trust", "-o", str(folder / "model.json"))
    parquet = folder / "parquet"
    yield measured("identify", parquet, rows, times=times, words=("identify", LOGS, *fresh))
    yield measured("identify, one core", parquet, rows, times=times, words=("identify", LOGS, "--jobs", "1", *fresh))
    yield measured("identify, CSV", folder / "csv", rows, times=times, words=("identify", LOGS, *fresh))
    run(COMMAND, folder / "told.txt", "segment", parquet, "--recipe", RECIPE)
    yield measured("segment, kept", parquet, rows, times=times, words=("segment", LOGS))
    added = ("identify", LOGS, "--add", "stribeck@3", *fresh[2:])
    yield measured("identify --add, kept", parquet, rows, times=times, words=added)
    looked = ("diagnose", str(folder / "model.json"), LOGS, "-o", str(folder / "diagnosis.json"))
    found = folder / "cache" / "diagnoses"
    yield measured("diagnose, pass kept", parquet, rows, times=times, words=looked, forget=found)
    yield measured("diagnose again", parquet, rows, times=times, words=looked)
    for many in millions:
        again = round(many * 1e6 / rows)
        if again > 1:
            logs = repeated(folder, again)
            yield measured("identify", logs, again * rows, times=1, words=("identify", LOGS, *fresh))


def main() -> None:
    """Measure, print and append."""
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    asked.add_argument("--rows", type=int, nargs="*", default=[10, 50], help="millions, beside two")
    asked.add_argument("--times", type=int, default=5)
    words = asked.parse_args()
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=False
    ).stdout.strip()
    day = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    told = {"day": day, "commit": commit, "cores": os.cpu_count(), "machine": platform.machine()}
    LOG.parent.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="pumaid-bench-") as folder:
        for line in lines(Path(folder), words.rows, words.times):
            whole, is_new = told | line, not LOG.exists()
            with LOG.open("a", newline="", encoding="utf-8") as stream:
                writer = csv.DictWriter(stream, list(whole))
                if is_new:
                    writer.writeheader()
                writer.writerow(whole)
            sys.stdout.write(", ".join(f"{name} {value}" for name, value in line.items()) + "\n")


if __name__ == "__main__":
    main()
