"""Physics that a virtual robot has and the paper's model has not: one table of laws, and how a user names them.

Nothing here is shared with the effects that a model is fitted with: the laws are written a second time, most of them
exactly where the model has a linear form, and gravity comes from the virtual arm's own masses.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from pumaid.effect_choice import did_you_mean, read_choice
from pumaid.errors import ModelError, Where
from pumaid.robot import Robot

Floats = NDArray[np.float64]

#: degC of the room, in which every motor begins; s in which a motor comes within 1/e of its last temperature; degC
#: above the room of a motor that draws its usual current for good.
AMBIENT, WARMING_TIME, RISE = 25.0, 600.0, 30.0
#: SI; no value of a law is larger on any arm, and farther on currents overflow.
GREATEST = 1e9
#: s; no current is logged later.
LATEST = 1.0
#: Significant digits of values that are not given.
_DIGITS = 4


@dataclass(frozen=True, slots=True)
class Hidden:
    """One hidden effect: its name in the catalogue of effects, its joint (from 1; None for all), its values (SI, A)."""

    effect: str
    joint: int | None = None
    values: dict[str, float] = field(default_factory=dict)


@dataclass(eq=False, slots=True)
class ArmState:
    """The whole arm at N instants, or at one (then without the first axis of all shapes)."""

    time: Floats  # (N,) s of the session
    first: Floats  # (J,) s of the session at which each joint's first run begins
    position: Floats  # (N, J) rad or m, like its derivatives
    velocity: Floats
    acceleration: Floats
    travel: Floats  # (N, J) rad or m since each joint left its last rest
    temperature: Floats  # (N, J) degC of the motors
    load: Floats = field(default_factory=lambda: np.zeros(0))  # (N, J) A that the weight draws
    # (N, J) A that the weight's moment across the axis would draw if it lay along it
    across: Floats = field(default_factory=lambda: np.zeros(0))
    friction: Floats = field(default_factory=lambda: np.zeros(0))  # (N, J) A of Coulomb and viscous friction


@dataclass(frozen=True, eq=False, slots=True)
class JointState:
    """One joint (from 1); `side` is +1 where its motor counts its current along the joint's motion, else -1."""

    arm: ArmState
    joint: int
    side: float

    def of(self, quantity: str) -> Floats:
        """(N,) values of a quantity of the arm at this joint."""
        column: Floats = getattr(self.arm, quantity)[..., self.joint - 1]
        return column

    @property
    def time(self) -> Floats:
        """(N,) s since the joint's first run began."""
        return np.asarray(self.arm.time - self.arm.first[self.joint - 1])

    @property
    def speed(self) -> Floats:
        """(N,) rad/s or m/s, not negative."""
        return np.abs(self.of("velocity"))

    @property
    def opposing(self) -> Floats:
        """(N,) direction of a current that overcomes friction: +1, -1, 0 at rest."""
        return np.asarray(self.side * np.sign(self.of("velocity")))


@dataclass(frozen=True, slots=True)
class Typical:
    """What is usual of one joint of a virtual arm, so that an effect can be given a size that shows."""

    joint: int  # from 1
    coulomb: float  # A, mean of both directions
    speed: float  # the highest that a plan uses, rad/s or m/s
    acceleration: float  # likewise, rad/s2 or m/s2
    half_span: float  # of what a plan lets it travel, rad or m
    load: float  # A of gravity, root mean square over many postures
    peak_load: float  # A of gravity, the greatest
    across: float  # A, root mean square of the moment across the axis
    coulomb_before: float  # A, Coulomb friction of the joint before it (of joint 2 for joint 1)
    last_mass: float  # kg of the last link
    reach: float  # m of the whole arm


class Kind(Enum):
    """How an effect acts."""

    FRICTION = "opposes the motion, by a size in A"
    LOAD = "draws a current whatever the motion"
    BODY = "changes what weighs, or where it stands"
    CURRENT = "changes the motor's whole current"
    CLOCK = "stamps the current late"


@dataclass(frozen=True, slots=True)
class Law:
    """One law, which acts in the current of the joint that its value ``on`` names; without such a value in its own."""

    kind: Kind
    keys: tuple[str, ...]  # names of its values, those of the catalogue's parameters and shapes
    usual: Callable[[Typical], tuple[float, ...]]  # values that show at a joint like that but do not rule it
    # (N,) A by the joint's state, the whole current before a law that changes it, and the values; none for laws of
    # bodies and clocks, which the virtual robot applies itself.
    current: Callable[..., Floats] | None = None
    is_of_arm: bool = False  # the whole arm's and not a joint's
    needs_masses: bool = False  # constants in amperes do not do


def _counterbalance(at: JointState, a: float, length: float, angle: float) -> Floats:
    """A constant force along a cylinder from a foot at distance 1 to a lever of length c: force times lever arm."""
    turned = at.of("position") - angle
    along = np.stack([length * np.cos(turned) - 1.0, length * np.sin(turned)])
    along = along / np.sqrt(along[0] ** 2 + along[1] ** 2)
    return np.asarray(a * (np.cos(turned) * along[1] - np.sin(turned) * along[0]))


def _load_friction(at: JointState, drive: float, back: float) -> Floats:
    load = at.of("load")
    return np.asarray(np.abs(load) * np.where(load * at.opposing > 0, drive, back))


def _waves(at: JointState, cos: float, sin: float, frequency: float) -> Floats:
    angle = frequency * at.of("position")
    return np.asarray(cos * np.cos(angle) + sin * np.sin(angle))


#: Name of the effect -> law; those of the whole current in the order in which they act.
LAWS = {
    "stribeck": Law(
        Kind.FRICTION,
        ("a", "velocity", "exponent"),
        lambda joint: (0.4 * joint.coulomb, 0.2 * joint.speed, 1.0),
        lambda at, a, velocity, exponent: a * np.exp(-((at.speed / velocity) ** exponent)),
    ),
    "viscous_power": Law(
        Kind.FRICTION,
        ("b", "exponent"),
        # As much as Coulomb friction at the highest speed: all but a tenth of it passes for viscous friction.
        lambda joint: (joint.coulomb / joint.speed**0.4, 0.4),
        lambda at, b, exponent: b * at.speed**exponent,
    ),
    "load_friction": Law(Kind.FRICTION, ("drive", "back"), lambda joint: (0.15, 0.1), _load_friction),
    "side_load_friction": Law(
        Kind.FRICTION,
        ("mu",),
        lambda joint: (0.4 * joint.coulomb / joint.across,),
        lambda at, mu: mu * at.of("across"),
        needs_masses=True,
    ),
    "position_friction": Law(
        Kind.FRICTION,
        ("cos", "sin", "harmonic"),
        lambda joint: (0.25 * joint.coulomb, 0.2 * joint.coulomb, 2.0),
        _waves,
    ),
    "ripple": Law(
        Kind.LOAD,
        ("cos", "sin", "frequency"),
        # Twenty waves over the span: slow enough for any log, fast enough to be no gravity.
        lambda joint: (0.15 * joint.coulomb, 0.1 * joint.coulomb, float(round(20 * np.pi / joint.half_span))),
        _waves,
    ),
    "spring": Law(
        Kind.LOAD, ("a",), lambda joint: (joint.coulomb / joint.half_span,), lambda at, a: a * at.of("position")
    ),
    "counterbalance": Law(
        Kind.LOAD, ("a", "length", "angle"), lambda joint: (joint.coulomb, 0.6, 0.5), _counterbalance
    ),
    "presliding": Law(
        Kind.FRICTION,
        ("a", "travel"),
        lambda joint: (0.6 * joint.coulomb, 0.08 * joint.half_span),
        lambda at, a, travel: -a * np.exp(-at.of("travel") / travel),
    ),
    "inertia": Law(
        Kind.LOAD,
        ("J",),
        lambda joint: (0.5 * joint.coulomb / joint.acceleration,),
        lambda at, J: at.side * J * at.of("acceleration"),
    ),
    "delay": Law(Kind.CLOCK, ("dt",), lambda joint: (0.04,)),
    "warmup": Law(
        Kind.FRICTION,
        ("a", "time_constant"),
        lambda joint: (0.4 * joint.coulomb, 600.0),
        lambda at, a, time_constant: a * np.exp(-at.time / time_constant),
    ),
    "friction_step": Law(
        Kind.FRICTION,
        ("a", "time"),
        lambda joint: (0.3 * joint.coulomb, 600.0),
        lambda at, a, time: a * (at.time > time),
    ),
    # Grease thins: a twentieth of the friction is gone with every degree of the first ten.
    "thermal_friction": Law(
        Kind.FRICTION,
        ("a",),
        lambda joint: (-0.05 * joint.coulomb,),
        lambda at, a: a * (at.of("temperature") - AMBIENT),
    ),
    "tilt": Law(Kind.BODY, ("x", "y"), lambda joint: (0.04, -0.03), is_of_arm=True),
    "zero_offset": Law(Kind.BODY, ("delta",), lambda joint: (0.06,)),
    "payload": Law(
        Kind.BODY,
        ("mass", "x", "y", "z", "time"),
        lambda joint: (joint.last_mass, 0.0, 0.03 * joint.reach, 0.05 * joint.reach, 600.0),
        is_of_arm=True,
        needs_masses=True,
    ),
    "flexibility": Law(Kind.BODY, ("c",), lambda joint: (0.08 / joint.peak_load,)),
    "coupling": Law(
        Kind.LOAD,
        ("c", "on"),
        # On the motor before: a drive passes through the joints before its own.
        lambda joint: (0.4 * joint.coulomb_before / joint.load, float(joint.joint - 1 if joint.joint > 1 else 2)),
        lambda at, c, on: c * (at.of("load") + at.of("friction")),
    ),
    "torque_constant_drift": Law(
        Kind.CURRENT,
        ("a", "time_constant"),
        lambda joint: (0.15, 600.0),
        lambda at, current, a, time_constant: current - a * current * np.expm1(-np.maximum(at.time, 0) / time_constant),
    ),
    "torque_droop": Law(
        Kind.CURRENT,
        ("a",),
        lambda joint: (0.3 / (joint.peak_load + joint.coulomb) ** 2,),
        lambda at, current, a: current + a * current**3,
    ),
    "saturation": Law(
        Kind.CURRENT,
        ("limit",),
        lambda joint: (0.75 * joint.peak_load + joint.coulomb,),
        lambda at, current, limit: np.clip(current, -limit, limit),
    ),
}


def added(hidden: Sequence[Hidden], at: JointState, kind: Kind) -> Floats | float:
    """(N,) A of hidden friction (its size) or of hidden loads that the joint has; 0 where it has none."""
    total: Floats | float = 0.0
    for effect in hidden:
        law, values = LAWS[effect.effect], effect.values
        if law.kind is kind and law.current and values.get("on", effect.joint) in (None, at.joint):
            cause = JointState(at.arm, effect.joint or at.joint, at.side)
            total = total + law.current(cause, *(values[key] for key in law.keys))
    return total


def whole(hidden: Sequence[Hidden], at: JointState, current: Floats) -> Floats:
    """(N,) A that laws of the whole current make of a joint's current (N,) A, in the order of the table."""
    for name, law in LAWS.items():
        for effect in hidden:
            if effect.effect == name and law.kind is Kind.CURRENT and law.current and effect.joint in (None, at.joint):
                current = law.current(at, current, *(effect.values[key] for key in law.keys))
    return current


def values_of(hidden: Sequence[Hidden], effect: str, key: str, *, n_joints: int) -> Floats:
    """(J,) sums of one value of an effect over the joints that have it, such as ``delta`` of ``zero_offset``."""
    out = np.zeros(n_joints)
    for entry in hidden:
        if entry.effect == effect:
            out[slice(None) if entry.joint is None else entry.joint - 1] += entry.values[key]
    return out


def delays(hidden: Sequence[Hidden], n_joints: int) -> Floats:
    """(J,) s by which each joint's current is stamped late; early, or later than `LATEST`, is refused (hide-wrong)."""
    late = values_of(hidden, "delay", "dt", n_joints=n_joints)
    if not np.all((late >= 0.0) & (late <= LATEST)):
        what = f"a current cannot be logged {float(late[np.argmax(np.abs(late))]):g} s late"
        raise ModelError("hide-wrong", what, Where(field="--hide delay"), f"give dt from 0 to {LATEST:g} s")
    return late


def sized(hidden: Sequence[Hidden], usual: Sequence[Typical], *, has_masses: bool) -> tuple[Hidden, ...]:
    """Hidden effects with all their values, one a joint where an effect of joints names none.

    Values that are missing follow from what is usual of every joint of the arm.

    Raises
    ------
    ModelError [hide-wrong]
        The effect needs masses and the arm has only constants; or weight, and the joint carries none.
    """
    out: list[Hidden] = []
    for effect in hidden:
        law, place = LAWS[effect.effect], Where(field=f"--hide {effect.effect}")
        if law.needs_masses and not has_masses:
            what = f"the arm is known by its constants in amperes alone, and {effect.effect} needs its masses"
            raise ModelError("hide-wrong", what, place, "leave out --truth table1")
        is_for_all = effect.joint is None and not law.is_of_arm
        joints = usual if is_for_all else [usual[(effect.joint or len(usual)) - 1]]
        full = [
            Hidden(effect.effect, joint.joint if is_for_all else effect.joint, _usual(law, joint) | effect.values)
            for joint in joints
        ]
        finite = [entry for entry in full if all(map(math.isfinite, entry.values.values()))]
        if not finite:
            what = f"joint {effect.joint} carries no weight, and {effect.effect} follows the weight"
            raise ModelError("hide-wrong", what, place, "name a joint that carries weight")
        out += finite
    return tuple(out)


def _usual(law: Law, joint: Typical) -> dict[str, float]:
    """Usual values by key; NaN where they follow from a weight and the joint carries none."""
    try:
        usual = law.usual(joint)
    except ZeroDivisionError:
        usual = (math.nan,) * len(law.keys)
    return {key: float(f"{value:.{_DIGITS}g}") for key, value in zip(law.keys, usual, strict=True)}


def parse(text: str, robot: Robot) -> Hidden:
    """A hidden effect as `read_choice` reads it; what is not there is refused (hide-wrong) with the nearest name."""
    place = Where(field=f"--hide {text}")
    try:
        choice = read_choice(text, robot, "--hide")
    except ModelError as wrong:
        raise ModelError("hide-wrong", wrong.what, place, wrong.mend) from None
    name, law = choice.effect, LAWS.get(choice.effect)
    if law is None:
        what = f"{name!r} is no effect that simulate can hide"
        raise ModelError("hide-wrong", what, place, did_you_mean(name, LAWS, f"known: {', '.join(LAWS)}"))
    what = mend = ""
    if law.is_of_arm and choice.joint is not None:
        what, mend = f"{name} belongs to the whole arm", f"--hide {name}"
    for key, value in choice.shape.items():
        if key not in law.keys:
            what, mend = f"{name} has no value {key!r}", did_you_mean(key, law.keys, f"known: {', '.join(law.keys)}")
        elif not abs(value) <= GREATEST:
            what = f"{key} is {value}, not a finite number up to {GREATEST:g}"
            mend = f"give a smaller number for {key}"
    if what:
        raise ModelError("hide-wrong", what, place, mend)
    return Hidden(name, choice.joint, dict(choice.shape))
