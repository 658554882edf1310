"""A run's equations: from its triangle, and from its bins where an effect does what the triangle does not know."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import CONSTANT_COLUMNS, Run, run_columns
from pumaid.lateness import doubts
from pumaid.records import Samples
from pumaid.robot import Robot
from pumaid.sight import FLAT, Sight

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, slots=True)
class Block:
    """A run reduced to as many equations as it can inform: (k, p) regressors, (k,) target, (k,) of the constant.

    `rest` is the sum of squares (A2) that no model of these columns can touch, `samples` the samples behind, `basis`
    (b, c) the triangle's regressors in the first b equations, `frame` (M, k - b) the directions in the run's weighted
    bins that the others are along, `inner` (p, p) the products of what columns do within bins, where no equation is,
    `peak` (p,) the largest size of columns that come from bins.
    """

    run: Run
    regressors: Floats
    target: Floats
    ones: Floats
    rest: float
    samples: int
    basis: Floats
    frame: Floats
    inner: Floats
    peak: Floats

    def beyond(self, values: Floats) -> float:
        """Sum of squares (A2) that (p,) values leave within the run where no equation tells of it."""
        return max(self.rest - float(values @ self.inner @ values), 0.0)


def of_triangles(
    robot: Robot, joint: int, runs: Sequence[Run], *, design: Callable[[Samples], Floats], noise: float | None = None
) -> Iterator[Block]:
    """Equations of runs of one joint and kind by columns that are combinations of their triangle's regressors.

    The combination is found by looking at the columns at a few instants that a run could contain.

    Parameters
    ----------
    robot
        The arm.
    joint
        That moves, from 1.
    runs
        All of one kind.
    design
        The columns (M, p) at M instants.
    noise
        A, of a sample: strokes are weighed by what an unknown delay does to them beside it. For fits, not for what a
        model leaves.
    """
    probes, basis = _probes(robot, joint, runs)
    columns = design(probes)
    inverse = np.linalg.pinv(basis, rcond=FLAT)
    one, p = CONSTANT_COLUMNS.index("one"), columns.shape[1]
    ways = inverse @ columns.reshape(len(runs), -1, p)
    factors = np.array([run.triangle.factor for run in runs])
    lefts, sizes, rights = np.linalg.svd(factors[:, :, :-1], full_matrices=False)
    late = doubts(robot, runs) if noise is not None else [None] * len(runs)
    each = zip(runs, factors[:, :, -1], lefts, sizes, rights, ways, late, strict=True)
    for run, current, left, singular, right, way, doubt in each:
        kept = singular > FLAT * max(float(singular[0]), 1e-300)
        base = singular[kept, None] * right[kept]
        target = left[:, kept].T @ current
        rest = float(current @ current - target @ target)
        if doubt is not None and noise is not None:
            own = np.sqrt(run.bins.count) * run.bins.current
            base, target, rest = doubt.over(noise).calmed(base, target, current=own, rest=rest)
        yield Block(
            run=run,
            regressors=base @ way,
            target=target,
            ones=base[:, one],
            rest=max(rest, 0.0),
            samples=run.samples,
            basis=base,
            frame=np.zeros((len(run.bins), 0)),
            inner=np.zeros((p, p)),
            peak=np.zeros(p),
        )


def of_bins(blocks: Sequence[Block], sight: Sight, *, columns: Floats, known: int) -> Iterator[Block]:
    """Equations of one joint's runs with more columns; what these do beyond the triangles gets equations of its own.

    Parameters
    ----------
    blocks
        Of the runs of `sight`, in their order.
    sight
        The bins.
    columns
        The new columns at its instants.
    known
        How many of the blocks' columns to keep.
    """
    along, rest = sight.split(columns)
    inside = sight.inside(columns, along)
    used, more = np.flatnonzero(rest.any(axis=0)), along.shape[2]
    inner = np.zeros((len(inside), known + more, known + more))
    inner[:, known:, known:] = inside
    peaks = np.maximum.reduceat(np.abs(columns), sight.grain * sight.starts, axis=0)
    for number, block in enumerate(blocks):
        here = slice(sight.starts[number], sight.starts[number] + sight.sizes[number])
        frame, upper = _orthonormal(rest[here][:, used])
        first, further = len(block.basis), len(upper)
        regressors = np.zeros((first + further, known + more))
        regressors[:first, :known] = block.regressors[:, :known]
        regressors[:first, known:] = block.basis @ along[number][: block.basis.shape[1]]
        regressors[first:, known + used] = upper
        target = frame.T @ sight.left[here]
        yield replace(
            block,
            regressors=regressors,
            target=np.concatenate([block.target, target]),
            ones=np.concatenate([block.ones, np.zeros(further)]),
            rest=max(block.rest - float(target @ target), 0.0),
            frame=frame,
            inner=inner[number],
            peak=np.concatenate([np.zeros(known), peaks[number]]),
        )


def padded(blocks: Sequence[Block], *, known: int, more: int) -> Iterator[Block]:
    """Equations with `more` columns of nothing after the first `known`."""
    size = known + more
    inner, peak = np.zeros((size, size)), np.zeros(size)
    for block in blocks:
        regressors = np.zeros((len(block.basis), size))
        regressors[:, :known] = block.regressors[: len(block.basis), :known]
        yield replace(block, regressors=regressors, inner=inner, peak=peak)


def _orthonormal(columns: Floats) -> tuple[Floats, Floats]:
    """(M, k) orthonormal columns and (k, p) parts of (M, p) columns along them; none where there is only rounding."""
    if not columns.any():
        return np.zeros((len(columns), 0)), np.zeros((0, columns.shape[1]))
    size = np.linalg.norm(columns, axis=0)
    left, singular, right = np.linalg.svd(columns / np.where(size > 0, size, 1.0), full_matrices=False)
    kept = singular > FLAT * singular[0]
    return left[:, kept], singular[kept, None] * right[kept] * size


def _probes(robot: Robot, joint: int, runs: Sequence[Run]) -> tuple[Samples, Floats]:
    """Instants that determine a column's combination of the triangle's regressors, and those regressors there.

    Returns samples of all runs one after another (R * K) and the basis (R, K, columns).
    """
    own, kind = joint - 1, runs[0].kind
    angle = np.array([0.3, 1.6, 2.9, 4.1, 5.2, 5.9])
    share = np.array([0.4, 1.3, 0.7, 1.7, 1.1, 0.2]) if kind == "stroke" else np.ones(6)
    pull = np.array([0.5, -0.8, 0.9, -0.1, 0.2, -0.6]) if kind == "stroke" else np.zeros(6)
    k = len(angle)
    posture = np.nan_to_num(np.array([run.posture for run in runs]))
    position = np.repeat(posture, k, axis=0)
    position[:, own] = np.tile(angle, len(runs))
    speed = np.array([run.speed for run in runs])
    velocity = np.zeros_like(position)
    velocity[:, own] = (speed[:, None] * share).ravel()
    acceleration = np.tile(pull, len(runs))
    direction = np.repeat(np.sign(speed), k)
    samples = Samples(joint, position, velocity, acceleration=acceleration, direction=direction)
    motion = (velocity[:, own], acceleration) if kind == "stroke" else None
    basis = run_columns(position[:, own], turns=robot.joint(joint).is_revolute, motion=motion)
    return samples, basis.reshape(len(runs), k, -1)
