"""The runs of one joint as one table of bins: what every fit and every test of a fit is computed from."""

import copy
import itertools
from collections.abc import Collection, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from pumaid.dataset import BLOCK, CONSTANT, Bins, FirstMotions, Run, coarser, finer, first_motions
from pumaid.effects import Extent, Samples
from pumaid.maths import Counts, Flags, Floats
from pumaid.preprocessing.differentiate import acceleration
from pumaid.preprocessing.replicates import LASTS, first_made, replicates
from pumaid.rigid_body import of_body, of_last_link
from pumaid.robot import Robot, posture_groups

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
#: Share of the motion of blocks that must be made again so that this matters, and parts in which it then is.
SAME_SPEED, SAME_POSTURE, AGAIN, PARTS = 0.03, 0.03, 0.1, 24


@dataclass(frozen=True, eq=False)
class JointBins:
    """All R runs of one joint (from 1), N bins one after the other.

    `samples` are the middles of the bins as effects see them; `run` counts the runs from 0. All joints but the moving
    one stand at the run's mean posture: held joints creep by thousandths of a rad, and columns of weight that differ by
    that alone would let weights of any size explain anything. `current` (N,) A is of the moving joint, `count` (N,) the
    samples behind it, `inside` (N,) A2 of variance inside the bin, `first` and `step` (R,) are the first bin of each
    run, and s that its bins last. `rigid_body` (N, P) is what its parameters ask of the joint in blocks of any motion,
    NaN in other runs; None where there is no block.
    """

    joint: int
    runs: tuple[Run, ...]
    samples: Samples
    current: Floats
    count: Floats
    inside: Floats
    first: Counts
    step: Floats
    rigid_body: Floats | None = None

    def __len__(self) -> int:
        return len(self.current)

    def with_samples(self, samples: Samples) -> "JointBins":
        """The same bins with the same samples, and their loads."""
        out = copy.copy(self)  # with all that was worked out of them
        out.__dict__.update(samples=samples, kept=self.kept)
        return out

    @cached_property
    def kept(self) -> dict[Any, Floats]:
        """Columns of these samples, without loads, for whoever needs them again."""
        return {}

    @cached_property
    def run(self) -> Counts:
        """(N,) number of the run (from 0) that each bin belongs to."""
        return self.samples.run.astype(np.int64)

    @cached_property
    def lengths(self) -> Counts:
        """(R,) bins of each run."""
        return np.diff(self.first, append=len(self))

    def sums(self, values: Floats) -> Floats:
        """(R, ...) sums over the bins of each run."""
        return np.asarray(np.add.reduceat(values, self.first, axis=0))

    def products(self, values: Floats, columns: Floats) -> Floats:
        """(R, V) sums over the bins of each run of (N,) values times each of (N, V) columns."""
        return np.array([self.sums(column * values) for column in columns.T]).T

    @cached_property
    def accelerates(self) -> Flags:
        """(R,) runs that are not at constant speed: strokes, and blocks."""
        return np.array([run.accelerates for run in self.runs], dtype=bool)

    @cached_property
    def is_block(self) -> Flags:
        """(R,) runs in which all joints may move."""
        return np.array([run.kind == BLOCK for run in self.runs], dtype=bool)

    @cached_property
    def is_cells(self) -> Flags:
        """(R,) blocks that are in cells, not in the parts of these."""
        return self.is_block & (self.lengths <= [len(run.bins) for run in self.runs])

    @cached_property
    def mean_square(self) -> float:
        """Mean squared current of a sample, A2."""
        return float(self.count @ (self.current**2 + self.inside) / self.count.sum())

    @cached_property
    def speeds(self) -> tuple[float, ...]:
        """Distinct speeds, rising, rad/s or m/s; where a joint accelerates, tenths of those it has."""
        moving = np.abs(self.samples.velocity[self.accelerates[self.run], self.joint - 1])
        tenths = np.quantile(moving, np.linspace(0.1, 0.9, 9)).tolist() if len(moving) else []
        return distinct([*(abs(run.speed) for run in self.runs if not run.accelerates), *tenths])

    @property
    def directions(self) -> frozenset[int]:
        """+1, -1 or both: the ways in which the joint moves."""
        return frozenset(np.unique(self.samples.direction).astype(int).tolist())

    @cached_property
    def groups(self) -> list[tuple[int, ...]]:
        """Runs (from 0) that repeat one another, every run in one group."""
        groups = [tuple(group) for group in replicates(self.runs)]
        return sorted([*groups, *((run,) for run in set(range(len(self.runs))).difference(*groups))])

    @cached_property
    def motions(self) -> Counts:
        """(N,) number of the motion in each bin: its run, or beyond these a part of what blocks make again and again.

        A program that runs again, or waves with a period, tell no more of other motion than if they were made once.
        """
        numbers, clock = self.run.copy(), np.array([run.clock for run in self.runs])[self.run]
        order = np.lexsort((self.samples.elapsed, clock))
        order = order[self.is_block[self.run[order]]]
        if len(order):
            steps = np.diff(self.samples.elapsed[order], prepend=self.samples.elapsed[order[0]])
            time = np.cumsum(np.where((steps < 0.0) | (steps > LASTS), LASTS, steps))
            first = first_made(time, self.samples.position[order])
            if np.mean(first < time) > AGAIN:
                numbers[order] = len(self.runs) + np.searchsorted(np.sort(first), first) * PARTS // len(first)
        return numbers

    @cached_property
    def postures(self) -> list[tuple[int, ...]]:
        """Runs (from 0) by held posture."""
        return [*map(tuple, posture_groups(np.array([run.posture for run in self.runs]), SAME_POSTURE))]

    @cached_property
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
        nearest = np.searchsorted(0.5 * (there[1:] + there[:-1]), q[a])
        width = np.median(np.abs(np.diff(q[a]))) if len(there) > 1 and len(q[a]) > 1 else np.inf
        is_shared = np.abs(there[nearest] - q[a]) <= width
        if np.count_nonzero(is_shared) <= 2:
            is_shared[:] = True
        return values[a][is_shared], values[b][order][nearest][is_shared]

    @cached_property
    def way(self) -> float:
        """Way (rad or m) that the joint goes during a bin, its root mean square."""
        return float(np.sqrt(np.mean((self.samples.velocity[:, self.joint - 1] * self.step[self.run]) ** 2)))

    @cached_property
    def nodes(self) -> tuple[Samples, Floats]:
        """k instants in each bin (k N), and (N, k) weights with which values there make the mean over the bin.

        One where all bins are of one sample, else three. They match the first five moments of as many equal steps as
        the bin has samples, so that a ripple with two bins a period is not averaged away, and a bin of three samples or
        fewer is exact.
        """
        n, moving, time = self.count, self.joint - 1, self.samples.time
        is_block, is_cell = self.is_block[self.run], self.is_cells[self.run]
        last = self.first + self.lengths - 1
        between = self.sums(n) - 0.5 * (n[self.first] + n[last])
        # s between samples; between the cells of a block there may be gaps.
        step = ((time[last] - time[self.first]) / np.maximum(between, 1.0))[self.run]
        step = np.where(is_block, self.step[self.run] / n, step)
        spread = np.sqrt(np.maximum(3.0 * n**2 - 7.0, 0.0) / 20.0)
        if not spread.any():
            return self.samples, np.ones((len(n), 1))
        side = np.divide(n**2 - 1.0, 24.0 * spread**2, out=np.zeros(len(n)), where=spread > 0)
        # The window of a block's cells is three means over a cell, of variance a quarter of its square.
        spread, side = np.where(is_cell, np.sqrt(0.75) * n, spread), np.where(is_cell, 1.0 / 6.0, side)
        ahead = ((step * spread)[:, None] * np.array([-1.0, 0.0, 1.0])).ravel()
        three: dict[str, Any] = {name: np.repeat(values, 3, axis=0) for name, values in self.samples.series().items()}
        accelerates = self.accelerates[self.run]
        beside = three["velocity"] * (np.repeat(is_block, 3) * ahead)[:, None]
        beside[:, moving] = 0.0
        three["position"] += beside
        moved = three["velocity"][:, moving] * ahead
        three["velocity"][:, moving] += np.repeat(accelerates, 3) * three["acceleration"] * ahead
        three["acceleration"] += np.repeat(accelerates * self.rates(self.samples.acceleration), 3) * ahead
        three["position"][:, moving] += moved
        three["time"] += ahead
        three["elapsed"] += ahead
        three["travel"] = np.maximum(three["travel"] + three["direction"] * moved, 0.0)
        return Samples(self.joint, **three), np.column_stack([side, 1.0 - 2.0 * side, side])

    @cached_property
    def harmonic(self) -> Floats:
        """(N, 2) means of cosine and sine of the moving joint's position over the bins."""
        q = self.nodes[0].position[:, self.joint - 1]
        return self.averaged(np.column_stack([np.cos(q), np.sin(q)]))

    def averaged(self, values: Floats) -> Floats:
        """(k N, ...) values at the nodes as (N, ...) means over the bins."""
        return np.einsum("ng,ng...->n...", self.nodes[1], values.reshape(*self.nodes[1].shape, *values.shape[1:]))

    def variance(self, values: Floats, waves: Floats) -> Floats:
        """(N,) variance inside the bins of (k N,) values at the nodes; in parts of blocks' cells of `waves` among them,
        since what else a prediction has there is no part of `inside`."""
        values = np.where(np.repeat(self.is_block[self.run], self.nodes[1].shape[1]), waves, values)
        apart = values.reshape(self.nodes[1].shape) - self.averaged(values)[:, None]
        return np.where(self.is_cells[self.run], 0.0, np.sum(self.nodes[1] * apart**2, axis=1))

    def rises(self, values: Floats) -> Floats:
        """(N,) central difference of values from bin to bin inside each run, one-sided at its ends."""
        place, (first, last) = np.arange(len(self)), (self.first, self.first + self.lengths - 1)
        before, after = np.maximum(place - 1, first[self.run]), np.minimum(place + 1, last[self.run])
        return np.asarray((values[after] - values[before]) / np.maximum(after - before, 1))

    def rates(self, values: Floats) -> Floats:
        """(N,) change of values a second, from bin to bin as in `rises`; zero in a run of one bin."""
        rise = self.rises(self.samples.time)
        return np.divide(self.rises(values), rise, out=np.zeros(len(self)), where=rise > 0.0)

    def squares(self, misfit: Floats) -> Floats:
        """(N,) A2 mean square of the samples of each bin beside a prediction that misses the bins by `misfit` (N,)."""
        return np.asarray(misfit**2 + self.inside_left(self.current - misfit))

    def inside_left(self, drawn: Floats, spread: Floats | None = None) -> Floats:
        """(N,) A2 of variance inside bins that a prediction (N,) leaves; `spread` is its own variance there, by default
        that of its straight line from bin to bin."""
        rise, slope = self.rises(drawn), self.rises(self.current - drawn)
        # The variance in a block's cells is about a straight line already.
        wide = np.where(self.is_block[self.run], 0.0, (1.0 - 1.0 / self.count**2) / 12.0)
        remaining = self.inside - (rise**2 * wide if spread is None else spread) - 2.0 * rise * slope * wide
        return np.where(remaining > 1e-6 * self.inside, remaining, 0.0)  # else rounding of the bin's own course


def joint_bins(
    robot: Robot,
    runs: Sequence[Run],
    *,
    most: int | None = None,
    begun: FirstMotions | None = None,
    is_settled: bool = True,
    finest: Collection[int | None] = (),
) -> tuple[JointBins, ...]:
    """The bins of each joint that moves in `runs` (in order of time), base first.

    A run has at most `most` bins a turn; `begun` says when joints first moved in all runs of the logs; `is_settled`
    leaves out the ends of runs at constant speed, where the speed still settles; `finest` joints have blocks in parts.
    """
    begun = first_motions(runs) if begun is None else begun
    out = []
    for joint in sorted({run.joint for run in runs}):
        chosen = tuple(run for run in runs if run.joint == joint)
        turn = 2.0 * np.pi if robot.joint(joint).is_revolute else np.inf
        thin = [_thinned(run, most, turn=turn, is_settled=is_settled, is_fine=joint in finest) for run in chosen]
        lengths = np.array([len(run.bins) for run in thin])
        first = (np.cumsum(lengths) - lengths).astype(np.int64)
        # Between cells of a block some are left out.
        is_long = [run.kind == BLOCK and len(run.bins) > 1 for run in thin]
        steps = [
            np.median(np.diff(run.bins.time)) if is_cut else run.duration / max(len(run.bins), 1)
            for run, is_cut in zip(thin, is_long, strict=True)
        ]
        count, current, inside = (
            np.concatenate([getattr(run.bins, name) for run in thin]) for name in ("count", "current", "variance")
        )
        series = [samples_of(run, begun).series() for run in thin]
        names = set(series[0]).intersection(*series)
        whole: dict[str, Any] = {name: np.concatenate([part[name] for part in series]) for name in names}
        samples = Samples(joint, **whole | {"run": np.repeat(np.arange(float(len(thin))), lengths)})
        asked = [run.bins.rigid_body for run in thin]
        width = max((part.shape[1] for part in asked if part is not None), default=0)
        body = [np.full((n, width), np.nan) if a is None else a for a, n in zip(asked, lengths, strict=True)]
        rows = np.concatenate(body) if width else None
        pull = np.zeros((robot.n_joints, len(samples)))
        pull[joint - 1] = samples.acceleration * np.repeat([run.accelerates for run in chosen], lengths)
        bodies = of_body(robot, joint, (samples.position.T, 0.0 * pull, pull))
        if rows is not None:
            values, constants = (part[:, :10] for part in of_last_link(robot))
            asked_there = rows @ values + constants[joint - 1]
            bodies = np.where(np.isfinite(asked_there), asked_there, bodies)
        samples = replace(samples, bodies=bodies)
        out.append(
            JointBins(joint, chosen, samples, current, count.astype(float), inside, first, np.array(steps), rows)
        )
    return tuple(out)


def _thinned(run: Run, most: int | None, *, turn: float, is_settled: bool, is_fine: bool) -> Run:
    """A run in at most `most` bins a turn; at constant speed settled, and with the acceleration that positions show."""
    if run.kind == CONSTANT:
        if is_settled and len(run.bins) >= FEWEST_SETTLED:
            lost, since = min(SETTLING, MOST_SETTLING * run.duration), run.bins.time - run.start
            chosen = (since >= lost) & (since <= run.duration - lost)
            values = {item.name: getattr(run.bins, item.name) for item in fields(Bins)}
            run = replace(run, bins=Bins(**{name: v[chosen] for name, v in values.items() if v is not None}))
        slope = acceleration(run.bins.time, run.bins.position[:, run.joint - 1])
        run = replace(run, bins=replace(run.bins, acceleration=slope))
    if is_fine and run.bins.parts is not None:
        return replace(run, bins=finer(run.bins, run.joint))
    limit = most and int(most * max(abs(run.span[1] - run.span[0]) / turn, 1.0))
    return replace(run, bins=coarser(run.bins, limit)) if limit else run


def samples_of(run: Run, begun: FirstMotions) -> Samples:
    """The M bins of a run as effects see them, other joints at its mean posture; at constant speed the velocity is its
    mean."""
    bins, moving = run.bins, run.joint - 1
    velocity, position = run.velocity, np.tile(run.posture, (len(bins), 1))
    position[:, moving] = bins.position[:, moving]
    direction = np.full(len(bins), float(run.direction))
    travel = run.lead + np.abs(position[:, moving] - run.span[0])
    if run.kind == CONSTANT:
        velocity[:, moving] = run.speed
    if run.kind == BLOCK:
        position, direction = bins.position, np.where(bins.velocity < 0.0, -1.0, 1.0)
        turned = np.flatnonzero(np.diff(direction, prepend=0.0))
        start = np.repeat(position[turned, moving], np.diff(turned, append=len(bins)))
        travel = np.abs(position[:, moving] - start)  # since the joint last turned back
    return Samples(
        run.joint,
        position,
        velocity,
        acceleration=bins.acceleration,
        direction=direction,
        time=bins.time - begun.get((run.joint, run.clock), 0.0),
        elapsed=bins.time - begun.get((0, run.clock), 0.0),
        travel=travel,
        temperature=bins.temperature,
        run=np.zeros(len(bins)),
        extra=bins.extra,
    )


def extent(bins: Sequence[JointBins], joint: int, drawn: Floats | None = None) -> Extent:
    """What the runs of `joint` (from 1) cover, or those of all joints (0, or one that has none).

    `drawn` (N,) is what a model predicts (A) for the runs of a single joint, the measured current where not given.
    """
    parts = [part for part in bins if part.joint == joint] or list(bins)
    times = [part.samples.time if len(parts) == 1 and joint else part.samples.elapsed for part in parts]
    positions = [part.samples.position[:, part.joint - 1] for part in parts]
    currents = [part.current if drawn is None else drawn for part in parts]
    starts = [
        t[part.is_block[part.run] | np.isin(np.arange(len(t)), part.first)]
        for part, t in zip(parts, times, strict=True)
    ]
    widths = [[abs(run.span[1] - run.span[0]) / max(len(run.bins), 1) for run in part.runs] for part in parts]
    return Extent(
        joint=joint or None,
        speeds=distinct([speed for part in parts for speed in part.speeds]),
        position=(min(float(q.min()) for q in positions), max(float(q.max()) for q in positions)),
        finest=2.0 * min(float(np.median(width)) for width in widths),
        travel=max(float(part.samples.travel.max()) for part in parts),
        starts=tuple(np.unique(np.concatenate(starts)).tolist()),
        duration=max(float(time.max()) for time in times),
        current=max(float(np.abs(current).max()) for current in currents),
    )


def distinct(speeds: Sequence[float]) -> tuple[float, ...]:
    """Speeds that differ by more than `SAME_SPEED`, rising."""
    out: list[float] = []
    for speed in sorted(speeds):
        if not out or speed > out[-1] * (1.0 + SAME_SPEED):
            out.append(speed)
    return tuple(out)
