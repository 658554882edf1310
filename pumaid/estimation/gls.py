"""The one weighted fit: bins of all joints, whitened by their noise, to parameters and ratios of gains."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pumaid.effect_spec import scale_of
from pumaid.effects import Scope
from pumaid.estimation import noise as noises
from pumaid.estimation.fit import (
    Fit,
    Row,
    Start,
    design_of,
    inner_noise,
    with_loads,
)
from pumaid.estimation.noise import Levels, NoiseModel
from pumaid.joint_bins import JointBins
from pumaid.maths import rank
from pumaid.maths.bilinear import (
    LARGEST_RATIO,
    RATIO_SPREAD,
    USUAL_RATIO,
    Bilinear,
    Gains,
    JointSolution,
    Recursion,
    fit_bilinear,
    prior_rows,
    restarted,
    spread_of,
)
from pumaid.model import DELAY, Model
from pumaid.preprocessing.options import STROKE

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]
Progress = Callable[[int, str], None]

#: Rounds of variances and joint fit: the second changes weights by well under a percent.
ROUNDS = 2
#: Step of a numerical derivative, as a share of the value.
STEP = 1e-4
#: Share of the range that is physical by which a parameter is uncertain before any data.
QUARTER = 0.25
#: How much firmer than its prior a shape is held at a bound.
TIGHT = 1e6
#: s, beside half a step of the log: what filters of drives and a fieldbus put between a current and its position.
LAG = 0.001
#: Noise of a joint between runs, over that inside them, beyond which the recursion is taken to have gone astray.
ASTRAY = 10.0


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
        stepped = [fitted.gains.with_edge(edge, size + way * step) for way in (1.0, -1.0)]
        rise = [drawn(replace(fitted, solution=replace(fitted.solution, gains=gains))) for gains in stepped]
        out[:, len(values) + k] = (rise[0] - rise[1]) / (2.0 * step)
    return out


def assign(model: Model, moving: Sequence[int]) -> Counts:
    """(J,) joint (from 0) in whose gain each link's parameters are when `moving` joints (from 1) have runs.

    A prismatic joint feels no weight but its own link's parameter.
    """
    turns = model.robot.is_revolute
    rows = [joint - 1 for joint in moving]
    felt_by = [[row for row in rows if row == link or (row < link and turns[row])] for link in range(len(turns))]
    return np.array([max(joints, default=-1) for joints in felt_by])


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
    rows = tuple(_row(model, joint, before) for joint in sorted(bins, key=lambda joint: -joint.joint))
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
        levels = noises.estimate(row.ones, design, row.target, counts=row.counts, is_loud=row.is_stroke)
        if levels is None:
            self.weak.append(row.joint)
            levels = Levels(row.slow, 0.0, max(int(row.bins.lengths.sum() - row.counts.sum()) // 4, 1))
        self.levels[row.joint] = floored(levels, row)
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
    chosen = [row.bins for row in before.rows] if bins is None else sorted(bins, key=lambda part: -part.joint)
    known_noise = dict(noise or {})
    if noise is None and bins is None and not is_renewed:
        known_noise = {row.joint: row.inner for row in before.rows}
    rows = tuple(_row(model, part, before, noise=known_noise.get(part.joint)) for part in chosen)
    levels = dict(before.levels)
    for joint, part in (noise or {}).items():
        levels[joint] = Levels(1.0, float(part.level[0]) ** 2, levels[joint].freedoms)
    owners = owners_of(model, before.assigned)
    limit = limits(rows, model)
    start = dict(zip(before.model.names, before.values, strict=True))
    values = np.array([0.0 if c.shape else start.get(c.name, 0.0) for c in model.columns])
    white, gains, held = system_of(rows, levels, owners), before.gains, priors(model, limit, is_tight=True)
    with np.errstate(divide="ignore"):
        spread = 1.0 / np.sqrt(before.pull)
    solution = fit_bilinear(white, values, gains, limit=reach_of(model, limit, gains), spread=spread, held=held)
    result = replace(before, model=model, rows=rows, levels=levels, system=white, solution=solution)
    repeated = frozenset(joint for joint, part in (noise or {}).items() if part.from_replicates)
    return replace(result, held=held, limit=limit, from_replicates=repeated)


def fit_with_replicates(model: Model, bins: Sequence[JointBins]) -> Fit:
    """A fit weighted by what repeated runs differ by, where there are enough of them, as tests of effects need it."""
    first = fit_bins(model, bins)
    return refit(first, model, noise={row.bins.joint: noises.noise_of(row.bins, row.misfit) for row in first.joints})


def releveled(fitted: Fit) -> Fit:
    """With each joint's noise as it is now that effects are in the model; the next fit is weighted by it."""
    owners = owners_of(fitted.model, fitted.assigned)
    levels = levels_of(fitted.rows, fitted.levels, fitted.values, gains=fitted.gains, owners=owners, held=fitted.held)
    return replace(fitted, levels=fitted.levels | levels)


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


def limits(rows: Sequence[Row], model: Model) -> Floats:
    """(p,) standard error at which each parameter, acting in full, is as uncertain as all that its joint drew."""
    drawn = {row.joint: float(np.sqrt(row.bins.mean_square)) for row in rows}
    speed = {row.joint: max(abs(run.speed) for run in row.bins.runs) for row in rows}
    pull = {row.joint: _hardest(row) for row in rows}
    g = float(np.linalg.norm(model.robot.gravity))
    full = {"gravity": dict.fromkeys(range(1, model.robot.n_joints + 1), g), "viscous": speed, "inertia": pull}
    out = []
    for index, column in enumerate(model.columns):
        if column.place is not None:
            out.append(_limit(model, rows, index))
        elif column.effect == DELAY:
            out.append(max((_delay(row) for row in rows if row.joint == column.owner), default=LAG))
        else:
            in_full = full.get(column.effect, {}).get(column.owner, 1.0) or 1.0
            out.append(max(drawn.get(column.owner, max(drawn.values())), np.finfo(float).tiny) / in_full)
    return np.array(out)


def _hardest(row: Row) -> float:
    """Largest acceleration of strokes, rad/s2 or m/s2."""
    pulls = np.abs(row.bins.samples.acceleration)[row.is_stroke[row.bins.run]]
    return float(pulls.max(initial=0.0))


def _delay(row: Row) -> float:
    """s, what a joint's delay in strokes may be before any data."""
    steps = [run.duration / max(run.samples, 1) for run in row.bins.runs if run.kind == STROKE]
    return 0.5 * float(np.mean(steps)) + LAG if steps else LAG


def _limit(model: Model, rows: Sequence[Row], index: int) -> float:
    """Of a parameter of an effect, from what a unit of it draws; of a shape, how far it may go."""
    column = model.columns[index]
    if column.shape is not None and column.place is not None:
        term = model.effects[column.place]
        return scale_of(term.shapes(model.robot)[column.shape], term.shape[column.shape])
    return plausible([(row.bins, float(np.abs(row.design[:, index]).max())) for row in rows], column.span)


def plausible(peaks: Sequence[tuple[JointBins, float]], span: float) -> float:
    """The size that a parameter of an effect may have before any data.

    Parameters
    ----------
    peaks
        Joints, and the most (A) that a unit of it draws there.
    span
        From the lowest to the highest value that is physical.
    """
    tiny = np.finfo(float).tiny
    sizes = [max(float(np.sqrt(bins.mean_square)), tiny) / peak for bins, peak in peaks if peak > 0.0]
    return min(sizes + [QUARTER * span] * math.isfinite(span), default=1.0)


def priors(model: Model, limit: Floats, *, is_tight: bool) -> Floats:
    """(h, p) a prior for each parameter of effects, and each delay: before any data it may be as large as its limit.

    The paper's parameters have none: what the data do not show of them is not identifiable. An effect's are held so
    that a shape at which it looks like the paper's model does not let it, and with it that model, run off.

    Parameters
    ----------
    model
        The model.
    limit
        (p,) as `limits` gives it.
    is_tight
        Whether shapes that are best at a bound are kept there.
    """
    columns = [(index, column) for index, column in enumerate(model.columns) if _has_prior(model, index)]
    out = np.zeros((len(columns), len(model.columns)))
    for row, (index, column) in zip(out, columns, strict=True):
        at_bound = column.place is not None and column.shape in model.effects[column.place].held
        row[index] = (TIGHT if is_tight and at_bound else 1.0) / limit[index]
    return out


def _has_prior(model: Model, index: int) -> bool:
    column = model.columns[index]
    return column.place is not None or column.effect == DELAY


def system_of(rows: Sequence[Row], levels: Mapping[int, Levels], owners: Counts) -> Bilinear:
    """The rows whitened by each joint's own noise."""
    stacked = np.vstack([row.whitened(levels[row.joint], row.joined) for row in rows])
    number = np.concatenate([np.full(row.target.size, row.joint - 1) for row in rows])
    return Bilinear(number, stacked[:, :-1], stacked[:, -1], owners)


def levels_of(
    rows: Sequence[Row],
    levels: Mapping[int, Levels],
    values: Floats,
    *,
    gains: Gains,
    owners: Counts,
    held: Floats,
) -> dict[int, Levels]:
    """Each joint's noise from what the fit leaves; without joints whose runs are too few to tell.

    What priors keep from fitting is left here, too: they count as equations with the noise that `levels` has.
    """
    out = {}
    for row in rows:
        plain = Bilinear(np.full(row.target.size, row.joint - 1), row.stacked, row.target.ravel(), owners)
        jacobian = plain.jacobian(gains, values)
        edges = [len(values) + k for k, edge in enumerate(gains.edges) if gains.parent[edge] == row.joint - 1]
        columns = np.concatenate([np.flatnonzero(owners == row.joint - 1), edges]).astype(int)
        residual = (plain.target - plain.scaled(gains) @ values).reshape(row.target.shape)
        design = jacobian[:, columns].reshape(*row.target.shape, -1)
        prior = held[np.any(held[:, columns[columns < len(values)]], axis=1)] * np.sqrt(levels[row.joint].sample)
        wide = np.hstack([prior, np.zeros((len(prior), len(gains.edges)))])[:, columns]
        estimated = _estimate(row, design, residual, prior=(wide, -prior @ values))
        if estimated is not None:
            out[row.joint] = floored(estimated, row)
    return out


def _estimate(row: Row, design: Floats, residual: Floats, *, prior: tuple[Floats, Floats]) -> Levels | None:
    """Noise of a joint from (R, k, q) and (R, k), with (h, q) and (h,) equations of priors as one run more."""
    extra, target = prior
    if not len(extra):
        return noises.estimate(row.ones, design, residual, counts=row.counts, is_loud=row.is_stroke)
    longer = max(row.target.shape[1], len(extra))

    def joined(values: Floats, last: Floats) -> Floats:
        out = np.zeros((len(values) + 1, longer, *values.shape[2:]))
        out[:-1, : values.shape[1]], out[-1, : len(last)] = values, last
        return out

    return noises.estimate(
        joined(row.ones, np.zeros(len(extra))),
        joined(design, extra),
        joined(residual, target),
        counts=np.append(row.counts, len(extra)),
        is_loud=np.append(row.is_stroke, False) if row.is_stroke.any() and not row.is_stroke.all() else None,
    )


def floored(levels: Levels, row: Row) -> Levels:
    """Never below what is rounding of the joint's current; and strokes as loud as all of them together are.

    What strokes have beyond noise, a model's misfit, comes again in each: however many there are, it does not average
    out, and they count as one. Strokes that are calmer (slow noise is less in short runs) lend that to no other run,
    and are not believed more for it.
    """
    spread = float(np.median(row.inner.spread))
    least = max(noises.EXACT**2 * row.bins.mean_square, np.finfo(float).tiny ** 0.5) / spread**2
    loud = 1.0 + max(levels.loud - 1.0, 0.0) * max(int(np.count_nonzero(row.is_stroke)), 1)
    return replace(levels, sample=max(levels.sample, least), loud=loud)


def reach_of(model: Model, limit: Floats, gains: Gains) -> Floats:
    """(p + edges,) standard errors that say nothing; what has a prior is never as uncertain as that."""
    has_prior = np.array([_has_prior(model, index) for index in range(len(model.columns))], dtype=bool)
    return np.concatenate([np.where(has_prior, 2.0 * limit, limit), np.full(len(gains.edges), LARGEST_RATIO)])


def is_astray(levels: Mapping[int, Levels], inside: Mapping[int, Levels]) -> bool:
    """Whether the recursion left some joint (from 1) with far more between runs than there is `inside` them."""
    return any(levels[joint].sample > ASTRAY * level.sample for joint, level in inside.items())
