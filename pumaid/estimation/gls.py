"""The one weighted fit: bins of all joints, whitened by their noise, to parameters and ratios of gains."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pumaid.effects import Scope
from pumaid.estimation import noise as noises
from pumaid.estimation.bilinear import (
    RATIO_SPREAD,
    Bilinear,
    JointSolution,
    fit_bilinear,
    is_astray,
    prior_rows,
    restarted,
    spread_of,
)
from pumaid.estimation.fit import (
    Fit,
    Start,
    design_of,
    with_loads,
)
from pumaid.estimation.noise import Levels, NoiseModel
from pumaid.estimation.rows import Row, floored, inner_noise, levels_of, limits, priors, reach_of, system_of
from pumaid.joint_bins import JointBins
from pumaid.maths import rank
from pumaid.maths.recursion import USUAL_RATIO, Recursion
from pumaid.model import DELAY, Model

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]
Progress = Callable[[int, str], None]

#: Rounds of variances and joint fit: the second changes weights by well under a percent.
ROUNDS = 2
#: Step of a numerical derivative, as a share of the value.
STEP = 1e-4


def with_chain_rule(fitted: Fit) -> Fit:
    """With errors that know that effects of the load move with the parameters and ratios that make the load.

    A payload felt by an inner joint is its mass times a ratio of gains: where the ratio is not known well, the mass is
    not, either.
    """
    if not fitted.model.needs_loads():
        return fitted
    rows = tuple(
        Row.of(row.bins, row.design, row.inner, moved=_moved_through_loads(fitted, row.bins), slow=row.slow)
        if any(term.effect.needs_loads and term.touches(row.joint) for term in fitted.model.effects)
        else row
        for row in fitted.rows
    )
    system = system_of(rows, fitted.levels, fitted.system.owners)
    jacobian = system.jacobian(fitted.gains, fitted.values)
    start = 0
    for row in rows:
        if row.moved is not None:
            jacobian[start : start + row.target.size] += row.whitened(fitted.levels[row.joint], row.moved)
        start += row.target.size
    residual = system.target - system.scaled(fitted.gains) @ fitted.values
    prior = prior_rows(fitted.held, np.sqrt(fitted.pull))
    target = np.concatenate([residual, np.zeros(len(prior))])
    limit = reach_of(fitted.model, fitted.limit, fitted.gains)
    linear = rank.solve(np.vstack([jacobian, prior]), target, limit=limit)
    solution = replace(fitted.solution, linear=linear, jacobian=jacobian, residual=residual)
    return replace(fitted, rows=rows, system=system, solution=solution)


def _moved_through_loads(fitted: Fit, bins: JointBins) -> Floats:
    """(N, P) derivative of what effects of the load draw, by what the load is made of."""
    model, values, edges = fitted.model, fitted.values, fitted.gains.edges
    terms = [(place, t) for place, t in enumerate(model.effects) if t.effect.needs_loads and t.touches(bins.joint)]
    sizes = {
        place: np.array([v for c, v in zip(model.columns, values, strict=True) if c.place == place and not c.shape])
        for place, _ in terms
    }

    def drawn(found: Fit) -> Floats:
        samples = with_loads(found, bins.samples, bins.lengths)
        return np.sum([term.linear(model.robot, samples) @ sizes[place] for place, term in terms], axis=0)

    out = np.zeros((len(bins), len(values) + len(edges)))
    for n, column in enumerate(model.columns):
        if column.place is None and (column.effect == "gravity" or column.owner == bins.joint):
            step = STEP * max(abs(values[n]), STEP * fitted.limit[n])
            moves = [way * step * np.eye(len(values))[n] for way in (1.0, -1.0)]
            rise = [drawn(replace(fitted, solution=replace(fitted.solution, values=values + move))) for move in moves]
            out[:, n] = (rise[0] - rise[1]) / (2.0 * step)
    for k, edge in enumerate(edges):
        size = fitted.gains.edge[edge]
        step = STEP * max(abs(size), STEP)
        some = [fitted.gains.with_edge(edge, size + way * step) for way in (1.0, -1.0)]
        rise = [drawn(replace(fitted, solution=replace(fitted.solution, gains=gains))) for gains in some]
        out[:, len(values) + k] = (rise[0] - rise[1]) / (2.0 * step)
    return out


def assign(model: Model, moving: Sequence[int]) -> Counts:
    """(J,) joint (from 0) in whose gain each link's parameters are when `moving` joints (from 1) have runs.

    A prismatic joint feels no weight but its own link's parameter.
    """
    turns = model.robot.is_revolute
    rows = [joint - 1 for joint in moving]
    felt_by = [[row for row in rows if row == link or (row < link and turns[row])] for link in range(len(turns))]
    return np.array([max(some, default=-1) for some in felt_by])


def owners_of(model: Model, assigned: Counts) -> Counts:
    """(p,) joint (from 0) in whose gain each column counts; -1 for one that acts on several joints in their own."""
    shared = [column.scope in (Scope.CAUSE, Scope.ARM) for column in model.columns]
    return np.where(shared, -1, assigned[model.owners - 1])


def fit_bins(
    model: Model,
    bins: Sequence[JointBins],
    *,
    before: Fit | None = None,
    recursive: bool = False,
    progress: Progress | None = None,
) -> Fit:
    """Recursion from the last joint to the first, then (unless `recursive`) all rows together.

    Each row is weighted by its own noise: correlated bins, and the level that a run shares.

    Parameters
    ----------
    model
        What the currents are spent on.
    bins
        Of some or all joints.
    before
        An earlier fit, by whose loads effects of the load are made.
    recursive
        Stop after the recursion.
    progress
        Called with the joint at work (0: all) and a word on what is done.

    Source
    ------
    S.-K. Lin, Theorem 1, for the recursion; the refinement is maximum likelihood for the same system.
    """
    tell = progress or (lambda joint, text: None)
    rows = tuple(_row(model, one, before) for one in sorted(bins, key=lambda one: -one.joint))
    assigned = assign(model, [row.joint for row in rows])
    owners = owners_of(model, assigned)
    limit, start = limits(rows, model), _Beginning(model, owners)
    for row in rows:
        tell(row.joint, "solving")
        start.take(row, limit)
    system, gains = system_of(rows, start.levels, owners), start.paper.gains
    solution = fit_bilinear(system, start.paper.values, gains, limit=reach_of(model, limit, gains), most_steps=0)
    first = Start(rows, dict(start.levels), system, solution, _absorbed(start.paper, start.is_load))
    held, levels = priors(model, limit, is_tight=True), dict(start.levels)
    pull = np.zeros(len(gains.edges))
    if not recursive:
        tell(0, "refining all joints together")
        system, solution, spread = _refine(owners, rows, levels, start=start.joint, limit=limit, held=held, model=model)
        pull = 1.0 / spread**2
    return Fit(model, rows, assigned, levels, tuple(start.weak), system, solution, pull, held, limit, first)


def _row(model: Model, bins: JointBins, before: Fit | None, *, noise: NoiseModel | None = None) -> Row:
    design = design_of(model, bins, before)
    inner, slow = (noise, 1.0) if noise is not None else inner_noise(bins, design)
    return Row.of(bins, design, inner, slow=slow)


class _Beginning:
    """The paper's recursion, and one whose weakly shown ratios cannot run off, which starts the joint fit."""

    def __init__(self, model: Model, owners: Counts) -> None:
        columns = model.columns
        solved = np.where([column.shape is not None or column.effect == DELAY for column in columns], -1, owners)
        self.paper, self.joint = (Recursion(solved, model.robot.n_joints) for _ in range(2))
        self.is_load = np.array([column.effect == "gravity" for column in columns])
        self.levels: dict[int, Levels] = {}
        self.weak: list[int] = []

    def take(self, row: Row, limit: Floats) -> None:
        """Solve one row; every later row that has data must have been taken."""
        design, _, _ = self.joint.design(row.joint - 1, row.stacked)
        design = design.reshape(*row.target.shape, -1)
        found = noises.estimate(row.ones, design, row.target, counts=row.counts, is_loud=row.is_stroke)
        if found is None:
            self.weak.append(row.joint)
            found = Levels(row.slow, 0.0, max(int(row.bins.lengths.sum() - row.counts.sum()) // 4, 1))
        self.levels[row.joint] = floored(found, row)
        white = row.whitened(self.levels[row.joint], row.joined)
        self.paper.take(row.joint - 1, white[:, :-1], white[:, -1], limit=limit)
        self.joint.take(row.joint - 1, white[:, :-1], white[:, -1], limit=limit, spread=RATIO_SPREAD)
        _unstretch(self.joint, row.joint - 1, is_load=self.is_load)


def eased(fitted: Fit) -> Fit:
    """With the errors that the fit has where shapes that are best at a bound are no better known than others."""
    free = priors(fitted.model, fitted.limit, is_tight=False)
    if len(free) == 0:
        return fitted
    prior = prior_rows(free, np.sqrt(fitted.pull))
    rows = np.vstack([fitted.solution.jacobian, prior])
    target = np.concatenate([fitted.solution.residual, np.zeros(len(prior))])
    linear = rank.solve(rows, target, limit=reach_of(fitted.model, fitted.limit, fitted.gains))
    return replace(fitted, held=free, solution=replace(fitted.solution, linear=linear))


def refit(
    before: Fit,
    model: Model,
    *,
    bins: Sequence[JointBins] | None = None,
    noise: Mapping[int, NoiseModel] | None = None,
    is_renewed: bool = False,
) -> Fit:
    """The joint fit of another model, from where `before` ended and with its variances: a quick one.

    Parameters
    ----------
    before
        A fit of all joints.
    model
        The same arm with other effects, or the same ones with other shapes.
    bins
        The runs, where not those of `before`.
    noise
        By joint (from 1), to weight the fit by; as before where not given.
    is_renewed
        Whether the noise inside runs is estimated anew, by what the other model leaves of each.
    """
    chosen = [row.bins for row in before.rows] if bins is None else sorted(bins, key=lambda one: -one.joint)
    known_noise = dict(noise or {})
    if noise is None and bins is None and not is_renewed:
        known_noise = {row.joint: row.inner for row in before.rows}
    rows = tuple(_row(model, one, before, noise=known_noise.get(one.joint)) for one in chosen)
    levels = dict(before.levels)
    if noise is not None:
        levels = {joint: Levels(1.0, float(one.level[0]) ** 2, levels[joint].freedoms) for joint, one in noise.items()}
    owners = owners_of(model, before.assigned)
    limit = limits(rows, model)
    known = dict(zip(before.model.names, before.values, strict=True))
    values = np.array([0.0 if c.shape else known.get(c.name, 0.0) for c in model.columns])
    white, gains, held = system_of(rows, levels, owners), before.gains, priors(model, limit, is_tight=True)
    with np.errstate(divide="ignore"):
        spread = 1.0 / np.sqrt(before.pull)
    solution = fit_bilinear(white, values, gains, limit=reach_of(model, limit, gains), spread=spread, held=held)
    found = replace(before, model=model, rows=rows, levels=levels, system=white, solution=solution)
    repeated = frozenset(joint for joint, one in (noise or {}).items() if one.from_replicates)
    return replace(found, held=held, limit=limit, from_replicates=repeated)


def fit_with_replicates(model: Model, bins: Sequence[JointBins]) -> Fit:
    """A fit weighted by what repeated runs differ by, where there are enough of them, as tests of effects need it."""
    first = fit_bins(model, bins)
    return refit(first, model, noise={row.bins.joint: noises.noise_of(row.bins, row.misfit) for row in first.joints})


def releveled(fitted: Fit) -> Fit:
    """With each joint's noise as it is now that effects are in the model; the next fit is weighted by it."""
    owners = owners_of(fitted.model, fitted.assigned)
    found = levels_of(fitted.rows, fitted.levels, fitted.values, gains=fitted.gains, owners=owners, held=fitted.held)
    return replace(fitted, levels=fitted.levels | found)


def _unstretch(start: Recursion, row: int, *, is_load: NDArray[np.bool_]) -> None:
    """Where only the product of a ratio and its load is known, share it out so that the ratio is a usual one.

    The load's own row cannot tell it (from friction, say) and gave it any size, perhaps next to none.
    """
    gains = start.gains
    for root in [edge for edge in gains.edges if gains.parent[edge] == row and abs(gains.edge[edge]) > RATIO_SPREAD]:
        below = [member for member in range(gains.n_rows) if root in gains.path(member)]
        load = np.isin(start.owners, below) & is_load
        if np.all(start.undetermined[load] | (start.values[load] == 0.0)):
            start.values[load] *= gains.edge[root]
            gains.edge[root] = USUAL_RATIO


def _absorbed(recursion: Recursion, is_load: NDArray[np.bool_]) -> dict[int, list[tuple[int, int]]]:
    """Columns left open by their own row; and weights of rows that were solved with an open load taken for known."""
    gains, owners = recursion.gains, recursion.owners
    lost = {row: [(r + 1, root + 1) for r, root in recursion.redundant if r == row] for row, _ in recursion.redundant}
    is_open = recursion.undetermined.copy()
    for edge in sorted(gains.edges, reverse=True):
        below = [row for row in range(gains.n_rows) if edge in gains.path(row)]
        if np.any(is_open & is_load & np.isin(owners, below)):
            is_open |= is_load & (owners == gains.parent[edge])
    return {int(n): lost.get(int(owners[n]), []) for n in np.flatnonzero(is_open)}


def _refine(
    owners: Counts,
    rows: Sequence[Row],
    levels: dict[int, Levels],
    *,
    start: Recursion,
    limit: Floats,
    held: Floats,
    model: Model,
) -> tuple[Bilinear, JointSolution, Floats]:
    """Joint fit with weights from its own residuals, and the prior spread of its ratios; `levels` is updated."""
    values, gains = start.values, start.gains
    reach = reach_of(model, limit, gains)
    inside = {row.joint: floored(Levels(row.slow, 0.0, levels[row.joint].freedoms), row) for row in rows}
    if is_astray(levels, inside):
        values, gains = restarted(system_of(rows, inside, owners), values, gains, limit=reach, held=held)
        levels.update(levels_of(rows, levels, values, gains=gains, owners=owners, held=held))
    white = system_of(rows, levels, owners)
    spread = spread_of(white, values, gains)
    for _ in range(ROUNDS):
        solution = fit_bilinear(white, values, gains, limit=reach, spread=spread, held=held)
        values, gains = solution.values, solution.gains
        levels.update(levels_of(rows, levels, values, gains=gains, owners=owners, held=held))
        white = system_of(rows, levels, owners)
    return white, fit_bilinear(white, values, gains, limit=reach, spread=spread, held=held), spread
