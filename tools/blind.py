"""Judge the diagnosis blind on virtual arms, and print the tables of what came out.

    python tools/blind.py run RESULTS.jsonl [--seeds 1] [--clean 200] [--jobs 2]
    python tools/blind.py run RESULTS.jsonl --busy 60 --first-seed 1000 [--jobs 2]
    python tools/blind.py report RESULTS.jsonl [-o docs/img/forecasts.png]

A run writes a line an experiment and may be cut at any time: what stands in the file is not run again. Cases come in a
fixed order that mixes all groups, so that a cut run is a fair sample of the whole. Seeds below 1000 are for
development, the published table has others. Busy arms, with zero to five effects at a joint, have a seed each.
"""

import argparse
import json
import os
import sys
import traceback
import zlib
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from blind_world.busy_tables import busy_page, draw_forecasts
from blind_world.case import BUSY, Case, busy_cases, cases
from blind_world.score import judged
from blind_world.tables import page


def record_of(case: Case) -> dict[str, Any]:
    """A case's record; what the program dies of is its outcome."""
    try:
        return judged(case)
    except Exception:
        record = {"key": case.key, "group": case.group, "effects": list(case.effects), "size": case.size}
        return record | {"seed": case.seed, "outcome": "crashed", "trace": traceback.format_exc()}


def run(options: argparse.Namespace) -> None:
    """Run what is asked for and not yet in the file."""
    done = {record["key"] for record in read(options.results)} if options.results.is_file() else set()
    plain = () if options.busy else cases(options.seeds, options.clean)
    mixed = sorted(plain, key=lambda case: zlib.crc32(case.key.encode()))
    waiting = [case for case in (*mixed, *busy_cases(options.first_seed, options.busy)) if case.key not in done]
    with options.results.open("a", encoding="utf-8") as out, ProcessPoolExecutor(options.jobs) as pool:
        tasks = [pool.submit(record_of, case) for case in waiting]
        for count, task in enumerate(as_completed(tasks), start=1):
            record = task.result()
            out.write(json.dumps(record, default=float) + "\n")
            out.flush()
            print(f"{count}/{len(tasks)} {record['key']}: {record['outcome']}", file=sys.stderr)


def read(path: Path) -> list[dict[str, Any]]:
    """The records of a file; a line that a cut run left unfinished is dropped."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return [json.loads(line) for line in lines if line.endswith("}")]


def main() -> None:
    """Run or report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", choices=("run", "report"))
    parser.add_argument("results", type=Path)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--clean", type=int, default=200, help="clean experiments per seed")
    parser.add_argument("--busy", type=int, default=0, help="busy arms, in place of all others")
    parser.add_argument("--first-seed", type=int, default=1, help="of the busy arms")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("-o", "--output", type=Path, help="where the figure of the forecasts of busy arms goes")
    options = parser.parse_args()
    if options.command == "run":
        run(options)
    else:
        records = read(options.results)
        is_busy = any(record["group"] == BUSY for record in records)
        print(busy_page(records) if is_busy else page(records), end="")
        if options.output:
            draw_forecasts([record for record in records if record["outcome"] == "done"], options.output)


if __name__ == "__main__":
    main()
