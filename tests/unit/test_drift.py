"""Repeated runs tell of currents that changed meanwhile, and are silent where nothing did."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from faulty import good

from pumaid.dataset import Log
from pumaid.estimation.estimate import identify
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.preprocessing.segment import segment

PENDULUM = read_recipe(shipped_recipes()["pendulum2"])


def told(tables: tuple[pd.DataFrame, ...]) -> list[str]:
    """The notes on repeats of logs with these tables, one file each."""
    logs = [
        Log(
            origin=f"log_{number}.csv",
            rows=np.arange(2, 2 + len(table)),
            time=table.t.to_numpy(),
            position=table[["q1", "q2"]].to_numpy(),
            velocity=None,
            current=table[["i1", "i2"]].to_numpy(),
            temperature=None,
            starts_clock=number == 1,
        )
        for number, table in enumerate(tables, start=1)
    ]
    notes = identify(segment(logs, PENDULUM), PENDULUM).notes
    return [note.text for note in notes if note.slug == "repeats-differ"]


def test_good_logs_are_passed_in_silence():
    """Forty sessions of two joints, with noise of samples and of runs, on seeds that no threshold was chosen on."""
    assert [told(good(seed)) for seed in range(500, 540)] == [[]] * 40


@pytest.mark.parametrize("share", [0.0, 1e-9, 3e-4])
def test_what_no_noise_hides_need_not_matter(share):
    """Where currents are without noise, rounding or a gain that is a few parts in ten thousand off is no change."""
    first, second = (exact(table) for table in good(0))
    assert told((first, second.assign(i1=(1.0 + share) * second.i1, i2=second.i2 + share))) == []


def exact(table: pd.DataFrame) -> pd.DataFrame:
    """The log with currents that are a function of position and speed alone."""
    moves = [np.sign(table[name]) * (table[name].abs() > 0.05) for name in ("qd1", "qd2")]
    i1 = 0.8 * np.cos(table.q1) + 0.3 * np.cos(table.q1 + table.q2) + 0.4 * moves[0] + 0.2 * table.qd1
    return table.assign(i1=i1, i2=0.3 * np.cos(table.q1 + table.q2) + 0.3 * moves[1] + 0.1 * table.qd2)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("change", "where", "size"),
    [
        (lambda table: table.assign(i1=table.i1 + 0.05), "A more whichever way it moves", 0.05),
        (
            lambda table: table.assign(i1=table.i1 - 0.06 * np.sign(table.qd1) * (table.qd1.abs() > 0.05)),
            "A less in the direction of motion",
            0.06,
        ),
        (lambda table: table.assign(i1=1.04 * table.i1), "% more in proportion to it", 4.0),
    ],
    ids=["zero", "friction", "gain"],
)
def test_a_change_is_told_with_its_size(seed, change, where, size):
    """A sensor's zero, friction and a gain that are others in the second pass, by three times the noise at most."""
    first, second = good(600 + seed)
    (text,) = told((first, change(second)))
    assert where in text and text.startswith("joint 1 draws ")
    number, error = (float(part) for part in text.removeprefix("joint 1 draws ").split()[:3:2])
    assert abs(number - size) < 5.0 * error


def test_a_change_of_a_quarter_of_the_noise_is_none():
    """What moves no number by more than its error is not told."""
    first, second = good(7)
    assert told((first, second.assign(i1=second.i1 + 0.005))) == []


def test_without_repeats_nothing_is_told():
    """One pass of runs has nothing to be compared with."""
    assert told(good(7)[:1]) == []
