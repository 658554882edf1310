"""One session of a pendulum's logs, and whether two passes over some logs left the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from command import run

from pumaid.dataset import Dataset
from pumaid.io.recipe import shipped_recipes


def make_session(folder: Path) -> Path:
    """The folder, with a recipe, a plan and logs of some minutes at 50 Hz in one Parquet file."""
    (folder / "recipe.yaml").write_bytes(shipped_recipes()["pendulum2"].read_bytes())
    run("plan", str(folder / "recipe.yaml"), "--minutes", "4")
    run("simulate", str(folder / "recipe.yaml"), "--seed", "5", "--rate", "50", "-o", str(folder / "logs"))
    return folder


def same(one: Dataset, other: Dataset) -> bool:
    """Runs equal to the bit, with their files, rows and clocks; rejects; files; notes."""
    for a, b in zip(one.runs, other.runs, strict=True):
        if (a.origin, a.first_row, a.last_origin, a.last_row, a.clock) != (
            b.origin,
            b.first_row,
            b.last_origin,
            b.last_row,
            b.clock,
        ):
            return False
        if not np.array_equal(a.triangle.factor, b.triangle.factor) or not np.array_equal(
            a.bins.current, b.bins.current
        ):
            return False
    left = [[(r.origin, r.first_row, r.last_row, r.reason, r.text, r.clock) for r in e.rejects] for e in (one, other)]
    return left[0] == left[1] and one.files == other.files and one.notes == other.notes


class Eager:
    """A cluster's client that works at once, in this process."""

    def __init__(self) -> None:
        self.calls: list[str] = []

    def nthreads(self):
        """Threads of each worker."""
        return {"here": 1}

    def submit(self, function, *values, pure, priority=0):
        """A finished future."""
        self.calls.append(getattr(function, "__name__", "join"))
        return Done(function(*(value.value if isinstance(value, Done) else value for value in values)))


class Done:
    """A future with its result."""

    def __init__(self, value) -> None:
        self.value = value

    def result(self):
        """What the task gave."""
        return self.value
