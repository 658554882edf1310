"""What a controller is told to do, one thing after the other: moves between postures and runs, from rest to rest."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.records import Motion, Plan
from pumaid.robot import Robot
from pumaid.simulation.timing import MOVE_SHARE, RAMP_TIME, REST, accelerations, highest_speeds, stretches
from pumaid.units import factor

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, slots=True)
class Step:
    """All joints from `start` to `end` (J,) together, straight in the joints' space, by one trapezoid of speed.

    Attributes
    ----------
    start, end
        rad or m.
    speed, acceleration
        Of the joint that goes farthest, rad/s or m/s, rad/s2 or m/s2.
    motion, number
        The run that this is and its number from 1; for a move None and the number of the run to which it leads.
    """

    start: Floats
    end: Floats
    speed: float
    acceleration: float
    motion: Motion | None
    number: int

    @property
    def way(self) -> float:
        """How far the joint goes that goes farthest, rad or m."""
        return float(np.max(np.abs(self.end - self.start)))

    @property
    def peak(self) -> float:
        """The speed that it reaches: less than `speed` on a short way."""
        return float(min(self.speed, np.sqrt(self.acceleration * self.way)))

    def corners(self) -> Iterator[tuple[float, Floats, Floats]]:
        """Time (s since the step began), positions (J,) and velocities (J,) where the ramps end, and at the end."""
        ramp, way = self.peak / self.acceleration, self.end - self.start
        cruise = self.way / self.peak - ramp
        share, rate = 0.5 * ramp * self.peak / self.way, self.peak / self.way
        yield ramp, self.start + share * way, rate * way
        if cruise > 1e-9:
            yield ramp + cruise, self.end - share * way, rate * way
        yield 2.0 * ramp + cruise, self.end, np.zeros_like(way)


def steps(robot: Robot, plan: Plan) -> Iterator[Step]:
    """The plan's moves and runs in order; the arm begins in the first run's posture.

    Parameters
    ----------
    robot, plan
        Speeds and ramps are those of `pumaid.simulation.timing`, so that programs and the virtual robot agree on runs.
        Moves are straight here, as controllers make them, and bent there.
    """
    ramps = accelerations(robot)
    now: Floats | None = None
    for number, motion in enumerate(plan.motions, start=1):
        j = motion.joint - 1
        begin = np.array(motion.hold, dtype=float)
        begin[j] = motion.start
        if now is not None and np.max(np.abs(begin - now)) > 1e-9:
            yield _move(robot, now, begin, number)
        end = begin.copy()
        end[j] = motion.end
        yield Step(begin, end, motion.velocity, max(float(ramps[j]), motion.velocity / RAMP_TIME), motion, number)
        now = end


def _move(robot: Robot, now: Floats, begin: Floats, number: int) -> Step:
    """As fast as the slowest joint allows when all arrive together."""
    way = np.abs(begin - now)
    share = way / way.max()
    moved = share > 1e-12
    speed = np.min(MOVE_SHARE * highest_speeds(robot)[moved] / share[moved])
    acceleration = np.min(accelerations(robot)[moved] / share[moved])
    return Step(now, begin, float(speed), float(acceleration), None, number)


def run_times(robot: Robot, plan: Plan) -> Floats:
    """(M, 2) s at which each run begins and ends, its ramps included, counted from the first rest.

    Parameters
    ----------
    robot, plan
        As for `steps`; timed as the virtual robot executes them.
    """
    clock, found = 0.0, []
    for stretch in stretches(robot, plan):
        if stretch.motion is not None:
            begin = clock + stretch.lead
            found.append((begin, clock + stretch.duration - REST))
        clock += stretch.duration
    return np.array(found).reshape(-1, 2)


def told(motion: Motion, robot: Robot) -> str:
    """A run in a remark: ``joint 3 (elbow) from -125 to 125 deg at 30 deg/s, fit``."""
    joint = robot.joint(motion.joint)
    scale, unit = (factor("deg"), "deg") if joint.is_revolute else (1.0, "m")
    start, end, speed = (value / scale + 0.0 for value in (motion.start, motion.end, motion.velocity))
    way = f"from {start:.6g} to {end:.6g} {unit} at {speed:.6g} {unit}/s"
    return f"joint {joint.number} ({joint.name}) {way}, {motion.purpose}"
