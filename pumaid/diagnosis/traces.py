"""What a residual can depend on, as columns over a joint's cells: position, direction, speed, load, time, start."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pumaid.diagnosis.field import distinct, joined, posture_groups
from pumaid.motion.options import CONSTANT
from pumaid.motion.replicates import replicates
from pumaid.records import Run, Samples

Floats = NDArray[np.float64]
Labels = NDArray[np.int64]

#: What counts as smooth: these harmonics of a turn, and polynomials over the span up to this degree (of a sliding joint
#: up to the second).
HARMONICS, DEGREE, SLIDING_DEGREE = 3, 5, 9
#: Half waves over the campaign: a warm-up, a drift or a step shows in these.
SLOW = 4
#: Lengths of a start, as shares of the span.
STARTS = (0.01, 0.03, 0.1)
#: Distinct speeds beyond which friction over speed is a smooth curve, not a mean for each.
MOST_SPEEDS = 8
#: Postures beyond which the rest count as one.
MOST_POSTURES = 24
#: Cells of a run: the first ones as they are, where a start shows, the others in groups.
FIRST, GROUPS = 16, 48


class Laid(Protocol):
    """The runs of one joint cell after cell, as a `Field` has them: what `Spread` states."""

    @property
    def joint(self) -> int: ...
    @property
    def runs(self) -> tuple[Run, ...]: ...
    @property
    def samples(self) -> Samples: ...
    @property
    def current(self) -> Floats: ...
    @property
    def count(self) -> Floats: ...
    @property
    def inside(self) -> Floats: ...
    @property
    def first(self) -> Labels: ...
    @property
    def groups(self) -> tuple[tuple[int, ...], ...]: ...


@dataclass(frozen=True, eq=False, slots=True)
class Spread:
    """The runs of one joint with all their cells, N together.

    Attributes
    ----------
    joint
        From 1.
    runs
        R of them.
    samples
        The cells; `run` counts the runs from 0.
    current, count, inside
        (N,) A of the moving joint, samples behind it, A2 of variance inside.
    first
        (R,) index of each run's first cell.
    groups
        Runs (from 0) that repeat one another, every run in one group.
    """

    joint: int
    runs: tuple[Run, ...]
    samples: Samples
    current: Floats
    count: Floats
    inside: Floats
    first: Labels
    groups: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, runs: Sequence[Run]) -> Spread:
        """At least one run, all of one joint."""
        joint, lengths = runs[0].joint, [len(run.cells) for run in runs]
        begun: dict[int, float] = {}
        for run in runs:
            begun[run.clock] = min(run.start, begun.get(run.clock, run.start))
        repeated = [tuple(group) for group in replicates(runs)]
        alone = [(k,) for k in range(len(runs)) if not any(k in group for group in repeated)]
        return cls(
            joint=joint,
            runs=tuple(runs),
            samples=joined([_samples(run, begun[run.clock]) for run in runs]),
            current=np.concatenate([run.cells.current[:, joint - 1] for run in runs]),
            count=np.concatenate([run.cells.count for run in runs]).astype(float),
            inside=np.concatenate([run.cells.variance for run in runs]),
            first=np.concatenate([[0], np.cumsum(lengths)[:-1]]).astype(np.int64),
            groups=tuple(sorted([*repeated, *alone])),
        )


def _samples(run: Run, begun: float) -> Samples:
    cells, own = run.cells, run.joint - 1
    return Samples(
        run.joint,
        cells.position,
        cells.velocity,
        acceleration=cells.acceleration,
        direction=np.full(len(cells), float(run.direction)),
        time=cells.time - begun,
        elapsed=cells.time - begun,
        travel=np.abs(cells.position[:, own] - run.span[0]),
        temperature=cells.temperature,
    )


@dataclass(frozen=True, eq=False, slots=True)
class View:
    """What the columns are made of at N cells of one joint.

    Attributes
    ----------
    weight
        (N,) samples.
    run
        (N,) number of the run from 0.
    share
        (N,) position between the lowest (0) and the highest (1) of the joint.
    angle
        (N,) position in rad; zero throughout for a sliding joint.
    way
        (N,) +1 or -1.
    speed
        (N,) share of the largest speed; `speed_group` its number where speeds are few.
    age
        (N,) share of the longest recording, s since the joint's first motion in it.
    travel
        (N,) share of the span since the motion began.
    temperature
        (N,) degC, NaN where not measured.
    load
        (N,) A that gravity draws by the model, NaN where not known.
    slope
        (N,) A per span: how the load changes along the position.
    pull
        (N,) acceleration as a share of the largest; zero at constant speed.
    speed_group, posture, clock
        (N,) numbers from 0; `speed_group` is -1 throughout where speeds are many.
    """

    weight: Floats
    run: Labels
    share: Floats
    angle: Floats
    way: Floats
    speed: Floats
    age: Floats
    travel: Floats
    temperature: Floats
    load: Floats
    slope: Floats
    pull: Floats
    speed_group: Labels
    posture: Labels
    clock: Labels

    def __len__(self) -> int:
        return len(self.weight)

    def coarse(self, starts: Labels) -> View:
        """Means over groups of cells that begin at `starts` (within one run each)."""
        total = np.add.reduceat(self.weight, starts)
        out: dict[str, Any] = {}
        for item in fields(View):
            values = getattr(self, item.name)
            whole = np.issubdtype(values.dtype, np.integer)
            out[item.name] = values[starts] if whole else np.add.reduceat(values * self.weight, starts) / total
        return View(**(out | {"weight": total}))


def view(laid: Laid, load: Floats | None, *, is_revolute: bool) -> View:
    """The cells of a field.

    Parameters
    ----------
    laid
        N cells.
    load
        (N,) A that gravity draws by the model, or None.
    is_revolute
        Whether the joint turns.
    """
    samples, own, runs = laid.samples, laid.joint - 1, laid.runs
    q = samples.position[:, own]
    speed = np.abs(samples.velocity[:, own])
    speeds = distinct([abs(run.speed) for run in runs])
    by_run = np.searchsorted(np.array(speeds) * (1.0 + 1e-9), [abs(run.speed) for run in runs], side="right") - 1
    few = len(speeds) <= MOST_SPEEDS and all(run.kind == CONSTANT for run in runs)
    posture = np.zeros(len(runs), dtype=np.int64)
    for number, group in enumerate(sorted(posture_groups(runs), key=lambda group: -len(group))):
        posture[group] = min(number, MOST_POSTURES)
    clocks = np.unique([run.clock for run in runs], return_inverse=True)[1]
    run, span = samples.run.astype(np.int64), float(np.ptp(q)) or 1.0
    return View(
        weight=laid.count,
        run=run,
        share=(q - q.min()) / span,
        angle=q if is_revolute else np.zeros(len(q)),
        way=samples.direction,
        speed=speed / (speed.max() or 1.0),
        age=samples.time / (samples.time.max() or 1.0),
        travel=samples.travel / span,
        temperature=samples.temperature,
        load=np.full(len(q), np.nan) if load is None else load,
        slope=np.full(len(q), np.nan) if load is None else _slopes(load, q / span, laid.first),
        pull=samples.acceleration / (np.abs(samples.acceleration).max() or 1.0),
        speed_group=(np.maximum(by_run, 0) if few else np.full(len(runs), -1))[run],
        posture=posture[run],
        clock=clocks[run],
    )


def _slopes(load: Floats, share: Floats, first: Labels) -> Floats:
    """(N,) derivative of a load by the position, run by run; 0 where a run stands still."""
    out = np.zeros_like(load)
    for own in np.split(np.arange(len(load)), first[1:]):
        if len(own) > 1:
            rise, way = np.gradient(load[own]), np.gradient(share[own])
            out[own] = np.divide(rise, way, out=np.zeros(len(own)), where=way != 0.0)
    return out


def coarse_starts(first: Labels, cells: int) -> Labels:
    """First cells of the groups in which all but ripples are looked for.

    Parameters
    ----------
    first
        (R,) each run's first cell.
    cells
        N.
    """
    pieces = []
    for start, end in itertools.pairwise([*first, cells]):
        inner = np.arange(end - start)
        if len(inner) > FIRST + GROUPS:
            inner = np.append(np.arange(FIRST), np.linspace(FIRST, len(inner), GROUPS + 1).astype(np.int64)[:-1])
        pieces.append(start + inner)
    return np.concatenate(pieces)


@dataclass(frozen=True, slots=True)
class Term:
    """One way in which a residual can depend on something: the part of the budget, the variable, and its columns."""

    part: str
    against: str
    columns: Callable[[View], Floats]

    @property
    def key(self) -> tuple[str, str]:
        """Part and variable."""
        return self.part, self.against


def _waves(share: Floats, most: int) -> Floats:
    """(N, most) half waves over a share between 0 and 1."""
    return np.asarray(np.cos(np.pi * share[:, None] * np.arange(1, most + 1)))


def _smooth(at: View) -> Floats:
    """(N, K) what varies little over a run."""
    turns = np.arange(1, HARMONICS + 1) * at.angle[:, None]
    if not at.angle.any():
        return _polynomials(at.share, SLIDING_DEGREE)
    return np.concatenate([np.cos(turns), np.sin(turns), _polynomials(at.share, DEGREE)], axis=1)


def _polynomials(share: Floats, degree: int) -> Floats:
    """(N, degree) Legendre's over a share between 0 and 1, without the constant."""
    return np.asarray(np.polynomial.legendre.legvander(2.0 * share - 1.0, degree)[:, 1:])


def _each(label: Labels) -> Floats:
    """(N, K) one column for each number from 0 on; none below."""
    return np.asarray((label[:, None] == np.arange(label.max() + 1)).astype(float))


def _ways(columns: Floats, at: View) -> Floats:
    return columns * at.way[:, None]


def _speeds(at: View) -> Floats:
    return _each(at.speed_group) if at.speed_group[0] >= 0 else _waves(at.speed, 4)


def _pressed(at: View) -> Floats:
    """Friction that grows with the load; how it differs between lifting and lowering is weight to a model."""
    return _ways(np.abs(at.load)[:, None] ** [1.0, 2.0], at)


def _bent(at: View) -> Floats:
    """A load that does not draw in proportion."""
    size = np.abs(at.load).max() or 1.0
    return np.column_stack([at.load * np.abs(at.load) / size, at.load**3 / size**2])


def _yielding(at: View) -> Floats:
    """Load where the joint stands a little farther than measured, by as much as it carries."""
    return (at.load * at.slope)[:, None]


def _lagging(at: View) -> Floats:
    """Load where the joint stood a moment ago."""
    return (at.way * at.speed * at.slope)[:, None]


def _harmonics(at: View) -> Floats:
    """First harmonic of the turn in each posture: what a wrong gravity leaves."""
    each = _each(at.posture)
    return np.concatenate([each * np.cos(at.angle)[:, None], each * np.sin(at.angle)[:, None]], axis=1)


def _within_clock(columns: Floats, at: View) -> Floats:
    """Less their mean over each recording and direction, since recordings cannot be compared in time."""
    label = 2 * at.clock + (at.way > 0)
    total = np.bincount(label, at.weight)
    means = [np.bincount(label, at.weight * column) / np.where(total > 0, total, 1.0) for column in columns.T]
    return columns - np.array(means).T[label]


def _ages(at: View) -> Floats:
    return _within_clock(_waves(at.age, SLOW), at)


def _loads_in_time(at: View) -> Floats:
    return _waves(at.age, 2) * at.load[:, None]


def _warmth(at: View) -> Floats:
    known = np.isfinite(at.temperature)
    mean = float(np.average(at.temperature[known], weights=at.weight[known])) if known.any() else 0.0
    return np.where(known, at.temperature - mean, 0.0)[:, None]


#: What is tried, by part and variable. That which turns round with the direction opposes motion.
TERMS = (
    Term("smooth", "position", _smooth),
    Term("smooth", "direction", lambda at: _ways(_smooth(at), at)),
    Term("smooth", "posture", _harmonics),
    Term("smooth", "load", _yielding),
    Term("start", "travel", lambda at: _ways(np.exp(-at.travel[:, None] / np.array(STARTS)), at)),
    Term("odd", "speed", lambda at: _ways(_speeds(at), at)),
    Term("odd", "load", _pressed),
    Term("odd", "lag", _lagging),
    Term("odd", "posture", lambda at: _ways(_each(at.posture), at)),
    Term("even", "posture", lambda at: _each(at.posture)),
    Term("even", "speed", _speeds),
    Term("even", "load", _bent),
    Term("time", "time", lambda at: _ways(_ages(at), at)),
    Term("time", "load", _loads_in_time),
    Term("time", "even", _ages),
    Term("time", "temperature", lambda at: np.concatenate([_ways(_warmth(at), at), _warmth(at)], axis=1)),
)


def fitted(at: View) -> Floats:
    """(N, 5) what is the joint's own in every model, so that a fit has taken it away: friction by direction, inertia.

    Weight is not: it is shared with other joints, which may have bent it. Columns of motions not made are zero.
    """
    ahead, back = at.way > 0, at.way < 0
    return np.column_stack([ahead, back, ahead * at.speed, back * at.speed, at.pull]).astype(float)
