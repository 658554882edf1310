"""Variances of noise and of runs' levels, against dense likelihoods and many draws."""

import numpy as np
import pytest
from scipy import optimize

from pumaid.estimation.noise import Levels, estimate, excess, freedoms, whiten

RUNS, ROWS = 12, 3
#: Each run's constant in its own rows, as the QR of a long run makes it: long along one direction.
ONES = np.random.default_rng(7).normal(size=(RUNS, ROWS)) * 10.0
DESIGN = np.random.default_rng(8).normal(size=(RUNS, ROWS, 4)) * 5.0
COUNTS = np.full(RUNS, ROWS)
SAMPLE, LEVEL = 0.04, 0.01


def draw(rng: np.random.Generator, *, level: float = LEVEL) -> np.ndarray:
    noise = np.sqrt(SAMPLE) * rng.normal(size=(RUNS, ROWS))
    return noise + np.sqrt(level) * rng.normal(size=(RUNS, 1)) * ONES


def covariance(sample: float, level: float) -> np.ndarray:
    """(R k, R k) dense."""
    whole = sample * np.eye(RUNS * ROWS)
    for run in range(RUNS):
        rows = slice(run * ROWS, (run + 1) * ROWS)
        whole[rows, rows] += level * np.outer(ONES[run], ONES[run])
    return whole


def dense_likelihood(target: np.ndarray, sample: float, level: float, *, more: np.ndarray | float = 0.0) -> float:
    """Minus twice the restricted log likelihood, straight from the book; `more` is added to the covariance."""
    X, V = DESIGN.reshape(-1, 4), covariance(sample, level) + more
    inverse = np.linalg.inv(V)
    info = X.T @ inverse @ X
    P = inverse - inverse @ X @ np.linalg.inv(info) @ X.T @ inverse
    return float(np.linalg.slogdet(V)[1] + np.linalg.slogdet(info)[1] + target.ravel() @ P @ target.ravel())


@pytest.mark.parametrize(("times", "least", "most"), [(1.0, 1.0, 1.3), (9.0, 7.5, 10.5)])
def test_excess_of_some_runs(times, least, most):
    """Over many draws the median is the variance that some runs have over others; never less than one."""
    rng, is_other = np.random.default_rng(2), np.arange(RUNS) % 3 == 0
    loud = np.where(is_other, np.sqrt(times), 1.0)[:, None]
    draws = [excess(DESIGN, loud * rng.normal(size=(RUNS, ROWS)), counts=COUNTS, is_other=is_other) for _ in range(200)]
    assert least <= np.median(draws) <= most and min(draws) >= 1.0
    assert excess(DESIGN, rng.normal(size=(RUNS, ROWS)), counts=COUNTS, is_other=np.full(RUNS, True)) == 1.0


@pytest.mark.parametrize("seed", [1, 2])
def test_variances_are_the_dense_optimum(seed):
    """No other two variances are likelier by the dense restricted likelihood."""
    target = draw(np.random.default_rng(seed))
    found = estimate(ONES, DESIGN, target, counts=COUNTS)

    def dense(logs: np.ndarray) -> float:
        return dense_likelihood(target, *np.exp(logs))

    best = optimize.minimize(dense, np.log([SAMPLE, LEVEL]), method="Nelder-Mead", options={"maxiter": 900})
    assert dense(np.log([found.sample, found.level])) <= best.fun + 1e-3


@pytest.mark.parametrize("unit", [1e-11, 1e11])
def test_units_of_columns_do_not_matter(unit):
    """A regressor in another unit, such as a load of a weak motor, leaves the variances alone."""
    target, columns = draw(np.random.default_rng(6)), np.array([1.0, unit, 1.0, 1.0])
    plain, scaled = (estimate(ONES, DESIGN * c, target, counts=COUNTS) for c in (1.0, columns))
    assert (scaled.sample, scaled.level) == pytest.approx((plain.sample, plain.level), rel=1e-6)


def test_data_without_noise():
    """Exact data have no variance; nothing divides by it."""
    target = DESIGN @ [1.0, 2.0, -1.0, 0.5]
    found = estimate(ONES, DESIGN, target, counts=COUNTS)
    assert 0.0 < found.sample < 1e-20 and found.level < 1e-20


def test_whitened_rows_have_unit_covariance():
    """The whitener is the inverse root of sample I + level 1 1'."""
    root = whiten(Levels(SAMPLE, LEVEL, 9), ONES, np.broadcast_to(np.eye(ROWS), (RUNS, ROWS, ROWS)))
    for run in range(RUNS):
        rows = slice(run * ROWS, (run + 1) * ROWS)
        assert root[run] @ covariance(SAMPLE, LEVEL)[rows, rows] @ root[run].T == pytest.approx(np.eye(ROWS), abs=1e-10)


def test_freedoms_are_those_of_drawn_variances():
    """Satterthwaite: 2 mean^2 / variance of a parameter's estimated variance over draws is its degrees of freedom."""
    # Levels well above the noise: where the estimate sticks at zero the formula is no more than a guide.
    level = 0.04
    truth = Levels(SAMPLE, level, RUNS * ROWS - 4)
    white = whiten(truth, ONES, DESIGN)
    inverse = np.linalg.inv(np.einsum("rkp,rkq->pq", white, white))
    told = freedoms(truth, ones=ONES, jacobian=white, inverse=inverse)
    drawn = []
    for n in range(500):
        found = estimate(ONES, DESIGN, draw(np.random.default_rng(900 + n), level=level), counts=COUNTS)
        again = whiten(found, ONES, DESIGN)
        drawn.append(np.diag(np.linalg.inv(np.einsum("rkp,rkq->pq", again, again))))
    variances = np.array(drawn)
    # 500 draws know a variance to some 10 %; the formula is first order in 1/freedoms of about 10 to 30.
    assert told == pytest.approx(2 * variances.mean(0) ** 2 / variances.var(0), rel=0.35)
