"""The runs of each joint as rows of one system, what their noise is taken for, and whitened by it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.chosen import scale_of
from pumaid.dataset import Run
from pumaid.equations import Block
from pumaid.maths import levels as variances
from pumaid.maths.joint_fit import Bilinear
from pumaid.maths.levels import Levels
from pumaid.model import Model
from pumaid.preprocessing.options import STROKE

Floats = NDArray[np.float64]

#: Share of the range that is physical by which a parameter is uncertain before any data.
QUARTER = 0.25

#: How much firmer than its prior a shape is held at a bound.
TIGHT = 1e6


@dataclass(frozen=True, eq=False, slots=True)
class Row:
    """All runs of one joint: (R, k) constants, (R, k, p) regressors, (R, k) targets, zero where a run has fewer rows.

    `counts` (R,) are the true rows of each run, `rests` (R,) the sums of squares (A2) beyond the model's reach; `inner`
    (p, p) and `peak` (p,) as of a `Block`.
    """

    joint: int
    runs: tuple[Run, ...]
    ones: Floats
    regressors: Floats
    target: Floats
    counts: NDArray[np.int64]
    rests: Floats
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
        rests, samples = np.array([block.rest for block in blocks]), sum(block.samples for block in blocks)
        inner = np.sum([block.inner for block in blocks], axis=0)
        peak = np.max([block.peak for block in blocks], axis=0)
        runs = tuple(block.run for block in blocks)
        return cls(joint, runs, ones, regressors, target, counts, rests, samples, inner, peak)

    def squares(self, values: Floats) -> float:
        """Sum of squares (A2), over all samples, that (p,) values in this joint's gain leave."""
        misfit = self.target - self.regressors @ values
        return float(np.sum(misfit**2)) + max(self.rest - float(values @ self.inner @ values), 0.0)

    @property
    def rest(self) -> float:
        """Sum of squares (A2) of all runs beyond the model's reach."""
        return float(self.rests.sum())

    @property
    def is_stroke(self) -> NDArray[np.bool_]:
        """(R,) runs from rest to rest.

        Their accelerations are smoothed differences of positions, and stand in for all that a change of speed does: in
        them the model misses by far more than where nothing is accelerated.
        """
        return np.array([run.kind == STROKE for run in self.runs], dtype=bool)

    def loudness(self, levels: Levels) -> Floats:
        """(R,) how many times the noise of a run at constant speed each run has."""
        return np.where(self.is_stroke, np.sqrt(levels.loud), 1.0)

    def quiet_ones(self, levels: Levels) -> Floats:
        """(R, k) constants of runs divided by how loud they are."""
        return np.asarray(self.ones / self.loudness(levels)[:, None])

    def whitened(self, levels: Levels, values: Floats) -> Floats:
        """(R k, q) of (R, k, q) by the joint's noise."""
        quiet = values / self.loudness(levels)[:, None, None]
        return variances.whiten(levels, self.quiet_ones(levels), quiet).reshape(self.target.size, -1)

    def white_rest(self, levels: Levels) -> float:
        """`rest` by the joint's noise."""
        return float(np.sum(self.rests / self.loudness(levels) ** 2)) / levels.sample

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
    white = [row.whitened(levels[row.joint], joined(row)) for row in rows]
    stacked = np.vstack(white)
    number = np.concatenate([np.full(row.target.size, row.joint - 1) for row in rows])
    return Bilinear(number, stacked[:, :-1], stacked[:, -1], owners)


def limits(rows: Sequence[Row], model: Model) -> Floats:
    """(p,) standard error at which each parameter, acting in full, is as uncertain as all that its joint drew."""
    drawn = {row.joint: float(np.sqrt(row.mean_square)) for row in rows}
    largest = max(drawn.values())
    most = {row.joint: _most(row.runs) for row in rows}
    speed, pull = ({joint: each[k] for joint, each in most.items()} for k in range(2))
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


def _most(runs: Sequence[Run]) -> tuple[float, float]:
    """Highest speed and largest acceleration of runs, rad/s and rad/s2 (m); at constant speed there is none."""
    pulls = (float(np.abs(run.bins.acceleration).max()) for run in runs if run.kind == STROKE)
    return max(abs(run.speed) for run in runs), max(pulls, default=0.0)


def _limit(model: Model, rows: Sequence[Row], index: int) -> float:
    """Of a parameter of a chosen effect, from what a unit of it draws; of a shape, how far it may go."""
    column = model.columns[index]
    if column.shape is not None and column.place is not None:
        one = model.effects[column.place]
        return scale_of(one.shapes(model.robot)[column.shape], one.choice.shape[column.shape])
    return plausible([(row, float(row.peak[index])) for row in rows], column.span)


def plausible(peaks: Sequence[tuple[Row, float]], span: float) -> float:
    """The size that a parameter of an effect may have before any data.

    Parameters
    ----------
    peaks
        Joints, and the most (A) that a unit of it draws there.
    span
        From the lowest to the highest value that is physical.
    """
    each = [max(float(np.sqrt(row.mean_square)), np.finfo(float).tiny) / peak for row, peak in peaks if peak > 0.0]
    return min(each + [QUARTER * span] * math.isfinite(span), default=1.0)


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
