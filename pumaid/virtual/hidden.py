"""Physics that a virtual robot has and the paper's model has not, in code of its own."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import ModelError, Where
from pumaid.records import Robot

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Hidden:
    """One hidden effect: its name in the catalogue of effects, its joint (from 1; None for all), its values (SI, A)."""

    effect: str
    joint: int | None = None
    values: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, slots=True)
class State:
    """What a hidden effect sees of one joint at N instants: time s, own position and velocity, gravity's current A.

    `side` is +1 where the motor's current counts along the joint's motion, else -1.
    """

    time: Floats
    position: Floats
    velocity: Floats
    load: Floats
    side: float

    @property
    def opposing(self) -> Floats:
        """Direction of a current that overcomes friction: +1, -1, 0 at rest."""
        return self.side * np.sign(self.velocity)


Law = Callable[[State, Mapping[str, float]], Floats]


def _stribeck(at: State, has: Mapping[str, float]) -> Floats:
    return at.opposing * has["a"] * np.exp(-((np.abs(at.velocity) / has["v_s"]) ** has["d"]))


def _viscous_power(at: State, has: Mapping[str, float]) -> Floats:
    return at.opposing * has["b"] * np.abs(at.velocity) ** has["p"]


def _load_friction(at: State, has: Mapping[str, float]) -> Floats:
    is_lifting = at.load * at.opposing > 0
    return at.opposing * np.abs(at.load) * np.where(is_lifting, has["drive"], has["back"])


def _position_friction(at: State, has: Mapping[str, float]) -> Floats:
    angle = has["k"] * at.position
    return at.opposing * (has["a"] * np.cos(angle) + has["b"] * np.sin(angle))


def _spring(at: State, has: Mapping[str, float]) -> Floats:
    return has["a"] * at.position + has["b"]


def _ripple(at: State, has: Mapping[str, float]) -> Floats:
    angle = has["f"] * at.position
    return has["a"] * np.cos(angle) + has["b"] * np.sin(angle)


def _warmup(at: State, has: Mapping[str, float]) -> Floats:
    return at.opposing * has["a"] * np.exp(-at.time / has["T"])


def _friction_step(at: State, has: Mapping[str, float]) -> Floats:
    return at.opposing * has["a"] * (at.time > has["t_0"])


#: Name -> law, and its values where none are given (A, rad or m, s): of the size of a tenth of an ampere, which is
#: several times the usual noise and a quarter of a usual Coulomb friction.
LAWS: dict[str, tuple[Law, dict[str, float]]] = {
    "stribeck": (_stribeck, {"a": 0.12, "v_s": 0.15, "d": 1.0}),
    "viscous_power": (_viscous_power, {"b": 0.12, "p": 0.4}),
    "load_friction": (_load_friction, {"drive": 0.12, "back": 0.06}),
    "position_friction": (_position_friction, {"a": 0.06, "b": 0.05, "k": 2.0}),
    "spring": (_spring, {"a": 0.1, "b": 0.0}),
    "ripple": (_ripple, {"a": 0.05, "b": 0.03, "f": 30.0}),
    "warmup": (_warmup, {"a": 0.12, "T": 600.0}),
    "friction_step": (_friction_step, {"a": 0.08, "t_0": 600.0}),
}


def parse(text: str, robot: Robot) -> Hidden:
    """A hidden effect as the command line writes it: ``EFFECT[@JOINT][:key=value,...]``.

    Parameters
    ----------
    text
        ``stribeck@3:a=0.1,v_s=0.2``; the joint is a number from 1, a joint's name or ``all``.
    robot
        Its joints.

    Raises
    ------
    ModelError [hide-wrong]
        No such effect, joint or value; the nearest right one is named.
    """
    head, _, tail = text.partition(":")
    name, _, joint = head.partition("@")
    if name not in LAWS:
        raise _refusal(text, f"{name!r} is no effect that simulate can hide", name, list(LAWS))
    _, usual = LAWS[name]
    values = dict(usual)
    for part in filter(None, tail.split(",")):
        key, _, number = part.partition("=")
        if key not in usual:
            raise _refusal(text, f"{name} has no value {key!r}", key, list(usual))
        try:
            values[key] = float(number)
        except ValueError:
            raise _refusal(text, f"{key} is {number!r}, which is no number", "", list(usual)) from None
    return Hidden(name, _joint(text, joint, robot), values)


def _joint(text: str, joint: str, robot: Robot) -> int | None:
    if joint in ("", "all"):
        return None
    names = {one.name: one.number for one in robot.joints}
    number = names.get(joint) or (int(joint) if joint.isdecimal() else 0)
    if not 1 <= number <= robot.n_joints:
        known = [*names, *(str(one) for one in names.values())]
        raise _refusal(text, f"{robot.name} has no joint {joint!r}", joint, known)
    return number


def _refusal(text: str, what: str, word: str, known: list[str]) -> ModelError:
    near = difflib.get_close_matches(word, known, n=1)
    mend = f"did you mean {near[0]}?" if near else f"known: {', '.join(known)}"
    return ModelError("hide-wrong", what, Where(field=f"--hide {text}"), mend)


def added(hidden: tuple[Hidden, ...], joint: int, at: State) -> Floats:
    """(N,) A that the hidden effects of joint `joint` (from 1) add to its current."""
    total = np.zeros(len(at.time))
    for one in hidden:
        if one.joint in (None, joint):
            law, usual = LAWS[one.effect]
            total += law(at, {**usual, **one.values})
    return total
