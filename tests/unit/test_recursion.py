"""Rows n to 1 of systems of class (1), knowing no robot."""

from __future__ import annotations

import numpy as np
import pytest

from pumaid.maths.bilinear import Gains, Recursion

RNG = np.random.default_rng(4)


def solved(owners, blocks, *, values, gains) -> Recursion:
    """The recursion over rows whose regressors are `blocks` (n arrays (N, p)) and whose targets the truth gives."""
    found = Recursion(np.array(owners), len(blocks))
    for row in reversed(range(len(blocks))):
        scale = gains[row] / np.array(gains)[np.array(owners)]
        found.take(row, blocks[row], blocks[row] @ (scale * values))
    return found


def test_discrete_system_of_the_paper():
    """The 2 x 2 system of the paper's Section V is identified from its simulated states and inputs."""
    a, b = np.array([0.7, -0.3, 1.6, 0.9]), np.array([2.0, -0.5])
    u, x, y = RNG.normal(size=(200, 2)), np.zeros(200), np.zeros(200)
    for k in range(1, 200):
        x[k] = (b[1] * u[k, 1] - a[3] * x[k - 1]) / a[2]
        y[k] = (b[0] * u[k, 0] - a[0] * x[k] - a[1] * x[k - 1] - a[3] * y[k - 1]) / a[2]
    now, before = slice(1, None), slice(None, -1)
    nothing = np.zeros(199)
    first = np.column_stack([x[now], x[before], y[now], y[before]])
    second = np.column_stack([nothing, nothing, x[now], x[before]])
    found = Recursion(np.array([0, 0, 1, 1]), 2)
    found.take(1, second, u[now, 1])
    found.take(0, first, u[now, 0])
    # w*_j = eta_j w_j with eta_i = 1 / b_i.
    assert found.values == pytest.approx([a[0] / b[0], a[1] / b[0], a[2] / b[1], a[3] / b[1]], rel=1e-10)
    assert found.gains.ratio(0, 1) == pytest.approx(b[1] / b[0], rel=1e-10)


def test_minimal_parameters_of_the_discrete_system_predict_it():
    """Scaling every gain and every parameter of a row alike changes nothing: w* and the ratio are all there is."""
    inner, outer = RNG.normal(size=(30, 2)), RNG.normal(size=(30, 1))
    blocks = [np.hstack([inner, outer]), np.hstack([np.zeros((30, 2)), outer])]
    one = solved([0, 0, 1], blocks, values=np.array([1.0, 2.0, 3.0]), gains=[4.0, 8.0])
    other = solved([0, 0, 1], blocks, values=np.array([1.0, 2.0, 3.0]), gains=[0.4, 0.8])
    assert one.values == pytest.approx(other.values) and one.gains.ratio(0, 1) == pytest.approx(0.5)


def test_a_row_that_feels_nothing_leaves_its_ratio_open():
    """Corollary 2: where no row reaches a cluster its ratio stays undetermined, its parameters do not."""
    a, b = RNG.normal(size=(20, 1)), RNG.normal(size=(20, 1))
    blocks = [np.hstack([a, 0.0 * b]), np.hstack([0.0 * a, b])]
    found = solved([0, 1], blocks, values=np.array([2.0, 3.0]), gains=[1.0, 5.0])
    assert found.values == pytest.approx([2.0, 3.0]) and np.isnan(found.gains.ratio(0, 1))
    assert found.redundant == [] and not found.undetermined.any()


def test_a_load_that_looks_like_the_rows_own_is_named():
    """A nu that lies in the span of own columns leaves the ratio open and marks the columns that absorb it."""
    own, other = RNG.normal(size=(20, 1)), RNG.normal(size=(20, 1))
    blocks = [np.hstack([own, other, 2.0 * own]), np.hstack([0.0 * own, 0.0 * own, other])]
    found = solved([0, 0, 1], blocks, values=np.array([1.0, 4.0, 3.0]), gains=[1.0, 1.0])
    assert found.redundant == [(0, 1)] and np.isnan(found.gains.ratio(0, 1))
    assert found.undetermined.tolist() == [True, False, False]
    # The absorbing column predicts this row all the same: 1 + 2 * 3.
    assert found.values == pytest.approx([7.0, 4.0, 3.0])


def test_a_later_row_ties_two_clusters():
    """Rows 1 and 2 do not feel each other; row 0 feels both, and so their ratio becomes known."""
    a, b, c = (RNG.normal(size=(30, 1)) for _ in range(3))
    none = np.zeros((30, 1))
    blocks = [np.hstack([a, b, c]), np.hstack([none, b, none]), np.hstack([none, none, c])]
    found = solved([0, 1, 2], blocks, values=np.array([1.0, 2.0, -3.0]), gains=[1.0, -4.0, 0.5])
    assert found.gains.ratio(1, 2) == pytest.approx(-8.0, rel=1e-10)
    assert found.gains.cluster(0) == [0, 1, 2]


def test_two_loads_that_look_alike_leave_both_ratios_open():
    """Where two clusters press a row in the same way only a sum is felt, and both ratios are named."""
    a, b = RNG.normal(size=(30, 1)), RNG.normal(size=(30, 1))
    none = np.zeros((30, 1))
    blocks = [np.hstack([a, b, 2.0 * b]), np.hstack([none, b, none]), np.hstack([none, none, b])]
    found = solved([0, 1, 2], blocks, values=np.array([1.0, 2.0, 3.0]), gains=[1.0, 2.0, 4.0])
    assert found.redundant == [(0, 1), (0, 2)] and not found.undetermined.any()


def test_rounding_of_a_load_is_no_column():
    """A nu that cancels but for rounding does not enter the row."""
    b = RNG.normal(size=(30, 1))
    found = Recursion(np.array([0, 1, 1]), 2)
    found.values[1:] = [0.1, 0.3]
    _, _, roots = found.design(0, np.hstack([b, 3.0 * b, -b]))
    assert roots == []


def test_prior_keeps_an_unseen_ratio_at_its_usual_value():
    """With a spread a nu that cannot be told joins with ratio one, and own columns predict the row together with it."""
    own, other = RNG.normal(size=(20, 1)), RNG.normal(size=(20, 1))
    rows, target = np.hstack([own, 2.0 * own]), 7.0 * own[:, 0]
    found = Recursion(np.array([0, 1]), 2)
    found.take(1, np.hstack([0.0 * own, other]), 3.0 * other[:, 0], limit=np.ones(2), spread=10.0)
    # A ratio ten larger takes sixty limits from the own column: the prior says nothing of either.
    found.take(0, rows, target, limit=np.ones(2), spread=10.0)
    assert found.redundant == [(0, 1)] and found.gains.ratio(0, 1) == 1.0
    assert found.values[0] == pytest.approx(1.0)


def test_ratio_of_rows_on_two_branches():
    """The ratio of two rows below a common one is the quotient of their edges, whichever way round."""
    gains = Gains(4)
    gains.merge(1, 3, 5.0)
    gains.merge(0, 1, 2.0)
    gains.merge(0, 2, 4.0)
    assert gains.ratio(1, 2) == pytest.approx(2.0) and gains.ratio(2, 1) == pytest.approx(0.5)
    assert gains.ratio(3, 2) == pytest.approx(0.4) and gains.ratio(0, 3) == pytest.approx(10.0)


def test_a_vanishing_ratio_spoils_no_other():
    """A ratio of zero further inward leaves the ratios outward of it known."""
    gains = Gains(3)
    gains.merge(1, 2, 3.0)
    gains.merge(0, 1, 0.0)
    assert gains.ratio(1, 2) == 3.0 and gains.ratio(0, 2) == 0.0


def test_scale_is_known_along_a_branch_only():
    """Columns act on rows of their own branch with a known factor; across branches it is not a number."""
    gains = Gains(3)
    gains.merge(0, 1, 2.0)
    gains.merge(0, 2, 4.0)
    wanted = [[1.0, 2.0, 4.0], [0.0, 1.0, np.nan], [0.0, 0.0, 1.0]]
    assert np.array_equal(gains.scales(), wanted, equal_nan=True)
