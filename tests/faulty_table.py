"""The table of faults in docs/faults.md: ``python tests/faulty_table.py`` tries them all and prints it."""

from __future__ import annotations

import shutil
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

from faulty import Fault, contents, invoke, make, outcome
from faulty_logs import all_logs
from faulty_recipes import all_recipes


def tried() -> Counter[str]:
    """Class -> how many mutations of logs and recipes are in it."""
    return Counter(fault.kind for fault in (*all_logs(), *all_recipes()))


def ended(good: Path, fault: Fault) -> str:
    """How identifying ends after one mutation of a copy of the good experiment."""
    with TemporaryDirectory() as scratch:
        arm = Path(shutil.copytree(good, Path(scratch) / "arm"))
        before = contents(arm / "results")
        fault.change(arm)
        return outcome(invoke("identify", str(arm / "logs"), "--json"), arm, before)


def main() -> None:
    """Try every mutation and print the table."""
    found: dict[str, Counter[str]] = {}
    with TemporaryDirectory() as scratch:
        good = make(Path(scratch) / "arm")
        invoke("identify", str(good / "logs"))
        for fault in (*all_logs(), *all_recipes()):
            found.setdefault(fault.kind, Counter())[ended(good, fault)] += 1
    print("| class | tried | refused | flagged | agrees |\n|---|---:|---:|---:|---:|")
    for kind, ends in found.items():
        counts = [str(ends[end] or "") for end in ("refused", "flagged", "agrees")]
        odd = sorted(set(ends) - {"refused", "flagged", "agrees"})
        print(f"| {kind} | {ends.total()} | {' | '.join(counts)} |", *odd)
    total = sum((ends for ends in found.values()), Counter())
    print(f"| all | {total.total()} | {total['refused']} | {total['flagged']} | {total['agrees']} |")


if __name__ == "__main__":
    main()
