"""What reading logs on a cluster is worth, and what a robot-hour costs: the numbers of docs/scale.md.

Simulates sessions of a six-joint arm, copies them to as many files as asked for (each another session), and reads them
in one process, in two, by one worker and by two workers of ``dask.distributed`` on this machine, which are started
before.

Run:  python tools/scale.py --files 24 --rate 200
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from pumaid import identify, plan, segment, simulate
from pumaid.cluster.connect import connected
from pumaid.cluster.cores import spread, started
from pumaid.cluster.gather import gather
from pumaid.cluster.pieces import Reading
from pumaid.files.recipe import read_recipe, shipped_recipes
from pumaid.files.table import LogReader, write_log
from pumaid.motion.options import DEFAULTS
from pumaid.records import Evidence, Robot
from pumaid.virtual import draw


def written(robot: Robot, folder: Path, files: int, rate: float, ending: str = "parquet") -> tuple[list[Path], int]:
    """Logs of as many sessions at that many samples a second, and their rows together."""
    made = plan(robot, minutes=8.0, seed=0)
    first = folder / f"session_000.{ending}"
    logs = list(simulate(robot, made, truth=draw(robot, 3), seed=1, rate=rate))
    write_log(first, logs, robot)
    paths = [first]
    for number in range(1, files):
        paths.append(folder / f"session_{number:03d}.{ending}")
        paths[-1].write_bytes(first.read_bytes())
    return paths, files * sum(map(len, logs))


def timed(work: Callable[[], Evidence]) -> tuple[float, Evidence]:
    """Seconds, the better of two times, and what was left."""
    best, found = float("inf"), None
    for _ in range(2):
        begin = time.monotonic()
        found = work()
        best = min(best, time.monotonic() - begin)
    assert found is not None
    return best, found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--files", type=int, default=24)
    parser.add_argument("--rate", type=float, default=200.0, help="Hz")
    parser.add_argument("--csv", action="store_true", help="text logs instead of Parquet")
    options = parser.parse_args()
    robot = read_recipe(shipped_recipes()["ur5e"])
    with tempfile.TemporaryDirectory() as scratch:
        ending = "csv" if options.csv else "parquet"
        paths, rows = written(robot, Path(scratch), options.files, options.rate, ending)
        hours = rows / options.rate / 3600.0
        amount = f"{rows:,} rows, {hours:.1f} robot-hours at {options.rate:g} Hz, {ending}"
        print(f"{len(paths)} files, {amount}, {os.cpu_count()} cores\n")
        print("| how | s | rows a second | robot-hours a core-hour | against one worker |\n|---|---|---|---|---|")
        alone, wanted = timed(lambda: segment(LogReader(paths, robot), robot))
        _told("one process", alone, rows, hours, 1, None)
        reading = Reading(robot, DEFAULTS)
        with started(reading, 1) as mates:
            taken, found = timed(lambda: spread(paths, reading, mates))
        _told("two processes (`--jobs 2`)", taken, rows, hours, 2, None)
        _check(found, wanted, robot)
        single = 0.0
        for workers in (1, 2):
            with connected("local", workers=workers) as client:
                taken, found = timed(lambda client=client: gather(paths, robot, client))
            single = single or taken
            _told(f"{workers} worker{'s' * (workers > 1)}", taken, rows, hours, workers, single / taken)
            _check(found, wanted, robot)
    print("\nthe models are equal to 1e-10")


def _check(found: Evidence, wanted: Evidence, robot: Robot) -> None:
    values = [[value.value or 0.0 for value in identify(one, robot).values] for one in (wanted, found)]
    assert np.allclose(*values, rtol=1e-10, atol=0.0), "the numbers are others"


def _told(how: str, seconds: float, rows: int, hours: float, cores: int, gain: float | None) -> None:
    worth = f"{gain:.2f}" if gain else "-"
    print(
        f"| {how} | {seconds:.1f} | {rows / seconds:,.0f} | {hours / (cores * seconds / 3600.0):,.0f} | {worth} |",
        flush=True,
    )


if __name__ == "__main__":
    sys.exit(main())
