"""How a virtual robot moves: trapezoids of speed, rests between them, and moves from posture to posture."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.records import Motion, Plan, Robot

Floats = NDArray[np.float64]

#: Speed of moves between postures where a joint states no highest speed: rad/s and m/s.
TURNING_SPEED, SLIDING_SPEED = 1.5, 0.25
#: s from rest to the highest speed.
RAMP_TIME = 0.4
#: s of rest before and after each run and move.
REST = 0.4
#: Share of a joint's highest speed at which moves between postures are made.
MOVE_SHARE = 0.7


def highest_speeds(robot: Robot) -> Floats:
    """(J,) highest speed, rad/s or m/s: the recipe's, or a usual one where the recipe states none."""
    usual = np.where(robot.is_revolute, TURNING_SPEED, SLIDING_SPEED)
    given = [np.nan if joint.max_velocity is None else joint.max_velocity for joint in robot.joints]
    return np.where(np.isnan(given), usual, given)


def accelerations(robot: Robot) -> Floats:
    """(J,) acceleration of ramps, rad/s2 or m/s2: the highest speed in `RAMP_TIME`."""
    return highest_speeds(robot) / RAMP_TIME


@dataclass(frozen=True, slots=True)
class Trapezoid:
    """One coordinate from `start` to `end` with speed at most `speed` and acceleration (both positive)."""

    start: float
    end: float
    speed: float
    acceleration: float

    @property
    def peak(self) -> float:
        """Highest speed reached: less than `speed` where the way is too short for it."""
        return float(min(self.speed, np.sqrt(self.acceleration * abs(self.end - self.start))))

    @property
    def ramp(self) -> float:
        """s of each ramp."""
        return self.peak / self.acceleration

    @property
    def duration(self) -> float:
        """s from rest to rest."""
        return self.ramp + (abs(self.end - self.start) / self.peak if self.peak > 0 else 0.0)

    def at(self, time: Floats) -> tuple[Floats, Floats, Floats]:
        """Position, velocity, acceleration (N,) each at `time` (N,) s since the start; at rest outside."""
        sign = 1.0 if self.end >= self.start else -1.0
        total, ramp, peak = self.duration, self.ramp, self.peak
        rising, falling = np.clip(time, 0.0, ramp), np.clip(time - (total - ramp), 0.0, ramp)
        cruising = np.clip(time - ramp, 0.0, max(total - 2 * ramp, 0.0))
        a = self.acceleration
        way = 0.5 * a * rising**2 + peak * cruising + peak * falling - 0.5 * a * falling**2
        velocity = a * (rising - falling)
        inside = (time >= 0.0) & (time < total)
        pushing = np.where(time < ramp, a, np.where(time >= total - ramp, -a, 0.0)) * inside
        # Past the end the ramps cancel only to rounding: a joint at rest must have no direction.
        return self.start + sign * way, sign * np.where(inside, velocity, 0.0), sign * pushing


@dataclass(frozen=True, eq=False, slots=True)
class Stretch:
    """A piece of the session: every joint's trapezoid, its length (s, rests included) and the motion it executes.

    `motion` is None for a move between postures. `lead` s of rest come before the joints start.
    """

    paths: tuple[Trapezoid, ...]
    lead: float
    duration: float
    motion: Motion | None
    index: int

    def at(self, time: Floats) -> tuple[Floats, Floats, Floats]:
        """Position, velocity, acceleration (N, J) each at `time` (N,) s since the stretch began."""
        parts = [path.at(time - self.lead) for path in self.paths]
        position, velocity, acceleration = (np.column_stack([part[k] for part in parts]) for k in range(3))
        return position, velocity, acceleration


def stretches(robot: Robot, plan: Plan) -> Iterator[Stretch]:
    """The session, stretch by stretch: to each motion's start with all joints at once, then the motion, with rests.

    The robot begins in the first motion's posture.
    """
    highest, ramps = highest_speeds(robot), accelerations(robot)
    now: Floats | None = None
    for index, motion in enumerate(plan.motions):
        begin = np.array(motion.hold, dtype=float)
        begin[motion.joint - 1] = motion.start
        if now is not None and np.max(np.abs(begin - now)) > 1e-9:
            yield _move(now, begin, speeds=MOVE_SHARE * highest, accelerations=ramps, index=index)
        paths = [Trapezoid(value, value, 1.0, 1.0) for value in begin.tolist()]
        j = motion.joint - 1
        paths[j] = Trapezoid(
            motion.start, motion.end, motion.velocity, max(float(ramps[j]), motion.velocity / RAMP_TIME)
        )
        yield Stretch(tuple(paths), REST, paths[j].duration + 2 * REST, motion, index)
        now = begin.copy()
        now[j] = motion.end


def _move(now: Floats, begin: Floats, *, speeds: Floats, accelerations: Floats, index: int) -> Stretch:
    rows = zip(now.tolist(), begin.tolist(), speeds.tolist(), accelerations.tolist(), strict=True)
    paths = tuple(Trapezoid(*row) for row in rows)
    return Stretch(paths, 0.0, max(path.duration for path in paths), None, index)


def cruise(robot: Robot, motion: Motion) -> tuple[tuple[float, float], float]:
    """Positions between which a motion keeps its speed, and for how long (s); ramps cut off both ends."""
    ramp = max(float(accelerations(robot)[motion.joint - 1]), motion.velocity / RAMP_TIME)
    way = 0.5 * motion.velocity**2 / ramp
    sign = 1.0 if motion.end >= motion.start else -1.0
    left = abs(motion.end - motion.start) - 2 * way
    return (motion.start + sign * way, motion.end - sign * way), max(left, 0.0) / motion.velocity


def first_starts(robot: Robot, plan: Plan, *, rate: float) -> Floats:
    """(J,) s at which each joint's first run begins; that of the arm's first where a joint has none.

    Parameters
    ----------
    robot, plan
        As for `stretches`.
    rate
        Samples a second: every stretch is a whole number of them.
    """
    clock, found = 0.0, np.full(robot.n_joints, np.nan)
    for stretch in stretches(robot, plan):
        if stretch.motion is not None and np.isnan(found[stretch.motion.joint - 1]):
            found[stretch.motion.joint - 1] = clock + stretch.lead
        clock += max(1, int(np.ceil(stretch.duration * rate))) / rate
    return np.where(np.isnan(found), np.nanmin(found) if plan.motions else 0.0, found)


def duration(robot: Robot, plan: Plan) -> float:
    """s that the plan takes, moves between postures and rests included."""
    return float(sum(stretch.duration for stretch in stretches(robot, plan)))
