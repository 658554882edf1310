"""What a plan can be made of: one joint moving at constant speed over its range or a part, the others held.

And the order of a plan's runs: replicates far apart in time, blocks in random order, moves short and clear.
"""

import itertools
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from pumaid.design.collision import TOLERANCE, Collision
from pumaid.errors import ModelError, Where
from pumaid.maths import Floats
from pumaid.robot import Joint, Robot
from pumaid.trajectory import (
    MOVE_SHARE,
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
#: Where home is forbidden so many postures are drawn, and so many free ones compared, by logarithms of what is
#: free of the ranges; what each joint that is not at its usual place takes from them.
_STANCES, _JUDGED, _UNUSUAL = 2000, 40, 0.1
#: Random orders of a pass that are improved, and of which the shortest is taken.
_STARTS = 30
#: Rounds in which orders avoid the moves that were found to strike something.
_ROUNDS = 60
#: s that a move costs which strikes something.
_STRUCK = 1e6
#: Passes up to which each joint's highest speed is asked for early.
_FEW = 2


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
    """(J,) where joints are held by default, rad or m: zero where the limits allow it, else mid-range.

    Where that, or much of the joints' ranges there, is forbidden, it is a posture that leaves more of them.
    """
    return np.array(stance(robot)[0])


@lru_cache(maxsize=16)
def stance(robot: Robot) -> tuple[tuple[float, ...], tuple[tuple[float, float], ...]]:
    """Home (J,), and (J, 2) lowest and highest position of each joint with the others there, clear of the forbidden."""
    usual_spans = tuple(span(joint) for joint in robot.joints)
    low, high = np.array(usual_spans).T
    usual = np.where(robot.is_revolute & (low <= 0.0) & (high >= 0.0), 0.0, 0.5 * (low + high))
    collision, rng = Collision(robot, spare=TOLERANCE), np.random.default_rng(0)
    if collision.is_free:
        return tuple(usual.tolist()), usual_spans
    grids = [_grid(joint, middle) for joint, middle in zip(robot.joints, usual, strict=True)]
    drawn = np.column_stack([rng.choice(grid, _STANCES) for grid in grids])
    drawn = np.vstack([usual, np.where(rng.random(drawn.shape) < 0.7, usual, drawn)])
    free = itertools.islice((place for place in drawn if collision.free_share(place, place)[1] is None), _JUDGED)
    best, worth, units = (tuple(usual.tolist()), usual_spans), -np.inf, [_unit(joint) for joint in robot.joints]
    for place in free:
        ranges, spans = [], [span(joint, at) for joint, at in zip(robot.joints, place.tolist(), strict=True)]
        for j, (at, unit) in enumerate(zip(place.tolist(), units, strict=True)):
            ends = (np.where(np.arange(len(place)) == j, end, place) for end in spans[j])
            down, up = (collision.free_share(place, end)[0] for end in ends)
            # Rounded inwards, since the last position that is free may be forbidden by a hair.
            lowest = spans[j][0] if down == 1.0 else at - math.floor(down * (at - spans[j][0]) / unit) * unit
            highest = spans[j][1] if up == 1.0 else at + math.floor(up * (spans[j][1] - at) / unit) * unit
            ranges.append((lowest, highest))
        shares = np.diff(ranges, axis=1)[:, 0] / np.diff(spans, axis=1)[:, 0]
        value = float(np.sum(np.log(np.maximum(shares, 1e-3)))) - _UNUSUAL * int(np.sum(place != usual))
        if value > worth + 1e-9:
            best, worth = (tuple(place.tolist()), tuple(ranges)), value
    return best


def _grid(joint: Joint, middle: float) -> Floats:
    low, high = span(joint, middle)
    if not joint.is_revolute:
        return np.round(np.linspace(low, high, 5), 4)
    low, high = max(low, middle - _FARTHEST), min(high, middle + _FARTHEST)
    steps = np.arange(math.ceil(low / _STEP - 1e-9), math.floor(high / _STEP + 1e-9) + 1) * _STEP
    return np.asarray(steps if len(steps) >= 5 else np.linspace(low, high, 5))


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
    middle = float(home(robot)[joint - 1])
    low, high = span(robot.joint(joint), middle)
    ranges = dict.fromkeys([(low, high), stance(robot)[1][joint - 1]])
    result = dict.fromkeys(sweep for speed in at for ends in ranges for sweep in _sweeps(robot, joint, speed, ends))
    return tuple(result) or (Sweep(joint, _passed(middle, high, low, middle), min(at)),)


def _sweeps(robot: Robot, joint: int, speed: float, ends: tuple[float, float]) -> Iterator[Sweep]:
    arm, longest, before = robot.joint(joint), PARTS[-1], 0.0
    middle, step = float(home(robot)[joint - 1]), _unit(arm)

    def cruising(end: float) -> float:
        return cruise(robot, Motion(joint, (0.0,) * robot.n_joints, middle, end, speed))[1]

    # An end too near to reach the speed on the way is left out.
    low, high = (end if cruising(end) >= 0.5 * PARTS[0] else middle for end in ends)
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
        stops = [end for end in (middle + up, middle - down) if 0.99 * PARTS[0] <= cruising(end) <= 1.01 * longest]
        yield from (Sweep(joint, (middle, end, middle), speed) for end in stops)
    if low < high and (high - low) / speed <= longest:
        yield Sweep(joint, _passed(middle, high, low, middle), speed)
        yield Sweep(joint, _passed(middle, low, high, middle), speed)


def _passed(*stops: float) -> tuple[float, ...]:
    return tuple(stop for k, stop in enumerate(stops) if k == 0 or abs(stop - stops[k - 1]) > 1e-9)


def postures(robot: Robot, joint: int, *, count: int, rng: np.random.Generator) -> Floats:
    """(K, J) postures, rad or m, in which one joint may run: home and `count` random ones, without repeats."""
    holds = np.tile(home(robot), (count + 1, 1))
    for axis in (axis for axis in robot.joints if axis.number != joint):
        holds[1:, axis.number - 1] = rng.choice(_grid(axis, holds[0, axis.number - 1]), count)
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


class NoWay(ModelError):
    """No free move was found to or from the posture `hold`."""

    hold: tuple[float, ...] = ()


def schedule(
    robot: Robot, passes: Sequence[Sequence[Block]], *, collision: Collision, rng: np.random.Generator
) -> tuple[Motion, ...]:
    """Motions in the order in which they are made.

    Each pass has its own order, so that replicates are a pass apart: the shortest of thirty random orders after each
    block has been moved to its best place. Of few passes the first begins with the fastest block of every joint, since
    what changes with time and what changes with speed look alike where slow runs come early and fast ones late.

    Raises
    ------
    NoWay [plan-unsafe]
        A posture cannot be reached without a collision.
    """
    parts = list(passes)
    if 0 < len(passes) <= _FEW and collision.is_free:  # with obstacles, fewer blocks at a time leave fewer free ways
        rising = sorted(passes[0], key=lambda block: max(sweep.speed for sweep in block.sweeps))
        fastest = {block.joint: block for block in rising if block.purpose == "fit"}
        parts = [[b for b in passes[0] if (b is fastest.get(b.joint)) is first] for first in (True, False)]
        parts += passes[1:]
    parts = [part for part in parts if part]
    out: list[Motion] = []
    now: Sequence[float] | None = None
    for part, later in zip(parts, [*parts[1:], []], strict=True):
        order = _shortest(robot, part, [now, *(block.hold for block in later)], collision=collision, rng=rng)
        for block in (part[k] for k in order):
            out += replace(block, sweeps=tuple(block.sweeps[k] for k in rng.permutation(len(block.sweeps)))).motions
        now = part[order[-1]].hold
    return tuple(out)


def _shortest(
    robot: Robot,
    blocks: Sequence[Block],
    around: Sequence[Sequence[float] | None],
    *,
    collision: Collision,
    rng: np.random.Generator,
) -> list[int]:
    """The shortest order of B blocks whose moves are free of collisions.

    `around` are the posture in which the arm stands (None: in any) and those to one of which it goes afterwards.
    """
    count, (now, *later) = len(blocks), around
    places = np.array([*(block.hold for block in blocks), blocks[0].hold if now is None else now])
    # s of moves between blocks, from the start (node B) and to the end (node B + 1), which costs nothing. To the
    # microsecond: an order and its reverse take equally long, and rounding must not choose between them.
    cost, pace = np.zeros((count + 2, count + 2)), MOVE_SHARE * highest_speeds(robot)
    cost[:-1, :-1] = np.round(np.max(np.abs(places[:, None] - places) / pace, axis=2), 6)
    cost[count] *= now is not None
    struck, hit = Counter[int](), ""

    def first_hit(before: int, after: int) -> str | None:
        ends = [places[after]] if after <= count else [np.array(place) for place in later]
        hits = [collision.first_hit(places[before], end) for end in ends]
        return hits[0] if hits and all(hits) else None

    def length(path: Sequence[int]) -> float:
        return round(float(np.sum(cost[path[:-1], path[1:]])), 6)

    for _ in range(1 if collision.is_free else _ROUNDS):
        for path in sorted((_improved(cost, rng.permutation(count).tolist()) for _ in range(_STARTS)), key=length):
            if length(path) >= _STRUCK:
                continue
            moves = itertools.pairwise(path if now is not None else path[1:])
            for move, where in {move: where for move in moves if (where := first_hit(*move))}.items():
                before, after = move
                cost[move], hit = _STRUCK, where
                cost[move[::-1]] = _STRUCK  # the way back is the same
                struck[after if after <= count else before] += 1
            if length(path) < _STRUCK:
                return path[1:-1]
    ((block, _),) = struck.most_common(1)
    error = NoWay(
        "plan-unsafe",
        f"no way leads to or from a posture of joint {blocks[block].joint} without a collision: {hit}",
        Where(joint=blocks[block].joint),
        "narrow the limits, or correct the recipe's block safety",
    )
    error.hold = blocks[block].hold
    raise error


def _improved(cost: Floats, order: list[int]) -> list[int]:
    """The path from the start over all blocks to the end, each put where it makes the way shortest, twice."""
    start, end = len(order), len(order) + 1
    for block in 2 * list(order):
        rest = [k for k in order if k != block]
        before, after = [start, *rest], [*rest, end]
        place = int(np.argmin(np.round(cost[before, block] + cost[block, after] - cost[before, after], 6)))
        order = [*rest[:place], block, *rest[place:]]
    return [start, *order, end]
