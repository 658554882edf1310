"""What a plan can be made of: one joint moving at constant speed over its range or a part, the others held."""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pumaid.design.collision import Collision
from pumaid.maths import Floats
from pumaid.robot import Joint, Robot
from pumaid.trajectory import (
    QUICKEST_SLIDE,
    QUICKEST_TURN,
    Motion,
    accelerations,
    cruise,
    highest_speeds,
    span,
)
from pumaid.units import factor

#: Shares of a joint's top speed: slow enough for Stribeck friction, fast enough to tell viscous friction from it.
SHARES = (0.035, 0.07, 0.15, 0.3, 0.6, 1.0)
#: s at constant speed of runs over a part of the range; slower runs than the last cover a part of the range.
PARTS = (0.8, 2.0, 5.0, 15.0)
#: Least way at constant speed (rad, m): ripples of a motor's turn should average out.
LEAST_TURN, LEAST_SLIDE = 6.0 * factor("deg"), 0.03
#: A longer part exceeds a shorter one by this factor; a part of more than `_WHOLE` of the room takes all of it.
_LONGER, _WHOLE = 1.3, 0.8
#: Least share of the range at constant speed; ramps take the rest.
_LEAST_CRUISE = 0.6
#: Held joints stand at multiples of `_STEP`, at most `_FARTHEST` from home (rad).
_STEP, _FARTHEST = 15.0 * factor("deg"), 150.0 * factor("deg")


@dataclass(frozen=True, slots=True)
class Sweep:
    """A round trip of one joint: from stop to stop (rad or m) at `speed` (rad/s or m/s), each way a run."""

    joint: int
    stops: tuple[float, ...]
    speed: float

    @property
    def low(self) -> float:
        """Lowest position, rad or m."""
        return min(self.stops)

    @property
    def high(self) -> float:
        """Highest position, rad or m."""
        return max(self.stops)


@dataclass(frozen=True, slots=True)
class Block:
    """Sweeps of one joint that begin and end in one posture (J,), rad or m; a candidate is a block of one sweep."""

    hold: tuple[float, ...]
    sweeps: tuple[Sweep, ...]
    purpose: str = "fit"

    @property
    def joint(self) -> int:
        """From 1."""
        return self.sweeps[0].joint

    @property
    def motions(self) -> tuple[Motion, ...]:
        """Its runs."""
        ways = [(sweep, way) for sweep in self.sweeps for way in itertools.pairwise(sweep.stops)]
        return tuple(Motion(self.joint, self.hold, *way, sweep.speed, self.purpose) for sweep, way in ways)


def home(robot: Robot) -> Floats:
    """(J,) where joints are held by default, rad or m: zero where the limits allow it, else mid-range."""
    low, high = np.transpose([span(joint) for joint in robot.joints])
    return np.where(robot.is_revolute & (low <= 0.0) & (high >= 0.0), 0.0, 0.5 * (low + high))


def top_speed(robot: Robot, joint: int) -> float:
    """Highest speed (rad/s or m/s) that a plan asks of a joint: less than its own where ramps would fill the range."""
    arm = robot.joint(joint)
    low, high = span(arm)
    room = math.sqrt((1.0 - _LEAST_CRUISE) * (high - low) * float(accelerations(robot)[joint - 1]))
    return min(float(highest_speeds(robot)[joint - 1]), room, QUICKEST_TURN if arm.is_revolute else QUICKEST_SLIDE)


def speeds(robot: Robot, joint: int, shares: Sequence[float]) -> tuple[float, ...]:
    """Speeds at these shares (0..1) of the top speed, rounded down to tenths of deg/s or mm/s, rising."""
    step, top = 0.1 * _unit(robot.joint(joint)), top_speed(robot, joint)
    rounded = set()
    for speed in (share * top for share in shares):
        unit = step * 10.0 if speed >= 100.0 * step else step
        rounded.add(float(np.floor(speed / unit + 1e-9) * unit) if speed >= 4 * step else speed)
    return tuple(sorted(rounded))


def _unit(joint: Joint) -> float:
    return factor("deg") if joint.is_revolute else factor("mm")


def sweeps(robot: Robot, joint: int, at: Sequence[float]) -> tuple[Sweep, ...]:
    """Sweeps at the speeds `at`: parts up and down from home, and tours over the whole range.

    All begin and end at the joint's home position, so that nothing is lost between two sweeps of a posture.
    """
    (low, high), middle = span(robot.joint(joint)), float(home(robot)[joint - 1])
    result = dict.fromkeys(sweep for speed in at for sweep in _sweeps(robot, joint, speed))
    return tuple(result) or (Sweep(joint, _passed(middle, high, low, middle), min(at)),)


def _sweeps(robot: Robot, joint: int, speed: float) -> Iterator[Sweep]:
    """Sweeps whose runs last neither too long nor too short."""
    arm, longest, before = robot.joint(joint), PARTS[-1], 0.0
    (low, high), middle, step = span(arm), float(home(robot)[joint - 1]), _unit(arm)
    # A very slow joint takes too long over the least way and gets a shorter one.
    least = min(LEAST_TURN if arm.is_revolute else LEAST_SLIDE, 0.7 * speed * longest)
    for seconds in PARTS:
        # The way with its ramps, in whole degrees or millimetres.
        way = max(speed * seconds, least) + speed**2 / max(float(accelerations(robot)[joint - 1]), 1e-9)
        way = math.ceil(way / step - 1e-9) * step if way >= 4 * step else way
        if way < _LONGER * before:
            continue
        before = way
        up, down = (room if way > _WHOLE * room else way for room in (high - middle, middle - low))
        for end in (middle + up, middle - down):
            cruising = cruise(robot, Motion(joint, (0.0,) * robot.n_joints, middle, end, speed))[1]
            if 0.99 * PARTS[0] <= cruising <= 1.01 * longest:
                yield Sweep(joint, (middle, end, middle), speed)
    if (high - low) / speed <= longest:
        yield Sweep(joint, _passed(middle, high, low, middle), speed)
        yield Sweep(joint, _passed(middle, low, high, middle), speed)


def _passed(*stops: float) -> tuple[float, ...]:
    """Stops without those where the joint stands already."""
    return tuple(stop for k, stop in enumerate(stops) if k == 0 or abs(stop - stops[k - 1]) > 1e-9)


def postures(robot: Robot, joint: int, *, count: int, rng: np.random.Generator) -> Floats:
    """(K, J) postures, rad or m, in which one joint may run: home and `count` random ones, without repeats."""
    holds = np.tile(home(robot), (count + 1, 1))
    for axis in (axis for axis in robot.joints if axis.number != joint):
        (low, high), middle = span(axis), holds[0, axis.number - 1]
        grid = np.round(np.linspace(low, high, 5), 4)
        if axis.is_revolute:
            low, high = max(low, middle - _FARTHEST), min(high, middle + _FARTHEST)
            steps = np.arange(math.ceil(low / _STEP - 1e-9), math.floor(high / _STEP + 1e-9) + 1) * _STEP
            grid = steps if len(steps) >= 5 else np.linspace(low, high, 5)
        holds[1:, axis.number - 1] = rng.choice(grid, count)
    _, first = np.unique(np.round(holds, 9), axis=0, return_index=True)
    return holds[np.sort(first)]


def free_blocks(collision: Collision, holds: Floats, ways: Sequence[Sweep]) -> list[Block]:
    """A block of each sweep of one joint in each posture (K, J) in which it is free of collisions."""
    out, moving = [], np.arange(holds.shape[1]) == ways[0].joint - 1
    ranges = {(way.low, way.high) for way in ways}
    ranges.add((min(low for low, _ in ranges), max(high for _, high in ranges)))
    widest_first = sorted(ranges, key=lambda ends: (ends[0] - ends[1], ends))
    for hold in holds:
        # From one sweep to another the joint passes what lies between: only ways within the widest free one are used.
        for low, high in widest_first:
            if collision.first_hit(np.where(moving, low, hold), np.where(moving, high, hold)) is None:
                place = tuple(hold.tolist())
                out += [Block(place, (way,)) for way in ways if low <= way.low and way.high <= high]
                break
    return out
