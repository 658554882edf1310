"""Rows n to 1 of any block-triangular system whose row gains are unknown.

The system is i = diag(eta) A w with A block upper triangular: each column belongs to one row (its owner), and row i
holds nothing of columns owned by rows before it. With w*_j = eta_j w_j, row i reads

    i_i = A_ii w*_i + sum_{j > i} (eta_i / eta_j) A_ij w*_j .

Rows are solved from the last to the first. Outer rows are kept in clusters within which all ratios of gains are known;
a cluster enters row i as one column nu, whose coefficient is eta_i / eta_c with c the cluster's first row, and joins
the cluster of i. Source: S.-K. Lin, eq. (1)-(8), Theorem 1, Corollary 2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pumaid.maths import rank

Floats = NDArray[np.float64]

#: A ratio of gains with a larger standard error than this says nothing about any machine.
LARGEST_RATIO = 1e4

#: What a ratio is taken for before any data: gains of one arm are of one order. Not zero, at which an outer ratio would
#: seem to act on nothing further inward.
USUAL_RATIO = 1.0


class Gains:
    """The known ratios of row gains, as a forest: an edge (i, c) holds eta_i / eta_c.

    Rows count from 0. Each tree is a cluster; its root is its first row, and every edge leads outward, so the ratio of
    a row to any row of its own subtree is the product of the edges on the path between them.
    """

    def __init__(self, n_rows: int) -> None:
        self.n_rows = n_rows
        self.parent: list[int | None] = [None] * n_rows
        self.edge: list[float] = [np.nan] * n_rows

    def root(self, row: int) -> int:
        """First row of the cluster that `row` is in."""
        while (up := self.parent[row]) is not None:
            row = up
        return row

    def cluster(self, root: int) -> list[int]:
        """Rows of the cluster with first row `root`."""
        return [row for row in range(self.n_rows) if self.root(row) == root]

    def path(self, row: int) -> list[int]:
        """Rows from `row` up to its root; the edge of each but the last is on the way."""
        steps = [row]
        while (up := self.parent[steps[-1]]) is not None:
            steps.append(up)
        return steps

    def merge(self, row: int, root: int, ratio: float) -> None:
        """Make the cluster of `root` part of the cluster of `row` with eta_row / eta_root = `ratio`."""
        self.parent[root], self.edge[root] = row, ratio

    def with_edge(self, row: int, value: float) -> Gains:
        """The same forest with another ratio on the edge above `row`."""
        other = Gains(self.n_rows)
        other.parent, other.edge = list(self.parent), list(self.edge)
        other.edge[row] = value
        return other

    @property
    def edges(self) -> list[int]:
        """Rows that have a parent: the lower ends of all edges."""
        return [row for row in range(self.n_rows) if self.parent[row] is not None]

    def scale(self, row: int, other: int) -> float:
        """eta_row / eta_other for `other` in the subtree of `row`, 1 for itself, NaN where it is not known."""
        steps = self.path(other)
        if row not in steps:
            return np.nan
        return math.prod(self.edge[step] for step in steps[: steps.index(row)])

    def ratio(self, row: int, other: int) -> float:
        """eta_row / eta_other for any two rows of one cluster, NaN where they are in different ones."""
        if self.root(row) != self.root(other):
            return np.nan
        down, up = self.path(other), self.path(row)
        product = [math.prod(self.edge[k] for k in one if k not in rest) for one, rest in ((down, up), (up, down))]
        return product[0] / product[1] if product[1] else np.nan

    def scales(self) -> Floats:
        """(n, n) of `scale`, 0 left of the diagonal."""
        out = np.triu(np.full((self.n_rows, self.n_rows), np.nan))
        for other in range(self.n_rows):
            row, product = other, 1.0
            out[row, other] = product
            while (up := self.parent[row]) is not None:
                product *= self.edge[row]
                row = up
                out[row, other] = product
        return out


class Recursion:
    """The state of the solution while rows are taken from the last to the first.

    Parameters
    ----------
    owners
        (p,) the row (from 0) that owns each column.
    n_rows
        Number of rows.

    Attributes
    ----------
    values
        (p,) w*, minimum-norm where undetermined.
    gains
        The ratios found so far.
    undetermined
        (p,) columns that their own row could not determine.
    redundant
        Pairs (row, root) whose ratio was met by a column but not determined by it.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> outer, inner, felt = (rng.normal(size=(20, 1)) for _ in range(3))
    >>> recursion = Recursion(np.array([0, 1]), 2)
    >>> recursion.take(1, np.hstack([np.zeros((20, 1)), outer]), 3.0 * outer[:, 0])
    >>> recursion.take(0, np.hstack([inner, felt]), 2.0 * inner[:, 0] + 0.5 * 3.0 * felt[:, 0])
    >>> np.round(recursion.values, 9).tolist(), round(recursion.gains.ratio(0, 1), 9)
    ([2.0, 3.0], 0.5)
    """

    def __init__(self, owners: Sequence[int] | NDArray[np.int64], n_rows: int) -> None:
        self.owners = np.asarray(owners, dtype=int)
        self.values = np.zeros(len(self.owners))
        self.gains = Gains(n_rows)
        self.undetermined = np.zeros(len(self.owners), dtype=bool)
        self.redundant: list[tuple[int, int]] = []

    def design(self, row: int, rows: Floats) -> tuple[Floats, NDArray[np.int64], list[int]]:
        """Row `row` as plain least squares.

        Parameters
        ----------
        row
            From 0; every later row that has data must have been taken.
        rows
            (N, p) of A over all columns.

        Returns
        -------
        matrix
            (N, own + clusters): the row's own columns, then one column nu a cluster that it feels.
        own
            Indices of the own columns.
        roots
            First row of the cluster behind each nu.
        """
        own = np.flatnonzero(self.owners == row)
        columns, roots = [rows[:, own]], []
        outward = {self.gains.root(other) for other in range(row + 1, self.gains.n_rows)}
        for root in sorted(outward):
            weights = np.zeros(len(self.owners))
            for member in self.gains.cluster(root):
                of_member = self.owners == member
                weights[of_member] = self.gains.scale(root, member) * self.values[of_member]
            nu = rows @ weights
            # Rounding of a regressor that is exactly zero must not become a column.
            floor = 1e-12 * np.linalg.norm(np.abs(rows) @ np.abs(weights))
            if np.linalg.norm(nu) > floor:
                columns.append(nu[:, None])
                roots.append(root)
        return np.hstack(columns), own, roots

    def take(
        self, row: int, rows: Floats, target: Floats, *, limit: Floats | None = None, spread: float | None = None
    ) -> None:
        """Solve row `row` from (N, p) regressors and (N,) target of equal variance.

        A nu that cannot be told from the row's own columns is left out: they absorb it, the ratio stays unknown, and
        the own columns that absorbed it are marked as undetermined. `limit` (p,) is that of `rank.solve`; `spread` is
        a prior standard deviation of ratios about `USUAL_RATIO` (rows whitened), for a start that no weakly shown ratio
        spoils: then a nu that cannot be told joins all the same, with that ratio.
        """
        matrix, own, roots = self.design(row, rows)
        if spread is not None:
            prior = np.hstack([np.zeros((len(roots), len(own))), np.eye(len(roots)) / spread])
            matrix = np.vstack([matrix, prior])
            target = np.concatenate([target, np.full(len(roots), USUAL_RATIO / spread)])
        if limit is not None:
            limit = np.concatenate([limit[own], np.full(len(roots), LARGEST_RATIO)])
        whole = rank.solve(matrix, target, limit=limit)
        sure = whole.determined
        told = np.append(np.ones(len(own), dtype=bool), sure[len(own) :])
        if told.all():
            solution = whole
        else:
            rest = target if spread is None else target - USUAL_RATIO * matrix[:, ~told].sum(axis=1)
            solution = rank.solve(matrix[:, told], rest, limit=None if limit is None else limit[told])
        self.values[own] = solution.values[: len(own)]
        self.undetermined[own] = ~sure[: len(own)]
        ratios = iter(solution.values[len(own) :])
        for root, is_told in zip(roots, told[len(own) :], strict=True):
            if is_told or spread is not None:
                self.gains.merge(row, root, float(next(ratios)) if is_told else USUAL_RATIO)
            if not is_told:
                self.redundant.append((row, root))
