"""Covariances clustered by run, their degrees of freedom, and intervals."""

import numpy as np
import pytest
from scipy import linalg, stats

from pumaid.estimation.gls import clustered, interval, recursion_covariance, two_sided
from pumaid.maths import Bilinear, Recursion

RNG = np.random.default_rng(9)
SIZES = (3, 5, 2, 4, 6, 3)
BLOCKS = [RNG.normal(size=(size, 3)) for size in SIZES]
WHOLE = np.vstack(BLOCKS)
INVERSE = np.linalg.inv(WHOLE.T @ WHOLE)


def by_blocks(
    blocks: list[np.ndarray], residual: np.ndarray, inverse: np.ndarray, **more
) -> tuple[np.ndarray, np.ndarray]:
    """`clustered` where each block is a run."""
    runs = np.repeat(np.arange(len(blocks)), [len(block) for block in blocks])
    return clustered(np.vstack(blocks), residual, inverse, runs=runs, **more)


def test_covariance_and_freedoms_are_the_dense_formulas():
    """CR2 with a matrix root of another library, and Satterthwaite's 2 E^2 / Var of each variance from dense forms."""
    # The mean of the formula under independent unit noise, summed exactly over the noise, is the true covariance.
    annihilator, makers = np.eye(len(WHOLE)) - WHOLE @ INVERSE @ WHOLE.T, []
    for J, rows in zip(BLOCKS, np.split(np.arange(len(WHOLE)), np.cumsum(SIZES)[:-1]), strict=True):
        A = np.real(linalg.inv(linalg.sqrtm(np.eye(len(J)) - J @ INVERSE @ J.T)))
        makers.append(INVERSE @ J.T @ A @ annihilator[rows])
    noise = RNG.normal(size=len(WHOLE))
    covariance, freedoms = by_blocks(BLOCKS, annihilator @ noise, INVERSE)
    assert covariance == pytest.approx(sum(np.outer(maker @ noise, maker @ noise) for maker in makers), rel=1e-9)
    assert sum(maker @ maker.T for maker in makers) == pytest.approx(INVERSE, rel=1e-9)
    for contrast in range(3):
        form = sum(np.outer(maker[contrast], maker[contrast]) for maker in makers)
        assert freedoms[contrast] == pytest.approx(np.trace(form) ** 2 / np.trace(form @ form), rel=1e-9)


def test_a_parameter_of_one_run_has_no_freedoms():
    """What a single run determines alone has the working model's variance, and says that no other run bears it out."""
    blocks = [np.column_stack([np.ones(4), np.zeros(4)]), np.column_stack([np.zeros(4), np.arange(1.0, 5.0)])]
    covariance, freedoms = by_blocks(blocks, np.zeros(8), np.diag([1 / 4, 1 / 30]))
    assert freedoms.tolist() == [0.0, 0.0]
    assert covariance == pytest.approx(np.diag([1 / 4, 1 / 30]))


def test_what_one_run_adds_to_many_is_as_uncertain_as_its_noise():
    """Twenty runs show a, one a + b: the error of b is that of both, on the mean over draws of white noise."""
    random = np.random.default_rng(8)
    blocks = [np.column_stack([np.ones(4), np.zeros(4)])] * 20 + [np.ones((4, 2))]
    rows = np.vstack(blocks)
    inverse, total, inside = np.linalg.inv(rows.T @ rows), np.zeros((2, 2)), 0
    for _ in range(400):
        noise = random.normal(size=len(rows))
        off = inverse @ rows.T @ noise
        covariance, freedoms = by_blocks(blocks, noise - rows @ off, inverse)
        total += covariance / 400
        low, high = interval(off[1], np.sqrt(covariance[1, 1]), freedoms[1])
        inside += low <= 0.0 <= high
    assert total == pytest.approx(inverse, rel=0.1)
    assert 0.92 < inside / 400 < 0.98 and 15 < freedoms[1] < 25
    # Noise that is known from two runs only supports no more than they do.
    _, few = by_blocks(blocks, noise - rows @ off, inverse, kin=np.array([0] * 19 + [1, 1]))
    assert few[1] == pytest.approx(1.0, rel=0.2)


@pytest.mark.parametrize("freedoms", [1.0, 2.7, 40.0, np.inf])
def test_interval_is_scipys(freedoms):
    """Student's interval and both tails, the normal ones for infinitely many degrees of freedom."""
    dist = stats.norm(2.0, 0.5) if np.isinf(freedoms) else stats.t(freedoms, 2.0, 0.5)
    assert interval(2.0, 0.5, freedoms) == pytest.approx(dist.interval(0.95), rel=1e-9)
    assert interval(2.0, 0.5, freedoms, level=0.6) == pytest.approx(dist.interval(0.6), rel=1e-9)
    assert two_sided(2.1, freedoms) == two_sided(-2.1, freedoms) == pytest.approx(2.0 * dist.sf(2.0 + 0.5 * 2.1))


OWNERS, RUNS, SIZE = np.array([0, 0, 1, 2]), 30, 4
DRAWS = np.random.default_rng(10)
ROW = np.repeat(np.arange(3), RUNS * SIZE)
RUN = np.repeat(np.arange(3 * RUNS), SIZE)
REGRESSORS = np.where(ROW[:, None] <= OWNERS, DRAWS.normal(size=(len(ROW), 4)), 0.0)
VALUES, GAINS = np.array([1.0, -2.0, 1.5, 3.0]), np.array([1.0, 0.5, 2.0])
EXACT = np.einsum("np,np,p->n", REGRESSORS, GAINS[ROW][:, None] / GAINS[OWNERS], VALUES)


def solved(target: np.ndarray) -> Recursion:
    found = Recursion(OWNERS, 3)
    for row in (2, 1, 0):
        found.take(row, REGRESSORS[row == ROW], target[row == ROW])
    return found


def noise(seed: int) -> np.ndarray:
    """White noise and a level a run, as strong."""
    rng = np.random.default_rng(seed)
    return 0.1 * rng.normal(size=len(ROW)) + 0.1 * np.repeat(rng.normal(size=3 * RUNS), SIZE)


def test_covariance_of_the_recursion_is_that_of_noisy_solutions():
    """Errors told from one experiment each are the spread over 500, and an outer row's moves the inner rows'."""
    draws, tables = [], []
    for seed in range(500):
        target = EXACT + noise(seed)
        found = solved(target)
        draws.append([*found.values, *(found.gains.edge[edge] for edge in found.gains.edges)])
        if seed < 60:
            system = Bilinear(ROW, REGRESSORS, target, OWNERS)
            tables.append(recursion_covariance(system, found.values, found.gains, runs=RUN)[0])
    told, drawn = np.mean(tables, axis=0), np.cov(np.array(draws).T)
    # 500 draws know a standard deviation to 3 %, 60 experiments' mean variance is known to some 4 %.
    assert np.sqrt(np.diag(told)) == pytest.approx(np.sqrt(np.diag(drawn)), rel=0.12)
    correlation = [part / np.sqrt(np.outer(np.diag(part), np.diag(part))) for part in (told, drawn)]
    assert np.max(np.abs(correlation[0] - correlation[1])) < 0.2  # 4 / sqrt(500)
    # A ratio's error must mirror that of the load that it scales: strong here, so that the test can fail.
    assert np.min(correlation[1]) < -0.3
