"""All rows at once: derivative, optimum, priors."""

from __future__ import annotations

import numpy as np
import pytest

from pumaid.maths.bilinear import Bilinear, Gains, fit_bilinear

RNG = np.random.default_rng(6)
N, OWNERS = 30, np.array([0, 0, 1, 2, 3])
ROW = np.repeat(np.arange(4), N)
REGRESSORS = np.where(ROW[:, None] <= OWNERS, RNG.normal(size=(4 * N, 5)), 0.0)
VALUES = np.array([1.0, -2.0, 0.5, 1.5, -0.7])


def chain(*edges: float) -> Gains:
    """Rows 0 - 1 - 3 on one branch, row 2 on another."""
    gains = Gains(4)
    for (upper, lower), ratio in zip([(1, 3), (0, 1), (0, 2)], edges, strict=True):
        gains.merge(upper, lower, ratio)
    return gains


TRUTH = chain(0.5, -1.5, 2.0)
#: Rows 1 and 2 do not feel each other here, as the branches say.
REGRESSORS[ROW == 1, 3] = 0.0
REGRESSORS[ROW == 2, 4] = 0.0
EXACT = Bilinear(ROW, REGRESSORS, np.zeros(4 * N), OWNERS).scaled(TRUTH) @ VALUES
SYSTEM = Bilinear(ROW, REGRESSORS, EXACT, OWNERS)


def prediction(values: np.ndarray, edges: np.ndarray) -> np.ndarray:
    return SYSTEM.scaled(chain(*edges)) @ values


def test_jacobian_is_the_slope_of_the_prediction():
    """Derivatives by parameters and by edges, in the order of `Gains.edges`, are finite differences'."""
    found = SYSTEM.jacobian(TRUTH, VALUES)
    lower = {1: 1, 2: 2, 3: 0}  # edge's lower end -> its place in `chain`
    step = 1e-6
    for number, edge in enumerate(TRUTH.edges):
        ahead, back = np.array([0.5, -1.5, 2.0]), np.array([0.5, -1.5, 2.0])
        ahead[lower[edge]] += step
        back[lower[edge]] -= step
        slope = (prediction(VALUES, ahead) - prediction(VALUES, back)) / (2 * step)
        assert found[:, 5 + number] == pytest.approx(slope, abs=1e-8)
    assert found[:, :5] == pytest.approx(SYSTEM.scaled(TRUTH))


def test_derivative_at_a_vanishing_ratio():
    """A ratio of zero has a derivative all the same: the columns that it would let through."""
    gains = chain(0.5, 0.0, 2.0)
    found = SYSTEM.jacobian(gains, VALUES)[:, 5 + gains.edges.index(1)]
    slope = prediction(VALUES, np.array([0.5, 1.0, 2.0])) - prediction(VALUES, np.array([0.5, 0.0, 2.0]))
    assert found == pytest.approx(slope, abs=1e-12)


def test_far_start_still_comes_home():
    """From ratios off by factors of three and with a sign wrong the steps, halved where needed, reach the truth."""
    found = fit_bilinear(SYSTEM, 0.3 * VALUES, chain(1.5, 0.5, 0.7))
    assert found.values == pytest.approx(VALUES, rel=1e-6)
    assert [found.gains.edge[edge] for edge in (3, 1, 2)] == pytest.approx([0.5, -1.5, 2.0], rel=1e-6)


def test_no_steps_only_linearises():
    """With no steps allowed the start comes back, with derivative and residual there."""
    found = fit_bilinear(SYSTEM, 1.1 * VALUES, TRUTH, most_steps=0)
    assert found.values == pytest.approx(1.1 * VALUES)
    assert found.residual == pytest.approx(EXACT - SYSTEM.scaled(TRUTH) @ (1.1 * VALUES))
    assert found.jacobian.shape == (4 * N, 8)


def test_start_is_not_changed():
    """The caller's gains stay what they were."""
    start = chain(1.5, 0.5, 0.7)
    fit_bilinear(SYSTEM, VALUES, start)
    assert [start.edge[edge] for edge in (3, 1, 2)] == [1.5, 0.5, 0.7]


def test_prior_holds_only_what_the_data_do_not():
    """A ratio whose load is far below the noise stays near its usual value; one that is felt ignores the prior."""
    quiet = VALUES * np.array([1.0, 1.0, 1.0, 1e-6, 1.0])  # row 2's load is a millionth
    noisy = SYSTEM.scaled(TRUTH) @ quiet + 0.01 * RNG.normal(size=4 * N)
    weighted = Bilinear(ROW, REGRESSORS / 0.01, noisy / 0.01, OWNERS)
    found = fit_bilinear(weighted, quiet, chain(0.5, -1.5, 2.0), spread=np.array([10.0, 10.0, 10.0]))
    assert abs(found.gains.edge[2] - 1.0) < 30.0
    assert found.gains.edge[1] == pytest.approx(-1.5, abs=0.05)


def test_unknown_ratio_stays_unknown():
    """Rows that start without an edge between them end without one, and their load counts as nothing."""
    gains = Gains(4)
    gains.merge(1, 3, 0.5)
    found = fit_bilinear(SYSTEM, VALUES, gains)
    assert found.gains.edges == [3] and np.isnan(found.gains.ratio(0, 1))


def test_condensed_squares_are_those_of_all_equations():
    """Noisy equations turned into a few: the same sum of squares wherever it is asked, and the same information."""
    noisy = Bilinear(ROW, REGRESSORS, EXACT + RNG.normal(size=4 * N), OWNERS)
    few = noisy.condensed()
    assert len(few.target) <= 4 * 6 < 4 * N
    for edges in ([0.5, -1.5, 2.0], [1.0, 0.3, -4.0], [0.0, 1.0, 1.0]):
        gains, values = chain(*edges), RNG.normal(size=5)
        squares = [np.sum((one.target - one.scaled(gains) @ values) ** 2) for one in (noisy, few)]
        assert squares[1] == pytest.approx(squares[0], rel=1e-12)
        slopes = [one.jacobian(gains, values) for one in (noisy, few)]
        assert slopes[1].T @ slopes[1] == pytest.approx(slopes[0].T @ slopes[0], rel=1e-10, abs=1e-10)
