"""Errors of the recursion, outer rows' included, against many noisy solutions."""

from __future__ import annotations

import numpy as np
import pytest

from pumaid.estimation.covariance import recursion_covariance
from pumaid.maths.bilinear import Bilinear, Recursion

OWNERS, RUNS, SIZE = np.array([0, 0, 1, 2]), 30, 4
RNG = np.random.default_rng(10)
ROW = np.repeat(np.arange(3), RUNS * SIZE)
RUN = np.repeat(np.arange(3 * RUNS), SIZE)
REGRESSORS = np.where(ROW[:, None] <= OWNERS, RNG.normal(size=(len(ROW), 4)), 0.0)
VALUES, GAINS = np.array([1.0, -2.0, 1.5, 3.0]), np.array([1.0, 0.5, 2.0])
EXACT = np.einsum("np,np,p->n", REGRESSORS, GAINS[ROW][:, None] / GAINS[OWNERS], VALUES)


def solved(target: np.ndarray) -> Recursion:
    found = Recursion(OWNERS, 3)
    for row in (2, 1, 0):
        found.take(row, REGRESSORS[row == ROW], target[row == ROW])
    return found


def unknowns(found: Recursion) -> np.ndarray:
    return np.array([*found.values, *(found.gains.edge[edge] for edge in found.gains.edges)])


def noise(seed: int) -> np.ndarray:
    """White noise and a level a run, as strong."""
    rng = np.random.default_rng(seed)
    return 0.1 * rng.normal(size=len(ROW)) + 0.1 * np.repeat(rng.normal(size=3 * RUNS), SIZE)


@pytest.fixture(scope="module")
def told_and_drawn() -> tuple[np.ndarray, np.ndarray]:
    """Mean covariance told, and covariance of 500 noisy solutions."""
    drawn, told = [], []
    for seed in range(500):
        target = EXACT + noise(seed)
        found = solved(target)
        drawn.append(unknowns(found))
        if seed < 60:
            system = Bilinear(ROW, REGRESSORS, target, OWNERS)
            told.append(recursion_covariance(system, found.values, found.gains, runs=RUN).covariance)
    return np.mean(told, axis=0), np.cov(np.array(drawn).T)


def test_variances_are_those_of_noisy_solutions(told_and_drawn):
    """Standard errors of parameters and ratios, told from one experiment each, are the spread over 500."""
    told, drawn = told_and_drawn
    # 500 draws know a standard deviation to 3 %, 60 experiments' mean variance is known to some 4 %.
    assert np.sqrt(np.diag(told)) == pytest.approx(np.sqrt(np.diag(drawn)), rel=0.12)


def test_correlations_across_rows_are_those_of_noisy_solutions(told_and_drawn):
    """An outer row's error moves the inner rows' results as told."""
    correlation = [part / np.sqrt(np.outer(np.diag(part), np.diag(part))) for part in told_and_drawn]
    assert np.max(np.abs(correlation[0] - correlation[1])) < 0.2  # 4 / sqrt(500)
    # A ratio's error must mirror that of the load that it scales: strong here, so that the test can fail.
    assert np.min(correlation[1]) < -0.3


def test_rows_without_data_have_no_variance():
    """What has no row of its own is told with no degrees of freedom."""
    part = ROW > 0
    found = Recursion(OWNERS, 3)
    for row in (2, 1):
        found.take(row, REGRESSORS[row == ROW], EXACT[row == ROW] + noise(1)[row == ROW])
    system = Bilinear(ROW[part], REGRESSORS[part], (EXACT + noise(1))[part], OWNERS)
    told = recursion_covariance(system, found.values, found.gains, runs=RUN[part])
    assert told.freedoms[:2].tolist() == [0.0, 0.0] and told.freedoms[2] > 10.0
