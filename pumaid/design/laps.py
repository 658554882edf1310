"""What a plan can be made of: laps with one joint, over its span or parts of it, at speeds that are worth trying."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.clearance import Clearance
from pumaid.records import Motion, Plan
from pumaid.robot import Joint, Robot
from pumaid.simulation.ranges import QUICKEST_SLIDE, QUICKEST_TURN, reference, span
from pumaid.trajectory import accelerations, cruise, duration, highest_speeds
from pumaid.units import factor

Floats = NDArray[np.float64]

#: Shares of the speed that a joint may have: slow enough for Stribeck friction, fast enough to tell viscous from it.
SHARES = (0.035, 0.07, 0.15, 0.3, 0.6, 1.0)
#: s at constant speed that a run over a part of the span lasts.
PARTS = (0.8, 2.0, 5.0)
#: Way at constant speed of any run, rad and m: waves of a motor's turn should not pass for friction.
LEAST_TURN, LEAST_SLIDE = 6.0 * factor("deg"), 0.03
#: Parts at one speed differ in length by this factor at least: shorter by less they could not be told apart in a log.
_LONGER = 1.3
#: A part that takes more than this share of the room takes all of it.
_WHOLE = 0.8
#: s of a run at most; slower ones cover parts.
_LONGEST = 15.0
#: A run keeps its speed over at least this share of its span; the ramps take the rest.
_LEAST_CRUISE = 0.6
#: Speeds that a joint must have courses at: fewer do not tell friction's two parts and a bend.
_FEWEST = 3


@dataclass(frozen=True, slots=True)
class Course:
    """Where one joint goes: from stop to stop (rad or m) at `speed` (positive), each way a run; back where it began."""

    joint: int
    stops: tuple[float, ...]
    speed: float

    @property
    def low(self) -> float:
        """Lowest position."""
        return min(self.stops)

    @property
    def high(self) -> float:
        """Highest position."""
        return max(self.stops)

    def motions(self, hold: tuple[float, ...], *, purpose: str = "fit") -> tuple[Motion, ...]:
        """Its runs in a posture of the other joints."""
        ways = zip(self.stops[:-1], self.stops[1:], strict=True)
        return tuple(Motion(self.joint, hold, start, end, self.speed, purpose) for start, end in ways)


def top_speed(robot: Robot, joint: int) -> float:
    """Speed (rad/s or m/s) that a plan may ask of joint `joint` (from 1).

    Its highest, at most 1.75 rad/s or 0.25 m/s, and less where the span is so short that ramps would fill it.
    """
    arm = robot.joint(joint)
    low, high = span(arm)
    room = math.sqrt((1.0 - _LEAST_CRUISE) * (high - low) * float(accelerations(robot)[joint - 1]))
    return min(float(highest_speeds(robot)[joint - 1]), room, QUICKEST_TURN if arm.is_revolute else QUICKEST_SLIDE)


def speeds(robot: Robot, joint: int, shares: Sequence[float]) -> tuple[float, ...]:
    """Speeds of a joint's runs, rising, each once, rounded down: to tenths of degrees or millimetres a second, to whole
    ones from ten on, very slow ones not at all.

    Parameters
    ----------
    robot, joint
        Its limits and highest speed; joint from 1.
    shares
        0..1 of `top_speed`.
    """
    step = 0.1 * _step(robot.joint(joint))
    most = top_speed(robot, joint)
    return tuple(sorted({_rounded(share * most, step) for share in shares}))


def _rounded(speed: float, step: float) -> float:
    whole = step * 10.0 if speed >= 100.0 * step else step
    return float(np.floor(speed / whole + 1e-9) * whole) if speed >= 4 * step else speed


def _step(joint: Joint) -> float:
    return factor("deg") if joint.is_revolute else factor("mm")


def courses(robot: Robot, joint: int, fast: Sequence[float]) -> tuple[Course, ...]:
    """Courses at each speed that a run can keep for long enough: parts up and down, and tours of the whole span.

    All begin and end where the joint is held while others run, so that no way is wasted: a tour goes to one end, over
    the whole span to the other, and back; a part there and back.

    Parameters
    ----------
    robot, joint
        Its span; joint from 1.
    fast
        Speeds, rad/s or m/s.
    """
    for least in (LEAST_TURN if robot.joint(joint).is_revolute else LEAST_SLIDE, 0.0):
        found = _courses(robot, joint, fast, least=least)
        # A joint so slow that a run over the least way lasts too long goes over less of it.
        if len({course.speed for course in found}) >= min(_FEWEST, len(fast)):
            return found
    low, high = span(robot.joint(joint))
    home = float(reference(robot)[joint - 1])
    return found or (Course(joint, _distinct((home, high, low, home)), min(fast)),)


def _courses(robot: Robot, joint: int, fast: Sequence[float], *, least: float) -> tuple[Course, ...]:
    """Courses whose runs last neither too long nor too short and are `least` long (rad or m)."""
    low, high = span(robot.joint(joint))
    home = float(reference(robot)[joint - 1])
    found: list[Course] = []
    for speed in fast:
        before = 0.0
        for lasting in (*PARTS, _LONGEST):
            way = _way(robot, joint, speed=speed, cruising=max(speed * lasting, least))
            if way < _LONGER * before:
                continue
            before = way
            up, down = (room if way > _WHOLE * room else way for room in (high - home, home - low))
            some = [Course(joint, (home, end, home), speed) for end in (home + up, home - down)]
            found += [one for one in some if _cruises(robot, one, lasting)]
        if (high - low) / speed <= _LONGEST:
            tours = (home, high, low, home), (home, low, high, home)
            found += [Course(joint, _distinct(stops), speed) for stops in tours]
    return tuple(dict.fromkeys(found))


def _distinct(stops: tuple[float, ...]) -> tuple[float, ...]:
    """Without stops that are where the joint stands already."""
    kept = [stop for k, stop in enumerate(stops) if k == 0 or abs(stop - stops[k - 1]) > 1e-9]
    return tuple(kept)


def _way(robot: Robot, joint: int, *, speed: float, cruising: float) -> float:
    """Way, ramps included, of a run that keeps its speed over `cruising` (rad or m); whole degrees or millimetres."""
    step = _step(robot.joint(joint))
    way = cruising + speed**2 / max(float(accelerations(robot)[joint - 1]), 1e-9)
    return math.ceil(way / step - 1e-9) * step if way >= 4 * step else way


def _cruises(robot: Robot, course: Course, lasting: float) -> bool:
    """Whether a course keeps its speed for at least a part's time, and takes no longer than a run may."""
    motion = course.motions((0.0,) * robot.n_joints)[0]
    kept = cruise(robot, motion)[1]
    return 0.99 * min(PARTS[0], lasting) <= kept <= 1.01 * max(_LONGEST, lasting)


def seconds(robot: Robot, course: Course) -> float:
    """s that a course takes, rests included."""
    return duration(robot, Plan(robot=robot.name, motions=course.motions((0.0,) * robot.n_joints)))


def free(clearance: Clearance, holds: Floats, some: Sequence[Course]) -> NDArray[np.bool_]:
    """(K, C) which of C courses of one joint can be driven in which of K postures without striking anything."""
    out = np.ones((len(holds), len(some)), dtype=bool)
    if clearance.is_free or not len(holds):
        return out
    # Parts are driven where the whole is free; only where it is not is each looked at.
    joint = some[0].joint - 1
    low, high = min(one.low for one in some), max(one.high for one in some)
    whole = clearance.struck(*_ends(holds, joint, low, high))
    ways = sorted({(one.low, one.high) for one in some})
    for k in np.flatnonzero(whole):
        hold = np.tile(holds[k], (len(ways), 1))
        starts, ends = hold.copy(), hold.copy()
        starts[:, joint], ends[:, joint] = np.array(ways).T
        open_ways = [way for way, hit in zip(ways, clearance.struck(starts, ends).tolist(), strict=True) if not hit]
        # Within the widest free way only: from one part to another the joint passes what lies between.
        low, high = max(open_ways, key=lambda way: way[1] - way[0], default=(1.0, 0.0))
        out[k] = [low <= one.low and one.high <= high for one in some]
    return out


def _ends(holds: Floats, joint: int, low: float, high: float) -> tuple[Floats, Floats]:
    starts, ends = holds.copy(), holds.copy()
    starts[:, joint], ends[:, joint] = low, high
    return starts, ends
