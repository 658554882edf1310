"""Grouping by likeness: what a loop over all earlier firsts gives."""

from __future__ import annotations

import numpy as np
import pytest

from pumaid.kinematics import apart, grouped, marked, near


@pytest.mark.parametrize("seed", range(5))
def test_groups_are_those_of_a_loop(seed):
    """Each number joins the first group whose first member it is like, also where likeness goes on in chains."""
    values = np.random.default_rng(seed).uniform(0.0, 1.0, 60)
    wanted: list[list[int]] = []
    for number, value in enumerate(values):
        own = next((group for group in wanted if abs(values[group[0]] - value) < 0.05), None)
        if own is None:
            wanted.append([number])
        else:
            own.append(number)
    assert list(grouped(60, lambda first, others: np.abs(values[others] - values[first]) < 0.05)) == wanted


def test_what_is_like_nothing_stands_alone():
    """Values that are not known are not even like themselves, and make a group each; nothing makes no group."""
    values = np.array([np.nan, 1.0, np.nan, 1.0])
    alike = lambda first, others: np.abs(values[others] - values[first]) < 0.1  # noqa: E731
    assert list(grouped(4, alike)) == [[0], [1, 3], [2]] and list(grouped(0, alike)) == []


@pytest.mark.parametrize("seed", range(5))
def test_near_postures_are_those_of_a_comparison_with_all(seed):
    """Joint after joint, with whole turns between and unknown positions, the same as all joints at once."""
    rng = np.random.default_rng(seed)
    postures = rng.choice([0.0, 0.3, 1.0], (200, 4)) + rng.normal(scale=0.01, size=(200, 4))
    postures += 2.0 * np.pi * rng.integers(-2, 3, postures.shape)
    postures[rng.random(postures.shape) < 0.05] = np.nan
    others = np.flatnonzero(rng.random(200) < 0.7)
    for first in range(0, 200, 7):
        wanted = ~(apart(postures[first], postures[others]) > 0.02).any(axis=1)
        found = near(postures, first, others, within=0.02)
        assert np.array_equal(found, others[wanted]) and np.array_equal(marked(others, found), wanted)
