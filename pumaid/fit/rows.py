"""The runs of each joint as rows of one system, what their noise is taken for, and whitened by it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.chosen import scale_of
from pumaid.equations import Block
from pumaid.maths import levels as variances
from pumaid.maths.joint_fit import Bilinear
from pumaid.maths.levels import Levels
from pumaid.model import Model
from pumaid.records import Run

Floats = NDArray[np.float64]

#: Noise below this share of the RMS current is rounding: data without noise, whose weights would be infinite. Large
#: enough that rounding, thus weighted, says nothing about a parameter's plausible size.
EXACT = 1e-10

#: Share of the range that is physical by which a parameter is uncertain before any data.
QUARTER = 0.25

#: How much firmer than its prior a shape is held at a bound.
TIGHT = 1e6

#: Cells of a run from which the correlation of its residual is read, three of them spent on its own first harmonic.
FEWEST_CELLS = 12
#: Correlation of neighbouring cells beyond which a residual is a trend: its long-run variance has no estimate.
MOST_CORRELATED = 0.98


@dataclass(frozen=True, eq=False, slots=True)
class Row:
    """All runs of one joint: (R, k) constants, (R, k, p) regressors, (R, k) targets, zero where a run has fewer rows.

    `counts` (R,) are the true rows of each run, `rest` the sum of squares (A2) beyond the model's reach; `inner` (p, p)
    and `peak` (p,) as of a `Block`.
    """

    joint: int
    runs: tuple[Run, ...]
    ones: Floats
    regressors: Floats
    target: Floats
    counts: NDArray[np.int64]
    rest: float
    samples: int
    inner: Floats
    peak: Floats

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
        inner = np.sum([block.inner for block in blocks], axis=0)
        peak = np.max([block.peak for block in blocks], axis=0)
        runs = tuple(block.run for block in blocks)
        return cls(joint, runs, ones, regressors, target, counts, rest, samples, inner, peak)

    def squares(self, values: Floats) -> float:
        """Sum of squares (A2), over all samples, that (p,) values in this joint's gain leave."""
        misfit = self.target - self.regressors @ values
        return float(np.sum(misfit**2)) + max(self.rest - float(values @ self.inner @ values), 0.0)

    @property
    def stacked(self) -> Floats:
        """(R k, p) regressors."""
        return self.regressors.reshape(-1, self.regressors.shape[2])

    @property
    def mean_square(self) -> float:
        """Mean squared current, A2."""
        return (float(np.sum(self.target**2)) + self.rest) / max(self.samples, 1)


def joined(row: Row) -> Floats:
    """(R, k, p + 1): regressors and target side by side."""
    return np.concatenate([row.regressors, row.target[:, :, None]], axis=2)


def rows_of(blocks: Sequence[Block]) -> tuple[Row, ...]:
    """A row for each joint that moves, outermost first."""
    moving = sorted({block.run.joint for block in blocks}, reverse=True)
    return tuple(Row.of(joint, [block for block in blocks if block.run.joint == joint]) for joint in moving)


def system(rows: Sequence[Row], levels: Mapping[int, Levels], owners: NDArray[np.int64]) -> Bilinear:
    """The rows whitened by each joint's own noise."""
    white = [variances.whiten(levels[row.joint], row.ones, joined(row)).reshape(row.target.size, -1) for row in rows]
    stacked = np.vstack(white)
    number = np.concatenate([np.full(row.target.size, row.joint - 1) for row in rows])
    return Bilinear(number, stacked[:, :-1], stacked[:, -1], owners)


def limits(rows: Sequence[Row], model: Model) -> Floats:
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
    for index, column in enumerate(model.columns):
        if column.place is not None:
            out.append(_limit(model, rows, index))
            continue
        in_full = full.get(column.effect, {}).get(column.owner, 1.0) or 1.0
        out.append(max(drawn.get(column.owner, largest), np.finfo(float).tiny) / in_full)
    return np.array(out)


def _limit(model: Model, rows: Sequence[Row], index: int) -> float:
    """Of a parameter of a chosen effect, from what a unit of it draws; of a shape, how far it may go."""
    column = model.columns[index]
    if column.shape is not None and column.place is not None:
        one = model.effects[column.place]
        return scale_of(one.shapes(model.robot)[column.shape], one.choice.shape[column.shape])
    drawn = [(float(np.sqrt(row.mean_square)), float(row.peak[index])) for row in rows]
    each = [max(size, np.finfo(float).tiny) / peak for size, peak in drawn if peak > 0.0]
    return min(each + [QUARTER * column.span] * math.isfinite(column.span), default=1.0)


def priors(model: Model, limit: Floats, *, is_tight: bool) -> Floats:
    """(h, p) a prior for each parameter of chosen effects: before any data it may be as large as its limit.

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
    columns = [(index, column) for index, column in enumerate(model.columns) if column.place is not None]
    out = np.zeros((len(columns), len(model.columns)))
    for row, (index, column) in zip(out, columns, strict=True):
        at_bound = column.place is not None and column.shape in model.effects[column.place].held
        row[index] = (TIGHT if is_tight and at_bound else 1.0) / limit[index]
    return out


def floored(levels: Levels, row: Row) -> Levels:
    """Never below what is rounding of the joint's current."""
    return replace(levels, sample=max(levels.sample, EXACT**2 * row.mean_square, np.finfo(float).tiny ** 0.5))


def from_inside(row: Row) -> Levels:
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
