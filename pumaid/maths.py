"""Kinds of arrays, and linear algebra that knows no robot.

Least squares that tells what the data leave open, and rows n to 1 of any block-triangular system whose row gains are
unknown.

The system is i = diag(eta) A w with A block upper triangular: each column belongs to one row (its owner), and row i
holds nothing of columns owned by rows before it. With w*_j = eta_j w_j, row i reads

    i_i = A_ii w*_i + sum_{j > i} (eta_i / eta_j) A_ij w*_j .

Rows are solved from the last to the first. Outer rows are kept in clusters within which all ratios of gains are known;
a cluster enters row i as one column nu, whose coefficient is eta_i / eta_c with c the cluster's first row, and joins
the cluster of i. Source: S.-K. Lin, eq. (1)-(8), Theorem 1, Corollary 2.
"""

import itertools
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]
Flags = NDArray[np.bool_]
Item = TypeVar("Item")
Key = TypeVar("Key", bound=Hashable)

#: Singular values of the column-scaled matrix below this share of the largest are rounding: triangles are formed in
#: double precision (1e-16) from regressors of order one, and merging thousands of them loses about six digits.
RELATIVE_TOLERANCE = 1e-9
#: With limits the columns are not scaled to one length, so only what is surely rounding of the largest counts as zero.
ROUNDING = 1e-13
#: Eigenvalues of a scaled information, or singular values of columns, below this share of the largest are directions
#: that the data do not show; columns shorter than a share of the longest are zero but for rounding.
FLAT, FAINT = 1e-10, 1e-12


@dataclass(frozen=True, eq=False, slots=True)
class LeastSquares:
    """A minimum-norm least-squares solution (p,) with its blind directions.

    `half` (p, k) spans the k directions that are determined: ``half half'`` is the pseudo-inverse of the information
    matrix, the covariance when the rows are whitened. `blind` (p, b) has directions, in columns, of unit length in the
    scaled parameters, that the rows do not determine. `singular` and `along` (k,) are the singular values of the scaled
    rows and the target along each direction.
    """

    values: Floats
    half: Floats
    blind: Floats
    singular: Floats
    along: Floats

    def damped(self, damping: float) -> tuple[Floats, float]:
        """(p,) the solution with `damping` added to the scaled information, and by how much the squares fall."""
        share = 1.0 / (1.0 + damping / self.singular**2)
        return self.half @ (share * self.along), float(self.along**2 @ (share * (2.0 - share)))

    @property
    def determined(self) -> Flags:
        """(p,) whether each parameter is free of every blind direction, but for rounding."""
        return np.max(np.abs(self.blind), axis=1, initial=0.0) < 1e-6


def least_squares(
    rows: Floats, target: Floats, *, limit: Floats | None = None, tolerance: float = RELATIVE_TOLERANCE
) -> LeastSquares:
    """Least squares by a column-scaled singular value decomposition, minimum norm where the rank is short.

    `rows` (N, p) and `target` (N,) are whitened: each target has unit variance (any common one without `limit`).
    `limit` (p,) is the largest standard error at which a parameter still says anything: a direction is blind, too, when
    its standard error exceeds one, each parameter measured by its limit. Singular values below the share `tolerance` of
    the largest count as zero.

    Source: C. L. Lawson and R. J. Hanson, Solving Least Squares Problems, ch. 14 (the paper used their HFTI).
    """
    norms = np.linalg.norm(rows, axis=0)
    inverse_scale = np.divide(1.0, norms, out=np.zeros_like(norms), where=norms > 0)
    if limit is not None:
        inverse_scale = np.where(norms > 0, limit, 0.0)
    basis, singular, right = np.linalg.svd(rows * inverse_scale, full_matrices=len(rows) < len(norms))
    full = np.zeros(len(norms))
    full[: len(singular)] = singular
    largest = singular.max(initial=0.0)
    is_shown = full > (tolerance * largest if limit is None else max(1.0, ROUNDING * largest))
    shown = np.flatnonzero(is_shown)
    half = inverse_scale[:, None] * (right[shown].T / full[shown])
    along = basis[:, shown].T @ target
    return LeastSquares(half @ along, half, right[~is_shown].T, full[shown], along)


def independent(rows: Floats, *, first: int = 0, tolerance: float = RELATIVE_TOLERANCE) -> Flags:
    """(p,) which columns are determined once the `first` leading columns have had the first word.

    The leading columns absorb what any other column shares with them, so a column that is a combination of leading
    ones is not determined while the leading ones stay so.
    """
    scale = np.linalg.norm(rows, axis=0)
    unit = np.divide(rows, scale, out=np.zeros_like(rows), where=scale > 0)
    lead, rest = unit[:, :first], unit[:, first:]
    if first:
        vectors, singular, _ = np.linalg.svd(lead, full_matrices=False)
        basis = vectors[:, singular > tolerance * singular[0]]
        lead, rest = basis.T @ lead, rest - basis @ (basis.T @ rest)
        rest[:, np.linalg.norm(rest, axis=0) < tolerance * 100] = 0.0
    parts = [least_squares(part, np.zeros(len(part)), tolerance=tolerance).determined for part in (lead, rest)]
    return np.concatenate(parts) & (scale > 0)


def pseudo_inverse(information: Floats) -> tuple[Floats, int]:
    """Pseudo-inverse (P, P) of a symmetric matrix in scaled columns, and the rank."""
    if information.size == 1 and information > 0.0:
        return 1.0 / information, 1
    half = inverse_root(information)
    return half @ half.T, half.shape[1]


def inverse_root(information: Floats) -> Floats:
    """(P, k) whose product with its own transpose is the pseudo-inverse of a symmetric matrix of rank k."""
    size = np.sqrt(np.maximum(np.diagonal(information), 0.0))
    unit = np.divide(1.0, size, out=np.zeros_like(size), where=size > FAINT * size.max(initial=0.0))
    values, vectors = np.linalg.eigh(information * unit[:, None] * unit[None, :])
    is_shown = values > FLAT * values[-1]
    return np.asarray(unit[:, None] * vectors[:, is_shown] / np.sqrt(values[is_shown]))


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

    def path(self, row: int) -> list[int]:
        """Rows from `row` up to its root; the edge of each but the last is on the way."""
        steps = [row]
        while (up := self.parent[steps[-1]]) is not None:
            steps.append(up)
        return steps

    def subtree(self, row: int) -> list[int]:
        """Rows at or beyond `row`."""
        return [other for other in range(self.n_rows) if row in self.path(other)]

    @property
    def edges(self) -> list[int]:
        """Rows that have a parent: the lower ends of all edges."""
        return [row for row in range(self.n_rows) if self.parent[row] is not None]

    @property
    def uppers(self) -> list[int]:
        """The parents of these rows: the upper ends of all edges."""
        return [up for up in self.parent if up is not None]

    @property
    def ratios(self) -> Floats:
        """(edges,) the ratio on each edge."""
        return np.array([self.edge[edge] for edge in self.edges])

    def with_ratios(self, ratios: Floats) -> "Gains":
        """The same forest with other ratios on its edges."""
        other = Gains(self.n_rows)
        other.parent, other.edge = list(self.parent), list(self.edge)
        for edge, ratio in zip(self.edges, ratios, strict=True):
            other.edge[edge] = float(ratio)
        return other

    def ratio(self, row: int, other: int) -> float:
        """eta_row / eta_other for any two rows of one cluster, NaN where they are in different ones."""
        above, scales = self.path(row), self.scales()
        shared = next((step for step in self.path(other) if step in above), None)
        is_known = shared is not None and scales[shared, row] != 0.0
        return float(scales[shared, other] / scales[shared, row]) if is_known else np.nan

    def scales(self) -> Floats:
        """(n, n) eta_row / eta_other for rows of a subtree, 1 for itself, 0 left of the diagonal, NaN where unknown."""
        out = np.triu(np.full((self.n_rows, self.n_rows), np.nan))
        np.fill_diagonal(out, 1.0)
        for edge, upper in zip(self.edges, self.uppers, strict=True):
            out[: upper + 1, edge] = out[: upper + 1, upper] * self.edge[edge]
        return out


class Recursion:
    """The state of the solution while rows are taken from the last to the first.

    `owners` (p,) is the row (from 0) that owns each column; `values` (p,) are w*, minimum-norm where `undetermined`
    (p,) by their own row; `gains` are the ratios so far, `redundant` pairs (row, root) whose ratio was met by a column
    but not determined by it.

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

    def __init__(self, owners: Sequence[int] | Counts, n_rows: int) -> None:
        self.owners = np.asarray(owners, dtype=int)
        self.values = np.zeros(len(self.owners))
        self.gains = Gains(n_rows)
        self.undetermined = np.zeros(len(self.owners), dtype=bool)
        self.redundant: list[tuple[int, int]] = []

    def design(self, row: int, rows: Floats) -> tuple[Floats, Counts, list[int]]:
        """Row `row` (from 0) as plain least squares; every later row that has data must have been taken.

        Returns (N, own + clusters) of (N, p) `rows`, the row's own columns and then one column nu a cluster that it
        feels; the numbers of the own columns; and the first row of the cluster behind each nu.
        """
        owned = np.flatnonzero(self.owners == row)
        columns, roots = [rows[:, owned]], []
        scales = self.gains.scales()
        for root in sorted({self.gains.path(other)[-1] for other in range(row + 1, self.gains.n_rows)}):
            weights = np.nan_to_num(np.append(scales[root], 0.0)[self.owners]) * self.values
            nu = rows @ weights
            # Rounding of a regressor that is exactly zero must not become a column.
            if np.linalg.norm(nu) > 1e-12 * np.linalg.norm(np.abs(rows) @ np.abs(weights)):
                columns.append(nu[:, None])
                roots.append(root)
        return np.hstack(columns), owned, roots

    def take(
        self, row: int, rows: Floats, target: Floats, *, limit: Floats | None = None, spread: float | None = None
    ) -> None:
        """Solve row `row` from (N, p) regressors and (N,) target of equal variance.

        A nu that cannot be told from the row's own columns is left out: they absorb it, the ratio stays unknown, and
        the own columns that absorbed it are marked as undetermined. `limit` (p,) is that of `least_squares`; `spread`
        is a prior standard deviation of ratios about `USUAL_RATIO` (rows whitened), for a start that no weakly shown
        ratio spoils: then a nu that cannot be told joins all the same, with that ratio.
        """
        matrix, owned, roots = self.design(row, rows)
        if spread is not None:
            matrix = np.vstack([matrix, np.eye(len(roots), matrix.shape[1], len(owned)) / spread])
            target = np.concatenate([target, np.full(len(roots), USUAL_RATIO / spread)])
        if limit is not None:
            limit = np.concatenate([limit[owned], np.full(len(roots), LARGEST_RATIO)])
        solution = least_squares(matrix, target, limit=limit)
        self.undetermined[owned] = ~solution.determined[: len(owned)]
        is_shown = solution.determined.copy()
        is_shown[: len(owned)] = True
        if not is_shown.all():
            rest = target if spread is None else target - USUAL_RATIO * matrix[:, ~is_shown].sum(axis=1)
            solution = least_squares(matrix[:, is_shown], rest, limit=None if limit is None else limit[is_shown])
        self.values[owned] = solution.values[: len(owned)]
        ratios = np.full(len(is_shown), USUAL_RATIO)
        ratios[is_shown] = solution.values
        for number, root in enumerate(roots, start=len(owned)):
            if is_shown[number] or spread is not None:
                self.gains.parent[root], self.gains.edge[root] = row, float(ratios[number])
            if not is_shown[number]:
                self.redundant.append((row, root))


#: Relative fall of the sum of squares below which another step is not worth taking: with ten thousand equations, moves
#: of some thousandths of a standard error.
CONVERGED = 1e-9
#: Steps at most. Share of the fall that the linearised system promises below which a step is damped harder, and by how
#: much; damping, over the square of the largest singular value, beyond which none helps.
MOST_STEPS, TRUSTED, HARDER, HARDEST = 60, 0.25, 3.0, 1e6
#: A ratio whose own row shows it neither to this standard error nor to `RATIO_SIGNIFICANT` standard errors is held
#: about one by `RATIO_SPREAD` in the joint fit. Neighbouring gains differ by up to about ten on published arms.
RATIO_KNOWN = 0.25
RATIO_SIGNIFICANT = 3.3
RATIO_SPREAD = 10.0
#: Ratios from which a restart begins besides, and the share of the sum of squares that another start must get below.
OTHER_RATIOS, BETTER = (USUAL_RATIO, -USUAL_RATIO), 0.98


@dataclass(frozen=True, eq=False, slots=True)
class Bilinear:
    """The whitened system: each equation's row of the system (N,), or the row (1,) of all; (N, p) regressors over all
    columns, (N,) target.

    `owners` (p,) is the row (from 0) that owns each column; -1 for one that counts in every row's own current.
    """

    row: Counts
    regressors: Floats
    target: Floats
    owners: Counts

    def scaled(self, gains: Gains) -> Floats:
        """(N, p) regressors times eta_row / eta_owner; unknown ratios count as zero."""
        return self.regressors * self._factors(gains)[self.row]

    def _factors(self, gains: Gains) -> Floats:
        """(rows, p) eta_row / eta_owner."""
        # The last column is what owner -1 finds.
        return np.hstack([np.nan_to_num(gains.scales()), np.ones((gains.n_rows, 1))])[:, self.owners]

    def left(self, values: Floats, gains: Gains) -> Floats:
        """(N,) what parameters and ratios leave of the target."""
        drawn = self.regressors @ (self._factors(gains) * values).T
        return self.target - drawn[np.arange(len(drawn)), self.row]

    def condensed(self) -> "Bilinear":
        """The same sums of squares, at any parameters and gains, in few equations, however many there are.

        A row of the system shares its ratios, so its equations may be turned among themselves: into a triangle of the
        columns that count in it, and the target.
        """
        parts = []
        for row in np.unique(self.row):
            table = np.column_stack([self.regressors, self.target])[self.row == row]
            live = np.flatnonzero(table.any(axis=0))
            if len(table) > len(live):
                upper: Floats = np.asarray(np.linalg.qr(table[:, live], mode="r"))
                table = np.zeros((len(upper), table.shape[1]))
                table[:, live] = upper
            parts.append((np.full(len(table), row), table))
        whole = np.vstack([table for _, table in parts])
        return Bilinear(np.concatenate([row for row, _ in parts]), whole[:, :-1], whole[:, -1], self.owners)

    def jacobian(self, gains: Gains, values: Floats) -> Floats:
        """(N, p + edges): derivative of the prediction by the parameters and by each edge of `gains`."""
        # The way from an owner to a row by an edge: from the owner up to its lower end, and from its upper end on;
        # where it does not lead there one of the two is unknown, and counts as zero.
        scales = np.nan_to_num(gains.scales())
        parts = self.regressors @ (values[:, None] * (self.owners[:, None] == np.arange(gains.n_rows)))
        by_edge = scales[:, gains.uppers][self.row] * (parts @ scales[gains.edges].T)
        return np.vstack([self.scaled(gains).T, by_edge.T]).T  # column after column, as large systems are


@dataclass(frozen=True, eq=False, slots=True)
class JointSolution:
    """Parameters (p,) and gains, with the least squares that led there over [values, edges], and the residual (N,)."""

    values: Floats
    gains: Gains
    linear: LeastSquares
    jacobian: Floats
    residual: Floats


def fit_bilinear(
    system: Bilinear,
    values: Floats,
    gains: Gains,
    *,
    limit: Floats | None = None,
    prior: Floats | None = None,
    centre: Floats | None = None,
    most_steps: int = MOST_STEPS,
) -> JointSolution:
    """Least squares over parameters and ratios together, from the recursion's solution.

    Steps are minimum-norm in directions that the data do not determine, so those keep their starting values; a step
    that lowers the sum of squares by less than the linearised system promises is damped, most where the data tell
    least. Edges that `gains` does not have stay unknown; `limit` is as for
    `least_squares`, over [values, edges]; `prior` (p + edges,) is the inverse of each one's prior standard deviation
    about `centre`, where not given of parameters about zero, of ratios about `USUAL_RATIO`, 0 where there is none. No
    steps only linearise at the start.

    Source: maximum likelihood for the bilinear model when the rows are whitened by their covariance; D. W. Marquardt,
    J. SIAM 11 (1963) 431-441, for the damped step; H. B. Nielsen, IMM-REP-1999-05 (DTU), for how it is damped next.
    """
    p, theta = len(values), np.concatenate([values, gains.ratios])
    held = np.zeros((0, len(theta))) if prior is None else np.diag(prior)[prior > 0.0]
    middle, small = np.repeat([0.0, USUAL_RATIO], [p, len(theta) - p]), system.condensed()
    middle = middle if centre is None else centre

    def residual(at: Floats) -> Floats:
        return np.concatenate([small.left(at[:p], gains.with_ratios(at[p:])), held @ (middle - at)])

    def step(at: Floats, off: Floats) -> LeastSquares:
        return least_squares(np.vstack([small.jacobian(gains.with_ratios(at[p:]), at[:p]), held]), off, limit=limit)

    off, damping = residual(theta), 0.0
    linear = step(theta, off)
    for _ in range(most_steps if len(linear.singular) else 0):
        square, weakest, strongest = float(off @ off), linear.singular[-1] ** 2, linear.singular[0] ** 2
        while True:
            move, promised = linear.damped(damping)
            moved = residual(theta + move)
            fall = square - float(moved @ moved)
            if fall >= TRUSTED * promised or promised <= CONVERGED * square or damping >= HARDEST * strongest:
                break
            damping = max(HARDER * damping, weakest)
        if fall <= 0.0:
            break
        theta, off = theta + move, moved
        linear = step(theta, off)
        if damping == 0.0 and fall < CONVERGED * square:
            break
        # After a step that fell short of its promise the next is damped alike: valleys are curved.
        damping = damping * max(1.0 / 3.0, 1.0 - (2.0 * fall / promised - 1.0) ** 3) if damping > weakest else 0.0
    gains = gains.with_ratios(theta[p:])
    return JointSolution(theta[:p], gains, linear, system.jacobian(gains, theta[:p]), system.left(theta[:p], gains))


def ratio_spread(system: Bilinear, values: Floats, gains: Gains) -> Floats:
    """(edges,) prior spread of each ratio: none where its own row shows it."""
    jacobian, out = system.jacobian(gains, values), []
    for number, (edge, row) in enumerate(zip(gains.edges, gains.uppers, strict=True)):
        columns = np.append(np.flatnonzero(system.owners == row), len(values) + number)
        alone = least_squares(jacobian[system.row == row][:, columns], system.target[system.row == row])
        error = float(np.linalg.norm(alone.half[-1])) if alone.determined[-1] else np.inf
        is_shown = error < RATIO_KNOWN or abs(gains.edge[edge]) > RATIO_SIGNIFICANT * error
        out.append(np.inf if is_shown else RATIO_SPREAD)
    return np.array(out)


def restarted(system: Bilinear, values: Floats, gains: Gains, *, limit: Floats, prior: Floats) -> tuple[Floats, Gains]:
    """The best of joint fits from the recursion's solution and from one with a ratio of another sign or size.

    Of few postures the recursion may take a ratio with the wrong sign, from which no downhill way leads to the truth.
    `system` is whitened by the noise inside runs; `limit` and `prior` are those of `fit_bilinear`.
    """
    system = system.condensed()
    best = fit_bilinear(system, values, gains, limit=limit, prior=prior)
    for number, ratio in itertools.product(range(len(gains.edges)), (None, *OTHER_RATIOS)):
        ratios = best.gains.ratios
        ratios[number] = -ratios[number] if ratio is None else ratio
        tried = best.gains.with_ratios(ratios)
        start = least_squares(system.scaled(tried), system.target, limit=limit[: len(values)]).values
        refined = fit_bilinear(system, start, tried, limit=limit, prior=prior)
        if refined.residual @ refined.residual < BETTER * (best.residual @ best.residual):
            best = refined
    return best.values, best.gains


def by_key(items: Iterable[Item], key: Callable[[Item], Key]) -> dict[Key, list[Item]]:
    """Items by their key, keys and items in the order in which they come."""
    groups = dict[Key, list[Item]]()
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return groups
