"""What commands cost beside merely reading their logs with pyarrow; appended to bench/log.csv.

python tests/bench/pass_speed.py [--rows 10 50] [--times 5]

Rows are in millions. Processes are timed from start to end, alternate, and the least time of each counts: what else the
machine does only adds. Longer logs are the same files again under other names (hard links).
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
from itertools import groupby
from pathlib import Path

from pumaid.io.recipe import shipped_recipes
from pumaid.io.write import write_log
from pumaid.simulation import table1
from pumaid.simulation.session import simulate

ROOT = Path(__file__).parents[2]
LOG = ROOT / "bench" / "log.csv"
RECIPE = shipped_recipes()["puma560"]
#: Thrice the paper's experiment takes some 2000 s of robot time; at this rate that is two million rows of 19 columns.
RATE = 1000.0
#: Reads all files of a folder into tables.
FLOOR = {
    "parquet": "import pathlib, sys\nimport pyarrow.parquet as pq\nread = pq.read_table\n",
    "csv": "import pathlib, sys\nimport pyarrow.csv as pc\nread = pc.read_csv\n",
}
READ = "for path in sorted(pathlib.Path(sys.argv[1]).iterdir()): read(path)\n"
#: A command that tells its own peak memory, MiB.
COMMAND = """
import pathlib, sys
from pumaid.__main__ import run
told = sys.argv.pop(1)
try:
    run()
finally:
    peak = pathlib.Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0]
    pathlib.Path(told).write_text(str(int(peak) // 1024))
"""


def run(program: str, *words: object) -> tuple[float, float]:
    """Wall and processor seconds of a Python process."""
    begun, before = time.perf_counter(), os.times()
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": ""}
    line = [sys.executable, "-c", program, *map(str, words)]
    subprocess.run(line, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment)
    after = os.times()
    processor = after.children_user + after.children_system - before.children_user - before.children_system
    return time.perf_counter() - begun, processor


def make_logs(folder: Path) -> int:
    """Two million rows as Parquet and as CSV in two folders; returns the rows."""
    truth, rows = table1.puma560(), 0
    logs = simulate(truth.robot, table1.experiment(3), seed=1, truth=truth, rate=RATE)
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


def measured(case: str, logs: Path, rows: int, *, times: int, words: list[object], is_fresh: bool = True) -> dict:
    """One line of the log: a command against reading the same files with pyarrow; `is_fresh` without a dataset."""
    told, results = logs.parent / "told.txt", logs.parent / "results"
    floor = FLOOR["csv" if logs.name == "csv" else "parquet"] + READ
    command, reading = [], []
    for _ in range(times):
        if is_fresh:
            shutil.rmtree(results, ignore_errors=True)
        command.append(run(COMMAND, told, *words, "--recipe", logs.parent / "recipe.yaml"))
        reading.append(run(floor, logs))
    wall, processor = (min(one) for one in zip(*command, strict=True))
    floor_wall, floor_processor = (min(one) for one in zip(*reading, strict=True))
    return {
        "case": case,
        "rows": rows,
        "seconds": f"{wall:.2f}",
        "pyarrow": f"{floor_wall:.2f}",
        "ratio": f"{wall / floor_wall:.2f}",
        "processor": f"{processor:.2f}",
        "pyarrow's": f"{floor_processor:.2f}",
        "peak MiB": told.read_text(),
        "load": f"{os.getloadavg()[0]:.1f}",
    }


def lines(folder: Path, millions: list[int], times: int) -> Iterator[dict]:
    """Every case in turn."""
    shutil.copy(RECIPE, folder / "recipe.yaml")
    rows, parquet, text = make_logs(folder), folder / "parquet", folder / "csv"
    identify = ["identify", parquet, "--trust"]
    yield measured("identify, CSV", text, rows, times=times, words=["identify", text, "--trust"])
    yield measured("identify, one process", parquet, rows, times=times, words=[*identify, "--jobs", 1])
    yield measured("identify", parquet, rows, times=times, words=identify)
    yield measured("identify again", parquet, rows, times=times, words=identify, is_fresh=False)
    diagnose = ["diagnose", folder / "results" / "model.json", parquet, "--trust"]
    yield measured("diagnose, with the dataset", parquet, rows, times=times, words=diagnose, is_fresh=False)
    for many in millions:
        again = round(many * 1e6 / rows)
        logs = repeated(folder, again)
        yield measured("identify", logs, again * rows, times=1, words=["identify", logs, "--trust"])


def main() -> None:
    """Measure, print and append."""
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    asked.add_argument("--rows", type=int, nargs="*", default=[10, 50], help="millions, beside two")
    asked.add_argument("--times", type=int, default=5)
    words = asked.parse_args()
    line = ["git", "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(line, cwd=ROOT, capture_output=True, text=True, check=False).stdout.strip()
    day = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    machine = {"day": day, "commit": commit, "cores": os.cpu_count(), "machine": platform.machine()}
    with tempfile.TemporaryDirectory(prefix="pumaid-bench-") as folder:
        for found in lines(Path(folder), words.rows, words.times):
            whole, is_new = machine | found, not LOG.exists()
            with LOG.open("a", newline="", encoding="utf-8") as stream:
                writer = csv.DictWriter(stream, list(whole))
                if is_new:
                    writer.writeheader()
                writer.writerow(whole)
            sys.stdout.write(", ".join(f"{name} {value}" for name, value in found.items()) + "\n")


if __name__ == "__main__":
    main()
