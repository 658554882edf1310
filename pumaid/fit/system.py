"""The fit itself: the model's blocks as a block-triangular system, solved row by row and then all at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.maths import levels as variances
from pumaid.maths import rank
from pumaid.maths.joint_fit import Bilinear, JointSolution, fit
from pumaid.maths.levels import Levels
from pumaid.maths.recursion import LARGEST_RATIO, USUAL_RATIO, Gains, Recursion
from pumaid.model import Block, Model
from pumaid.records import Run

Floats = NDArray[np.float64]
Progress = Callable[[int, str], None]

#: Noise below this share of the RMS current is rounding: data without noise, whose weights would be infinite. Large
#: enough that rounding, thus weighted, says nothing about a parameter's plausible size.
EXACT = 1e-10

#: A ratio whose own row shows it neither to this standard error nor to `RATIO_SIGNIFICANT` standard errors is held
#: about one by `RATIO_SPREAD` in the joint fit. Neighbouring gains differ by up to about ten on published arms.
RATIO_KNOWN = 0.25
RATIO_SIGNIFICANT = 3.3
RATIO_SPREAD = 10.0

#: Cells of a run from which the correlation of its residual is read, three of them spent on its own first harmonic.
FEWEST_CELLS = 12
#: Correlation of neighbouring cells beyond which a residual is a trend: its long-run variance has no estimate.
MOST_CORRELATED = 0.98

#: Rounds of variances and joint fit: the second changes weights by well under a percent.
ROUNDS = 2


@dataclass(frozen=True, eq=False, slots=True)
class Row:
    """All runs of one joint: (R, k) constants, (R, k, p) regressors, (R, k) targets, zero where a run has fewer rows.

    `counts` (R,) are the true rows of each run, `rest` the sum of squares (A2) beyond the model's reach.
    """

    joint: int
    runs: tuple[Run, ...]
    ones: Floats
    regressors: Floats
    target: Floats
    counts: NDArray[np.int64]
    rest: float
    samples: int

    @classmethod
    def of(cls, joint: int, blocks: Sequence[Block]) -> Row:
        """Stack the blocks of one joint."""
        counts = np.array([len(block.target) for block in blocks])
        shape = (len(blocks), int(counts.max()))
        ones, target = np.zeros(shape), np.zeros(shape)
        regressors = np.zeros((*shape, blocks[0].regressors.shape[1]))
        for number, block in enumerate(blocks):
            rows = slice(0, counts[number])
            ones[number, rows], target[number, rows] = block.ones, block.target
            regressors[number, rows] = block.regressors
        rest, samples = sum(block.rest for block in blocks), sum(block.samples for block in blocks)
        return cls(joint, tuple(block.run for block in blocks), ones, regressors, target, counts, rest, samples)

    @property
    def stacked(self) -> Floats:
        """(R k, p) regressors."""
        return self.regressors.reshape(-1, self.regressors.shape[2])

    @property
    def mean_square(self) -> float:
        """Mean squared current, A2."""
        return (float(np.sum(self.target**2)) + self.rest) / max(self.samples, 1)


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
    system, solution, pull
        The final whitened rows, the fit over all of them, and the precision (edges,) of the prior on each ratio.
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
    run_of: NDArray[np.int64]
    limit: Floats

    @property
    def gains(self) -> Gains:
        """The ratios found."""
        return self.solution.gains

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


def solve(model: Model, runs: Sequence[Run], *, recursive: bool = False, progress: Progress | None = None) -> Fitted:
    """Recursion from the last joint to the first, then (unless `recursive`) all rows together.

    Each row is weighted by its own noise: a variance of samples and a variance of the level that a run shares.

    Source
    ------
    S.-K. Lin, Theorem 1, for the recursion; the refinement is maximum likelihood for the same system.
    """
    tell = progress or (lambda joint, text: None)
    moving = sorted({run.joint for run in runs}, reverse=True)
    assigned = assign(model, moving)
    owners = assigned[model.owners - 1]
    blocks = model.blocks(runs)
    rows = tuple(Row.of(joint, [block for block in blocks if block.run.joint == joint]) for joint in moving)
    # The paper's recursion, and beside it one whose weakly shown ratios cannot run off: that one starts the joint fit.
    recursion, start = Recursion(owners, model.robot.n_joints), Recursion(owners, model.robot.n_joints)
    levels: dict[int, Levels] = {}
    weak, limit = [], _limits(rows, model)
    is_load = np.array([column.effect == "gravity" for column in model.columns])
    for row in rows:
        tell(row.joint, "solving")
        design, _, _ = start.design(row.joint - 1, row.stacked)
        estimated = variances.estimate(row.ones, design.reshape(*row.target.shape, -1), row.target, counts=row.counts)
        if estimated is None:
            weak.append(row.joint)
            estimated = _from_inside(row)
        levels[row.joint] = _floored(estimated, row)
        white = variances.whiten(levels[row.joint], row.ones, _joined(row)).reshape(row.target.size, -1)
        recursion.take(row.joint - 1, white[:, :-1], white[:, -1], limit=limit)
        start.take(row.joint - 1, white[:, :-1], white[:, -1], limit=limit, spread=RATIO_SPREAD)
        _unstretch(start, row.joint - 1, is_load=is_load)
    first = _system(rows, levels, owners)
    gains, first_levels = recursion.gains, dict(levels)
    taken = fit(first, recursion.values, gains, limit=_with_edges(limit, gains), most_steps=0)
    system, solution, spread = first, taken, np.full(len(gains.edges), np.inf)
    if not recursive:
        tell(0, "refining all joints together")
        system, solution, spread = _refine(rows, levels, start, limit)
    runs_before = np.cumsum([0, *[len(row.runs) for row in rows]])
    run_of = np.concatenate(
        [
            before + np.repeat(np.arange(len(row.runs)), row.target.shape[1])
            for before, row in zip(runs_before, rows, strict=False)
        ]
    )
    absorbed = _absorbed(recursion, is_load)
    told = (model, rows, assigned, levels, first_levels, tuple(weak))
    return Fitted(*told, first, taken, absorbed, system, solution, 1.0 / spread**2, run_of, limit)


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
    rows: Sequence[Row], levels: dict[int, Levels], start: Recursion, limit: Floats
) -> tuple[Bilinear, JointSolution, Floats]:
    """Joint fit with weights from its own residuals, and the prior spread of its ratios; `levels` is updated."""
    values, gains, owners = start.values, start.gains, start.owners
    system = _system(rows, levels, owners)
    limit = _with_edges(limit, gains)
    spread = _spread(system, values, gains)
    for _ in range(ROUNDS):
        solution = fit(system, values, gains, limit=limit, spread=spread)
        values, gains = solution.values, solution.gains
        for row in rows:
            plain = Bilinear(np.full(row.target.size, row.joint - 1), row.stacked, row.target.ravel(), owners)
            jacobian = plain.jacobian(gains, values)
            edges = [len(values) + k for k, edge in enumerate(gains.edges) if gains.parent[edge] == row.joint - 1]
            own = np.concatenate([np.flatnonzero(owners == row.joint - 1), edges]).astype(int)
            residual = (plain.target - plain.scaled(gains) @ values).reshape(row.target.shape)
            design = jacobian[:, own].reshape(*row.target.shape, -1)
            estimated = variances.estimate(row.ones, design, residual, counts=row.counts)
            if estimated is not None:
                levels[row.joint] = _floored(estimated, row)
        system = _system(rows, levels, owners)
    return system, fit(system, values, gains, limit=limit, spread=spread), spread


def _spread(system: Bilinear, values: Floats, gains: Gains) -> Floats:
    """(edges,) prior spread of each ratio: none where its own row shows it."""
    jacobian, out = system.jacobian(gains, values), []
    for number, edge in enumerate(gains.edges):
        row = gains.parent[edge]
        here = system.row == row
        own = np.flatnonzero(system.owners == row)
        columns = np.column_stack([jacobian[here][:, own], jacobian[here][:, len(values) + number]])
        alone = rank.solve(columns, system.target[here])
        error = float(np.sqrt(alone.inverse[-1, -1])) if alone.determined[-1] else np.inf
        shown = error < RATIO_KNOWN or abs(gains.edge[edge]) > RATIO_SIGNIFICANT * error
        out.append(np.inf if shown else RATIO_SPREAD)
    return np.array(out)


def _joined(row: Row) -> Floats:
    """(R, k, p + 1): regressors and target side by side."""
    return np.concatenate([row.regressors, row.target[:, :, None]], axis=2)


def _system(rows: Sequence[Row], levels: dict[int, Levels], owners: NDArray[np.int64]) -> Bilinear:
    white = [variances.whiten(levels[row.joint], row.ones, _joined(row)).reshape(row.target.size, -1) for row in rows]
    stacked = np.vstack(white)
    number = np.concatenate([np.full(row.target.size, row.joint - 1) for row in rows])
    return Bilinear(number, stacked[:, :-1], stacked[:, -1], owners)


def _limits(rows: Sequence[Row], model: Model) -> Floats:
    """(p,) standard error at which each parameter, acting in full, is as uncertain as all that its joint drew."""
    drawn = {row.joint: float(np.sqrt(row.mean_square)) for row in rows}
    largest = max(drawn.values())
    speed, pull = dict.fromkeys(drawn, 0.0), dict.fromkeys(drawn, 0.0)
    for row in rows:
        speed[row.joint] = max(abs(run.speed) for run in row.runs)
        pull[row.joint] = max(float(np.max(np.abs(run.cells.acceleration), initial=0.0)) for run in row.runs)
    g = float(np.linalg.norm(model.robot.gravity))
    full = {"gravity": dict.fromkeys(range(1, model.robot.n_joints + 1), g), "viscous": speed, "inertia": pull}
    out = []
    for column in model.columns:
        in_full = full.get(column.effect, {}).get(column.owner, 1.0) or 1.0
        out.append(max(drawn.get(column.owner, largest), np.finfo(float).tiny) / in_full)
    return np.array(out)


def _with_edges(limit: Floats, gains: Gains) -> Floats:
    return np.concatenate([limit, np.full(len(gains.edges), LARGEST_RATIO)])


def _floored(levels: Levels, row: Row) -> Levels:
    return replace(levels, sample=max(levels.sample, EXACT**2 * row.mean_square, np.finfo(float).tiny ** 0.5))


def _from_inside(row: Row) -> Levels:
    """Variance of low-frequency noise from the course of the residual inside runs, where runs are too few to compare.

    The residual of a run's own fit is taken as first-order autoregressive over cells; its long-run variance a sample is
    variance x samples a cell x (1 + r) / (1 - r). The level that a run shares stays unknown (zero).
    """
    total, weight = 0.0, 0
    for run in row.runs:
        cells, own = run.cells, run.joint - 1
        q, current = cells.position[:, own], cells.current[:, own]
        basis = np.column_stack([np.cos(q), np.sin(q), np.ones(len(q)), cells.acceleration])
        if len(q) < FEWEST_CELLS:
            continue
        residual = current - basis @ np.linalg.lstsq(basis, current, rcond=1e-6)[0]
        square = float(residual @ residual)
        r = float(residual[1:] @ residual[:-1]) / square if square > 0 else 0.0
        r = min(max(r, 0.0), MOST_CORRELATED)
        total += square * float(np.mean(cells.count)) * (1.0 + r) / (1.0 - r)
        weight += len(q) - 3
    if weight == 0:
        return Levels(max(row.rest / max(row.samples - 3, 1), 0.0), 0.0, 1)
    return Levels(total / weight, 0.0, max(weight // 4, 1))
