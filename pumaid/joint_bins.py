"""The runs of one joint as one table of bins: what every fit and every test of a fit is computed from."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Bins, Campaign, Run, coarser
from pumaid.kinematics import apart, grouped
from pumaid.preprocessing.differentiate import acceleration
from pumaid.preprocessing.options import CONSTANT
from pumaid.preprocessing.replicates import replicates
from pumaid.robot import Robot
from pumaid.samples import Extent, Loads, Samples

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]

#: Bins a run at which slow effects are looked for: 64 periods of a position-dependent effect, four times finer than
#: the narrowest presliding that a ramp leaves visible; and at which periodic ones are.
COARSE, FINE = 128, 512

#: s at either end of a run at constant speed that are left out, and the most of its duration that this may be: the
#: steep part of the transient in which the speed settles, and the first samples of the next ramp.
SETTLING, MOST_SETTLING = 0.03, 0.2
#: Bins below which a run is taken as it is.
FEWEST_SETTLED = 20

#: Speeds within this share are one speed; held positions closer than this (rad or m) are one posture: far above encoder
#: noise and creep, far below what a planner would call another posture.
SAME_SPEED, SAME_POSTURE = 0.03, 0.03

#: Share of the variance inside a bin that is rounding of its own course.
ROUNDED = 1e-6

#: Positions of a run from which two harmonics of the position are known.
PLACES = 5

#: Fields of samples that have a value an instant.
SERIES = tuple(item.name for item in fields(Samples) if item.name not in ("joint", "loads"))


@dataclass(frozen=True, eq=False)
class JointBins:
    """All R runs of one joint, N bins one after the other.

    Attributes
    ----------
    joint
        From 1.
    runs
        In the order in which they were given.
    samples
        The middles of the bins as effects see them; `run` counts the runs from 0. All joints but the moving one stand
        at the run's mean posture: held joints creep by thousandths of a rad, and columns of weight that differ by that
        alone would let weights of any size explain anything.
    current, count, inside
        (N,) A of the moving joint, samples behind it, and A2 of variance inside the bin.
    first, step
        (R,) first bin of each run, and s that its bins last.
    groups, postures
        Runs (from 0) that repeat one another, every run in one group; and by held posture.
    """

    joint: int
    runs: tuple[Run, ...]
    samples: Samples
    current: Floats
    count: Floats
    inside: Floats
    first: Counts
    step: Floats
    groups: tuple[tuple[int, ...], ...]
    postures: tuple[tuple[int, ...], ...]

    def __len__(self) -> int:
        return len(self.current)

    @property
    def run(self) -> Counts:
        """(N,) number of the run (from 0) that each bin belongs to."""
        return self.samples.run.astype(np.int64)

    @property
    def lengths(self) -> Counts:
        """(R,) bins of each run."""
        return np.diff(self.first, append=len(self))

    def sums(self, values: Floats) -> Floats:
        """(R, ...) sums over the bins of each run."""
        return np.asarray(np.add.reduceat(values, self.first, axis=0))

    @property
    def is_stroke(self) -> NDArray[np.bool_]:
        """(R,) runs from rest to rest."""
        return np.array([run.kind != CONSTANT for run in self.runs], dtype=bool)

    @property
    def mean_square(self) -> float:
        """Mean squared current of a sample, A2."""
        return float(self.count @ (self.current**2 + self.inside) / self.count.sum())

    @property
    def speeds(self) -> tuple[float, ...]:
        """Distinct speeds, rising, rad/s or m/s."""
        return distinct([abs(run.speed) for run in self.runs])

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Neighbours in time among runs that repeat one another."""
        return [pair for group in self.groups for pair in itertools.pairwise(group)]

    def side_by_side(self, values: Floats, pair: tuple[int, int]) -> tuple[Floats, Floats]:
        """Values of two runs at the first's bins that the second passed too, the second's at the nearest of its bins.

        The nearest, not a mean of two, so that the noise is not smoothed.
        """
        a, b = (slice(int(self.first[k]), int(self.first[k] + self.lengths[k])) for k in pair)
        q = self.samples.position[:, self.joint - 1]
        order = np.argsort(q[b], kind="stable")
        there = q[b][order]
        right = np.clip(np.searchsorted(there, q[a]), 0, len(there) - 1)
        before = np.maximum(right - 1, 0)
        nearest = np.where(np.abs(there[right] - q[a]) < np.abs(q[a] - there[before]), right, before)
        width = np.median(np.abs(np.diff(q[a]))) if len(there) > 1 and len(q[a]) > 1 else np.inf
        shared = np.abs(there[nearest] - q[a]) <= width
        if np.count_nonzero(shared) <= 2:
            shared = np.ones(len(shared), dtype=bool)
        return values[a][shared], values[b][order][nearest][shared]

    def extent(self, drawn: Floats | None = None) -> Extent:
        """What the runs cover; `drawn` (N,) is what a model predicts (A), the measured current where not given."""
        q = self.samples.position[:, self.joint - 1]
        widths = [abs(run.span[1] - run.span[0]) / max(len(run.bins), 1) for run in self.runs]
        return Extent(
            joint=self.joint,
            speeds=self.speeds,
            position=(float(q.min()), float(q.max())),
            finest=2.0 * float(np.median(widths)),
            travel=float(self.samples.travel.max()),
            starts=tuple(sorted(float(self.samples.time[k]) for k in self.first)),
            duration=float(self.samples.time.max()),
            current=float(np.abs(self.current if drawn is None else drawn).max()),
            postures=len(self.postures),
        )

    @cached_property
    def nodes(self) -> tuple[Samples, Floats]:
        """Three instants in each bin (3 N), and (N, 3) weights with which values there make the mean over the bin.

        They match the first five moments of as many equal steps as the bin has samples, so that a ripple with two bins
        a period is not averaged away, and a bin of three samples or fewer is exact.
        """
        n, moving = self.count, self.joint - 1
        spread = np.sqrt(np.maximum(3.0 * n**2 - 7.0, 0.0) / 20.0)
        side = np.divide(n**2 - 1.0, 24.0 * spread**2, out=np.zeros(len(n)), where=spread > 0)
        weights = np.column_stack([side, 1.0 - 2.0 * side, side])
        ahead = (self._sample_step() * spread)[:, None] * np.array([-1.0, 0.0, 1.0])
        three: dict[str, Any] = {
            name: np.repeat(held, 3, axis=0) for name in SERIES if (held := getattr(self.samples, name)) is not None
        }
        ahead = ahead.ravel()
        stroke = np.repeat(self.is_stroke[self.run], 3)
        moved = three["velocity"][:, moving] * ahead
        three["velocity"][:, moving] += np.where(stroke, three["acceleration"] * ahead, 0.0)
        three["acceleration"] = three["acceleration"] + np.repeat(self._jerk(), 3) * ahead
        three["position"][:, moving] += moved
        three["time"] += ahead
        three["elapsed"] += ahead
        three["travel"] = np.maximum(three["travel"] + three["direction"] * moved, 0.0)
        return replace(self.samples, **three, loads=None), weights

    @cached_property
    def harmonic(self) -> Floats:
        """(N, 2) means of cosine and sine of the moving joint's position over the bins."""
        q = self.nodes[0].position[:, self.joint - 1]
        return self.averaged(np.column_stack([np.cos(q), np.sin(q)]))

    def averaged(self, values: Floats) -> Floats:
        """(3 N, ...) values at the nodes as (N, ...) means over the bins."""
        return np.einsum("ng,ng...->n...", self.nodes[1], values.reshape(len(self), 3, *values.shape[1:]))

    def variance(self, values: Floats) -> Floats:
        """(N,) variance inside the bins of (3 N,) values at the nodes."""
        three = values.reshape(len(self), 3)
        return np.asarray(np.sum(self.nodes[1] * (three - self.averaged(values)[:, None]) ** 2, axis=1))

    def inside_left(self, drawn: Floats, own: Floats | None = None) -> Floats:
        """(N,) A2 of variance inside bins that a prediction (N,) leaves; `own` is its own variance there, by default
        that of its straight line from bin to bin."""
        parts = [np.split(values, self.first[1:]) for values in (drawn, self.current - drawn)]
        rise, slope = (
            np.concatenate([np.gradient(piece) if len(piece) > 1 else 0.0 * piece for piece in part]) for part in parts
        )
        wide = (1.0 - 1.0 / self.count**2) / 12.0
        remaining = self.inside - (rise**2 * wide if own is None else own) - 2.0 * rise * slope * wide
        return np.where(remaining > ROUNDED * self.inside, remaining, 0.0)

    def _sample_step(self) -> Floats:
        """(N,) s between samples of the run of each bin."""
        last = self.first + self.lengths - 1
        between = self.sums(self.count) - 0.5 * (self.count[self.first] + self.count[last])
        time = self.samples.time
        return np.asarray(((time[last] - time[self.first]) / np.maximum(between, 1.0))[self.run])

    def _jerk(self) -> Floats:
        """(N,) slope of the acceleration of strokes."""
        out = np.zeros(len(self))
        for start, size, is_stroke in zip(self.first, self.lengths, self.is_stroke, strict=True):
            span = slice(start, start + size)
            if is_stroke and size > 1:
                out[span] = np.gradient(self.samples.acceleration[span], self.samples.time[span])
        return out


def joint_bins(
    robot: Robot,
    runs: Sequence[Run],
    *,
    most: int | None = None,
    campaign: Campaign | None = None,
    is_settled: bool = True,
) -> tuple[JointBins, ...]:
    """The bins of each joint that moves in `runs`, base first.

    Parameters
    ----------
    robot
        The arm.
    runs
        In order of time.
    most
        Most bins of a run, or of a turn of a joint that turns round and round; as they are where not given.
    campaign
        That of all runs of the logs: when each joint first moved.
    is_settled
        Whether the ends of runs at constant speed, where the speed still settles, are left out.
    """
    campaign = campaign or Campaign.of(runs)
    out = []
    for joint in sorted({run.joint for run in runs}):
        joint_runs = [run for run in runs if run.joint == joint]
        settled = [_settled(run) for run in joint_runs] if is_settled else joint_runs
        turn = 2.0 * np.pi if robot.joint(joint).is_revolute else np.inf
        limits = [most and int(most * max(abs(run.span[1] - run.span[0]) / turn, 1.0)) for run in settled]
        thin = [_thinned(_sloped(run), limit) for run, limit in zip(settled, limits, strict=True)]
        out.append(_joined(joint, tuple(joint_runs), thin, campaign))
    return tuple(out)


def _joined(joint: int, runs: tuple[Run, ...], thin: Sequence[Run], campaign: Campaign) -> JointBins:
    lengths = np.array([len(run.bins) for run in thin])
    repeated = [tuple(group) for group in replicates(runs)]
    paired = {k for group in repeated for k in group}
    return JointBins(
        joint=joint,
        runs=runs,
        samples=joined([samples_of(run, campaign, is_held=True) for run in thin]),
        current=np.concatenate([run.bins.current for run in thin]),
        count=np.concatenate([run.bins.count for run in thin]).astype(float),
        inside=np.concatenate([run.bins.variance for run in thin]),
        first=np.concatenate([[0], np.cumsum(lengths)[:-1]]).astype(np.int64),
        step=np.array([run.duration / max(len(run.bins), 1) for run in thin]),
        groups=tuple(sorted([*repeated, *((k,) for k in range(len(runs)) if k not in paired)])),
        postures=tuple(tuple(group) for group in posture_groups(runs)),
    )


def samples_of(run: Run, campaign: Campaign, *, is_held: bool = False) -> Samples:
    """The M bins of a run as effects see them; at constant speed the velocity is the run's own mean.

    Parameters
    ----------
    run
        Its bins.
    campaign
        When its joint first moved.
    is_held
        Whether the other joints stand at the run's mean posture throughout.
    """
    bins, moving = run.bins, run.joint - 1
    velocity, position = run.velocity, bins.position
    if run.kind == CONSTANT:
        velocity[:, moving] = run.speed
    if is_held:
        position = np.tile(run.posture, (len(bins), 1))
        position[:, moving] = bins.position[:, moving]
    return Samples(
        run.joint,
        position,
        velocity,
        acceleration=bins.acceleration,
        direction=np.full(len(bins), float(run.direction)),
        time=campaign.since(run.joint, run.clock, bins.time),
        elapsed=campaign.since(0, run.clock, bins.time),
        travel=campaign.lead(run) + np.abs(bins.position[:, moving] - run.span[0]),
        temperature=bins.temperature,
        run=np.zeros(len(bins)),
        extra=bins.extra,
    )


def joined(many: Sequence[Samples]) -> Samples:
    """Samples of one joint one after another, without loads; `run` counts them from 0."""
    parts = {name: [getattr(samples, name) for samples in many] for name in SERIES}
    series: dict[str, Any] = {
        name: np.concatenate(part) for name, part in parts.items() if all(values is not None for values in part)
    }
    run = np.repeat(np.arange(float(len(many))), [len(samples) for samples in many])
    return replace(many[0], **series | {"run": run}, loads=None)


def at(samples: Samples, rows: Counts) -> Samples:
    """The instants `rows` of some samples."""
    parts = {name: getattr(samples, name) for name in SERIES}
    series = {name: part[rows] for name, part in parts.items() if part is not None and len(part)}
    if samples.loads is None:
        return Samples(samples.joint, **series)
    loads = {item.name: getattr(samples.loads, item.name) for item in fields(Loads)}
    chosen = {name: part if name == "gains" else part[rows] for name, part in loads.items()}
    return Samples(samples.joint, **series, loads=Loads(**chosen))


def swept(samples: Samples, sizes: Counts, table: Callable[[Samples], Floats], *, turns: bool) -> Floats:
    """A table's values at all of M instants of R runs of `sizes` instants each, asked for at `PLACES` of each.

    Exact for whatever is a direction of a link, a lever or a load, or a product of two of them, while one joint moves
    and the others stand: two harmonics of its position, or its square of a slide's.

    Parameters
    ----------
    samples, sizes
        Runs one after another; in each all joints but the moving one have one position throughout.
    table
        (K, F) at K instants.
    turns
        Whether the moving joint is revolute.

    Returns
    -------
    values
        (M, F); columns with a NaN in a run are NaN in all of it.
    """
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
    moving = samples.joint - 1
    places = np.linspace(0.0, 2.0 * np.pi, PLACES, endpoint=False) if turns else np.linspace(-1.0, 1.0, PLACES)
    knots = at(samples, np.repeat(starts, PLACES))
    position = knots.position.copy()
    position[:, moving] = np.tile(places, len(sizes))
    asked = table(replace(knots, position=position))
    parts = np.linalg.pinv(_harmonics(places, turns)) @ asked.reshape(len(sizes), PLACES, -1)
    basis, out = _harmonics(samples.position[:, moving], turns), np.empty((len(samples), asked.shape[1]))
    for start, size, part in zip(starts, sizes, parts, strict=True):
        out[start : start + size] = basis[start : start + size] @ part
    return out


def _harmonics(q: Floats, turns: bool) -> Floats:
    """(M, 5) two harmonics of an angle, or (M, 3) powers of a displacement."""
    if turns:
        return np.column_stack([np.ones(len(q)), np.cos(q), np.sin(q), np.cos(2.0 * q), np.sin(2.0 * q)])
    return np.column_stack([np.ones(len(q)), q, q * q])


def extent(bins: Sequence[JointBins], joint: int) -> Extent:
    """What the runs of `joint` (from 1) cover, or those of all joints (0)."""
    extents = [part.extent() for part in bins if joint in (0, part.joint)] or [part.extent() for part in bins]
    starts = [float(part.samples.elapsed[k]) for part in bins for k in part.first]
    ends = [float(part.samples.elapsed.max()) for part in bins]
    return Extent(
        joint=joint or None,
        speeds=distinct([speed for part in extents for speed in part.speeds]),
        position=(min(part.position[0] for part in extents), max(part.position[1] for part in extents)),
        finest=min(part.finest for part in extents),
        travel=max(part.travel for part in extents),
        starts=extents[0].starts if joint and len(extents) == 1 else tuple(sorted(starts)),
        duration=extents[0].duration if joint and len(extents) == 1 else max(ends),
        current=max(part.current for part in extents),
        postures=max(part.postures for part in extents),
    )


def typical(values: Floats, travel: Floats) -> float:
    """The median of values (R,) of runs over the way `travel` (R,) that was gone.

    Half of the way was gone in runs with less, half in runs with more: of a plan with many short runs and a few over
    the whole span, the latter show what depends on the place.
    """
    order = np.argsort(values, kind="stable")
    gone = np.cumsum(travel[order])
    return float(values[order[int(np.searchsorted(gone, 0.5 * gone[-1]))]])


def distinct(speeds: Sequence[float]) -> tuple[float, ...]:
    """Speeds that differ by more than `SAME_SPEED`, rising."""
    out: list[float] = []
    for speed in sorted(speeds):
        if not out or speed > out[-1] * (1.0 + SAME_SPEED):
            out.append(speed)
    return tuple(out)


def posture_groups(runs: Sequence[Run]) -> list[list[int]]:
    """Numbers of the runs (from 0) by held posture."""
    posture = np.nan_to_num(np.array([run.posture for run in runs]))

    def alike(first: int, others: Counts) -> NDArray[np.bool_]:
        return np.asarray(np.all(apart(posture[first], posture[others]) < SAME_POSTURE, axis=1))

    return list(grouped(len(runs), alike))


def _settled(run: Run) -> Run:
    """A run at constant speed without the bins in which its speed is still settling."""
    if run.kind != CONSTANT or len(run.bins) < FEWEST_SETTLED:
        return run
    lost, since = min(SETTLING, MOST_SETTLING * run.duration), run.bins.time - run.start
    is_settled = (since >= lost) & (since <= run.duration - lost)
    values: dict[str, Any] = {item.name: getattr(run.bins, item.name) for item in dataclasses.fields(Bins)}
    return replace(run, bins=Bins(**{name: value[is_settled] for name, value in values.items() if value is not None}))


def _sloped(run: Run) -> Run:
    """A run at constant speed with the acceleration that its positions show, before its bins are made coarser."""
    if run.kind != CONSTANT:
        return run
    slope = acceleration(run.bins.time, run.bins.position[:, run.joint - 1])
    return replace(run, bins=replace(run.bins, acceleration=slope))


def _thinned(run: Run, most: int | None) -> Run:
    return run if most is None or len(run.bins) <= most else replace(run, bins=coarser(run.bins, most))
