"""Physics that a virtual robot has and the paper's model has not: one table of laws, and how a user names them.

Nothing here is shared with the effects that a model is fitted with: the laws are written a second time, most of them
exactly where the model has a linear form, and gravity comes from the virtual arm's own masses.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

import numpy as np

from pumaid.errors import ModelError, Where, meant, refuse
from pumaid.maths import Floats
from pumaid.robot import Robot, read_choice

#: degC of the room, in which every motor begins; s in which a motor comes within 1/e of its last temperature; degC
#: above the room of a motor that draws its usual current for good.
AMBIENT, WARMING_TIME, RISE = 25.0, 600.0, 30.0
#: SI; no value of a law is larger on any arm, and farther on currents overflow.
GREATEST = 1e9
#: Values that no law has at zero or below.
ABOVE_ZERO = ("velocity", "exponent", "travel", "time_constant", "frequency", "harmonic", "length", "limit", "mass")
#: s; no current is logged later.
LATEST = 1.0


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

    def __getattr__(self, quantity: str) -> Floats:
        """(N,) values of any other quantity of the arm at this joint."""
        return np.asarray(getattr(self.arm, quantity)[..., self.joint - 1])

    @property
    def time(self) -> Floats:
        """(N,) s since the joint's first run began."""
        return np.asarray(self.arm.time - self.arm.first[self.joint - 1])

    @property
    def opposing(self) -> Floats:
        """(N,) direction of a current that overcomes friction: +1, -1, 0 at rest."""
        return np.asarray(self.side * np.sign(self.velocity))


class Kind(Enum):
    """How an effect acts."""

    FRICTION = "opposes the motion, by a size in A"
    LOAD = "draws a current whatever the motion"
    ROBOT = "changes what weighs, where it stands, or when its current is stamped"
    CURRENT = "changes the motor's whole current"


class Law(NamedTuple):
    """One law, which acts in the current of the joint that its value ``on`` names; without such a value in its own."""

    kind: Kind
    # (N,) A by the joint's state, the whole current before a law that changes it, and the values; none for laws that
    # the virtual robot applies itself.
    current: Callable[..., Floats] | None = None
    is_of_arm: bool = False  # the whole arm's and not a joint's
    needs_masses: bool = False  # constants in amperes do not do
    is_of_weight: bool = False  # nothing where the joint carries none


def _counterbalance(at: JointState, a: float, length: float, angle: float) -> Floats:
    """A constant force along a cylinder from a foot at distance 1 to a lever of length c: force times lever arm."""
    turned = at.position - angle
    along = np.stack([length * np.cos(turned) - 1.0, length * np.sin(turned)])
    along = along / np.sqrt(along[0] ** 2 + along[1] ** 2)
    return np.asarray(a * (np.cos(turned) * along[1] - np.sin(turned) * along[0]))


def _waves(at: JointState, cos: float, sin: float, frequency: float) -> Floats:
    angle = frequency * at.position
    return np.asarray(cos * np.cos(angle) + sin * np.sin(angle))


#: Name of the effect -> law; those of the whole current in the order in which they act.
LAWS = {
    "stribeck": Law(
        Kind.FRICTION, lambda at, a, velocity, exponent: a * np.exp(-((np.abs(at.velocity) / velocity) ** exponent))
    ),
    "smooth_friction": Law(
        Kind.FRICTION, lambda at, a, velocity: 2.0 * a / (1.0 + np.exp(-2.0 * np.abs(at.velocity) / velocity)) - 2.0 * a
    ),
    "viscous_power": Law(Kind.FRICTION, lambda at, b, exponent: b * np.abs(at.velocity) ** exponent),
    "load_friction": Law(
        Kind.FRICTION,
        lambda at, drive, back: np.abs(at.load) * np.where(at.load * at.opposing > 0, drive, back),
        is_of_weight=True,
    ),
    "load_friction_square": Law(Kind.FRICTION, lambda at, a: a * at.load**2, is_of_weight=True),
    "stribeck_load": Law(
        Kind.FRICTION,
        lambda at, a, velocity: a * np.abs(at.load) * np.exp(-((np.abs(at.velocity) / velocity) ** 1.3)),
        is_of_weight=True,
    ),
    "side_load_friction": Law(Kind.FRICTION, lambda at, mu: mu * at.across, needs_masses=True),
    "position_friction": Law(Kind.FRICTION, lambda at, cos, sin, harmonic: _waves(at, cos, sin, harmonic)),
    "ripple": Law(Kind.LOAD, _waves),
    "load_ripple": Law(
        Kind.LOAD,
        lambda at, cos, sin, frequency: np.sqrt(at.load**2) * _waves(at, cos, sin, frequency),
        is_of_weight=True,
    ),
    "spring": Law(Kind.LOAD, lambda at, a: a * at.position),
    "counterbalance": Law(Kind.LOAD, _counterbalance),
    "presliding": Law(Kind.FRICTION, lambda at, a, travel: -a * np.exp(-at.travel / travel)),
    "inertia": Law(Kind.LOAD, lambda at, J: at.side * J * at.acceleration),
    "delay": Law(Kind.ROBOT),
    "warmup": Law(Kind.FRICTION, lambda at, a, time_constant: a * np.exp(-at.time / time_constant)),
    "friction_step": Law(Kind.FRICTION, lambda at, a, time: a * (at.time > time)),
    "thermal_friction": Law(Kind.FRICTION, lambda at, a: a * (at.temperature - AMBIENT)),
    "tilt": Law(Kind.ROBOT, is_of_arm=True),
    "zero_offset": Law(Kind.ROBOT),
    "payload": Law(Kind.ROBOT, is_of_arm=True, needs_masses=True),
    "flexibility": Law(Kind.ROBOT, is_of_weight=True),
    "coupling": Law(Kind.LOAD, lambda at, c, on: c * (at.load + at.friction)),
    "torque_constant_drift": Law(
        Kind.CURRENT,
        lambda at, current, a, time_constant: current - a * current * np.expm1(-np.maximum(at.time, 0) / time_constant),
    ),
    "torque_droop": Law(Kind.CURRENT, lambda at, current, a: current + a * current**3),
    "saturation": Law(Kind.CURRENT, lambda at, current, limit: np.clip(current, -limit, limit)),
}


def usual_values(joint: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """Values of every effect by the names that the catalogue has; they show at a joint like that but do not rule it.

    `joint` says what is usual of it (`Truth.typical`). Values that follow from a weight are not finite without one.
    """
    c, half, peak, reach = (joint[key] for key in ("coulomb", "half_span", "peak_load", "reach"))
    with np.errstate(all="ignore"):
        usual = {
            "stribeck": {"a": 0.4 * c, "velocity": 0.2 * joint["speed"], "exponent": 1.0},
            "smooth_friction": {"a": 0.6 * c, "velocity": 0.2 * joint["speed"]},
            # As much as Coulomb friction at the highest speed: all but a tenth of it passes for viscous friction.
            "viscous_power": {"b": c / joint["speed"] ** 0.4, "exponent": 0.4},
            "load_friction": {"drive": 0.15, "back": 0.1},
            "load_friction_square": {"a": 0.2 / np.float64(peak)},
            "stribeck_load": {"a": 0.2, "velocity": 0.2 * joint["speed"]},
            "side_load_friction": {"mu": 0.4 * c / np.float64(joint["across"])},
            "position_friction": {"cos": 0.25 * c, "sin": 0.2 * c, "harmonic": 2.0},
            # Twenty waves over the span: slow enough for any log, fast enough to be no gravity.
            "ripple": {"cos": 0.15 * c, "sin": 0.1 * c, "frequency": round(20 * np.pi / half)},
            "load_ripple": {
                "cos": 0.3 * c / np.float64(peak),
                "sin": 0.2 * c / np.float64(peak),
                "frequency": round(20 * np.pi / half),
            },
            "spring": {"a": c / half},
            "counterbalance": {"a": c, "length": 0.6, "angle": 0.5},
            "presliding": {"a": 0.6 * c, "travel": 0.08 * half},
            "inertia": {"J": 0.5 * c / joint["acceleration"]},
            "delay": {"dt": 0.04},
            "warmup": {"a": 0.4 * c, "time_constant": 600.0},
            "friction_step": {"a": 0.3 * c, "time": 600.0},
            # Grease thins: a twentieth of the friction is gone with every degree of the first ten.
            "thermal_friction": {"a": -0.05 * c},
            "tilt": {"x": 0.04, "y": -0.03},
            "zero_offset": {"delta": 0.06},
            "payload": {"mass": joint["last_mass"], "x": 0.0, "y": 0.03 * reach, "z": 0.05 * reach, "time": 600.0},
            "flexibility": {"c": 0.08 / np.float64(peak)},
            # On the motor before: a drive passes through the joints before its own.
            "coupling": {"c": 0.4 * joint["coulomb_before"] / np.float64(joint["load"]), "on": joint["joint"] - 1 or 2},
            "torque_constant_drift": {"a": 0.15, "time_constant": 600.0},
            "torque_droop": {"a": 0.3 / (peak + c) ** 2},
            "saturation": {"limit": 0.75 * peak + c},
        }
    # To four significant digits.
    return {name: {key: float(f"{v:.4g}") for key, v in values.items()} for name, values in usual.items()}


#: Name of the effect -> names of its values.
KEYS = {name: tuple(values) for name, values in usual_values(defaultdict(lambda: 1.0)).items()}


def acted(hidden: Sequence[Hidden], at: JointState, kind: Kind, *, current: Floats | float = 0.0) -> Floats | float:
    """(N,) A that `current` (N,) A is when what is hidden of a kind has acted in a joint.

    Friction and loads add to it, friction its size; laws of the whole current change it.
    """
    for effect in hidden:
        law, values = LAWS[effect.effect], effect.values
        if law.kind is kind and law.current and values.get("on", effect.joint) in (None, at.joint):
            cause = JointState(at.arm, effect.joint or at.joint, at.side)
            is_whole = kind is Kind.CURRENT
            current = law.current(cause, current, **values) if is_whole else current + law.current(cause, **values)
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
        raise ModelError(
            "hide-wrong",
            f"a current cannot be logged {float(late[np.argmax(np.abs(late))]):g} s late",
            Where(field="--hide delay"),
            f"give dt from 0 to {LATEST:g} s",
        )
    return late


def sized(hidden: Sequence[Hidden], usual: Sequence[Mapping[str, float]], *, has_masses: bool) -> tuple[Hidden, ...]:
    """Hidden effects with all their values, one a joint where an effect of joints names none, as they act in turn.

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
            raise ModelError(
                "hide-wrong",
                f"the arm is known by its constants in amperes alone, and {effect.effect} needs its masses",
                place,
                "take an arm with masses",
            )
        is_for_all, before = effect.joint is None and not law.is_of_arm, len(out)
        for joint in usual if is_for_all else [usual[(effect.joint or len(usual)) - 1]]:
            values = usual_values(joint)[effect.effect] | effect.values
            if all(map(math.isfinite, values.values())) and not (law.is_of_weight and joint["peak_load"] == 0.0):
                out.append(Hidden(effect.effect, int(joint["joint"]) if is_for_all else effect.joint, values))
        if len(out) == before:
            at = "none of the joints carries" if is_for_all else f"joint {effect.joint} does not carry"
            raise ModelError(
                "hide-wrong",
                f"{at} weight, and {effect.effect} follows the weight",
                place,
                "name a joint that carries weight",
            )
    last = [name for name, law in LAWS.items() if law.kind is Kind.CURRENT]
    return tuple(sorted(out, key=lambda effect: last.index(effect.effect) if effect.effect in last else -1))


def parse(text: str, robot: Robot) -> Hidden:
    """A hidden effect as `read_choice` reads it; what is not there is refused (hide-wrong) with the nearest name."""
    place = Where(field=f"--hide {text}")
    try:
        choice = read_choice(text, robot, "--hide")
    except ModelError as wrong:
        raise ModelError("hide-wrong", wrong.what, place, wrong.mend) from None
    name, law, keys = choice.effect, LAWS.get(choice.effect), KEYS.get(choice.effect, ())
    mends = {}
    if law is None:
        mends[f"{name!r} is no effect that simulate can hide"] = meant(name, list(LAWS))
    elif law.is_of_arm and choice.joint is not None:
        mends[f"{name} belongs to the whole arm"] = f"--hide {name}"
    for key, value in choice.shape.items() if law else ():
        if key not in keys:
            mends[f"{name} has no value {key!r}"] = meant(key, keys)
        elif not abs(value) <= GREATEST:
            mends[f"{key} is {value}, not a finite number up to {GREATEST:g}"] = f"give a smaller number for {key}"
        elif key in ABOVE_ZERO and value <= 0.0:
            mends[f"{key} is {value:g}, not above 0"] = f"give a larger number for {key}"
        elif key == "on" and (value == choice.joint or value not in range(1, robot.n_joints + 1)):
            mends[f"on is {value:g}, no other joint"] = f"joints count from 1 to {robot.n_joints}"
    refuse([ModelError("hide-wrong", what, place, mend) for what, mend in mends.items()])
    return Hidden(name, choice.joint, dict(choice.shape))
