"""The mergeable QR factor: what least squares needs of samples, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from pumaid.maths.triangle import Triangle

RNG = np.random.default_rng(1)
ROWS, TARGET = RNG.normal(size=(60, 3)), RNG.normal(size=60)
NAMES = ("a", "b", "c")
WHOLE = Triangle.of(NAMES, ROWS, TARGET)


def test_normal_equations_are_those_of_the_samples():
    """R'R is the Gram matrix of columns and target."""
    joined = np.column_stack([ROWS, TARGET])
    assert WHOLE.factor.T @ WHOLE.factor == pytest.approx(joined.T @ joined, rel=1e-12, abs=1e-12)


def test_factor_is_the_one_with_positive_diagonal():
    """The factor is unique, so equal data give equal factors whichever way they came."""
    assert np.all(np.diag(WHOLE.factor) >= 0.0)
    assert np.all(np.tril(WHOLE.factor, -1) == 0.0)


def test_fewer_samples_than_columns():
    """Two samples of three columns are no error: the factor is short of rank."""
    few = Triangle.of(NAMES, ROWS[:2], TARGET[:2])
    assert few.factor.shape == (4, 4) and few.count == 2
    assert np.linalg.matrix_rank(few.factor) == 2


def test_rows_solve_like_the_samples():
    """Rows over combined columns are least squares' own, and give the misfit of any values, not only the best ones."""
    matrix, values = RNG.normal(size=(3, 2)), np.array([0.3, -0.7])
    rows, target = WHOLE.rows()
    wanted = np.linalg.lstsq(ROWS @ matrix, TARGET, rcond=None)[0]
    assert np.linalg.lstsq(rows @ matrix, target, rcond=None)[0] == pytest.approx(wanted, rel=1e-10)
    misfit = np.sum((TARGET - ROWS @ matrix @ values) ** 2)
    assert np.sum((target - rows @ matrix @ values) ** 2) == pytest.approx(misfit, rel=1e-12)


def test_different_columns_do_not_merge():
    """Triangles of other columns, or of the same in another order, are refused, named."""
    with pytest.raises(ValueError, match="different columns"):
        _ = WHOLE + Triangle.of(("a", "c", "b"), ROWS, TARGET)


def test_nothing_does_not_merge():
    """No triangle at all has no columns, and is refused."""
    with pytest.raises(ValueError, match="different columns"):
        Triangle.merge([])


def test_wrong_shape_is_refused():
    """A factor that is not of its columns is refused with both sizes."""
    with pytest.raises(ValueError, match=r"\(3, 3\), 3 columns need \(4, 4\)"):
        Triangle(NAMES, np.eye(3), 5)


def test_factor_is_read_only():
    """What runs share cannot be changed by one of them."""
    with pytest.raises(ValueError, match="read-only"):
        WHOLE.factor[0, 0] = 1.0
