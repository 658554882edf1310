"""`separable`: the finest groups whose sums are known; the oracle looks at every group."""

from itertools import combinations

import numpy as np
import pytest

from pumaid.estimation.evaluate import separable


def gram(*directions: list[float]) -> np.ndarray:
    """What terms may be off by together, along each of these directions."""
    moves = np.array(directions).T
    return moves @ moves.T


def test_a_trade_of_four_is_one_group():
    """Groups larger than are looked for are still found as what is left over."""
    assert separable(gram([1, 1, 1, -3]), 0.1) == [(0, 1, 2, 3)]


@pytest.mark.parametrize("seed", range(20))
def test_groups_are_known_and_no_finer(seed):
    """Every group's sum is known, and no part of a group is, for trades between random terms."""
    rng = np.random.default_rng(seed)
    moves = np.zeros((4, 2))
    for column in range(2):
        one, other = rng.choice(4, 2, replace=False)
        moves[[one, other], column] = rng.uniform(0.5, 2.0) * np.array([1.0, -1.0])
    groups = separable(moves @ moves.T, 0.1)
    for group in groups:
        assert np.linalg.norm(moves[list(group)].sum(axis=0)) < 0.1
        for part in (p for size in range(1, len(group)) for p in combinations(group, size)):
            assert np.linalg.norm(moves[list(part)].sum(axis=0)) > 0.1
