"""Runs that could still be made: within the recipe's limits, in postures of the data and in new ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.design.collision import Collision
from pumaid.effect_spec import EffectTerm
from pumaid.estimation.fit import Fit, FitRow, with_loads
from pumaid.estimation.noise import Noise
from pumaid.joint_bins import JointBins, distinct
from pumaid.records import Samples
from pumaid.robot import Joint
from pumaid.trajectory import Motion
from pumaid.units import factor

Floats = NDArray[np.float64]
Room = tuple[float, float]

#: Slowest run as a share of the highest speed, and of the slowest run so far: whichever is slower.
SLOW, SLOWER = 0.02, 0.5
#: Fastest run as a share of the highest speed: a trajectory generator overshoots.
FAST = 0.95
#: Speeds tried, from the slowest to the fastest.
SPEEDS = 9
#: s of a ramp from rest to the speed of a run, and least time at constant speed.
RAMP, LEAST = 0.4, 0.5
#: s that a run takes at most, unless the data have longer ones.
LONGEST = 40.0
#: What is left free at a limit, as a share of the range, and at most (rad or m).
MARGIN, MOST_MARGIN = 0.02, 0.05
#: Widest stretch of a turning joint that is worth its time, rad.
WIDEST = 1.5 * np.pi
#: Postures taken from the data, and drawn.
KNOWN, DRAWN = 5, 9
#: Decimals of a known posture, rad or m.
DIGITS = 4
#: Held joints stand at multiples of this, so that people can read and set them, and this near to where they have been
#: on the average: rad.
STEP, FARTHEST = 15.0 * factor("deg"), 150.0 * factor("deg")
#: Bins of a run; of a wave of a periodic effect, and at most.
CELLS, A_WAVE, MOST_CELLS = 40, 4, 512
#: Seed of the drawn postures.
SEED = 41


@dataclass(frozen=True, slots=True)
class Lap:
    """There and back with one joint at one speed.

    Attributes
    ----------
    joint
        Moving joint, from 1.
    hold
        (J,) positions of all joints, rad or m.
    low, high
        rad or m.
    speed
        rad/s or m/s.
    is_new
        Whether the arm stood in no such posture before.
    """

    joint: int
    hold: tuple[float, ...]
    low: float
    high: float
    speed: float
    is_new: bool

    @property
    def motions(self) -> tuple[Motion, Motion]:
        """Forward and backward."""
        ends = ((self.low, self.high), (self.high, self.low))
        first, second = (Motion(self.joint, self.hold, start, end, self.speed) for start, end in ends)
        return first, second


def room(solved: Fit, number: int) -> Room:
    """Lowest and highest position (rad or m) that a joint may take: its limits, else where it has been."""
    been = _been(solved, number)
    limits = solved.model.robot.joint(number).limits
    if limits is None:
        return been
    margin = min(MARGIN * (limits[1] - limits[0]), MOST_MARGIN)
    low, high = min(limits[0] + margin, been[0]), max(limits[1] - margin, been[1])
    return max(low, limits[0]), min(high, limits[1])


def _been(solved: Fit, number: int) -> Room:
    q = [row.bins.samples.position[:, number - 1] for row in solved.joints]
    return min(float(one.min()) for one in q), max(float(one.max()) for one in q)


def laps(solved: Fit, joint: int, *, drawn: int = DRAWN) -> tuple[Lap, ...]:
    """What joint `joint` (from 1) can do: every speed on every stretch in every posture.

    Parameters
    ----------
    solved
        The data so far.
    joint
        Moves.
    drawn
        New postures.
    """
    postures = [(hold, False) for hold in _known(solved, joint)]
    postures += [(hold, True) for hold in _drawn(solved, joint, drawn)]
    stretches = [(*_stretch(solved, joint, speed, wide), speed) for speed in speeds(solved, joint) for wide in (1, 0)]
    here = [one for k, one in enumerate(stretches) if one not in stretches[:k]]
    found = [Lap(joint, hold, low, high, speed, is_new) for hold, is_new in postures for low, high, speed in here]
    return tuple(_free(solved, found))


def _free(solved: Fit, found: Sequence[Lap]) -> list[Lap]:
    """Laps that strike nothing of what the recipe forbids."""
    collision, joint = Collision(solved.model.robot), found[0].joint - 1 if found else 0
    if collision.is_free:
        return list(found)
    starts, ends = (np.array([lap.hold for lap in found]) for _ in range(2))
    starts[:, joint], ends[:, joint] = [lap.low for lap in found], [lap.high for lap in found]
    return [lap for lap, start, end in zip(found, starts, ends, strict=True) if not collision.strikes(start, end)]


def speeds(solved: Fit, joint: int) -> tuple[float, ...]:
    """Speeds (rad/s or m/s) on a logarithmic grid, rounded to two digits of degrees or millimetres a second."""
    arm, runs = solved.model.robot.joint(joint), solved.row(joint).bins.runs
    seen = [abs(run.speed) for run in runs]
    highest = arm.max_velocity or max(seen)
    slow, fast = min(SLOW * highest, SLOWER * min(seen)), min(max(FAST * highest, *seen), highest)
    low, high = _wide(solved, joint)
    fast = min(fast, max((high - low) / (RAMP + LEAST), max(seen)))
    unit = _step(arm)
    rounded = [unit * float(f"{speed / unit:.2g}") for speed in np.geomspace(slow, fast, SPEEDS)]
    return distinct([min(speed, fast) for speed in rounded])


def _step(joint: Joint) -> float:
    return factor("deg") if joint.is_revolute else factor("mm")


def _wide(solved: Fit, joint: int) -> Room:
    low, high = room(solved, joint)
    q = solved.row(joint).bins.samples.position[:, joint - 1]
    if not solved.model.robot.joint(joint).is_revolute:
        return low, high
    spare = max(0.5 * (WIDEST - float(np.ptp(q))), 0.0)
    return max(low, float(q.min()) - spare), min(high, float(q.max()) + spare)


def _stretch(solved: Fit, joint: int, speed: float, is_wide: int) -> Room:
    """From where to where: as wide as possible, or as the data's run that is nearest in speed; slow ones shorter."""
    runs = solved.row(joint).bins.runs
    near = min(runs, key=lambda run: abs(np.log(abs(run.speed) / speed)))
    low, high = _wide(solved, joint)
    if not is_wide:
        ramps = RAMP * abs(near.speed) / 2.0
        low, high = max(low, min(near.span) - ramps), min(high, max(near.span) + ramps)
    longest = max(LONGEST, *(run.duration for run in runs))
    spare = max(high - low - speed * longest, 0.0) / 2.0
    unit = _step(solved.model.robot.joint(joint))
    ends = unit * np.ceil((low + spare) / unit), unit * np.floor((high - spare) / unit)
    return (float(ends[0]), float(ends[1])) if ends[1] - ends[0] > RAMP * speed else (low, high)


def _known(solved: Fit, joint: int) -> list[tuple[float, ...]]:
    """Postures of the data, those with the most runs first, without the last digits of what was measured."""
    bins, arms = solved.row(joint).bins, solved.model.robot.joints
    groups = sorted(bins.postures, key=lambda group: (-len(group), group[0]))[:KNOWN]
    held = np.round(bins.samples.position[bins.first[[group[0] for group in groups]]], DIGITS)
    bounds = [arm.limits or (-np.inf, np.inf) for arm in arms]
    return [tuple(one.tolist()) for one in np.clip(held, *np.transpose(bounds))]


def _drawn(solved: Fit, joint: int, count: int) -> list[tuple[float, ...]]:
    rng = np.random.default_rng([SEED, joint])
    robot, base = solved.model.robot, np.array(_known(solved, joint)[0])
    out = []
    for _ in range(count if robot.n_joints > 1 else 0):
        hold = base.copy()
        for other in robot.joints:
            low, high = room(solved, other.number)
            if other.is_revolute:
                middle = 0.5 * sum(_been(solved, other.number))
                low, high = max(low, middle - FARTHEST), min(high, middle + FARTHEST)
            steps = STEP if other.is_revolute else (high - low) / 8.0 or 1.0
            places = np.arange(np.ceil(low / steps - 1e-9), np.floor(high / steps + 1e-9) + 1) * steps
            if other.number != joint and len(places):
                hold[other.number - 1] = rng.choice(places)
        out.append(tuple(np.round(hold, 9).tolist()))
    return out


def bins_for(solved: Fit, added: Sequence[EffectTerm]) -> int:
    """Bins a run that show all effects, periodic ones too."""
    out = CELLS
    for one in added:
        if one.effect.periodic is not None and one.joint is not None:
            low, high = _wide(solved, one.joint)
            waves = one.shape[one.effect.periodic] * (high - low) / (2.0 * np.pi)
            out = max(out, int(np.clip(A_WAVE * waves, CELLS, MOST_CELLS)))
    return out


def ahead(solved: Fit, chosen: Sequence[Lap], *, age: tuple[float, float], bins: int = CELLS) -> FitRow:
    """Runs of one joint that have not been made, as a row: two a lap, forward and backward, nothing measured.

    Noise is that of the run of the data that is nearest in speed, at the new length of bins.

    Parameters
    ----------
    solved
        The data so far.
    chosen
        L laps of one joint.
    age
        s since the joint's and the arm's first motion when a run starts.
    bins
        K of each run.
    """
    joint, own = chosen[0].joint, chosen[0].joint - 1
    old = solved.row(joint)
    lap = [each for each in chosen for _ in range(2)]
    sign = np.tile([1.0, -1.0], len(chosen))
    speed = np.array([one.speed for one in lap])
    low, high = (np.array([getattr(one, name) for one in lap]) for name in ("low", "high"))
    ramp = np.minimum(0.5 * RAMP * speed, 0.25 * (high - low))
    way = high - low - 2.0 * ramp
    share = (np.arange(bins) + 0.5) / bins
    gone = way[:, None] * share
    position = np.repeat(np.array([one.hold for one in lap]), bins, axis=0)
    position[:, own] = (np.where(sign > 0, low + ramp, high - ramp)[:, None] + sign[:, None] * gone).ravel()
    velocity = np.zeros_like(position)
    velocity[:, own] = np.repeat(sign * speed, bins)
    passed = (gone / speed[:, None]).ravel()
    samples = Samples(
        joint,
        position,
        velocity,
        acceleration=np.zeros(len(position)),
        direction=np.repeat(sign, bins),
        time=age[0] + passed,
        elapsed=age[1] + passed,
        travel=gone.ravel(),
        temperature=np.full(len(position), _temperature(old, is_cold=age[0] == 0.0)),
        run=np.repeat(np.arange(float(len(lap))), bins),
        extra=None if old.bins.samples.extra is None else np.zeros((len(position), old.bins.samples.extra.shape[1])),
    )
    step = way / speed / bins
    nothing = np.zeros(len(position))
    made = replace(
        old.bins,
        runs=(),
        samples=samples,
        current=nothing,
        count=nothing + 1.0,
        inside=nothing,
        first=np.arange(len(lap)) * bins,
        step=step,
        groups=(),
        postures=(),
    )
    return _as_row(solved, made, old.noise.at(old.bins, speed, step))


def _as_row(solved: Fit, bins: JointBins, noise: Noise) -> FitRow:
    bins = replace(bins, samples=with_loads(solved, bins.samples, bins.lengths))
    design = np.hstack([solved.model.along(bins.samples, bins.lengths), solved.model.beyond(bins.samples)])
    row = solved.at(bins, design, noise)
    return replace(row, residual=bins.current, misfit=bins.current)


def _temperature(old: FitRow, *, is_cold: bool) -> float:
    known = old.bins.samples.temperature[np.isfinite(old.bins.samples.temperature)]
    return float("nan") if len(known) == 0 else float(known.min() if is_cold else known.max())
