"""The fit itself: the model's blocks as a block-triangular system, solved row by row and then all at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Run
from pumaid.effects import Scope
from pumaid.equations import Block
from pumaid.estimation.noise import floored, from_inside, levels_of, of_strokes
from pumaid.estimation.ratios import RATIO_SPREAD, is_astray, restarted, spread_of
from pumaid.estimation.rows import Row, joined, limits, priors, rows_of, system
from pumaid.maths import levels as variances
from pumaid.maths import rank
from pumaid.maths.joint_fit import Bilinear, JointSolution, fit, prior_rows
from pumaid.maths.levels import Levels
from pumaid.maths.recursion import LARGEST_RATIO, USUAL_RATIO, Gains, Recursion
from pumaid.model import Model
from pumaid.preprocessing.options import STROKE

Floats = NDArray[np.float64]
Progress = Callable[[int, str], None]

#: Rounds of variances and joint fit: the second changes weights by well under a percent.
ROUNDS = 2


@dataclass(frozen=True, eq=False, slots=True)
class Fitted:
    """A fit before it is put into words.

    Attributes
    ----------
    model, rows
        The model, and a row for each joint that moves, outermost first.
    assigned
        (J,) joint (from 0) in whose gain link j's parameters are expressed: its own or, where that never moves, the
        next inner one that does and feels them; -1 where there is none.
    levels, first_levels
        Variances by joint (from 1), at the end and of the recursion.
    weak
        Joints whose level a run could not be estimated (too few runs).
    first_system, first
        The recursion: its whitened rows and its result, with the least squares over all rows there.
    absorbed
        By column (from 0) that the recursion leaves open: the ratios (i, j) of gains (joints from 1) whose loads it
        absorbs.
    system, solution
        The final whitened rows and the fit over all of them.
    pull, held
        Precision (edges,) of the prior on each ratio, and (h, p) of those on parameters, as for `joint_fit.fit`.
    run_of
        (N,) number of the run that each equation belongs to.
    limit
        (p,) standard error at which each parameter says nothing any more.
    """

    model: Model
    rows: tuple[Row, ...]
    assigned: NDArray[np.int64]
    levels: dict[int, Levels]
    first_levels: dict[int, Levels]
    weak: tuple[int, ...]
    first_system: Bilinear
    first: JointSolution
    absorbed: dict[int, list[tuple[int, int]]]
    system: Bilinear
    solution: JointSolution
    pull: Floats
    held: Floats
    run_of: NDArray[np.int64]
    limit: Floats

    @property
    def gains(self) -> Gains:
        """The ratios found."""
        return self.solution.gains

    def scales(self) -> Floats:
        """(J, J) eta_i / eta_j of links as the fit has them; NaN where unknown, 0 below the diagonal."""
        known = self.gains.scales()
        n = len(known)
        out = np.zeros((n, n))
        for i in range(n):
            for j in range(i, n):
                unit = int(self.assigned[j])
                out[i, j] = known[i, unit] if unit >= i else np.nan
        return out

    @property
    def first_values(self) -> Floats:
        """(p,) parameters by the recursion."""
        return self.first.values

    @property
    def first_gains(self) -> Gains:
        """Ratios by the recursion."""
        return self.first.gains


def assign(model: Model, moving: Sequence[int]) -> NDArray[np.int64]:
    """(J,) joint (from 0) in whose gain each link's parameters are when `moving` joints (from 1) have runs.

    A prismatic joint feels no weight but its own link's parameter.
    """
    turns = model.robot.is_revolute
    rows = [joint - 1 for joint in moving]
    felt_by = [[row for row in rows if row == link or (row < link and turns[row])] for link in range(len(turns))]
    return np.array([max(some, default=-1) for some in felt_by])


def owners_of(model: Model, assigned: NDArray[np.int64]) -> NDArray[np.int64]:
    """(p,) joint (from 0) in whose gain each column counts; -1 for one that acts on several joints in their own."""
    shared = [column.scope in (Scope.CAUSE, Scope.ARM) for column in model.columns]
    return np.where(shared, -1, assigned[model.owners - 1])


def solve(
    model: Model,
    runs: Sequence[Run],
    *,
    blocks: Sequence[Block] | None = None,
    gauge: Floats | None = None,
    recursive: bool = False,
    progress: Progress | None = None,
) -> Fitted:
    """Recursion from the last joint to the first, then (unless `recursive`) all rows together.

    Each row is weighted by its own noise: a variance of samples and a variance of the level that a run shares.

    Parameters
    ----------
    model
        What the currents are spent on.
    runs
        Of some or all joints.
    blocks
        Their equations by the model, where they are there already.
    gauge
        (h, p) sums of parameters that are 0 by convention.
    recursive
        Stop after the recursion.
    progress
        Called with the joint at work (0: all) and a word on what is done.

    Source
    ------
    S.-K. Lin, Theorem 1, for the recursion; the refinement is maximum likelihood for the same system.
    """
    tell = progress or (lambda joint, text: None)
    rows = rows_of(model.blocks(runs, noise=stroke_noise(model, runs)) if blocks is None else blocks)
    assigned = assign(model, [row.joint for row in rows])
    owners = owners_of(model, assigned)
    # The paper's recursion, and beside it one whose weakly shown ratios cannot run off: that one starts the joint fit.
    solved = np.where([column.shape is not None for column in model.columns], -1, owners)
    recursion, start = Recursion(solved, model.robot.n_joints), Recursion(solved, model.robot.n_joints)
    levels: dict[int, Levels] = {}
    weak, limit = [], limits(rows, model)
    is_load = np.array([column.effect == "gravity" for column in model.columns])
    for row in rows:
        tell(row.joint, "solving")
        design, _, _ = start.design(row.joint - 1, row.stacked)
        design = design.reshape(*row.target.shape, -1)
        estimated = variances.estimate(row.ones, design, row.target, counts=row.counts, is_loud=row.is_stroke)
        if estimated is None:
            weak.append(row.joint)
            estimated = from_inside(row)
        levels[row.joint] = floored(estimated, row)
        white = row.whitened(levels[row.joint], joined(row))
        recursion.take(row.joint - 1, white[:, :-1], white[:, -1], limit=limit)
        start.take(row.joint - 1, white[:, :-1], white[:, -1], limit=limit, spread=RATIO_SPREAD)
        _unstretch(start, row.joint - 1, is_load=is_load)
    first = system(rows, levels, owners)
    gains, first_levels = recursion.gains, dict(levels)
    reach = _reach(model, limit, gains)
    taken = fit(first, recursion.values, gains, limit=reach, most_steps=0)
    final, solution, spread = first, taken, np.full(len(gains.edges), np.inf)
    held = held_by(model, limit, gauge)
    if not recursive:
        tell(0, "refining all joints together")
        final, solution, spread = _refine(
            owners, rows, levels, start=start, limit=_reach(model, limit, start.gains), held=held
        )
    absorbed = _absorbed(recursion, is_load)
    told = (model, rows, assigned, levels, first_levels, tuple(weak))
    return Fitted(*told, first, taken, absorbed, final, solution, 1.0 / spread**2, held, _run_of(rows), limit)


def stroke_noise(model: Model, runs: Sequence[Run], *, alone: bool = False) -> dict[int, float]:
    """Joint (from 1) -> standard deviation of a sample of its strokes (A), what the model lacks in them included.

    By a fit that weighs no delay, against which a delay is then weighed: how strokes differ from each other and from
    runs at constant speed, and the course of what is left inside them, which tells what comes again in each.

    Parameters
    ----------
    model, runs
        As for `solve`.
    alone
        Whether joints that have nothing but strokes are among them. Left out, they are fitted such that they are missed
        by as little as can be: what else the model lacks in strokes would pass for a delay.
    """
    kinds: dict[int, set[str]] = {}
    for run in runs:
        kinds.setdefault(run.joint, set()).add(run.kind)
    joints = [joint for joint, own in kinds.items() if STROKE in own and (alone or len(own) > 1)]
    if not joints:
        return {}
    fitted = solve(model, runs, blocks=model.blocks(runs), recursive=True)
    out = {}
    for row in (row for row in fitted.rows if row.joint in joints):
        levels, inside = fitted.levels[row.joint], of_strokes(row)
        out[row.joint] = float(np.sqrt(max(levels.sample * levels.loud, inside)))
    return out


def held_by(model: Model, limit: Floats, gauge: Floats | None) -> Floats:
    """(h, p) priors on effects, shapes at a bound kept there, and sums that are 0 by convention."""
    own = priors(model, limit, is_tight=True)
    return own if gauge is None else np.vstack([own, gauge])


def eased(fitted: Fitted) -> Fitted:
    """With the errors that the fit has where shapes that are best at a bound are no better known than others."""
    free = priors(fitted.model, fitted.limit, is_tight=False)
    if len(free) == 0:
        return fitted
    held = np.vstack([free, fitted.held[len(free) :]])
    prior = prior_rows(held, np.sqrt(fitted.pull))
    rows = np.vstack([fitted.solution.jacobian, prior])
    target = np.concatenate([fitted.solution.residual, np.zeros(len(prior))])
    linear = rank.solve(rows, target, limit=_reach(fitted.model, fitted.limit, fitted.gains))
    return replace(fitted, held=held, solution=replace(fitted.solution, linear=linear))


def again(before: Fitted, model: Model, blocks: Sequence[Block], *, gauge: Floats | None = None) -> Fitted:
    """The joint fit of another model to the same runs, from where `before` ended and with its noise: a quick one.

    Parameters
    ----------
    before
        A fit of all joints.
    model
        The same arm with other effects, or the same ones with other shapes.
    blocks
        The runs' equations by `model`.
    gauge
        (h, p) sums of parameters that are 0 by convention.
    """
    rows, owners = rows_of(blocks), owners_of(model, before.assigned)
    limit = limits(rows, model)
    known = dict(zip(before.model.names, before.solution.values, strict=True))
    values = np.array([0.0 if c.shape else known.get(c.name, 0.0) for c in model.columns])
    white, gains, held = system(rows, before.levels, owners), before.gains, held_by(model, limit, gauge)
    with np.errstate(divide="ignore"):
        spread = 1.0 / np.sqrt(before.pull)
    solution = fit(white, values, gains, limit=_reach(model, limit, gains), spread=spread, held=held)
    found = replace(before, model=model, rows=rows, run_of=_run_of(rows), limit=limit)
    return replace(found, system=white, solution=solution, held=held)


def _run_of(rows: Sequence[Row]) -> NDArray[np.int64]:
    """(N,) number of the run that each equation belongs to."""
    before = np.cumsum([0, *[len(row.runs) for row in rows]])
    parts = zip(before, rows, strict=False)
    return np.concatenate([n + np.repeat(np.arange(len(row.runs)), row.target.shape[1]) for n, row in parts])


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
    owners: NDArray[np.int64],
    rows: Sequence[Row],
    levels: dict[int, Levels],
    *,
    start: Recursion,
    limit: Floats,
    held: Floats,
) -> tuple[Bilinear, JointSolution, Floats]:
    """Joint fit with weights from its own residuals, and the prior spread of its ratios; `levels` is updated."""
    inside = {row.joint: floored(from_inside(row), row) for row in rows}
    values, gains = start.values, start.gains
    if is_astray(levels, inside):
        values, gains = restarted(system(rows, inside, owners), values, gains, limit=limit, held=held)
        levels.update(levels_of(rows, levels, values, gains=gains, owners=owners, held=held))
    white = system(rows, levels, owners)
    spread = spread_of(white, values, gains)
    for _ in range(ROUNDS):
        solution = fit(white, values, gains, limit=limit, spread=spread, held=held)
        values, gains = solution.values, solution.gains
        levels.update(levels_of(rows, levels, values, gains=gains, owners=owners, held=held))
        white = system(rows, levels, owners)
    return white, fit(white, values, gains, limit=limit, spread=spread, held=held), spread


def releveled(fitted: Fitted) -> Fitted:
    """With each joint's noise as it is now that effects are in the model; the next fit is weighted by it."""
    solution, owners = fitted.solution, owners_of(fitted.model, fitted.assigned)
    found = levels_of(fitted.rows, fitted.levels, solution.values, gains=fitted.gains, owners=owners, held=fitted.held)
    return replace(fitted, levels=fitted.levels | found)


def _reach(model: Model, limit: Floats, gains: Gains) -> Floats:
    """(p + edges,) standard errors that say nothing; what has a prior is never as uncertain as that."""
    has_prior = np.array([column.place is not None for column in model.columns], dtype=bool)
    return np.concatenate([np.where(has_prior, 2.0 * limit, limit), np.full(len(gains.edges), LARGEST_RATIO)])
