"""What a residual can depend on, as columns over the bins of a joint: the terms of the residual budget."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pumaid.joint_bins import JointBins
from pumaid.preprocessing.options import CONSTANT

Floats = NDArray[np.float64]
Labels = NDArray[np.int64]

#: Distinct speeds beyond which friction over speed is a smooth curve; postures beyond which the rest count as one.
MOST_SPEEDS, MOST_POSTURES = 8, 24
#: Smooth over position: harmonics of a turn and the degree of a polynomial over the span; that of a slide.
HARMONICS, DEGREE, SLIDING_DEGREE = 3, 5, 9
#: Half waves over the campaign: a warm-up, a drift or a step shows in these. Lengths of a start, shares of the span.
SLOW, STARTS = 6, (0.01, 0.03, 0.1)
#: Key of the ripples.
RIPPLE = ("fast", "position")


@dataclass(frozen=True, eq=False, slots=True)
class BudgetVariables:
    """What a residual can depend on, at N bins of one joint.

    Attributes
    ----------
    weight, run
        (N,) samples, and number of the run from 0.
    share, angle
        (N,) position between the lowest (0) and the highest (1) of the joint; in rad, zero for a sliding joint.
    direction, speed, acceleration
        (N,) +1 or -1; share of the largest speed; share of the largest acceleration.
    age, travel
        (N,) share of the longest recording since the joint's first motion; share of the span since the motion began.
    temperature, load, slope
        (N,) degC; A that gravity draws by the model and A per span by which it changes; NaN where not known.
    speed_group, posture, clock
        (N,) numbers from 0; `speed_group` is -1 throughout where speeds are many.
    """

    weight: Floats
    run: Labels
    share: Floats
    angle: Floats
    direction: Floats
    speed: Floats
    acceleration: Floats
    age: Floats
    travel: Floats
    temperature: Floats
    load: Floats
    slope: Floats
    speed_group: Labels
    posture: Labels
    clock: Labels

    @classmethod
    def of(cls, bins: JointBins, load: Floats | None, *, is_revolute: bool) -> BudgetVariables:
        """At the bins of one joint; `load` (N,) is what gravity draws by the model (A), or None."""
        samples, runs = bins.samples, bins.runs
        q = samples.position[:, bins.joint - 1]
        speed, span = np.abs(samples.velocity[:, bins.joint - 1]), float(np.ptp(q)) or 1.0
        speeds = np.array(bins.speeds)
        are_few = len(speeds) <= MOST_SPEEDS and all(run.kind == CONSTANT for run in runs)
        nearest = [int(np.argmin(np.abs(speeds - abs(run.speed)))) if are_few else -1 for run in runs]
        posture = np.zeros(len(runs), dtype=np.int64)
        for number, group in enumerate(sorted(bins.postures, key=len, reverse=True)):
            posture[list(group)] = min(number, MOST_POSTURES)
        clock = np.unique([run.clock for run in runs], return_inverse=True)[1]
        unknown = np.full(len(q), np.nan)
        return cls(
            weight=bins.count,
            run=bins.run,
            share=(q - q.min()) / span,
            angle=q if is_revolute else np.zeros(len(q)),
            direction=samples.direction,
            speed=speed / (speed.max() or 1.0),
            acceleration=samples.acceleration / (np.abs(samples.acceleration).max() or 1.0),
            age=samples.time / (samples.time.max() or 1.0),
            travel=samples.travel / span,
            temperature=samples.temperature,
            load=unknown if load is None else load,
            slope=unknown if load is None else _slope(load, q / span, bins),
            speed_group=np.array(nearest)[bins.run],
            posture=posture[bins.run],
            clock=clock[bins.run],
        )

    def coarse(self, starts: Labels) -> BudgetVariables:
        """Means over groups of bins that begin at `starts` (within one run each)."""
        total = np.add.reduceat(self.weight, starts)
        out: dict[str, Any] = {}
        for item in fields(BudgetVariables):
            values = getattr(self, item.name)
            is_label = np.issubdtype(values.dtype, np.integer)
            out[item.name] = values[starts] if is_label else np.add.reduceat(values * self.weight, starts) / total
        return BudgetVariables(**(out | {"weight": total}))


def _slope(load: Floats, share: Floats, bins: JointBins) -> Floats:
    """(N,) derivative of a load by the position, run by run; 0 where a run stands still."""
    out = np.zeros_like(load)
    for rows in np.split(np.arange(len(load)), bins.first[1:]):
        if len(rows) > 1:
            rise, way = np.gradient(load[rows]), np.gradient(share[rows])
            out[rows] = np.divide(rise, way, out=np.zeros(len(rows)), where=way != 0.0)
    return out


@dataclass(frozen=True, slots=True)
class BudgetTerm:
    """One way in which a residual can depend on something.

    `part` of the budget, the variable (`against`), its columns over the bins, and the effects that look like it.
    """

    part: str
    against: str
    columns: Callable[[BudgetVariables], Floats]
    points_to: tuple[str, ...]


def _half_waves(share: Floats, most: int) -> Floats:
    return np.asarray(np.cos(np.pi * share[:, None] * np.arange(1, most + 1)))


def _smooth(at: BudgetVariables) -> Floats:
    """(N, K) what varies little over a run."""
    degree = DEGREE if at.angle.any() else SLIDING_DEGREE
    polynomials = np.polynomial.legendre.legvander(2.0 * at.share - 1.0, degree)[:, 1:]
    if not at.angle.any():
        return np.asarray(polynomials)
    turns = np.arange(1, HARMONICS + 1) * at.angle[:, None]
    return np.concatenate([np.cos(turns), np.sin(turns), polynomials], axis=1)


def _indicators(label: Labels) -> Floats:
    """(N, K) one column for each number from 0 on; none below."""
    return np.asarray((label[:, None] == np.arange(label.max() + 1)).astype(float))


def _odd(columns: Floats, at: BudgetVariables) -> Floats:
    return columns * at.direction[:, None]


def _by_speed(at: BudgetVariables) -> Floats:
    return _indicators(at.speed_group) if at.speed_group[0] >= 0 else _half_waves(at.speed, 4)


def _bent_load(at: BudgetVariables) -> Floats:
    size = np.abs(at.load).max() or 1.0
    return np.column_stack([at.load * np.abs(at.load) / size, at.load**3 / size**2])


def _first_harmonics(at: BudgetVariables) -> Floats:
    """First harmonic of the turn in each posture: what a wrong gravity leaves."""
    postures = _indicators(at.posture)
    return np.concatenate([postures * np.cos(at.angle)[:, None], postures * np.sin(at.angle)[:, None]], axis=1)


def _centred(columns: Floats, at: BudgetVariables, label: Labels) -> Floats:
    """Less their mean over the bins of each label."""
    total = np.bincount(label, at.weight)
    means = [np.bincount(label, at.weight * column) / np.where(total > 0, total, 1.0) for column in columns.T]
    return columns - np.array(means).T[label]


def _within(make: Callable[[BudgetVariables], Floats]) -> Callable[[BudgetVariables], Floats]:
    """Columns as they vary within each run."""
    return lambda at: _centred(make(at), at, at.run)


def _ages(at: BudgetVariables) -> Floats:
    """Time within each recording and direction, since recordings cannot be compared in time."""
    return _centred(_half_waves(at.age, SLOW), at, 2 * at.clock + (at.direction > 0))


def _warmth(at: BudgetVariables) -> Floats:
    is_measured = np.isfinite(at.temperature)
    mean = 0.0
    if is_measured.any():
        mean = float(np.average(at.temperature[is_measured], weights=at.weight[is_measured]))
    warmth = np.where(is_measured, at.temperature - mean, 0.0)[:, None]
    return np.concatenate([_odd(warmth, at), warmth], axis=1)


def _starts(at: BudgetVariables) -> Floats:
    return _odd(np.exp(-at.travel[:, None] / np.array(STARTS)), at)


_WEIGHT = ("tilt", "zero_offset", "coupling", "payload")
_BENT = ("torque_droop", "saturation")
_SIDE = ("side_load_friction", "load_friction", "coupling")
#: What is tried. Columns that turn round with the direction oppose motion.
TERMS = (
    BudgetTerm("smooth", "position", _within(_smooth), ("spring", "counterbalance", "flexibility")),
    BudgetTerm(
        "smooth", "direction", _within(lambda at: _odd(_smooth(at), at)), ("position_friction", "load_friction")
    ),
    BudgetTerm("smooth", "posture", _within(_first_harmonics), ("tilt", "zero_offset", "flexibility", "coupling")),
    BudgetTerm("smooth", "load", _within(lambda at: (at.load * at.slope)[:, None]), ("flexibility",)),
    BudgetTerm("start", "travel", _within(_starts), ("presliding", "inertia")),
    BudgetTerm(
        "odd", "direction", lambda at: _odd(at.speed[:, None] ** [0.0, 1.0], at), ("warmup", "thermal_friction")
    ),
    BudgetTerm("odd", "speed", lambda at: _odd(_by_speed(at), at), ("stribeck", "viscous_power")),
    BudgetTerm("odd", "load", lambda at: _odd(np.abs(at.load)[:, None] ** [1.0, 2.0], at), ("load_friction",)),
    BudgetTerm("odd", "lag", lambda at: (at.direction * at.speed * at.slope)[:, None], ("delay",)),
    BudgetTerm("odd", "posture", lambda at: _odd(_indicators(at.posture), at), _SIDE),
    BudgetTerm("even", "direction", lambda at: at.speed[:, None] ** [0.0, 1.0], ("payload",)),
    BudgetTerm("even", "posture", lambda at: _indicators(at.posture), _WEIGHT),
    BudgetTerm("even", "speed", _by_speed, _BENT),
    BudgetTerm("even", "load", _bent_load, _BENT),
    BudgetTerm("time", "time", lambda at: _odd(_ages(at), at), ("warmup", "friction_step")),
    BudgetTerm(
        "time", "load", lambda at: _half_waves(at.age, 2) * at.load[:, None], ("torque_constant_drift", "payload")
    ),
    BudgetTerm("time", "even", _ages, ("payload",)),
    BudgetTerm("time", "temperature", _warmth, ("thermal_friction", "warmup")),
)
#: Parts that point to causes, in the order in which they are told.
CAUSES = ("smooth", "fast", "start", "odd", "even", "time")
POINTS_TO = {(term.part, term.against): term.points_to for term in TERMS} | {RIPPLE: ("ripple",)}


def fitted_columns(at: BudgetVariables) -> Floats:
    """(N, 5) friction by direction and inertia: the joint's own in every model, so that a fit has taken them away.

    Gravity is not: it is shared with other joints, which may have bent it.
    """
    ahead, back = at.direction > 0, at.direction < 0
    return np.column_stack([ahead, back, ahead * at.speed, back * at.speed, at.acceleration]).astype(float)
