"""All rows of the bilinear system at once: Gauss-Newton on parameters and ratios of gains."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.estimation.noise import Levels
from pumaid.maths import rank
from pumaid.maths.recursion import USUAL_RATIO, Gains

Floats = NDArray[np.float64]

#: Relative fall of the sum of squares below which another step is not worth taking.
CONVERGED = 1e-12
MOST_STEPS = 60

#: A ratio whose own row shows it neither to this standard error nor to `RATIO_SIGNIFICANT` standard errors is held
#: about one by `RATIO_SPREAD` in the joint fit. Neighbouring gains differ by up to about ten on published arms.
RATIO_KNOWN = 0.25
RATIO_SIGNIFICANT = 3.3
RATIO_SPREAD = 10.0

#: Noise of a joint between runs, over that inside them, beyond which the recursion is taken to have gone astray; ratios
#: from which the joint fit starts as well then; and the share of the sum of squares that they must get below.
ASTRAY, OTHER_RATIOS, BETTER = 10.0, (USUAL_RATIO, -USUAL_RATIO), 0.98


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
            here = self.row == row
            rows, target = self.regressors[here], self.target[here]
            own = np.flatnonzero(rows.any(axis=0))
            if len(rows) > len(own) + 1:
                upper: Floats = np.asarray(np.linalg.qr(np.column_stack([rows[:, own], target]), mode="r"))
                rows, target = np.zeros((len(upper), rows.shape[1])), upper[:, -1]
                rows[:, own] = upper[:, :-1]
            numbers.append(np.full(len(rows), row))
            regressors.append(rows)
            targets.append(target)
        return Bilinear(np.concatenate(numbers), np.vstack(regressors), np.concatenate(targets), self.owners)

    def jacobian(self, gains: Gains, values: Floats) -> Floats:
        """(N, p + edges): derivative of the prediction by the parameters and by each edge of `gains`."""
        scaled, edges = self.scaled(gains), gains.edges
        # The way from an owner to a row by an edge: from the owner up to its lower end, and from its upper end on;
        # where it does not lead there one of the two is unknown, and counts as zero.
        known = np.nan_to_num(gains.scales())
        parts = (self.regressors * values) @ (self.owners[:, None] == np.arange(gains.n_rows))
        uppers = [up for up in gains.parent if up is not None]
        return np.hstack([scaled, known[:, uppers][self.row] * (parts @ known[edges].T)])


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
        here = white.row == row
        own = np.flatnonzero(white.owners == row)
        columns = np.column_stack([jacobian[here][:, own], jacobian[here][:, len(values) + number]])
        alone = rank.solve(columns, white.target[here])
        error = float(np.sqrt(alone.inverse[-1, -1])) if alone.determined[-1] else np.inf
        shown = error < RATIO_KNOWN or abs(gains.edge[edge]) > RATIO_SIGNIFICANT * error
        out.append(np.inf if shown else RATIO_SPREAD)
    return np.array(out)


def is_astray(levels: Mapping[int, Levels], inside: Mapping[int, Levels]) -> bool:
    """Whether the recursion left some joint (from 1) with far more between runs than there is `inside` them."""
    return any(levels[joint].sample > ASTRAY * own.sample for joint, own in inside.items())


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
        known = rank.solve(white.scaled(tried), white.target, limit=limit[: len(values)]).values
        found = fit_bilinear(white, known, tried, limit=limit, spread=spread, held=held)
        if found.residual @ found.residual < BETTER * (best.residual @ best.residual):
            best = found
    return best.values, best.gains
