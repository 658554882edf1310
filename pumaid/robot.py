"""The arm as its recipe states it, in SI, and where its links are: a constant placement a joint, then its motion.

Frames by roll, pitch and yaw or by an axis, and postures that are near one another.
"""

import hashlib
import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pumaid.errors import ModelError, Where, nearest
from pumaid.maths import Counts, Flags, Floats

Point = tuple[float, float, float]
#: Quantities of a joint in the order in which a table's columns are kept.
QUANTITIES = ("position", "velocity", "current", "temperature")
#: The joint of a choice that stands for all of them.
ALL = "all"
#: Shapes that are words -> these, in the order of the numbers that they stand for.
SHAPE_WORDS: Mapping[str, tuple[str, ...]] = {
    "of": ("position", "speed", "load", "travel", "time", "temperature"),
    "odd": ("false", "true"),
    "times": ("nothing", "speed"),
}


@dataclass(frozen=True, slots=True)
class Joint:
    """One joint and the link that it moves; its frame is stated by modified Denavit-Hartenberg parameters (Craig)."""

    number: int  # from 1, base to tip
    name: str
    kind: str  # "revolute" or "prismatic": about or along the frame's z
    theta: float = 0.0  # rad, m; theta of a revolute and d of a prismatic joint are added to the measured position
    alpha: float = 0.0
    a: float = 0.0
    d: float = 0.0
    limits: tuple[float, float] | None = None  # lowest and highest measured position, rad or m
    max_velocity: float | None = None  # rad/s or m/s
    gear_ratio: float | None = None  # motor turns per joint turn (of a prismatic joint rad of the motor per m)
    # Rows of the (4, 4) frame at zero in that of the joint before, instead of the parameters.
    placement: tuple[tuple[float, ...], ...] | None = None

    @property
    def frame(self) -> Floats:
        """(4, 4) the joint's frame at zero in that of the joint before."""
        if self.placement is not None:
            return np.array(self.placement)
        # J. J. Craig, Introduction to Robotics, 3rd ed., eq. (3.6).
        c, s, ca, sa = np.cos(self.theta), np.sin(self.theta), np.cos(self.alpha), np.sin(self.alpha)
        return np.array(
            [
                [c, -s, 0.0, self.a],
                [s * ca, c * ca, -sa, -sa * self.d],
                [s * sa, c * sa, ca, ca * self.d],
                [0.0, 0.0, 0.0, 1.0],
            ]
        )

    @property
    def is_revolute(self) -> bool:
        """Whether the joint turns."""
        return self.kind == "revolute"

    @property
    def position_unit(self) -> str:
        """``"rad"`` or ``"m"``."""
        return "rad" if self.is_revolute else "m"


@dataclass(frozen=True, slots=True)
class Conversion:
    """What a log's number of a joint means: (number - zero) * scale, in the unit of the quantity.

    `encoding` says how the number shows its sign: ``float`` by itself, ``intN`` (or ``uintN-two-complement``) in N bits
    that may have been read as if without one, ``sign-bit-N`` by a bit beside its size. `step` is what stands in the log
    for one count of it.
    """

    scale: float = 1.0
    zero: float = 0.0
    encoding: str = "float"
    step: float = 1.0

    def decoded(self, values: Floats) -> Floats:
        """(N,) numbers as a log has them, with their sign; those that have it stay."""
        bits = [int(word) for word in re.findall(r"\d+", self.encoding)]
        if not bits:
            return values
        is_bit = "bit" in self.encoding
        place = self.step * 2.0 ** (bits[0] if is_bit else bits[0] - 1)
        return np.where(values < place - 0.5 * self.step, values, place - values if is_bit else values - 2.0 * place)


@dataclass(frozen=True, slots=True)
class LogFormat:
    """How this robot's logs are written: column templates, their units and signs.

    Templates hold ``{joint}`` (from 1), ``{joint0}`` (from 0) or ``{name}`` (the joint's, from `names`); `velocity` and
    `temperature` may be absent from a log. `units` are unit words by quantity (time, position, velocity,
    prismatic_position, prismatic_velocity, current, temperature), SI where not named. `signs` hold J values of +1 or -1
    for position (and velocity) and for current, by which the log's numbers are multiplied. `fraction` is a second
    column of the time, with fractions of its seconds. `conversions` hold J values for a quantity.
    """

    time: str = "t"
    position: str = "q{joint}"
    velocity: str | None = "qd{joint}"
    current: str = "i{joint}"
    temperature: str | None = "temp{joint}"
    units: Mapping[str, str] = field(default_factory=dict)
    signs: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    fraction: str = ""
    conversions: Mapping[str, tuple[Conversion, ...]] = field(default_factory=dict)
    delay: float = 0.0  # s by which the currents of a row were drawn before its positions

    def conversion(self, quantity: str, joint: int) -> Conversion:
        """What the numbers of `quantity` of joint `joint` (from 1) mean."""
        return self.conversions[quantity][joint - 1] if quantity in self.conversions else Conversion()

    def column(self, quantity: str, joint: int) -> str | None:
        """The file's column for `quantity` of joint `joint` (from 1), or none if the format has no such quantity."""
        template = getattr(self, quantity)
        name = self.names[joint - 1] if joint <= len(self.names) else f"joint{joint}"
        return None if template is None else str(template).format(joint=joint, joint0=joint - 1, name=name)


@dataclass(frozen=True, slots=True)
class EffectChoice:
    """An effect beyond the paper's model, at one joint or (None) at every joint where it applies, with given shapes."""

    effect: str
    joint: int | None = None
    shape: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Box:
    """A block along the base's axes that the tip and every capsule stay out of: lowest and highest corner, m."""

    name: str
    low: Point
    high: Point


@dataclass(frozen=True, slots=True)
class Capsule:
    """A rod with round ends fixed to a link (0: the base, 1..J what each joint moves).

    `start` and `end` of its axis are in the link's frame, m; where they are one point it is a ball.
    """

    link: int
    start: Point
    end: Point
    radius: float


@dataclass(frozen=True, slots=True)
class Safety:
    """The block `safety` of a recipe: forbidden space and the arm's own extent."""

    boxes: tuple[Box, ...] = ()
    tool: Point | None = None  # m, the tip in the last link's frame; None: its origin, held against what stands only
    margin: float = 0.02  # m that must be left
    ignore: tuple[tuple[int, int], ...] = ()  # pairs of links whose shapes are not held against each other
    floor: float | None = None  # m above the base's origin, against gravity, below which nothing may come
    links: tuple[tuple[int, float], ...] = ()  # link and radius (m) of capsules that follow from the joints' frames
    capsules: tuple[Capsule, ...] = ()  # those of neighbouring links are never held against each other


#: A known load that the last link carries: kg, and where its centre of mass is in that link's frame, m (in the recipe
#: and in plans as the recipe states that frame).
Payload = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Robot:
    """The arm as its recipe states it; what is made once of an arm is cached by it, so that its parts are immutable."""

    name: str
    joints: tuple[Joint, ...]  # base to tip
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.80665)  # m/s2, in base axes
    log: LogFormat = field(default_factory=LogFormat, hash=False)
    effects: tuple[EffectChoice, ...] = field(default=(), hash=False)  # that are switched on
    origin: str = ""  # the recipe's file name; empty where the robot was made in memory, like the digest
    digest: str = ""  # SHA-256 of the recipe
    effect_lines: tuple[int | None, ...] = ()  # of the recipe, on which its effects stand
    safety: Safety | None = None  # what the arm must not touch
    # By (I, J), J < I from 1: turns of joint I's motor for a turn of J's while joint I stands; both have gear ratios.
    coupling: Mapping[tuple[int, int], float] = field(default_factory=dict, hash=False)
    payloads: Mapping[str, Payload] = field(default_factory=dict, hash=False)  # by name or pattern of log files
    # (4, 4) rows of the last link's frame in the one that the recipe states: of another axis, or of a standard table.
    tip: tuple[tuple[float, ...], ...] = tuple(map(tuple, np.eye(4).tolist()))

    def joint(self, number: int) -> Joint:
        """Joint by its number, from 1."""
        return self.joints[number - 1]

    @property
    def n_joints(self) -> int:
        """J."""
        return len(self.joints)

    @property
    def geometry(self) -> str:
        """SHA-256 of what a recipe says of the arm itself, not of its name, its logs and its effects."""
        return hashlib.sha256(repr((self.joints, self.gravity, sorted(self.coupling.items()))).encode()).hexdigest()

    def carried(self, payload: Payload) -> Payload:
        """A payload whose place counts in the last link's frame as the recipe states it, in the link's frame here."""
        x, y, z, _ = (np.linalg.inv(self.tip) @ (*payload[1:], 1.0)).tolist()
        return payload[0], x, y, z

    @property
    def placements(self) -> Floats:
        """(J, 4, 4) each joint's frame at zero in that of the joint before, the first in the base."""
        return _placements(self.joints)

    @property
    def length(self) -> float:
        """m that its links reach if stretched; infinite where the geometry gives them none."""
        return float(np.linalg.norm(self.placements[:, :3, 3], axis=1).sum()) or math.inf

    @property
    def is_revolute(self) -> Flags:
        """(J,) whether each joint turns."""
        return np.array([joint.is_revolute for joint in self.joints])

    @property
    def shaft_speeds(self) -> Floats:
        """(J, J) unit lower triangular: from joints' velocities to those that drive the friction of their motors.

        With motor speeds qdS_i = qd_i/r_i + sum of r_ij qdS_j over j < i and r_i = 1/gear_ratio, joint i's is
        r_i qdS_i. The identity where no gear couples joints.

        Source
        ------
        S.-K. Lin, Identification of a Class of Nonlinear Deterministic Systems, eq. (38)-(40).
        """
        out = np.eye(self.n_joints)
        for (driven, driving), ratio in sorted(self.coupling.items()):
            after, before = self.joint(driven).gear_ratio, self.joint(driving).gear_ratio
            assert after is not None and before is not None
            out[driven - 1] += ratio * before / after * out[driving - 1]
        return out

    def shaft_velocity(self, velocity: Floats) -> Floats:
        """(N, J) velocities that drive each motor's friction, in units of its joint, for (N, J) joint velocities."""
        return velocity @ self.shaft_speeds.T if self.coupling else velocity

    def rotations(self, position: ArrayLike) -> Floats:
        """(N, J, 3, 3) from every link frame to the base, for (N, J) measured positions; ``[:, i, :, 2]`` are axes."""
        angles = np.where(self.is_revolute, np.atleast_2d(np.asarray(position, dtype=float)), 0.0)
        cosines, sines = np.cos(angles), np.sin(angles)
        out = np.empty((*angles.shape, 3, 3))
        x, y, z = np.broadcast_to(np.eye(3)[:, None], (3, len(angles), 3))
        for joint, turn in enumerate(self.placements[:, :3, :3]):
            x, y, z = (turn[0, k] * x + turn[1, k] * y + turn[2, k] * z for k in range(3))
            c, s = cosines[:, joint, None], sines[:, joint, None]
            x, y = c * x + s * y, c * y - s * x
            out[:, joint, :, 0], out[:, joint, :, 1], out[:, joint, :, 2] = x, y, z
        return out

    def frames(self, position: ArrayLike) -> tuple[Floats, Floats]:
        """Rotations (N, J, 3, 3) of all link frames and their origins (N, J, 3) in base axes, m."""
        q, placements, out = np.atleast_2d(np.asarray(position, dtype=float)), self.placements, self.rotations(position)
        steps = out[..., 2] * np.where(self.is_revolute, 0.0, q)[..., None]
        steps[:, 0] += placements[0, :3, 3]
        steps[:, 1:] += np.einsum("njab,jb->nja", out[:, :-1], placements[1:, :3, 3])
        return out, np.cumsum(steps, axis=1)

    def displacements(self, position: Floats) -> Floats:
        """(N, J) m along each z, for (N, J) measured positions: the lever arms of what slides."""
        return np.where(self.is_revolute, 0.0, position) + np.array([joint.d for joint in self.joints])


def steiner(masses: Floats, centres: Floats) -> Floats:
    """(J, 6) kg m2 that masses at their centres have about the origins: xx, xy, xz, yy, yz, zz."""
    x, y, z = centres.T
    return np.asarray(masses * [y * y + z * z, -x * y, -x * z, x * x + z * z, -y * z, x * x + y * y]).T


def of_point(robot: Robot, mass: float, moments: Floats) -> Floats:
    """(10, 4) what of each parameter of a body a point on the last link has per unit of mass and of first moments (3,).

    Of its inertia, which is their square over the mass, the tangent where they are, so that all of it is theirs by
    Euler; none where they are no point within the arm's own length.
    """
    out, axes, place = np.eye(10, 4), np.eye(3), np.asarray(moments) / (mass or np.inf)
    if np.linalg.norm(place) <= robot.length:
        out[4:, 0] = -steiner(np.ones(1), place[None])[0]
        out[4:, 1:] = 0.5 * (steiner(np.ones(3), place + axes) - steiner(np.ones(3), place - axes)).T
    return out


@lru_cache(maxsize=64)
def _placements(joints: tuple[Joint, ...]) -> Floats:
    out = np.array([joint.frame for joint in joints])
    out.setflags(write=False)
    return out


def apart(first: ArrayLike, second: ArrayLike) -> Floats:
    """How far held positions are apart (rad or m, not negative), whole turns taken out; NaN where either is NaN.

    Encoders of endless joints are unwrapped file by file, so one posture may be told with turns between. A sliding
    joint that travels 2 pi m is taken for one of them: none does.
    """
    gap = np.asarray(first, dtype=float) - np.asarray(second, dtype=float)
    return np.abs(np.remainder(gap + np.pi, 2.0 * np.pi) - np.pi)


def placement(xyz: ArrayLike, rpy: ArrayLike, axis: ArrayLike = (0.0, 0.0, 1.0)) -> Floats:
    """A (4, 4) frame shifted by `xyz` (m), turned by `rpy` (rad) and then by the least angle that takes z to `axis`.

    Source
    ------
    URDF's definition of ``origin`` (wiki.ros.org/urdf/XML/joint): Rot_z(yaw) Rot_y(pitch) Rot_x(roll).
    """
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    about_y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    about_z = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    out = np.eye(4)
    out[:3, :3] = about_z @ about_y @ about_x @ turn_of_z(axis)
    out[:3, 3] = xyz
    return out


def turn_of_z(axis: ArrayLike) -> Floats:
    """The rotation (3, 3) by the least angle that takes z to the direction of a vector; about x where that is -z."""
    x, y, z = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    if z < 1e-15 - 1.0:
        return np.diag([1.0, -1.0, -1.0])
    cross = np.array([[0.0, 0.0, x], [0.0, 0.0, y], [-x, -y, 0.0]])
    return np.eye(3) + cross + cross @ cross / (1.0 + z)


def roll_pitch_yaw(rotation: Floats) -> tuple[float, float, float]:
    """Angles (rad) with Rot_z(yaw) Rot_y(pitch) Rot_x(roll) = `rotation` (3, 3), exact also at a pitch of 90 deg."""
    yaw = float(np.arctan2(rotation[1, 0], rotation[0, 0]))
    pitch = float(np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0])))
    # Roll from what is left when yaw is taken out: near a right angle the errors of both then cancel.
    side = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
    return float(np.arctan2(-side @ rotation[:, 2], side @ rotation[:, 1])), pitch, yaw


def grouped(count: int, alike: Callable[[int, Counts], Counts]) -> Iterator[list[int]]:
    """Groups of numbers 0..count-1, each of a first one and those after it that are like it and like no earlier first.

    Parameters
    ----------
    count
        How many there are.
    alike
        Of a number and (n,) numbers, those of these that are like it.

    Examples
    --------
    >>> values = np.array([1.0, 5.0, 1.1, 5.1, 1.2])
    >>> list(grouped(5, lambda first, others: others[np.abs(values[others] - values[first]) < 0.15]))
    [[0, 2], [1, 3], [4]]
    """
    remaining = np.arange(count, dtype=np.int64)
    while len(remaining):
        members = np.zeros(len(remaining), np.bool_)
        members[np.searchsorted(remaining, alike(int(remaining[0]), remaining))] = True
        members[0] = True
        yield remaining[members].tolist()
        remaining = remaining[~members]


def posture_groups(postures: Floats, within: float) -> list[list[int]]:
    """Counts (from 0) of (N, J) postures that are `within` (rad or m) of the first of their group."""
    return list(grouped(len(postures), lambda first, rest: near(postures, first, rest, within=within)))


def near(postures: Floats, first: int, numbers: Counts, *, within: float) -> Counts:
    """Those of some postures that are one's neighbours, whole turns taken out.

    Parameters
    ----------
    postures
        (N, J) rad or m; where one is NaN it is near any.
    first, numbers
        The one's number, and (n,) numbers.
    within
        How far apart (rad or m) they may be at each joint.
    """
    # Joint after joint: of thousands of postures few are left for the second.
    for column in postures.T:
        numbers = numbers[~(apart(column[first], column[numbers]) > within)]
    return numbers


def numbered(key: str, value: Any) -> Any:
    """The number that a word of a shape stands for; any other value as it is."""
    words, word = SHAPE_WORDS.get(key, ()), str(value).lower()
    return float(words.index(word)) if word in words else value


def worded(shape: Mapping[str, float]) -> dict[str, Any]:
    """A shape as people and documents have it: words for numbers where the effect has any."""
    words: Mapping[str, Any] = {**SHAPE_WORDS, "odd": (False, True)} if "of" in shape else {}
    return {key: words[key][int(size)] if key in words else size for key, size in shape.items()}


def read_choice(text: str, robot: Robot, option: str) -> EffectChoice:
    """What a user writes after `option`, ``EFFECT[@JOINT][:KEY=VALUE,...]``; the effect and its keys are not checked.

    The joint is a number from 1, a joint's name or ``all`` (as is none). Raises ModelError: effect-joint where there is
    no such joint, effect-shape where a value is no number or given twice.
    """
    where, shape = Where(field=f"{option} {text}"), dict[str, float]()
    head, _, tail = text.partition(":")
    name, at, word = (part.strip() for part in head.partition("@"))
    if at and not word:
        raise ModelError("effect-joint", "no joint is named after the @", where, f"write {option} stribeck@3")
    names = {axis.name: axis.number for axis in robot.joints}
    joint = None if word in ("", ALL) else names.get(word) or (int(word) if word.isdecimal() else 0)
    if joint is not None and not 1 <= joint <= robot.n_joints:
        near = nearest(word, names)
        mend = f"did you mean {near}?" if near else f"one of {', '.join(names)}, a number from 1, or {ALL}"
        raise ModelError("effect-joint", f"{robot.name} has no joint {word}", where, mend)
    for key, _, value in (part.partition("=") for part in tail.split(",") if part.strip()):
        key = key.strip()
        if key in shape:
            raise ModelError("effect-shape", f"{key} is given twice", where, "give it once")
        try:
            shape[key] = float(numbered(key, value.strip()))
        except ValueError:
            what = " or ".join(f"{key}={word}" for word in SHAPE_WORDS.get(key, ("NUMBER",)))
            raise ModelError(
                "effect-shape", f"{key} is {value!r}, which is no number", where, f"write {what}, or leave it out"
            ) from None
    return EffectChoice(name, joint, shape)
