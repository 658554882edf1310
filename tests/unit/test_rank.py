"""Least squares that says what it does not know."""

import numpy as np
import pytest

from pumaid.maths import rank

RNG = np.random.default_rng(3)
ROWS, TARGET = RNG.normal(size=(40, 4)), RNG.normal(size=40)
SHORT = np.column_stack([ROWS[:, :3], ROWS[:, 0] - 2.0 * ROWS[:, 1]])  # the last is a combination of two others


def test_blind_direction_changes_no_prediction():
    """Moving along a blind direction, in unscaled parameters, leaves the rows' product alone."""
    found = rank.solve(SHORT, TARGET)
    assert SHORT @ (found.blind[:, 0] / found.scale) == pytest.approx(np.zeros(40), abs=1e-12)
    assert np.linalg.norm(found.blind[:, 0]) == pytest.approx(1.0)


def test_short_rank_gives_the_shortest_solution():
    """Of all solutions it is the shortest in parameters scaled by their columns' norms, as by a pseudo-inverse."""
    size = np.linalg.norm(SHORT, axis=0)
    wanted = np.linalg.pinv(SHORT / size, rcond=1e-9) @ TARGET / size
    assert rank.solve(SHORT, TARGET).values == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize("power", [-8, 8])
def test_units_of_columns_do_not_matter(power):
    """A column in another unit changes its own value by the unit and nothing else, dependent or not."""
    unit = np.array([1.0, 10.0**power, 1.0, 1.0])
    plain, scaled = rank.solve(SHORT, TARGET), rank.solve(SHORT * unit, TARGET)
    assert scaled.values * unit == pytest.approx(plain.values, rel=1e-8)
    assert scaled.determined.tolist() == plain.determined.tolist()


def test_limit_keeps_a_sum_whose_terms_are_vague():
    """Two nearly equal columns: their difference is blind, their sum known."""
    first = np.ones(100)
    rows = np.column_stack([first, first + 1e-6 * RNG.normal(size=100)]) / 0.1  # noise of 0.1
    found = rank.solve(rows, rows @ [1.0, 2.0], limit=np.ones(2) * 10.0)
    assert not found.determined.any()
    assert found.values.sum() == pytest.approx(3.0, abs=1e-6)


@pytest.mark.parametrize("weight", [1.0, 1e6, 1e14])
def test_rounding_is_not_information(weight):
    """However large the weights of data without noise, an exact dependence stays blind, limits or not."""
    third = 0.1 * SHORT[:, 0] + 0.3 * SHORT[:, 1]  # equal but for rounding to a combination
    rows = np.column_stack([SHORT[:, :2], third]) * weight
    found = rank.solve(rows, rows @ [1.0, 2.0, 3.0], limit=np.full(3, 100.0))
    assert not found.determined.any()


def test_leading_columns_have_the_first_word():
    """What leading columns can say, the others no longer can, and the leading ones keep their place."""
    rows = np.column_stack([SHORT[:, 0], SHORT[:, 1], SHORT[:, 3], SHORT[:, 2]])
    assert rank.independent(rows, first=2).tolist() == [True, True, False, True]
