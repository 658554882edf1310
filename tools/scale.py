"""What reading logs on a cluster is worth, and what a robot-hour costs: the numbers of docs/scale.md.

Simulates sessions of a six-joint arm, copies them to as many files as asked for (each another session), and reads them
in one process, in two, by one worker and by two workers of ``dask.distributed`` on this machine, which are started
before; all ways in turn, several rounds.

Run:  python tools/scale.py --files 24 --rate 200
"""

from __future__ import annotations

import argparse
import gc
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")  # as the command line does

import distributed
import numpy as np

from pumaid import identify, plan, segment, simulate
from pumaid.cluster.connect import connected
from pumaid.cluster.cores import spread
from pumaid.cluster.desk import started
from pumaid.cluster.gather import gather
from pumaid.cluster.pieces import Reading
from pumaid.dataset import Dataset
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.io.table import LogReader, write_log
from pumaid.preprocessing.options import DEFAULTS
from pumaid.preprocessing.suspicion import Watch
from pumaid.robot import Robot
from pumaid.simulation import draw


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


def timed(ways: dict[str, Callable[[], Dataset]], rounds: int) -> dict[str, tuple[float, Dataset]]:
    """Seconds of each way, the least of all rounds but a first one, and what was left; rounds go through all ways.

    A machine that is slower for a minute is so for all of them.
    """
    best = dict.fromkeys(ways, float("inf"))
    found: dict[str, Dataset] = {}
    for number in range(rounds + 1):
        for name, work in ways.items():
            begin = time.monotonic()
            found[name] = work()
            if number:
                best[name] = min(best[name], time.monotonic() - begin)
    return {name: (best[name], found[name]) for name in ways}


@contextmanager
def cluster_of(workers: int, *, foreign: bool) -> Iterator[Any]:
    """A client of so many worker processes, pumaid's own or those that somebody else started."""
    if not foreign:
        with connected("local", workers=workers) as client:
            yield client
        return
    with (
        distributed.LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster,
        connected(cluster.scheduler_address) as client,
    ):
        yield client


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--files", type=int, default=24)
    parser.add_argument("--rate", type=float, default=200.0, help="Hz")
    parser.add_argument("--csv", action="store_true", help="text logs instead of Parquet")
    parser.add_argument("--foreign", action="store_true", help="workers as dask starts them, joined by their address")
    parser.add_argument("--rounds", type=int, default=4)
    options = parser.parse_args()
    gc.set_threshold(50_000)  # as the command line does
    robot = read_recipe(shipped_recipes()["ur5e"])
    with ExitStack() as stack:
        scratch = stack.enter_context(tempfile.TemporaryDirectory())
        ending = "csv" if options.csv else "parquet"
        paths, rows = written(robot, Path(scratch), options.files, options.rate, ending)
        hours = rows / options.rate / 3600.0
        amount = f"{rows:,} rows, {hours:.1f} robot-hours at {options.rate:g} Hz, {ending}"
        reading = Reading(robot, DEFAULTS)
        # One for each round, begun before the cluster is; each reads once.
        mates = stack.enter_context(started(reading.tried, options.rounds + 1))
        one, two = (stack.enter_context(cluster_of(number, foreign=options.foreign)) for number in (1, 2))
        ways: dict[str, Callable[[], Dataset]] = {
            "one process": lambda: segment(Watch(LogReader(paths, robot), robot), robot),
            "two processes (`--jobs 2`)": lambda: spread(paths, reading, [mates.pop()]),
            "1 worker": lambda: gather(paths, robot, one),
            "2 workers": lambda: gather(paths, robot, two),
        }
        took = timed(ways, options.rounds)
    print(f"{len(paths)} files, {amount}, {os.cpu_count()} cores\n")
    print("| how | s | rows a second | robot-hours a core-hour | against one worker |\n|---|---|---|---|---|")
    single, wanted = took["1 worker"][0], took["one process"][1]
    for how, (seconds, found) in took.items():
        cores = 1 if how.startswith(("one", "1")) else 2
        worth = f"{single / seconds:.2f}" if "worker" in how else "-"
        each = f"{rows / seconds:,.0f} | {hours / (cores * seconds / 3600.0):,.0f}"
        print(f"| {how} | {seconds:.1f} | {each} | {worth} |")
        _check(found, wanted, robot)
    print("\nthe models are equal to 1e-10")


def _check(found: Dataset, wanted: Dataset, robot: Robot) -> None:
    known, told = ([value.value or 0.0 for value in identify(one, robot).values] for one in (wanted, found))
    assert np.allclose(told, known, rtol=1e-10, atol=0.0), "the numbers are others"


if __name__ == "__main__":
    main()
