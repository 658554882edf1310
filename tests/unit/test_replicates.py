"""Which runs repeat one another, and the noise floor that they show."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter
from worlds import PENDULUM, course, run_of

from pumaid.preprocessing.replicates import noise_floor, pairs, replicates

SIGMA = 0.1
#: Experiments whose floors are averaged: 48 differences of 400 samples each know a floor to well under 1 %.
EXPERIMENTS = range(12)


def world(seed: int, *, phi: float = 0.0, level: float = 0.0, ripple: float = 0.0, shift: float = 0.0, kind="constant"):
    """Two runs of each of two speeds both ways: weight, friction, ripple, noise (AR(1) of `phi`) and levels."""
    rng, runs = np.random.default_rng(seed), []
    for duration in (2.0, 3.0):
        for way in (2.0, -2.0, 2.0, -2.0):
            moves = course(kind, *(rng.normal() * shift + np.array([-way, way])), duration=duration, samples=400)
            white = rng.normal(size=400)
            noise = lfilter([np.sqrt(1 - phi**2)], [1, -phi], white, zi=[phi * rng.normal()])[0] if phi else white
            current = 3.0 * np.cos(moves[1]) + np.sign(way) + ripple * np.sin(9.0 * moves[1])
            current = current + SIGMA * noise + level * rng.normal()
            runs.append(run_of(PENDULUM, 1, (0.0, 0.3), course=moves, current=current))
    return runs


@pytest.mark.parametrize(
    ("conditions", "expected", "within"),
    [
        *(({"phi": phi, "kind": kind}, SIGMA, 0.04) for phi in (0.0, 0.9, 0.98) for kind in ("constant", "stroke")),
        # 48 pairs know the level's variance, a fifth of all, to 20 %: the floor to 2 %; three of these.
        ({"level": 0.05}, np.hypot(SIGMA, 0.05), 0.06),
        *(({"ripple": 0.3, "shift": shift}, SIGMA, 0.05) for shift in (0.0, 0.05)),
    ],
    ids=str,
)
def test_floor_of_noise(conditions, expected, within):
    """White or correlated, it is the noise's standard deviation and what a run differs by as a whole."""
    # A ripple three times the noise that repeats hardly moves the floor, though bins lie elsewhere in each run.
    floors = [noise_floor(pairs(world(seed, **conditions)))[0] for seed in EXPERIMENTS]
    assert np.sqrt(np.mean(np.square(floors))) == pytest.approx(expected, rel=within)


def test_exact_runs_have_no_floor():
    """Without noise the floor is far below any current sensor's step; without a repeated run it is unknown."""
    moves = course("constant", -2.0, 2.0, samples=4000)
    run = run_of(PENDULUM, 1, (0.0, 0.3), course=moves, current=3.0 * np.cos(moves[1]), bins=400)
    assert noise_floor(pairs([run, run]))[0] < 1e-3
    found, why = noise_floor(pairs(world(0)[:2]))
    assert found is None and "no run is repeated" in why


def pendulum(**changes: object):
    """A run that others are compared with."""
    moves = course("constant", -1.0, 1.0)
    return replace(run_of(PENDULUM, 1, (0.0, 0.3), course=moves, current=np.cos(moves[1])), **changes)


@pytest.mark.parametrize(
    ("changes", "is_same"),
    [
        ({}, True),
        ({"joint": 2}, False),
        ({"kind": "stroke"}, False),
        ({"speed": 1.02}, True),
        ({"speed": 1.05}, False),
        ({"speed": -1.0}, False),
        ({"posture": np.array([np.nan, 0.305])}, True),
        ({"posture": np.array([np.nan, 0.32])}, False),
        ({"span": (-0.9, 1.1)}, True),
        ({"span": (-0.4, 1.6)}, False),
        ({"span": (-1.0 + 2 * np.pi, 1.0 + 2 * np.pi)}, True),
    ],
)
def test_what_repeats_what(changes, is_same):
    """Same joint, kind, direction, speed within 3 %, posture within 0.01 rad, most of the way; turns do not count."""
    found = replicates([pendulum(), pendulum(**changes)])
    assert found == ([[0, 1]] if is_same else [])


def test_groups_keep_apart():
    """Three repeats make one group, two of another speed a second; a lone run is in none."""
    runs = [pendulum(speed=speed) for speed in (1.0, 0.5, 1.0, 2.0, 0.5, 1.0)]
    assert replicates(runs) == [[0, 2, 5], [1, 4]]
