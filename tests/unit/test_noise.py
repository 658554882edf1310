"""Variances of noise and of runs' levels, covariances clustered by run, and intervals."""

import numpy as np
import pytest
from scipy import linalg, optimize, stats

from pumaid.estimation.covariance import clustered, interval, recursion_covariance, two_sided
from pumaid.estimation.noise import NoiseModel, _svd, estimate, excess, freedoms
from pumaid.maths import Bilinear, Recursion

RUNS, ROWS = 12, 3
#: Each run's constant in its own rows, as the QR of a long run makes it: long along one direction.
ONES = np.random.default_rng(7).normal(size=(RUNS, ROWS)) * 10.0
DESIGN = np.random.default_rng(8).normal(size=(RUNS, ROWS, 4)) * 5.0
COUNTS = np.full(RUNS, ROWS)
SAMPLE, LEVEL = 0.04, 0.01


def stated(sample: float, level: float, count: int = RUNS * ROWS - 4) -> NoiseModel:
    """With these two variances."""
    return NoiseModel(np.zeros(RUNS), np.ones(RUNS), np.full(RUNS, np.sqrt(level)), sample=sample, freedoms=count)


def draw(rng: np.random.Generator, *, level: float = LEVEL) -> np.ndarray:
    return np.sqrt(SAMPLE) * rng.normal(size=(RUNS, ROWS)) + np.sqrt(level) * rng.normal(size=(RUNS, 1)) * ONES


def covariance(sample: float, level: float) -> np.ndarray:
    """(R k, R k) dense."""
    return sample * np.eye(RUNS * ROWS) + level * linalg.block_diag(*(np.outer(part, part) for part in ONES))


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
    assert dense(np.log(found[:2])) <= best.fun + 1e-3


@pytest.mark.parametrize("unit", [1e-11, 1e11])
def test_units_of_columns_do_not_matter(unit):
    """A regressor in another unit, such as a load of a weak motor, leaves the variances alone."""
    target, columns = draw(np.random.default_rng(6)), np.array([1.0, unit, 1.0, 1.0])
    plain, scaled = (estimate(ONES, DESIGN * c, target, counts=COUNTS) for c in (1.0, columns))
    assert scaled == pytest.approx(plain, rel=1e-6)


def test_data_without_noise():
    found = estimate(ONES, DESIGN, DESIGN @ [1.0, 2.0, -1.0, 0.5], counts=COUNTS)
    assert 0.0 < found[0] < 1e-20 and found[1] < 1e-20


def test_whitened_rows_have_unit_covariance():
    """The whitener is the inverse root of sample I + level 1 1'."""
    root = stated(SAMPLE, LEVEL).whiten_reduced(ONES, np.broadcast_to(np.eye(ROWS), (RUNS, ROWS, ROWS)))
    for run in range(RUNS):
        rows = slice(run * ROWS, (run + 1) * ROWS)
        assert root[run] @ covariance(SAMPLE, LEVEL)[rows, rows] @ root[run].T == pytest.approx(np.eye(ROWS), abs=1e-10)


def test_freedoms_are_those_of_drawn_variances():
    """Satterthwaite: 2 mean^2 / variance of a parameter's estimated variance over draws is its degrees of freedom."""
    # Levels well above the noise: where the estimate sticks at zero the formula is no more than a guide.
    level, truth = 0.04, stated(SAMPLE, 0.04)
    white = truth.whiten_reduced(ONES, DESIGN)
    inverse = np.linalg.inv(np.einsum("rkp,rkq->pq", white, white))
    told = freedoms(truth, ones=ONES, jacobian=white, inverse=inverse)
    drawn = []
    for n in range(500):
        found = estimate(ONES, DESIGN, draw(np.random.default_rng(900 + n), level=level), counts=COUNTS)
        again = stated(*found).whiten_reduced(ONES, DESIGN)
        drawn.append(np.diag(np.linalg.inv(np.einsum("rkp,rkq->pq", again, again))))
    variances = np.array(drawn)
    # 500 draws know a variance to some 10 %; the formula is first order in 1/freedoms of about 10 to 30.
    assert told == pytest.approx(2 * variances.mean(0) ** 2 / variances.var(0), rel=0.35)


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


OWNERS, SMALL_RUNS, SIZE = np.array([0, 0, 1, 2]), 30, 4
DRAWS = np.random.default_rng(10)
ROW = np.repeat(np.arange(3), SMALL_RUNS * SIZE)
RUN = np.repeat(np.arange(3 * SMALL_RUNS), SIZE)
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
    return 0.1 * rng.normal(size=len(ROW)) + 0.1 * np.repeat(rng.normal(size=3 * SMALL_RUNS), SIZE)


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


def test_matrices_whose_decomposition_does_not_converge_are_decomposed_all_the_same(monkeypatch):
    """LAPACK's divide and conquer fails on some matrices that QR iterations solve: the factors are the same."""
    matrices = np.random.default_rng(3).normal(size=(4, 9, 5))
    expected = _svd(matrices)[1]

    def failing(*_: object, **__: object) -> None:
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr(np.linalg, "svd", failing)
    basis, singular, right = _svd(matrices)
    assert singular == pytest.approx(expected, rel=1e-12)
    assert basis * singular[:, None] @ right == pytest.approx(matrices, abs=1e-12)
