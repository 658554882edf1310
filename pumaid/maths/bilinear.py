"""Rows n to 1 of any block-triangular system whose row gains are unknown.

The system is i = diag(eta) A w with A block upper triangular: each column belongs to one row (its owner), and row i
holds nothing of columns owned by rows before it. With w*_j = eta_j w_j, row i reads

    i_i = A_ii w*_i + sum_{j > i} (eta_i / eta_j) A_ij w*_j .

Rows are solved from the last to the first. Outer rows are kept in clusters within which all ratios of gains are known;
a cluster enters row i as one column nu, whose coefficient is eta_i / eta_c with c the cluster's first row, and joins
the cluster of i. Source: S.-K. Lin, eq. (1)-(8), Theorem 1, Corollary 2.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

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
        product = [math.prod(self.edge[k] for k in way if k not in rest) for way, rest in ((down, up), (up, down))]
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
        owned = np.flatnonzero(self.owners == row)
        columns, roots = [rows[:, owned]], []
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
        return np.hstack(columns), owned, roots

    def take(
        self, row: int, rows: Floats, target: Floats, *, limit: Floats | None = None, spread: float | None = None
    ) -> None:
        """Solve row `row` from (N, p) regressors and (N,) target of equal variance.

        A nu that cannot be told from the row's own columns is left out: they absorb it, the ratio stays unknown, and
        the own columns that absorbed it are marked as undetermined. `limit` (p,) is that of `rank.solve`; `spread` is
        a prior standard deviation of ratios about `USUAL_RATIO` (rows whitened), for a start that no weakly shown ratio
        spoils: then a nu that cannot be told joins all the same, with that ratio.
        """
        matrix, owned, roots = self.design(row, rows)
        if spread is not None:
            prior = np.hstack([np.zeros((len(roots), len(owned))), np.eye(len(roots)) / spread])
            matrix = np.vstack([matrix, prior])
            target = np.concatenate([target, np.full(len(roots), USUAL_RATIO / spread)])
        if limit is not None:
            limit = np.concatenate([limit[owned], np.full(len(roots), LARGEST_RATIO)])
        whole = rank.solve(matrix, target, limit=limit)
        sure = whole.determined
        is_shown = np.append(np.ones(len(owned), dtype=bool), sure[len(owned) :])
        if is_shown.all():
            solution = whole
        else:
            rest = target if spread is None else target - USUAL_RATIO * matrix[:, ~is_shown].sum(axis=1)
            solution = rank.solve(matrix[:, is_shown], rest, limit=None if limit is None else limit[is_shown])
        self.values[owned] = solution.values[: len(owned)]
        self.undetermined[owned] = ~sure[: len(owned)]
        ratios = iter(solution.values[len(owned) :])
        for root, is_told in zip(roots, is_shown[len(owned) :], strict=True):
            if is_told or spread is not None:
                self.gains.merge(row, root, float(next(ratios)) if is_told else USUAL_RATIO)
            if not is_told:
                self.redundant.append((row, root))


#: Relative fall of the sum of squares below which another step is not worth taking.
CONVERGED = 1e-12
MOST_STEPS = 60

#: A ratio whose own row shows it neither to this standard error nor to `RATIO_SIGNIFICANT` standard errors is held
#: about one by `RATIO_SPREAD` in the joint fit. Neighbouring gains differ by up to about ten on published arms.
RATIO_KNOWN = 0.25
RATIO_SIGNIFICANT = 3.3
RATIO_SPREAD = 10.0

#: Ratios from which a restart begins besides, and the share of the sum of squares that it must get below.
OTHER_RATIOS, BETTER = (USUAL_RATIO, -USUAL_RATIO), 0.98


@dataclass(frozen=True, eq=False, slots=True)
class Bilinear:
    """The whitened system: for each block of rows its row of the system, regressors over all columns, and target.

    Attributes
    ----------
    row
        (N,) row of the system (from 0) that each equation belongs to.
    regressors, target
        (N, p), (N,), whitened.
    owners
        (p,) row that owns each column; -1 for one that counts in every row's own current.
    """

    row: NDArray[np.int64]
    regressors: Floats
    target: Floats
    owners: NDArray[np.int64]

    def factors(self, gains: Gains) -> Floats:
        """(n, p) eta_row / eta_owner of every row and column; unknown ratios count as zero."""
        return _widened(np.nan_to_num(gains.scales()), 1.0)[:, self.owners]

    def scaled(self, gains: Gains) -> Floats:
        """(N, p) regressors times eta_row / eta_owner; unknown ratios count as zero."""
        return self.regressors * self.factors(gains)[self.row]

    def condensed(self) -> Bilinear:
        """The same sums of squares, at any parameters and gains, in few equations, however many there are.

        A row of the system shares its ratios, so its equations may be turned among themselves: into a triangle of the
        columns that count in it, and the target.
        """
        numbers, regressors, targets = list[NDArray[np.int64]](), list[Floats](), list[Floats]()
        for row in np.unique(self.row):
            is_row = self.row == row
            rows, target = self.regressors[is_row], self.target[is_row]
            live = np.flatnonzero(rows.any(axis=0))
            if len(rows) > len(live) + 1:
                upper: Floats = np.asarray(np.linalg.qr(np.column_stack([rows[:, live], target]), mode="r"))
                rows, target = np.zeros((len(upper), rows.shape[1])), upper[:, -1]
                rows[:, live] = upper[:, :-1]
            numbers.append(np.full(len(rows), row))
            regressors.append(rows)
            targets.append(target)
        return Bilinear(np.concatenate(numbers), np.vstack(regressors), np.concatenate(targets), self.owners)

    def jacobian(self, gains: Gains, values: Floats) -> Floats:
        """(N, p + edges): derivative of the prediction by the parameters and by each edge of `gains`."""
        scaled, edges = self.scaled(gains), gains.edges
        # The way from an owner to a row by an edge: from the owner up to its lower end, and from its upper end on;
        # where it does not lead there one of the two is unknown, and counts as zero.
        scales = np.nan_to_num(gains.scales())
        parts = (self.regressors * values) @ (self.owners[:, None] == np.arange(gains.n_rows))
        uppers = [up for up in gains.parent if up is not None]
        return np.hstack([scaled, scales[:, uppers][self.row] * (parts @ scales[edges].T)])


@dataclass(frozen=True, eq=False, slots=True)
class JointSolution:
    """Parameters (p,) and gains, with the least squares that led there over [values, edges], and the residual (N,)."""

    values: Floats
    gains: Gains
    linear: rank.Solution
    jacobian: Floats
    residual: Floats


def _widened(scales: Floats, value: float) -> Floats:
    """(n, n + 1): a last column of `value`, which is what owner -1 finds."""
    return np.hstack([scales, np.full((len(scales), 1), value)])


def _moved(gains: Gains, steps: Floats) -> Gains:
    other = Gains(gains.n_rows)
    other.parent, other.edge = list(gains.parent), list(gains.edge)
    for edge, step in zip(gains.edges, steps, strict=True):
        other.edge[edge] += float(step)
    return other


def fit_bilinear(
    system: Bilinear,
    values: Floats,
    gains: Gains,
    *,
    limit: Floats | None = None,
    spread: Floats | None = None,
    held: Floats | None = None,
    most_steps: int = MOST_STEPS,
) -> JointSolution:
    """Least squares over parameters and ratios together, from the recursion's solution.

    Steps are minimum-norm in directions that the data do not determine, so those keep their starting values; a step
    that does not lower the sum of squares is halved.

    Parameters
    ----------
    system
        Whitened rows.
    values, gains
        Where to start; edges that `gains` does not have stay unknown.
    most_steps
        0 only linearises at the start.
    limit
        As for `rank.solve`, over [values, edges].
    spread
        (edges,) prior standard deviation of each ratio about `USUAL_RATIO`, infinite where it has none: it keeps a
        ratio that the data hardly show from drifting off and taking others along.
    held
        (h, p) sums of parameters that are 0 before any data, each in units of its prior standard deviation.

    Source
    ------
    Maximum likelihood for the bilinear model when the rows are whitened by their covariance; G. A. F. Seber and C. J.
    Wild, Nonlinear Regression, ch. 14, for the damped Gauss-Newton step.
    """
    p = len(values)
    pull = np.zeros(len(gains.edges)) if spread is None else 1.0 / spread
    prior = prior_rows(np.zeros((0, p)) if held is None else held, pull)
    small = system.condensed()
    jacobian, residual = _augmented(small, values, gains, prior)
    cost = float(residual @ residual)
    for _ in range(most_steps):
        step = rank.solve(jacobian, residual, limit=limit).values
        share, better = 1.0, False
        while share > 1e-6 and not better:
            new_values, new_gains = values + share * step[:p], _moved(gains, share * step[p:])
            new_cost = _cost(small, new_values, new_gains, prior)
            better, share = new_cost < cost, share / 2.0
        if not better:
            break
        fall = cost - new_cost
        values, gains, cost = new_values, new_gains, new_cost
        jacobian, residual = _augmented(small, values, gains, prior)
        if fall < CONVERGED * cost:
            break
    linear = rank.solve(jacobian, residual, limit=limit)
    return JointSolution(values, gains, linear, system.jacobian(gains, values), _residual(system, values, gains))


def _residual(system: Bilinear, values: Floats, gains: Gains) -> Floats:
    return system.target - system.scaled(gains) @ values


def _edges(gains: Gains) -> Floats:
    return np.array([gains.edge[edge] for edge in gains.edges])


def _cost(system: Bilinear, values: Floats, gains: Gains, prior: Floats) -> float:
    residual = _residual(system, values, gains)
    return float(residual @ residual + np.sum((prior @ _off(values, gains)) ** 2))


def _off(values: Floats, gains: Gains) -> Floats:
    """(p + edges,) how far all are from where their priors have them."""
    return np.concatenate([values, _edges(gains) - USUAL_RATIO])


def prior_rows(held: Floats, pull: Floats) -> Floats:
    """(edges + h, p + edges) an equation for each ratio, of weight `pull` (edges,), and for each sum `held` (h, p)."""
    edges, width = len(pull), held.shape[1]
    ratios = np.hstack([np.zeros((edges, width)), np.diag(pull)])
    return np.vstack([ratios, np.hstack([held, np.zeros((len(held), edges))])])


def _augmented(system: Bilinear, values: Floats, gains: Gains, prior: Floats) -> tuple[Floats, Floats]:
    """Jacobian and residual with a row for each prior."""
    residual = _residual(system, values, gains)
    pulled = -(prior @ _off(values, gains))
    return np.vstack([system.jacobian(gains, values), prior]), np.concatenate([residual, pulled])


def spread_of(white: Bilinear, values: Floats, gains: Gains) -> Floats:
    """(edges,) prior spread of each ratio: none where its own row shows it."""
    jacobian, out = white.jacobian(gains, values), []
    for number, edge in enumerate(gains.edges):
        row = gains.parent[edge]
        is_row = white.row == row
        owned = np.flatnonzero(white.owners == row)
        columns = np.column_stack([jacobian[is_row][:, owned], jacobian[is_row][:, len(values) + number]])
        alone = rank.solve(columns, white.target[is_row])
        error = float(np.sqrt(alone.inverse[-1, -1])) if alone.determined[-1] else np.inf
        shown = error < RATIO_KNOWN or abs(gains.edge[edge]) > RATIO_SIGNIFICANT * error
        out.append(np.inf if shown else RATIO_SPREAD)
    return np.array(out)


def restarted(white: Bilinear, values: Floats, gains: Gains, *, limit: Floats, held: Floats) -> tuple[Floats, Gains]:
    """The best of joint fits from the recursion's solution and from one with a ratio of another sign or size.

    Of few postures the recursion may take a ratio with the wrong sign, from which no downhill way leads to the truth.

    Parameters
    ----------
    white
        Rows whitened by the noise inside runs.
    values, gains
        (p,) parameters and ratios by the recursion.
    limit, held
        As for `joint_fit.fit`.
    """
    white = white.condensed()
    spread = spread_of(white, values, gains)
    best = fit_bilinear(white, values, gains, limit=limit, spread=spread, held=held)
    for number, ratio in itertools.product(range(len(gains.edges)), (None, *OTHER_RATIOS)):
        edge = gains.edges[number]
        tried = best.gains.with_edge(edge, -best.gains.edge[edge] if ratio is None else ratio)
        start = rank.solve(white.scaled(tried), white.target, limit=limit[: len(values)]).values
        refined = fit_bilinear(white, start, tried, limit=limit, spread=spread, held=held)
        if refined.residual @ refined.residual < BETTER * (best.residual @ best.residual):
            best = refined
    return best.values, best.gains
