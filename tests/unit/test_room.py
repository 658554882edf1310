"""Bins of thousands of runs: bounded, evenly spread, and none lost where there are few."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import worlds

from pumaid.dataset import CONSTANT_COLUMNS, Bins, Reject, Run
from pumaid.maths.triangle import Triangle
from pumaid.preprocessing.room import OF_REJECTS, OF_RUNS, ONE_IN, Room


def run(number: int, bins: int = 512) -> Run:
    """A run of joint 1 or 2, there and back in turns."""
    rng, direction = np.random.default_rng(number), 1 if number % 2 else -1
    time = np.arange(bins) / 100.0
    position, velocity, current = rng.normal(size=(bins, 2)), *rng.normal(size=(2, bins))
    inside = Bins(np.full(bins, 5), time, position, velocity, np.zeros(bins), current, np.ones(bins), time, None)
    triangle = Triangle(CONSTANT_COLUMNS, np.eye(4), 5 * bins)
    joint = 1 + number // 2 % 2
    return Run(joint, "constant", "a", 2, 9, 0.0, 1.0, np.zeros(2), (0.0, 1.0), direction, 0.0, 20.0, triangle, inside)


def kept(count: int, most: int) -> list[Run]:
    """What is kept of so many runs."""
    room = Room(replace(OF_RUNS, most=most))
    for number in range(count):
        room.add(run(number))
    return room.records


def test_few_runs_keep_all():
    """Below the bound nothing is touched."""
    runs = [run(number) for number in range(10)]
    room = Room(replace(OF_RUNS, most=10 * 512))
    for one in runs:
        room.add(one)
    assert all(a is b for a, b in zip(room.records, runs, strict=True))


@pytest.mark.parametrize("count", [50, 500, 3000])
def test_cells_stay_bounded(count):
    """However many runs come, bins stay below the bound and twice the fewest a run."""
    assert sum(len(one.bins) for one in kept(count, 20_000)) <= 20_000 + 2 * OF_RUNS.fewest * count


def test_fine_runs_are_spread_evenly():
    """Both directions of both joints, early and late, keep some runs whole."""
    runs = kept(600, 150_000)
    fine = [number for number, one in enumerate(runs) if len(one.bins) == 512]
    assert len(fine) == pytest.approx(len(runs) / ONE_IN, rel=0.1)
    for joint in (1, 2):
        for direction in (1, -1):
            own = [n for n in fine if (runs[n].joint, runs[n].direction) == (joint, direction)]
            assert min(own) < 60
            assert max(own) > 540


def test_coarser_runs_hold_the_same_samples():
    """Counts, means and triangles of a run are those that it had."""
    before, after = run(5), kept(600, 50_000)[5]
    assert len(after.bins) < 512
    assert after.samples == before.samples == after.bins.count.sum()
    mean = [np.average(one.bins.current, weights=one.bins.count) for one in (before, after)]
    np.testing.assert_allclose(*mean, rtol=1e-12)


def test_what_is_no_run_is_bounded_too():
    """Ramps keep bins within their share, some of them all, and what has no bins stays as it is."""
    room = Room(replace(OF_REJECTS, most=3000))
    for number in range(400):
        one = run(number, bins=64)
        bins = worlds.means_of(one) if number % 4 else None
        room.add(Reject("a", 2, 9, 0.0, 1.0, (one.joint,), "ramp", "", one.samples, bins))
    sizes = [0 if one.bins is None else len(one.bins) for one in room.records]
    assert sum(sizes) <= 3000 + 2 * OF_REJECTS.fewest * 300 and sizes.count(0) == 100 and max(sizes) == 64
    assert all(one.bins is None or one.bins.count.sum() == one.samples for one in room.records)
