"""What a plan is made of, and in which order: one joint moving at constant speed over its range or a part, the others
held, where the arm keeps its distance from forbidden boxes and from itself; distances are MuJoCo's.
"""

import itertools
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from pumaid.errors import ModelError, RecipeError, Where, refuse
from pumaid.maths import Floats
from pumaid.robot import Joint, Robot, Safety, Sphere
from pumaid.simulation.mujoco_engine import chain
from pumaid.trajectory import (
    MOVE_SHARE,
    QUICKEST_SLIDE,
    QUICKEST_TURN,
    Motion,
    accelerations,
    cruise,
    highest_speeds,
    in_words,
    span,
)
from pumaid.units import factor

#: m: no path within the margin is called free, and none that stays this far outside it is called a collision.
TOLERANCE = 1e-3
#: m beyond which a distance need not be known.
_FAR = 10.0
#: m, radius that stands for the tip.
_POINT = 1e-6
#: Random postures: a pair that touches in all of them is a fault of the recipe.
_DRAWN = 400
#: rad and m: range of joints without limits in these postures.
_TURN, _SLIDE = (-np.pi, np.pi), (-0.5, 0.5)


class Geometry(NamedTuple):
    """A shape of the MuJoCo model."""

    label: str
    link: int  # 0 for the base
    extent: float = 0.0  # m from the link's origin to its farthest point
    is_box: bool = False


class Collision:
    """The arm's spheres, its tip and the forbidden boxes of a recipe's block `safety`, asked about whole paths.

    Raises
    ------
    RecipeError [safety-always-touching]
        A pair touches in every posture within the limits; a `Faults` where several do.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot, self.safety = robot, robot.safety or Safety()
        self._pairs: list[tuple[Geometry, Geometry]] = []
        if robot.safety is not None:
            self._build()
            self._refuse_what_always_touches()

    @property
    def is_free(self) -> bool:
        """Whether the recipe forbids nothing."""
        return not self._pairs

    def first_hit(self, start: Floats, end: Floats) -> str | None:
        """Where the straight path from `start` to `end` (J,), rad or m, first comes too near; None where it is free.

        One sentence: what comes near to what, and at which joint positions.

        Notes
        -----
        Conservative advancement: from a posture in which all distances are at least d beyond the margin, no point can
        use that up before it has gone d, so the next posture looked at is that far away and nothing is missed.
        """
        if self.is_free:
            return None
        rates, share, margin = self._reach @ np.abs(end - start), 0.0, self.safety.margin
        while True:
            position = start + share * (end - start)
            distance = self.distances(position)
            nearest = int(distance.argmin())
            if distance[nearest] < margin + TOLERANCE:
                outer, inner = self._pairs[nearest]
                return (
                    f"{outer.label} comes nearer to {inner.label} than the margin of {1e3 * margin:.0f} mm where the"
                    f" joints are at {in_words(self.robot, position)}"
                )
            if share >= 1.0:
                return None
            with np.errstate(divide="ignore"):
                share = min(1.0, share + float(np.min((distance - margin) / rates)))

    def distances(self, position: Floats) -> Floats:
        """(P,) m between the P pairs at joint positions (J,), negative where they overlap."""
        import mujoco

        self._data.qpos[:] = position
        mujoco.mj_kinematics(self._model, self._data)
        measure, model, data = mujoco.mj_geomDistance, self._model, self._data
        return np.array([measure(model, data, outer, inner, _FAR, None) for outer, inner in self._geometries])

    def _build(self) -> None:
        """The MuJoCo model: a chain of bodies with the recipe's shapes on them, and the pairs that are checked."""
        import mujoco

        safety, last = self.safety, self.robot.n_joints
        spec, bodies = chain(self.robot, [{"mass": 1.0, "inertia": [1.0, 1.0, 1.0]}] * last)
        shapes = list[Geometry]()
        for number, sphere in enumerate([Sphere(last, safety.tool or (0.0, 0.0, 0.0), _POINT), *safety.spheres]):
            bodies[sphere.link].add_geom(name=str(len(shapes)), pos=sphere.centre, size=[sphere.radius, 0, 0])
            label = f"sphere {number} of {f'link {sphere.link}' if sphere.link else 'the base'}"
            shapes.append(
                Geometry(
                    label if number else "the tip", sphere.link, float(np.linalg.norm(sphere.centre)) + sphere.radius
                )
            )
        for box in safety.boxes:
            low, high = np.array(box.low), np.array(box.high)
            spec.worldbody.add_geom(
                name=str(len(shapes)), type=mujoco.mjtGeom.mjGEOM_BOX, pos=(low + high) / 2, size=(high - low) / 2
            )
            shapes.append(Geometry(f"the box '{box.name}'", 0, is_box=True))
        self._model: Any = spec.compile()
        self._data: Any = mujoco.MjData(self._model)
        geometry = [self._model.geom(str(number)).id for number in range(len(shapes))]
        # Moving shapes with boxes, and spheres with those of links that are not adjacent; without a stated tool the tip
        # is the wrist's centre, which lies inside the wrist's own sphere.
        pairs = [
            (first, second)
            for first, outer in enumerate(shapes)
            for second, inner in enumerate(shapes)
            if (inner.is_box and outer.link)
            or (
                outer.link > inner.link + 1 and (inner.link, outer.link) not in safety.ignore and (safety.tool or first)
            )
        ]
        self._pairs = [(shapes[first], shapes[second]) for first, second in pairs]
        self._geometries = [(geometry[first], geometry[second]) for first, second in pairs]
        self._reach = np.array([self._lever(*pair) for pair in self._pairs])

    def _lever(self, outer: Geometry, inner: Geometry) -> Floats:
        """(J,) m a rad, or m a m: how far each joint takes the outer shape at most, seen from the inner one."""
        out, length = np.zeros(self.robot.n_joints), outer.extent
        for joint in reversed(self.robot.joints[inner.link : outer.link]):
            out[joint.number - 1] = length if joint.is_revolute else 1.0
            slide = 0.0 if joint.is_revolute else float(np.max(np.abs(joint.limits or _SLIDE)))
            length += float(np.linalg.norm(joint.frame[:3, 3])) + slide
        return out

    def _refuse_what_always_touches(self) -> None:
        joints, margin, faults = self.robot.joints, self.safety.margin, []
        low, high = np.transpose([joint.limits or (_TURN if joint.is_revolute else _SLIDE) for joint in joints])
        rng = np.random.default_rng(0)
        distance = np.array([self.distances(position) for position in rng.uniform(low, high, (_DRAWN, len(low)))])
        for pair in np.flatnonzero((distance < margin).all(axis=0)):
            outer, inner = self._pairs[pair]
            what = (
                f"{outer.label} is nearer to {inner.label} than the margin of {1e3 * margin:.0f} mm in all of {_DRAWN}"
                " random postures within the limits, so no posture is allowed"
            )
            mend = f"make the spheres smaller, or add {[inner.link, outer.link]} to safety.ignore"
            if inner.is_box:
                mend = "make the box smaller; a sphere that does not move belongs to link 0, which may stand in a box"
            faults.append(RecipeError("safety-always-touching", what, Where(file=self.robot.origin or None), mend))
        refuse(faults)


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


#: Random orders of a pass that are improved, and of which the shortest is taken.
_STARTS = 30
#: Rounds in which orders avoid the moves that were found to strike something.
_ROUNDS = 60
#: s that a move costs which strikes something.
_STRUCK = 1e6
#: Passes up to which each joint's highest speed is asked for early.
_FEW = 2


def schedule(
    robot: Robot, passes: Sequence[Sequence[Block]], *, collision: Collision, rng: np.random.Generator
) -> tuple[Motion, ...]:
    """Motions in the order in which they are made.

    Each pass has its own order, so that replicates are a pass apart: the shortest of thirty random orders after each
    block has been moved to its best place. Of few passes the first begins with the fastest block of every joint, since
    what changes with time and what changes with speed look alike where slow runs come early and fast ones late.

    Raises
    ------
    ModelError [plan-unsafe]
        A posture cannot be reached without a collision.
    """
    parts = list(passes)
    if 0 < len(passes) <= _FEW and collision.is_free:  # with obstacles, fewer blocks at a time leave fewer free ways
        fits = sorted(
            (block for block in passes[0] if block.purpose == "fit"),
            key=lambda block: max(sweep.speed for sweep in block.sweeps),
        )
        fastest = {block.joint: block for block in fits}
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
        paths = [_improved(cost, rng.permutation(count).tolist()) for _ in range(_STARTS)]
        for path in sorted(paths, key=length):
            if length(path) >= _STRUCK:
                continue
            moves = list(itertools.pairwise(path if now is not None else path[1:]))
            for move, where in {move: where for move in moves if (where := first_hit(*move))}.items():
                cost[move], hit = _STRUCK, where
                before, after = move
                struck[after if after <= count else before] += 1
            if length(path) < _STRUCK:
                return path[1:-1]
    ((block, _),) = struck.most_common(1)
    raise ModelError(
        "plan-unsafe",
        f"no way leads to or from a posture of joint {blocks[block].joint} without a collision: {hit}",
        Where(joint=blocks[block].joint),
        "narrow the limits, give fewer postures, or correct the recipe's boxes and spheres",
    )


def _improved(cost: Floats, order: list[int]) -> list[int]:
    """The path from the start over all blocks to the end, each put where it makes the way shortest, twice."""
    start, end = len(order), len(order) + 1
    for block in 2 * list(order):
        rest = [k for k in order if k != block]
        before, after = [start, *rest], [*rest, end]
        place = int(np.argmin(np.round(cost[before, block] + cost[block, after] - cost[before, after], 6)))
        order = [*rest[:place], block, *rest[place:]]
    return [start, *order, end]
