"""How a virtual robot moves: from rest to rest under the speed limit of its controller, with moves between postures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.robot import Robot
from pumaid.trajectory import (
    MOVE_SHARE,
    RAMP_TIME,
    REST,
    Motion,
    Plan,
    Trapezoid,
    accelerations,
    highest_speeds,
    move_trapezoid,
    run_trapezoid,
)

Floats = NDArray[np.float64]

#: Gains of the controller (34): 1/s2 and 1/s, K_D = 2 sqrt(K_P). Within a `NEAR`th of a second's way of its target a
#: joint leaves its speed and creeps in.
K_P, K_D = 400.0, 40.0
NEAR = K_P / K_D
#: s in which a joint that left its speed is at rest: critically damped, of its last way a five-hundredth is left then,
#: and friction holds it.
BRAKE_TIME = 0.42
#: Share of the speed within which it counts as kept.
KEPT = 0.002


@dataclass(frozen=True, slots=True)
class Path:
    """One coordinate from `start` to `end`: a step of the controller's target, its speed limited.

    The limit rises from 0 to `speed` at `acceleration` (both positive). What is told here is what (34) and (36) make
    of it where the current does what it should: the speed follows its limit 1/K_D s late, is kept, and falls
    exponentially from a `NEAR`th of a second before the end.
    """

    start: float
    end: float
    speed: float
    acceleration: float

    @property
    def way(self) -> float:
        """rad or m, not negative."""
        return abs(self.end - self.start)

    @property
    def peak(self) -> float:
        """Highest speed: less than `speed` where the way is too short for it."""
        a = self.acceleration
        # The limit a t meets what (36) allows so near the end, NEAR (way - a t^2 / 2).
        return float(min(self.speed, a * (np.sqrt(1.0 + 2.0 * self.way * NEAR**2 / a) - 1.0) / NEAR))

    @property
    def ramp(self) -> float:
        """s in which the limit rises to the peak."""
        return self.peak / self.acceleration

    @property
    def settling(self) -> float:
        """s from the ramp's end until the speed is kept, ever nearer."""
        deficit = (1.0 - np.exp(-K_D * self.ramp)) / (K_D * max(self.ramp, 1e-9))
        return float(max(np.log(max(deficit, 1e-9) / KEPT), 0.0) / K_D)

    @property
    def leaving(self) -> float:
        """s from the start until the joint leaves its speed for the end."""
        if self.peak <= 0.0:
            return 0.0
        return self.ramp / 2 + 1.0 / K_D + max(self.way / self.peak - 1.0 / NEAR, self.ramp / 2)

    @property
    def duration(self) -> float:
        """s from rest to rest."""
        return self.leaving + BRAKE_TIME if self.way > 0 else 0.0

    @property
    def kept(self) -> tuple[float, float]:
        """s from the start between which the speed is kept; the same instant twice where it never is."""
        first, last = self.ramp + self.settling, self.leaving
        return (first, last) if last > first else (last, last)

    def kept_at(self, time: Floats) -> Floats:
        """(N,) position `time` (N,) s after the start, while the speed is kept."""
        sign = 1.0 if self.end >= self.start else -1.0
        return np.asarray(self.start + sign * self.peak * (time - self.ramp / 2 - 1.0 / K_D))


@dataclass(frozen=True, eq=False, slots=True)
class Stretch:
    """A piece of the session: every joint's path, its length (s, rests included) and the motion it executes.

    `motion` is None for a move between postures. `lead` s of rest come before the joints start.
    """

    paths: tuple[Path, ...]
    lead: float
    duration: float
    motion: Motion | None
    index: int

    def samples(self, rate: float) -> int:
        """Samples at `rate` (Hz): every stretch is a whole number of them."""
        return max(1, int(np.ceil(self.duration * rate)))


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
            straight = move_trapezoid(robot, now, begin, number=index + 1)
            yield _move(straight, speeds=MOVE_SHARE * highest, accelerations=ramps)
        paths = [Path(value, value, 1.0, 1.0) for value in begin.tolist()]
        j = motion.joint - 1
        paths[j] = _path(robot, motion)
        yield Stretch(tuple(paths), REST, run_trapezoid(robot, motion).seconds, motion, index)
        now = begin.copy()
        now[j] = motion.end


def _path(robot: Robot, motion: Motion) -> Path:
    ramp = max(float(accelerations(robot)[motion.joint - 1]), motion.velocity / RAMP_TIME)
    return Path(motion.start, motion.end, motion.velocity, ramp)


def _move(straight: Trapezoid, *, speeds: Floats, accelerations: Floats) -> Stretch:
    rows = zip(straight.start.tolist(), straight.end.tolist(), speeds.tolist(), accelerations.tolist(), strict=True)
    paths = tuple(Path(*row) for row in rows)
    return Stretch(paths, 0.0, straight.seconds, None, straight.number - 1)


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
        clock += stretch.samples(rate) / rate
    return np.where(np.isnan(found), np.nanmin(found) if plan.motions else 0.0, found)
