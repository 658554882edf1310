"""What commands cost beside merely reading their logs with pyarrow; appended to bench/log.csv.

python tests/bench/pass_speed.py [--rows 10 50] [--times 5]

Rows are in millions. Processes are timed from start to end, alternate, and the least time of each counts: what else the
machine does only adds. Longer logs are the same files again under other names (hard links).
"""

import argparse
import datetime
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from itertools import groupby
from pathlib import Path

import pandas as pd

from pumaid.io.recipe import shipped_recipes
from pumaid.io.write import write_log
from pumaid.simulation import simulate

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))
import table1  # noqa: E402

LOG = ROOT / "bench" / "log.csv"
#: Reads all files of a folder into tables.
FLOOR = """
import pathlib, sys
import {module} as module
for path in sorted(pathlib.Path(sys.argv[1]).iterdir()): module.{read}(path)
"""
FLOORS = {
    "parquet": FLOOR.format(module="pyarrow.parquet", read="read_table"),
    "csv": FLOOR.format(module="pyarrow.csv", read="read_csv"),
}
#: A command that writes its own peak memory, MiB.
COMMAND = """
import pathlib, sys
from pumaid.__main__ import run
place = sys.argv.pop(1)
try:
    run()
finally:
    peak = pathlib.Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0]
    pathlib.Path(place).write_text(str(int(peak) // 1024))
"""


def append(path: Path, records: Iterable[dict[str, object]], **about: object) -> None:
    """Append each record as it comes, with the day, the machine and what else is to be said of all; print it, too."""
    day = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    about = {"day": day, "cores": os.cpu_count(), "machine": platform.machine()} | about
    table = pd.read_csv(path, dtype=str) if path.exists() else pd.DataFrame()
    for record in records:
        rounded = {name: f"{value:.4g}" if isinstance(value, float) else value for name, value in record.items()}
        table = pd.concat([table, pd.DataFrame([about | rounded])])
        table.to_csv(path, index=False)
        print(", ".join(f"{name} {value}" for name, value in rounded.items()), flush=True)


def seconds(program: str, *words: object) -> float:
    """Wall seconds of a Python process."""
    begun = time.perf_counter()
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": ""}
    line = [sys.executable, "-c", program, *map(str, words)]
    subprocess.run(line, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment)
    return time.perf_counter() - begun


def make_logs(folder: Path) -> int:
    """Two million rows of 19 columns as Parquet and as CSV in two folders; returns the rows."""
    truth, rows = table1.puma560(), 0
    logs = simulate(truth.robot, table1.experiment(3), seed=1, truth=truth, rate=1000.0)
    for origin, batches in groupby(logs, key=lambda log: log.origin):
        of_file = list(batches)
        rows += sum(map(len, of_file))
        for ending in ("parquet", "csv"):
            write_log(folder / ending / f"{origin}.{ending}", of_file, truth.robot)
    return rows


def measured(case: str, words: list[object], rows: int, *, times: int, is_fresh: bool = True) -> dict[str, object]:
    """One line of the log: a command against reading the same files with pyarrow; `is_fresh` without a dataset."""
    logs = next(word for word in words if isinstance(word, Path) and word.is_dir())
    peak, commands, readings = logs.parent / "peak.txt", [], []
    for _ in range(times):
        if is_fresh:
            shutil.rmtree(logs.parent / "results", ignore_errors=True)
        commands.append(seconds(COMMAND, peak, *words, "--trust", "--recipe", logs.parent / "recipe.yaml"))
        readings.append(seconds(FLOORS["csv" if logs.name == "csv" else "parquet"], logs))
    command, reading = min(commands), min(readings)
    record = {"case": case, "rows": rows, "seconds": f"{command:.2f}", "pyarrow": f"{reading:.2f}"}
    record |= {"ratio": f"{command / reading:.2f}", "peak MiB": peak.read_text()}
    return record | {"load": f"{os.getloadavg()[0]:.1f}"}


def cases(folder: Path, millions: list[int], times: int) -> Iterator[dict[str, object]]:
    """Every case in turn."""
    shutil.copy(shipped_recipes()["puma560"], folder / "recipe.yaml")
    rows, parquet, model = make_logs(folder), folder / "parquet", folder / "results" / "model.json"
    yield measured("identify, CSV", ["identify", folder / "csv"], rows, times=times)
    yield measured("identify, one process", ["identify", parquet, "--jobs", 1], rows, times=times)
    yield measured("identify", ["identify", parquet], rows, times=times)
    yield measured("identify again", ["identify", parquet], rows, times=times, is_fresh=False)
    yield measured("diagnose, with the dataset", ["diagnose", model, parquet], rows, times=times, is_fresh=False)
    for many in millions:
        again = round(many * 1e6 / rows)
        logs = folder / f"parquet{again}"
        logs.mkdir()
        for number in range(again):
            for path in sorted(parquet.iterdir()):
                (logs / f"{number:03}_{path.name}").hardlink_to(path)
        yield measured("identify", ["identify", logs], again * rows, times=1)


def main() -> None:
    """Measure, print and append."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, nargs="*", default=[10, 50], help="millions, beside two")
    parser.add_argument("--times", type=int, default=5)
    options = parser.parse_args()
    line = ["git", "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(line, cwd=ROOT, capture_output=True, text=True, check=False).stdout.strip()
    with tempfile.TemporaryDirectory(prefix="pumaid-bench-") as folder:
        append(LOG, cases(Path(folder), options.rows, options.times), commit=commit)


if __name__ == "__main__":
    main()
