"""Judge the diagnosis blind on virtual arms, and print the tables of what came out.

    python tools/blind.py run RESULTS.jsonl [--seeds 1] [--arms puma ur stanford] [--effects NAME ...] [--sizes 2 3]
                              [--groups effect clean outside pair thin] [--clean 200] [--jobs 2] [--cli 0.02]
    python tools/blind.py report RESULTS.jsonl

A run writes a line an experiment and may be cut at any time: what stands in the file is not run again. Cases come in a
fixed order that mixes all groups, so that a cut run is a fair sample of the whole. Seeds below 1000 are for
development, the published table has others.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
import traceback
import zlib
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from blind_world.arms import KINDS
from blind_world.case import SIZES, Case, cases
from blind_world.score import judged
from blind_world.tables import page

GROUPS = ("effect", "clean", "outside", "pair", "thin")


def wanted(options: argparse.Namespace) -> Iterator[Case]:
    """The cases that the options ask for."""
    for case in cases(options.seeds, options.arms, options.clean):
        if case.group not in options.groups:
            continue
        if options.effects and not set(case.effects) & set(options.effects):
            continue
        if case.group == "effect" and case.size not in options.sizes:
            continue
        yield case


def one(case: Case, share_on_command_line: float) -> dict[str, Any]:
    """A case's record; what the program dies of is its outcome."""
    also = zlib.crc32(("cli" + case.key).encode()) % 10_000 < 10_000 * share_on_command_line
    try:
        return judged(case, on_command_line=also)
    except Exception:
        told = {"key": case.key, "group": case.group, "effects": list(case.effects), "arm": case.kind}
        return told | {"size": case.size, "seed": case.seed, "outcome": "crashed", "trace": traceback.format_exc()}


def run(options: argparse.Namespace) -> int:
    """Run what is wanted and not yet in the file."""
    path: Path = options.results
    done = {record["key"] for record in read(path)} if path.is_file() else set()
    left = [case for case in wanted(options) if case.key not in done]
    left.sort(key=lambda case: zlib.crc32(case.key.encode()))
    left = left[: options.most]
    begun = time.monotonic()
    with path.open("a", encoding="utf-8") as out, ProcessPoolExecutor(options.jobs) as pool:
        waiting = [pool.submit(one, case, options.cli) for case in left]
        for count, finished in enumerate(as_completed(waiting), start=1):
            record = finished.result()
            out.write(json.dumps(record, default=float) + "\n")
            out.flush()
            spent = time.monotonic() - begun
            line = f"{count}/{len(left)} {spent:.0f} s  {record['key']}: {record['outcome']}"
            sys.stderr.write(line + "\n")
    return 0


def read(path: Path) -> list[dict[str, Any]]:
    """The records of a file; a line that a cut run left unfinished is dropped."""
    found = []
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            found.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return found


def main() -> int:
    """Run or report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    running = commands.add_parser("run", help="run experiments")
    running.add_argument("results", type=Path)
    running.add_argument("--seeds", type=int, nargs="+", default=[1])
    running.add_argument("--arms", nargs="+", choices=list(KINDS), default=list(KINDS))
    running.add_argument("--effects", nargs="+", default=[])
    running.add_argument("--sizes", type=float, nargs="+", default=list(SIZES))
    running.add_argument("--groups", nargs="+", choices=GROUPS, default=list(GROUPS))
    running.add_argument("--clean", type=int, default=200, help="clean experiments per seed")
    running.add_argument("--most", type=int, default=None, help="stop after so many")
    running.add_argument("--jobs", type=int, default=2)
    running.add_argument("--cli", type=float, default=0.02, help="share that also goes through the command line")
    running.set_defaults(work=run)
    reporting = commands.add_parser("report", help="print the tables")
    reporting.add_argument("results", type=Path)
    reporting.set_defaults(work=lambda options: sys.stdout.write(page(read(options.results))) and 0)
    options = parser.parse_args()
    return int(options.work(options))


if __name__ == "__main__":
    sys.exit(main())
