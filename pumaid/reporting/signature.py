"""What an effect looks like: its current against the variable in which it lives, in both directions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.effects import Effect, Family, Scope
from pumaid.records import Loads, Samples
from pumaid.robot import Joint, Robot

Floats = NDArray[np.float64]

#: Two level axes, one beyond the other: each feels gravity, the first also what the second carries.
ARM = Robot(
    "two links that hang",
    (
        Joint(1, "hip", "revolute", alpha=np.pi / 2, a=0.0, gear_ratio=60.0),
        Joint(2, "knee", "revolute", a=0.4, gear_ratio=60.0),
    ),
)

#: A: gravity's largest current in the hip by its own link and by the knee's, and in the knee.
LOADS = (1.4, 0.6, 0.8)

#: What everything is that the picture does not vary: rad, rad/s, m or rad, s, degC, rad/s2.
USUAL = {"position": 0.6, "speed": 0.5, "travel": 1e3, "time": 1e6, "temperature": 35.0, "acceleration": 1.0}

#: Variable -> unit and the range that is shown where the effect's own shape says nothing of it.
RANGES: dict[str, tuple[str, float, float]] = {
    "speed": ("rad/s", 0.01, 1.0),
    "load": ("A", -2.0, 2.0),
    "predicted current": ("A", -4.0, 4.0),
    "travel": ("rad", 0.0, 0.4),
    "time": ("s", 0.0, 3600.0),
    "temperature": ("degC", 10.0, 50.0),
    "acceleration": ("rad/s2", -2.0, 2.0),
    "position": ("rad", -2.6, 2.6),
}

#: Family of an effect -> variables in which its signature is looked for; then all others.
LIVES_IN = {
    Family.SPEED: ("speed",),
    Family.LOAD: ("load",),
    Family.CURRENT: ("predicted current",),
    Family.START: ("travel",),
    Family.TIME: ("time",),
    Family.PAYLOAD: ("time",),
    Family.TEMPERATURE: ("temperature",),
    Family.MOTION: ("acceleration", "position"),
    Family.DIRECTION: ("speed",),
}

#: Of a shape in the variable's own unit (a speed, a time): how many times its value is shown.
TIMES = 4.0
#: Periods of a ripple that are shown.
PERIODS = 3.0
#: Points of a curve.
POINTS = 161
#: Below this share of its size a current does not vary.
FLAT = 1e-9


@dataclass(frozen=True, eq=False, slots=True)
class Signature:
    """Current of one effect at the examples of its parameters and shapes, moving forward and backward.

    Attributes
    ----------
    variable, unit
        What it is drawn against.
    values
        (M,) of the variable.
    forward, backward
        (M,) A.
    marks
        Shapes that are a value of the variable: name and value.
    text
        The examples, in words.
    """

    variable: str
    unit: str
    values: Floats
    forward: Floats
    backward: Floats
    marks: tuple[tuple[str, float], ...]
    text: str

    @property
    def is_same_both_ways(self) -> bool:
        """Whether the direction of the motion makes no difference."""
        size = float(np.abs(self.forward).max(initial=0.0))
        return bool(np.allclose(self.forward, self.backward, atol=FLAT * max(size, 1e-300)))


def signature(effect: Effect) -> Signature:
    """The current of `effect` against the first variable of its family in which it varies, at its examples."""
    owner = _owner(effect)
    shape = {one.name: one.example for one in effect.shapes(ARM, owner)}
    order = dict.fromkeys((*LIVES_IN.get(effect.family, ("position",)), *RANGES))
    found = [_seen(effect, owner, variable, shape) for variable in order]
    return next((one for one in found if _varies(one)), found[0])


def sketch(shown: Signature, *, width: int = 60, height: int = 11) -> str:
    """A signature as a small plot of letters: o forward, x backward, * where both are.

    Parameters
    ----------
    shown
        What is drawn.
    width, height
        Letters and lines of the plot itself.
    """
    low, high = _range(shown)
    lines = [[" "] * width for _ in range(height)]
    zero = _row(0.0, low, high, height)
    if low <= 0.0 <= high:
        lines[zero] = ["-"] * width
    columns = np.linspace(0, len(shown.values) - 1, width).round().astype(int)
    for mark, curve in (("x", shown.backward), ("o", shown.forward)):
        for place, index in enumerate(columns):
            row = _row(float(curve[index]), low, high, height)
            lines[row][place] = "*" if mark == "o" and lines[row][place] == "x" else mark
    labels = {0: f"{high:.3g}", height - 1: f"{low:.3g}"}
    if 1 < zero < height - 2 and low < 0.0 < high:
        labels[zero] = "0"
    margin = max(len(label) for label in labels.values())
    body = [f"{labels.get(n, ''):>{margin}} |{''.join(line).rstrip()}" for n, line in enumerate(lines)]
    first, last = f"{shown.values[0]:.3g}", f"{shown.values[-1]:.3g}"
    foot = f"{first}{f'{shown.variable} ({shown.unit})':^{max(width - len(first) - len(last), 1)}}{last}"
    ways = "* both directions" if shown.is_same_both_ways else "o forward, x backward, * both"
    head = f"{'A':>{margin}}  {ways}"
    return "\n".join([head, *body, f"{'':>{margin}}  {foot}"])


def _owner(effect: Effect) -> int:
    """Who owns the effect in the picture: the first joint that may, or 0 for the whole arm."""
    if effect.scope is Scope.ARM:
        return 0
    return next((joint.number for joint in ARM.joints if effect.applies(ARM, joint.number) is None), 1)


def _varies(shown: Signature) -> bool:
    both = np.concatenate([shown.forward, shown.backward])
    spread = max(float(np.ptp(shown.forward)), float(np.ptp(shown.backward)))
    return spread > FLAT * max(float(np.abs(both).max()), 1e-300)


def _seen(effect: Effect, owner: int, variable: str, shape: Mapping[str, float]) -> Signature:
    """The signature against one variable, in the joint where it is felt."""
    unit, low, high = RANGES[variable]
    shapes = effect.shapes(ARM, owner)
    marks = tuple((one.name, one.example) for one in shapes if one.unit == unit)
    if marks and variable != "position":
        size = TIMES / 2.0 if low < 0.0 else TIMES
        low, high = (-size if low < 0.0 else 0.0) * marks[0][1], size * marks[0][1]
    if effect.periodic and variable == "position":
        half = PERIODS * np.pi / shape[effect.periodic]
        low, high = -half, half
    values = np.linspace(low, high, POINTS)
    parameters = effect.parameters(ARM, owner)
    example = np.array([one.example for one in parameters])
    ways: list[Floats] = []
    for way in (1.0, -1.0):
        felt = [
            effect.columns(ARM, _instants(joint, variable, values, way=way), number=owner, shape=shape) @ example
            for joint in _felt_in(effect, owner)
        ]
        ways.append(max(felt, key=lambda current: float(np.abs(current).max())))
    told = [f"{one.name} = {one.example:.3g}{_unit(one.unit)}" for one in parameters]
    told += [f"{one.name} = {one.example:.3g}{_unit(one.unit)}" for one in shapes]
    return Signature(variable, unit, values, ways[0], ways[1], marks, ", ".join(told))


def _felt_in(effect: Effect, owner: int) -> list[int]:
    """Joints in whose current the effect may be."""
    everywhere = effect.scope in (Scope.ARM, Scope.CAUSE)
    return [joint.number for joint in ARM.joints] if everywhere else [owner]


def _unit(unit: str) -> str:
    return "" if unit == "1" else " " + unit.format(unit="rad")


def _instants(joint: int, variable: str, values: Floats, *, way: float) -> Samples:
    """Instants at which one variable takes `values` and all else is as usual."""
    held = {name: np.full(len(values), value) for name, value in USUAL.items()}
    if variable in held:
        held[variable] = values
    position = np.full((len(values), ARM.n_joints), 0.4)
    position[:, joint - 1] = held["position"]
    velocity = np.zeros_like(position)
    velocity[:, joint - 1] = way * held["speed"]
    return Samples(
        joint,
        position,
        velocity,
        acceleration=held["acceleration"],
        direction=np.full(len(values), way),
        time=held["time"],
        elapsed=held["time"],
        travel=held["travel"],
        temperature=held["temperature"],
        run=np.zeros(len(values)),
        loads=_loads(joint, position, variable, values),
    )


def _loads(joint: int, position: Floats, variable: str, values: Floats) -> Loads:
    """Gravity's currents of the two links, from their heights; the varied one as it is varied."""
    own_link, beyond, knee = LOADS
    first, second = position[:, 0], position.sum(axis=1)
    hip_load = own_link * np.cos(first) + beyond * np.cos(second)
    others = np.column_stack([hip_load, knee * np.cos(second)])
    slope_beyond = -beyond * np.sin(second)
    hip_slopes = np.column_stack([-own_link * np.sin(first) + slope_beyond, slope_beyond])
    slopes = hip_slopes if joint == 1 else np.repeat(-knee * np.sin(second)[:, None], 2, axis=1)
    load = values if variable == "load" else others[:, joint - 1]
    drawn = values if variable == "predicted current" else load
    # The axes point along -y: a turn of the base about y is one of the joints the other way, about x it is nothing.
    tilts = np.column_stack([np.zeros(len(load)), -slopes[:, 0]])
    gains = np.array([1.0, beyond / knee]) if joint == 1 else np.array([knee / beyond, 1.0])
    return Loads(load, others, slopes, tilts, np.abs(load), drawn, gains)


def _range(shown: Signature) -> tuple[float, float]:
    both = np.concatenate([shown.forward, shown.backward])
    low, high = min(float(both.min()), 0.0), max(float(both.max()), 0.0)
    return (low, high) if high > low else (-1.0, 1.0)


def _row(value: float, low: float, high: float, height: int) -> int:
    return round((high - value) / (high - low) * (height - 1))
