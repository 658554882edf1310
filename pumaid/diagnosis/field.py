"""All runs of one joint as one set of bins: what every statistic of the diagnosis is computed from."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Bins, Run
from pumaid.maths.alike import grouped
from pumaid.model import Model
from pumaid.preprocessing.binning import coarser
from pumaid.preprocessing.differentiate import acceleration
from pumaid.preprocessing.options import CONSTANT
from pumaid.preprocessing.replicates import replicates
from pumaid.records import Campaign, Extent, Samples
from pumaid.sight import joined, samples_of

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]

#: Bins a run at which slow effects are looked for: 64 periods of a position-dependent effect, four times finer than
#: the narrowest presliding that a ramp leaves visible.
COARSE = 128

#: s at either end of a run at constant speed that are left out, and the most of its duration that this may be: the
#: steep part of the transient in which the speed settles (see `settling`), and the first samples of the next ramp.
SETTLING, MOST_SETTLING = 0.03, 0.2

#: Speeds within this share are one speed.
SAME_SPEED = 0.03


@dataclass(frozen=True, eq=False, slots=True)
class Field:
    """The runs of one joint, bin after bin.

    Attributes
    ----------
    joint
        From 1.
    runs
        R runs, in order of time.
    samples
        All N bins as effects see them; `run` counts the runs from 0.
    current
        (N,) A of the moving joint.
    count
        (N,) samples behind each bin.
    inside
        (N,) A2: variance inside each bin.
    first
        (R,) index of each run's first bin.
    step
        (R,) s, duration of a bin of each run.
    groups
        Runs (from 0) that repeat one another, every run in one group.
    postures
        Runs (from 0) by held posture.
    base
        (N, p) regressors of the base model, ratios of gains left out.
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
    base: Floats

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
        left = np.maximum(right - 1, 0)
        nearest = np.where(np.abs(there[right] - q[a]) < np.abs(q[a] - there[left]), right, left)
        width = np.median(np.abs(np.diff(q[a]))) if len(there) > 1 and len(q[a]) > 1 else np.inf
        shared = np.abs(there[nearest] - q[a]) <= width
        if np.count_nonzero(shared) <= 2:
            shared = np.ones(len(shared), dtype=bool)
        return values[a][shared], values[b][order][nearest][shared]

    def extent(self, drawn: Floats) -> Extent:
        """What the runs cover; `drawn` (N,) is what the model predicts (A)."""
        q = self.samples.position[:, self.joint - 1]
        starts = sorted(float(self.samples.time[k]) for k in self.first)
        widths = [abs(run.span[1] - run.span[0]) / max(len(run.bins), 1) for run in self.runs]
        return Extent(
            joint=self.joint,
            speeds=self.speeds,
            position=(float(q.min()), float(q.max())),
            finest=2.0 * float(np.median(widths)),
            travel=float(self.samples.travel.max()),
            starts=tuple(starts),
            duration=float(self.samples.time.max()),
            current=float(np.abs(drawn).max()),
            postures=len(self.postures),
        )


def fields(
    model: Model, runs: Sequence[Run], *, most: int = COARSE, campaign: Campaign | None = None
) -> tuple[Field, ...]:
    """A field for each joint that moves in `runs`, base first; `campaign` is that of all runs of the logs."""
    return fields_at(model, runs, (most,), campaign=campaign)[0]


def fields_at(
    model: Model, runs: Sequence[Run], finenesses: Sequence[int], *, campaign: Campaign | None = None
) -> list[tuple[Field, ...]]:
    """The fields of all joints that move in `runs`, base first, for each number of bins a run.

    Parameters
    ----------
    model
        Of the arm.
    runs
        In order of time.
    finenesses
        Most bins of a run, or a turn of a joint that turns round and round.
    campaign
        That of all runs of the logs; when each joint first moved.
    """
    campaign = campaign or Campaign.of(runs)
    joints = sorted({run.joint for run in runs})
    settled = [_Settled.of([run for run in runs if run.joint == joint]) for joint in joints]
    return [tuple(_field(model, one, campaign=campaign, most=most) for one in settled) for most in finenesses]


@dataclass(frozen=True, eq=False, slots=True)
class _Settled:
    """The runs of one joint without their ends; `sloped` with the acceleration of their bins; groups as in `Field`."""

    runs: tuple[Run, ...]
    sloped: tuple[Run, ...]
    groups: tuple[tuple[int, ...], ...]
    postures: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, runs: Sequence[Run]) -> _Settled:
        """Of all runs of a joint, in order of time."""
        kept = tuple(_settled(run) for run in runs)
        repeated = [tuple(group) for group in replicates(kept)]
        grouped_ones = {k for group in repeated for k in group}
        alone = [(k,) for k in range(len(kept)) if k not in grouped_ones]
        return cls(
            kept,
            tuple(_sloped(run) for run in kept),
            tuple(sorted([*repeated, *alone])),
            tuple(tuple(group) for group in posture_groups(kept)),
        )


def _field(model: Model, settled: _Settled, *, campaign: Campaign, most: int) -> Field:
    """One joint's runs in at most `most` bins each, of a joint that turns round and round each turn."""
    runs, joint = settled.runs, settled.runs[0].joint
    turn = 2.0 * np.pi if model.robot.joint(joint).is_revolute else np.inf
    thin = [_thinned(run, int(most * max(abs(run.span[1] - run.span[0]) / turn, 1.0))) for run in settled.sloped]
    many = [_held(samples_of(run, campaign), run) for run in thin]
    samples = joined(many)
    is_stroke = np.repeat([run.kind != CONSTANT for run in thin], [len(one) for one in many])
    lengths = np.array([len(one) for one in many])
    return Field(
        joint=joint,
        runs=runs,
        samples=samples,
        current=np.concatenate([run.bins.current for run in thin]),
        count=np.concatenate([run.bins.count for run in thin]).astype(float),
        inside=np.concatenate([run.bins.variance for run in thin]),
        first=np.concatenate([[0], np.cumsum(lengths)[:-1]]).astype(np.int64),
        step=np.array([run.duration / max(len(run.bins), 1) for run in thin]),
        groups=settled.groups,
        postures=settled.postures,
        base=model.along(replace(samples, acceleration=np.where(is_stroke, samples.acceleration, 0.0)), lengths),
    )


def _sloped(run: Run) -> Run:
    """A run at constant speed with the acceleration that its positions show, before its bins are made coarser."""
    if run.kind != CONSTANT:
        return run
    found = acceleration(run.bins.time, run.bins.position[:, run.joint - 1])
    return replace(run, bins=replace(run.bins, acceleration=found))


def _thinned(run: Run, most: int) -> Run:
    return run if len(run.bins) <= most else replace(run, bins=coarser([run.bins], most))


def _held(samples: Samples, run: Run) -> Samples:
    """The bins of a run with all joints but the moving one at the run's posture, as the fit sees them.

    Held joints creep by thousandths of a rad as the moving one speeds up and turns back; columns of weight that differ
    by that alone would let weights of any size explain anything.
    """
    position = np.tile(run.posture, (len(samples), 1))
    position[:, run.joint - 1] = samples.position[:, run.joint - 1]
    return replace(samples, position=position)


def _settled(run: Run) -> Run:
    """A run at constant speed without the bins in which its speed is still settling."""
    if run.kind != CONSTANT or len(run.bins) < FEWEST_SETTLED:
        return run
    lost, since = min(SETTLING, MOST_SETTLING * run.duration), run.bins.time - run.start
    kept = (since >= lost) & (since <= run.duration - lost)
    values: dict[str, Any] = {item.name: getattr(run.bins, item.name) for item in dataclasses.fields(Bins)}
    some = {name: value[kept] for name, value in values.items() if value is not None}
    return replace(run, bins=Bins(**some))


#: Bins below which a run is taken as it is.
FEWEST_SETTLED = 20


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
        return np.asarray(np.all(np.abs(posture[first] - posture[others]) < SAME_POSTURE, axis=1))

    return list(grouped(len(runs), alike))


#: Held positions closer than this (rad or m) are one posture.
SAME_POSTURE = 0.03
