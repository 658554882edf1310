"""Grouping by likeness: what a loop over all earlier firsts gives."""

from __future__ import annotations

import numpy as np
import pytest

from pumaid.maths.alike import grouped


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
    assert grouped(60, lambda first, others: np.abs(values[others] - values[first]) < 0.05) == wanted


def test_what_is_like_nothing_stands_alone():
    """Values that are not known are not even like themselves, and make a group each; nothing makes no group."""
    values = np.array([np.nan, 1.0, np.nan, 1.0])
    alike = lambda first, others: np.abs(values[others] - values[first]) < 0.1  # noqa: E731
    assert grouped(4, alike) == [[0], [1, 3], [2]] and grouped(0, alike) == []
