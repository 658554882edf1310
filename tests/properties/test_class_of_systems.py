"""Random systems of class (1): what is determined is found exactly, what is not is said to be open.

The oracle sets up the whole bilinear system densely, all gains unknown, and looks at the null space of its derivative
at the truth; it knows neither order of rows nor clusters.
"""

from dataclasses import dataclass

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize

from pumaid.maths import Bilinear, Recursion, fit_bilinear

SAMPLES = 40
#: Relative; random 40-row blocks have condition numbers up to some hundreds a row, over up to seven rows.
EXACT = 1e-7


@dataclass
class System:
    """Regressors of every row (n arrays (N, p)), owners (p,), gains (n,) and starred parameters (p,) of the truth."""

    blocks: list[np.ndarray]
    owners: np.ndarray
    gains: np.ndarray
    values: np.ndarray

    def target(self, row: int) -> np.ndarray:
        return self.blocks[row] @ (self.gains[row] / self.gains[self.owners] * self.values)

    def null(self) -> np.ndarray:
        """(p + n, b) directions of starred parameters and of logarithms of gains that change no current."""
        parts = []
        for row, block in enumerate(self.blocks):
            scaled = block * (self.gains[row] / self.gains[self.owners])
            by_gain = np.zeros((SAMPLES, len(self.gains)))
            for column, owner in enumerate(self.owners):
                by_gain[:, row] += scaled[:, column] * self.values[column]
                by_gain[:, owner] -= scaled[:, column] * self.values[column]
            parts.append(np.hstack([scaled, by_gain]))
        dense = np.vstack(parts)
        _, singular, right = np.linalg.svd(dense)
        return right[np.append(singular, np.zeros(len(right) - len(singular))) < 1e-9 * singular[0]].T


@st.composite
def systems(draw, *, full: bool = False) -> System:
    """Up to seven rows of one to three columns; each coupling block is zero or not (always there if `full`)."""
    n = draw(st.integers(2, 7))
    widths = draw(st.lists(st.integers(1, 3), min_size=n, max_size=n))
    felt = draw(st.lists(st.booleans(), min_size=n * n, max_size=n * n))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    owners, blocks = np.repeat(np.arange(n), widths), []
    for row in range(n):
        there = np.array([owner == row or (owner > row and (full or felt[row * n + owner])) for owner in owners])
        blocks.append(np.where(there, rng.normal(size=(SAMPLES, len(owners))), 0.0))
    signs = rng.choice([-1.0, 1.0], (2, max(n, len(owners))))
    gains = signs[0, :n] * rng.uniform(0.3, 3.0, n)
    return System(blocks, owners, gains, signs[1, : len(owners)] * rng.uniform(0.5, 2.0, len(owners)))


def recursion(system: System, rows: list[int] | None = None, owners: np.ndarray | None = None) -> Recursion:
    """The recursion over `rows` (all of them where not given)."""
    found = Recursion(system.owners if owners is None else owners, len(system.blocks))
    for row in reversed(range(len(system.blocks)) if rows is None else rows):
        found.take(row, system.blocks[row], system.target(row))
    return found


@settings(max_examples=80, deadline=None)
@given(systems())
def test_what_the_dense_system_determines_is_exact(system):
    """Every starred parameter is; a ratio is a number exactly where no null direction changes it, then the truth's."""
    solved, null, p = recursion(system), system.null(), len(system.owners)
    assert np.allclose(solved.values, system.values, rtol=EXACT)
    for i in range(len(system.gains)):
        for j in range(i):
            is_open = bool(np.max(np.abs(null[p + i] - null[p + j]), initial=0.0) > 1e-6)
            ratio = solved.gains.ratio(j, i)
            assert np.isnan(ratio) == is_open
            assert is_open or np.isclose(ratio, system.gains[j] / system.gains[i], rtol=EXACT)


@settings(max_examples=25, deadline=None)
@given(systems(full=True), st.data())
def test_rows_without_data(system, data):
    """Columns whose row has no data are found in the gain of the next inner row that has; the rest as ever."""
    n = len(system.blocks)
    rows = sorted({0, *data.draw(st.lists(st.integers(0, n - 1), max_size=n))})
    owners = np.array([max(row for row in rows if row <= owner) for owner in system.owners])
    # A row of 40 samples must have room for all columns that become its own, and for the loads outward.
    found = recursion(system, rows, owners)
    wanted = system.values * system.gains[owners] / system.gains[system.owners]
    assert np.allclose(found.values, wanted, rtol=EXACT)


@settings(max_examples=10, deadline=None)
@given(systems(full=True), st.integers(0, 2**32 - 1))
def test_joint_fit_of_noisy_rows_is_the_dense_optimum(system, seed):
    """With noise no other optimiser, over parameters and all gains densely, finds a smaller sum of squares."""
    n, p = len(system.blocks), len(system.owners)
    rng = np.random.default_rng(seed)
    targets = [system.target(row) + 0.05 * rng.normal(size=SAMPLES) for row in range(n)]
    start = Recursion(system.owners, n)
    for row in reversed(range(n)):
        start.take(row, system.blocks[row], targets[row])
    whole = Bilinear(np.repeat(np.arange(n), SAMPLES), np.vstack(system.blocks), np.concatenate(targets), system.owners)
    found = fit_bilinear(whole, start.values, start.gains)

    def residual(unknown: np.ndarray) -> np.ndarray:
        gains = np.append(unknown[p:], 1.0)
        return np.concatenate(
            [
                block @ (gains[row] / gains[system.owners] * unknown[:p]) - targets[row]
                for row, block in enumerate(system.blocks)
            ]
        )

    known = np.concatenate([system.values, system.gains[:-1] / system.gains[-1]])
    dense = optimize.least_squares(residual, known, xtol=1e-12, ftol=1e-12, gtol=1e-12)
    assert found.residual @ found.residual <= 2.0 * dense.cost * (1.0 + 1e-6)
