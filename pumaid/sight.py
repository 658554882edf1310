"""Runs as effects see them, bin by bin, and what a column does inside each run beyond the run's triangle."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Run, run_columns
from pumaid.knots import COURSES, at, spread
from pumaid.lateness import axes
from pumaid.preprocessing.differentiate import acceleration as acceleration_of
from pumaid.records import Campaign, Loads, Samples
from pumaid.robot import Robot

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]

#: Instants inside a bin (shares of its width from its middle) and their weights: Gauss and Legendre's rule, exact
#: enough for the mean over a bin of a ripple with two bins a period.
NODES = np.sqrt(0.6) / 2.0 * np.array([-1.0, 0.0, 1.0])
WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18.0

#: Singular values of a run's basis below this share of its largest are rounding.
FLAT = 1e-10

#: What a column has beyond the basis of its run, below this share of its size, is rounding.
INSIDE = 1e-7


def samples_of(run: Run, campaign: Campaign, *, has_slope: bool = False) -> Samples:
    """A run's bins as what effects see; at constant speed the velocity is the run's own mean.

    Parameters
    ----------
    run
        M bins.
    campaign
        When its joint first moved.
    has_slope
        Whether the acceleration of a run at constant speed is the smooth second derivative of its positions, not zero.
    """
    bins, own = run.bins, run.joint - 1
    velocity = run.velocity
    acceleration = bins.acceleration
    if run.kind == "constant":
        velocity[:, own] = run.speed
        if has_slope:
            acceleration = acceleration_of(bins.time, bins.position[:, own])
    return Samples(
        run.joint,
        bins.position,
        velocity,
        acceleration=acceleration,
        direction=np.full(len(bins), float(run.direction)),
        time=campaign.since(run.joint, run.clock, bins.time),
        elapsed=campaign.since(0, run.clock, bins.time),
        travel=campaign.lead(run) + np.abs(bins.position[:, own] - run.span[0]),
        temperature=bins.temperature,
        run=np.zeros(len(bins)),
        extra=bins.extra,
    )


@dataclass(frozen=True, eq=False, slots=True)
class Sight:
    """All runs of one joint, ready for columns of any effect: (N,) bins in all, with g = 1 or 3 instants in each.

    Attributes
    ----------
    joint, runs
        R runs of one joint.
    samples
        g N instants: of each bin its middle, or three about it.
    weight
        (N,) root of the samples in each bin.
    starts
        (R,) first bin of each run.
    regressors
        (g N, k) of the triangle at the instants.
    basis
        (N, k) of each run orthonormal columns that span what its triangle knows, weighted; zero columns where it knows
        less.
    lift
        (R, k, k): parts along the basis to parts along the triangle's regressors.
    left
        (N,) weighted current (A) beyond the basis.
    has_slope
        Whether the acceleration of runs at constant speed is read from their positions.
    axis
        (N,) along which all that is weighted is shrunk where an unknown delay is more noise; zero where none is.
    """

    joint: int
    runs: tuple[Run, ...]
    samples: Samples
    weight: Floats
    starts: Counts
    regressors: Floats
    basis: Floats
    lift: Floats
    left: Floats
    axis: Floats
    has_slope: bool = False

    @classmethod
    def of(
        cls,
        robot: Robot,
        joint: int,
        runs: Sequence[Run],
        *,
        campaign: Campaign,
        has_slope: bool = False,
        is_fine: bool = True,
        noise: float | None = None,
    ) -> Sight:
        """The runs among `runs` in which `joint` moves; `is_fine` looks at three instants of each bin, not one.

        `noise` as of `equations.of_triangles`.
        """
        own = tuple(run for run in runs if run.joint == joint)
        middles = [samples_of(run, campaign, has_slope=has_slope) for run in own]
        samples = joined([_inside(*one) for one in zip(own, middles, strict=True)] if is_fine else middles)
        sizes = np.array([len(run.bins) for run in own])
        starts = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
        weight = np.sqrt(np.concatenate([run.bins.count for run in own]).astype(float))
        is_stroke = np.repeat([run.kind == "stroke" for run in own], len(samples) // len(weight) * sizes)
        instants = _regressors(robot, samples, is_stroke)
        regressors = averaged(instants, len(weight))
        axis = axes(robot, own, noise) if noise is not None and is_stroke.any() else np.zeros(len(weight))
        joint_current = np.concatenate([run.bins.current for run in own])
        joint_columns = np.column_stack([regressors, joint_current])
        weighted = _shrunk(weight[:, None] * joint_columns, axis, starts)
        basis, lift = np.zeros_like(regressors), np.zeros((len(own), regressors.shape[1], regressors.shape[1]))
        for number, (start, size) in enumerate(zip(starts, sizes, strict=True)):
            here = slice(start, start + size)
            left, singular, right = np.linalg.svd(weighted[here, :-1], full_matrices=False)
            kept = np.flatnonzero(singular > FLAT * max(float(singular[0]), 1e-300))
            basis[here, kept] = left[:, kept]
            lift[number][:, kept] = right[kept].T / singular[kept]
        current = weighted[:, -1]
        along = np.add.reduceat(basis * current[:, None], starts, axis=0)
        left_over = current - np.einsum("nk,nk->n", basis, np.repeat(along, sizes, axis=0))
        return cls(joint, own, samples, weight, starts, instants, basis, lift, left_over, axis, has_slope)

    @property
    def sizes(self) -> Counts:
        """(R,) bins of each run."""
        return np.diff(self.starts, append=len(self.weight))

    @property
    def grain(self) -> int:
        """Instants in each bin."""
        return len(self.samples) // len(self.weight)

    def with_loads(self, loads: Callable[[Samples], Loads]) -> Sight:
        """The same with what a fitted model says of gravity; `loads` is asked at a few instants of each run."""
        return replace(self, samples=replace(self.samples, loads=spread(self.samples, self.grain * self.sizes, loads)))

    def middles(self) -> Sight:
        """The same with one instant a bin: coarser for ripples near two bins a period, and three times quicker."""
        if self.grain == 1:
            return self
        rows = np.arange(1, len(self.samples), len(NODES))
        return replace(self, samples=at(self.samples, rows), regressors=self.regressors[rows])

    def split(self, columns: Floats) -> tuple[Floats, Floats]:
        """Columns at the instants as (R, k, p) parts along the triangle's regressors and (N, p) weighted rest."""
        bins = _shrunk(self.weight[:, None] * averaged(columns, len(self.weight)), self.axis, self.starts)
        size = np.sqrt(self.per_run(bins * bins))
        along = self.per_run(self.basis[:, :, None] * bins[:, None, :])
        rest = bins - np.einsum("nk,nkp->np", self.basis, np.repeat(along, self.sizes, axis=0))
        is_inside = np.sqrt(self.per_run(rest * rest)) <= INSIDE * size
        rest[np.repeat(is_inside, self.sizes, axis=0)] = 0.0
        return self.lift @ along, rest

    def inside(self, columns: Floats, along: Floats) -> Floats:
        """(R, p, p) summed products, over the samples, of what columns at the instants do within bins.

        Without what the triangle does there: (R, k, p) `along`, as `split` gives it.
        """
        if self.grain == 1:
            return np.zeros((len(self.runs), columns.shape[1], columns.shape[1]))
        own = np.empty_like(columns)
        instants = self._instants()
        for number, here in enumerate(instants):
            np.subtract(columns[here], self.regressors[here] @ along[number], out=own[here])
        off = own.reshape(len(self.weight), self.grain, -1) - averaged(own, len(self.weight))[:, None]
        weighted = (self.weight[:, None, None] * np.sqrt(WEIGHTS)[:, None] * off).reshape(own.shape)
        return np.array([weighted[here].T @ weighted[here] for here in instants])

    def _instants(self) -> list[slice]:
        """Where the instants of each run are."""
        ends = (self.grain * np.append(self.starts, len(self.weight))).tolist()
        return [slice(*pair) for pair in pairwise(ends)]

    def per_run(self, values: Floats) -> Floats:
        """(N, ...) summed over the bins of each run: (R, ...)."""
        return np.asarray(np.add.reduceat(values, self.starts, axis=0))


def _shrunk(values: Floats, axis: Floats, starts: Counts) -> Floats:
    """(N, p) weighted bins without the part along `axis` (N,) of each run."""
    if not axis.any():
        return values
    along = np.add.reduceat(axis[:, None] * values, starts, axis=0)
    return np.asarray(values - axis[:, None] * np.repeat(along, np.diff(starts, append=len(axis)), axis=0))


def averaged(values: Floats, bins: int) -> Floats:
    """(g N, ...) at the instants inside bins as (N, ...) means over the `bins`."""
    if len(values) == bins:
        return values
    parts = values.reshape(bins, len(NODES), *values.shape[1:])
    return np.asarray(np.tensordot(parts, WEIGHTS, axes=([1], [0])))


def joined(many: Sequence[Samples]) -> Samples:
    """Samples of one joint one after another, without loads; `run` counts them from 0."""
    if len(many) == 1:
        return replace(many[0], run=np.zeros(len(many[0])), loads=None)
    parts = {name: [getattr(samples, name) for samples in many] for name in COURSES}
    known: dict[str, Any] = {
        name: np.concatenate(part) for name, part in parts.items() if all(one is not None for one in part)
    }
    run = np.repeat(np.arange(float(len(many))), [len(samples) for samples in many])
    return replace(many[0], **known | {"run": run}, loads=None)


def _inside(run: Run, middle: Samples) -> Samples:
    """Three instants in each bin of a run."""
    bins, own = run.bins, run.joint - 1
    between = float(bins.count.sum()) - 0.5 * float(bins.count[0] + bins.count[-1])
    width = bins.count * (float(bins.time[-1] - bins.time[0]) / max(between, 1.0))
    # The mean of a few samples at equal steps is not quite that of their span; of a single one it is itself.
    ahead = ((width * np.sqrt(1.0 - 1.0 / bins.count**2))[:, None] * NODES).ravel()
    three: dict[str, Any] = {
        name: np.repeat(held, len(NODES), axis=0) for name in COURSES if (held := getattr(middle, name)) is not None
    }
    moved = three["velocity"][:, own] * ahead
    if run.kind == "stroke" and len(bins) > 1:
        three["velocity"][:, own] += three["acceleration"] * ahead
        three["acceleration"] += np.repeat(np.gradient(middle.acceleration, middle.time), len(NODES)) * ahead
    three["position"][:, own] += moved
    three["time"] += ahead
    three["elapsed"] += ahead
    three["travel"] = np.maximum(three["travel"] + run.direction * moved, 0.0)
    return replace(middle, **three)


def _regressors(robot: Robot, samples: Samples, is_stroke: NDArray[np.bool_]) -> Floats:
    """(3 N, k) of the triangle: three columns, five where there are strokes."""
    own = samples.joint - 1
    courses = np.where(is_stroke, [samples.velocity[:, own], samples.acceleration], 0.0)
    motion = (courses[0], courses[1]) if is_stroke.any() else None
    return run_columns(samples.position[:, own], turns=robot.joint(samples.joint).is_revolute, motion=motion)
