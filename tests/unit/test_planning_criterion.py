"""What makes a plan good: its number and its slope against dense inverses, differences and chords."""

from __future__ import annotations

import numpy as np
import pytest

from pumaid.design.criterion import Criterion

ROBOTS, WIDTH = 3, 5
SIZE = np.array([0.2, 1.0, 3.0, 0.01, 7.0])
MASK = np.array([True, True, False, True, False])
KINDS = [(power, counted) for power in (0.0, 12.0) for counted in (None, MASK)]


def information(rng: np.random.Generator, *, rank: int = 9) -> np.ndarray:
    """(G, p, p) of random rows whose columns are of very different size."""
    rows = rng.standard_normal((ROBOTS, rank, WIDTH)) * np.array([100.0, 3.0, 0.5, 2000.0, 1.0])
    return np.swapaxes(rows, -1, -2) @ rows


def slow(power: float, counted: np.ndarray | None, matrices: np.ndarray) -> float:
    """The mean over robots of the logarithm of the mean relative error, term by term."""
    each = []
    for matrix in matrices:
        covariance = np.linalg.inv(matrix)
        errors = [covariance[k, k] ** 0.5 / SIZE[k] for k in range(WIDTH) if counted is None or counted[k]]
        mean = np.prod(errors) ** (1 / len(errors)) if power == 0 else np.mean(np.power(errors, power)) ** (1 / power)
        each.append(np.log(mean))
    return float(np.mean(each))


@pytest.mark.parametrize(("power", "counted"), KINDS)
def test_value_is_the_mean_error(power, counted):
    """The criterion is what a dense inverse says, for one matrix and for a stack; 1e-6 leaves room for the ridge."""
    rng = np.random.default_rng(1)
    some = np.stack([information(rng) for _ in range(4)])
    found = Criterion(power, SIZE, counted).value(some)
    assert found == pytest.approx([slow(power, counted, one) for one in some], abs=1e-6)


@pytest.mark.parametrize(("power", "counted"), KINDS)
def test_pull_is_the_slope(power, counted):
    """Half of the pull times a small change is what the criterion falls by: central differences of the slow value."""
    rng = np.random.default_rng(2)
    now, step = information(rng), 1e-4
    pull = Criterion(power, SIZE, counted).pull(now)
    for _ in range(10):
        more = information(rng, rank=1)
        slope = slow(power, counted, now + step * more) - slow(power, counted, now - step * more)
        assert -0.5 * np.sum(pull * more) == pytest.approx(slope / (2 * step), rel=1e-4)


@pytest.mark.parametrize(("power", "counted"), KINDS)
def test_pull_on_what_there_is_sums_to_one(power, counted):
    """Twice the information makes every error the square root of a half: the pull on the whole is one."""
    now = information(np.random.default_rng(3))
    assert np.sum(Criterion(power, SIZE, counted).pull(now) * now) == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize(("power", "counted"), KINDS)
def test_criterion_is_convex(power, counted):
    """Along forty random lines no value lies above its chord, near and far from the ends."""
    rng, criterion = np.random.default_rng(4), Criterion(power, SIZE, counted)
    for _ in range(40):
        ends = [10.0 ** rng.uniform(-3, 3) * information(rng, rank=int(rng.integers(5, 9))) for _ in range(2)]
        share = rng.uniform()
        chord = (1 - share) * criterion.value(ends[0]) + share * criterion.value(ends[1])
        assert criterion.value((1 - share) * ends[0] + share * ends[1]) <= chord + 1e-6


def test_errors_are_those_of_the_inverse():
    """Standard errors in the parameters' own units, whatever the sizes."""
    now = information(np.random.default_rng(5))
    wanted = [np.sqrt(np.diag(np.linalg.inv(one))) for one in now]
    assert Criterion(12.0, SIZE).errors(now) == pytest.approx(np.array(wanted), rel=1e-6)


@pytest.mark.parametrize("power", [0.0, 12.0])
def test_what_does_not_count_may_be_dark(power):
    """A parameter without any information, not counted, changes neither value nor pull; nothing overflows."""
    now = information(np.random.default_rng(6))
    dark = now.copy()
    dark[:, 4, :] = dark[:, :, 4] = 0.0
    counted = np.array([True, True, True, True, False])
    small = Criterion(power, np.append(SIZE[:4], 1e-30), counted)
    alone = Criterion(power, SIZE[:4])
    assert small.value(dark) == pytest.approx(float(alone.value(now[:, :4, :4])))
    assert small.pull(dark)[:, :4, :4] == pytest.approx(alone.pull(now[:, :4, :4]))


def test_worst_is_nearly_the_worst():
    """The power 12 gives the largest relative error within the root of their number; the geometric mean does not."""
    now = np.broadcast_to(np.diag(1.0 / (SIZE * np.array([1e-3, 1e-3, 0.3, 1e-3, 1e-3])) ** 2), (1, WIDTH, WIDTH))
    assert 0.3 * WIDTH ** (-1 / 12) * 0.999 < np.exp(Criterion(12.0, SIZE).value(now)) <= 0.3
    assert np.exp(Criterion(0.0, SIZE).value(now)) == pytest.approx((0.3 * 1e-12) ** 0.2, rel=1e-6)
