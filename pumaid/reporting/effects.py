"""What an effect says of itself, as plain values, and its signature: its current against what it depends on."""

import inspect
import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from pumaid.effects import ARM, Effect, Family, Loads, Parameter, Samples, Scope, Shape
from pumaid.maths import Floats
from pumaid.reporting.table import Row, Table
from pumaid.rigid_body import of_body
from pumaid.robot import Joint, Robot
from pumaid.units import number

#: Joints of `ARM` that stand for their kinds; neither is the first nor the last, which are special to some effects.
TURNING, SLIDING = 5, 4

#: Scope -> whose its parameters are, in words.
OWNERS = {
    Scope.JOINT: "each joint",
    Scope.LINK: "each link",
    Scope.CAUSE: "the joint that causes it",
    Scope.ARM: "the whole arm",
}


def facts(effect: Effect) -> dict[str, Any]:
    """All that an effect says of itself, SI; parameters as a revolute (rad) and a prismatic (m) joint own them.

    `owner` of a parameter is ``revolute``, ``prismatic`` or ``arm``; `not_at` tells why the effect cannot act at one of
    them; bounds that are not there are None.
    """
    numbers = {"arm": 0} if effect.scope is Scope.ARM else {"revolute": TURNING, "prismatic": SLIDING}
    refusals = {kind: effect.applies(ARM, number) for kind, number in numbers.items()}
    owners = [(kind, number) for kind, number in numbers.items() if refusals[kind] is None]
    return {
        "effect": effect.name,
        "title": effect.title,
        "equation": effect.equation,
        "base": effect.base,
        "scope": effect.scope.value,
        "owner": OWNERS[effect.scope],
        "family": effect.family.value,
        "shown_by": [trace.value for trace in effect.trace],
        "seen_in": effect.seen_in,
        "look_alikes": list(effect.look_alikes),
        "physics": inspect.cleandoc(type(effect).__doc__ or ""),
        "parameters": [
            {"owner": kind, "symbol": parameter.symbol.format(n="N")} | _stated(parameter)
            for kind, number in owners
            for parameter in effect.parameters(ARM, number)[: 2 if effect.is_free else None]
        ],
        "shapes": [
            {"owner": kind, "is_searched": shape.is_searched} | _stated(shape)
            for kind, number in owners
            for shape in effect.shapes(ARM, number)
        ],
        "not_at": {
            kind: reason.replace(f"joint {numbers[kind]}", "the joint") for kind, reason in refusals.items() if reason
        },
        "source": effect.source,
        "command": command(effect),
        "signature": signature(effect),
    }


def _stated(item: Parameter | Shape) -> dict[str, Any]:
    values = {name: getattr(item, name) for name in ("name", "unit", "meaning", "example", "low", "high")}
    return {name: None if value in (-math.inf, math.inf) else value for name, value in values.items()}


def command(effect: Effect) -> str:
    """What a user types to have the effect in a model; empty for the effects that every model has."""
    if effect.base:
        return ""
    owner = "" if effect.scope is Scope.ARM else f"@{TURNING}"
    shape = "".join(f":{shape.name}={TURNING - 1}" for shape in effect.shapes(ARM, TURNING) if shape.name == "on")
    return f"pumaid identify logs/ --add {effect.name}{owner}{shape}"


def bounds(low: float | None, high: float | None) -> str:
    """Bounds in words."""
    ends = "" if low is None else f"{low:g} or more", "" if high is None else f"{high:g} or less"
    return f"{low:g} to {high:g}" if all(ends) else "".join(ends) or "any"


def merged(items: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Parameters or shapes; those that a revolute and a prismatic joint have alike but for the unit stand once."""
    alike: dict[str, dict[str, Any]] = {}
    for item in items:
        key = repr({name: value for name, value in item.items() if name not in ("owner", "unit")})
        units = [alike[key]["unit"], item["unit"]] if key in alike else [item["unit"]]
        alike[key] = item | {"unit": " or ".join(dict.fromkeys(units))} | ({"owner": "any"} if key in alike else {})
    return list(alike.values())


def effects_table(effects: Iterable[dict[str, Any]]) -> Table:
    """A row an effect, by its `facts`, those of all models first."""
    rows: list[Row] = []
    for effect in sorted(effects, key=lambda effect: not effect["base"]):
        name = f"{effect['effect']} (in all models)" if effect["base"] else effect["effect"]
        rows.append([name, effect["title"], effect["equation"], effect["family"], ", ".join(effect["look_alikes"])])
    return Table(
        "",
        ("effect", "meaning", "current", "family", "look-alikes"),
        rows,
        caption="s sign of motion, q position, v speed, t time, load: of gravity, drawn: the predicted current (A)",
        words=(0, 1, 2, 3, 4),
    )


def effect_parts(entry: dict[str, Any]) -> list[str | Table]:
    """An effect explained by its `facts`: law, physics, parameters and shapes, where it is seen and how it is added."""
    parts: list[str | Table] = [f"{entry['effect']}: {entry['title']}\n\n{entry['equation']}\n\n{entry['physics']}"]
    for kind, title in (("parameter", f"parameters of {entry['owner']}:"), ("shape", "shape (searched, or given):")):
        rows: list[Row] = []
        for item in merged(entry[f"{kind}s"]):
            limits, example = bounds(item["low"], item["high"]), f"{item['example']:g}"
            rows.append([item["owner"], item["name"], item["unit"], limits, example, item["meaning"]])
        parts += (
            [Table(title, ("joint", kind, "unit", "bounds", "example", "meaning"), rows, words=(0, 1, 2, 3, 5))]
            if rows
            else []
        )
    curve = entry["signature"]
    points = np.column_stack([curve["values"], curve["forward"], curve["backward"]])[:: POINTS // TOLD]
    header = (f"{curve['variable']} ({curve['unit']})", "forward (A)", "backward (A)")
    shown = Table(
        f"signature ({curve['at']}):", header, [[number(x, 3) for x in row] for row in points.tolist()], words=()
    )
    lines = [
        *(f"not at a {kind} joint: {reason}" for kind, reason in entry["not_at"].items()),
        *([f"look-alikes: {', '.join(entry['look_alikes'])}"] if entry["look_alikes"] else []),
        f"residual depends on: {', '.join(entry['shown_by'])}",
        *([f"best seen in: {entry['seen_in']}"] if entry["seen_in"] else []),
        f"to add it: {entry['command'] or 'it is in all models'}",
        f"source: {entry['source']}",
    ]
    return [*parts, shown, "\n".join(lines)]


# Signatures

#: Two level axes, one beyond the other, and the amplitudes of gravity's currents in them (A).
HANGING = Robot(
    "two hanging links",
    (
        Joint(1, "hip", "revolute", alpha=np.pi / 2, a=0.0, gear_ratio=60.0),
        Joint(2, "knee", "revolute", a=0.4, gear_ratio=60.0),
    ),
)
LOADS = np.array([2.0, 0.8])

#: Values of what is not varied: rad, rad/s, rad, s, degC, rad/s2.
CONSTANT = {"position": 0.6, "speed": 0.5, "travel": 1e3, "time": 1e6, "temperature": 35.0, "acceleration": 1.0}

#: Variable -> unit and range.
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

#: Family of an effect -> its variable; others depend on position.
VARIABLES = {
    Family.SPEED: "speed",
    Family.LOAD: "load",
    Family.CURRENT: "predicted current",
    Family.START: "travel",
    Family.TIME: "time",
    Family.PAYLOAD: "time",
    Family.TEMPERATURE: "temperature",
    Family.MOTION: "acceleration",
    Family.DIRECTION: "speed",
}

#: Points of a curve, and steps between those that a table has; range in multiples of a shape's example; periods of a
#: ripple; share below which nothing varies.
POINTS, TOLD, MULTIPLE, PERIODS, FLAT = 61, 12, 4.0, 3.0, 1e-9


def signature(effect: Effect) -> dict[str, Any]:
    """The current of `effect` at the examples of its parameters and shapes, as `facts` has it.

    Against the variable of its family, or the first other one in which it varies: `variable`, `unit`, `values` (M,),
    currents `forward` and `backward` (M,) A, and `at`, the examples in words.
    """
    curves = [
        _against(effect, variable)
        for variable in dict.fromkeys((VARIABLES.get(effect.family, "position"), "position", *RANGES))
    ]
    ways = [np.array([curve["forward"], curve["backward"]]) for curve in curves]
    varying = [np.ptp(way, axis=1).max() > FLAT * max(np.abs(way).max(), 1e-300) for way in ways]
    return curves[varying.index(True) if True in varying else 0]


def _against(effect: Effect, variable: str) -> dict[str, Any]:
    joints = (n for n in (1, 2) if effect.applies(HANGING, n) is None)
    owner = 0 if effect.scope is Scope.ARM else next(joints, 1)
    shapes, parameters = effect.shapes(HANGING, owner), effect.parameters(HANGING, owner)
    shape = {item.name: item.example for item in shapes}
    unit, low, high = RANGES[variable]
    scales = [item.example for item in shapes if item.unit == unit]
    if scales and variable != "position":
        high = MULTIPLE * scales[0] * (0.5 if low < 0.0 else 1.0)
        low = -high if low < 0.0 else 0.0
    if effect.periodic and variable == "position":
        high = PERIODS * np.pi / shape[effect.periodic]
        low = -high
    values, joint = np.linspace(low, high, POINTS), 1 if effect.scope in (Scope.ARM, Scope.CAUSE) else owner
    currents = [
        effect.columns(HANGING, _samples(joint, variable, values, way=way), number=owner, shape=shape)
        @ [item.example for item in parameters]
        for way in (1.0, -1.0)
    ]
    items: list[Parameter | Shape] = [*parameters, *shapes]
    return {
        "variable": variable,
        "unit": unit,
        "values": values,
        "forward": currents[0],
        "backward": currents[1],
        "at": ", ".join(
            f"{item.name} = {item.example:.3g} {item.unit}".removesuffix(" 1") for item in items if item.example
        ),
    }


def _samples(joint: int, variable: str, values: Floats, *, way: float) -> Samples:
    """Samples in which one variable takes `values` and the rest is constant; loads follow from gravity elsewhere."""
    full = np.ones(len(values))
    signals = {name: value * full for name, value in CONSTANT.items()} | {variable: values}
    position, velocity = np.full((len(values), 2), 0.4), np.zeros((len(values), 2))
    position[:, joint - 1] = signals["position"]
    velocity[:, joint - 1] = way * signals["speed"]
    angle, size = position.sum(axis=1), LOADS[joint - 1]
    slope = -size * np.sin(angle)
    load = signals.get("load", size * np.cos(angle))
    by_joint, slopes = np.outer(np.cos(angle), LOADS), np.column_stack([slope, slope])
    tilts = np.column_stack([0.0 * full, -slope])  # the axes point along -y
    drawn, rubs = signals.get("predicted current", load), np.ones((2, 2, 2))
    loads = Loads(load, by_joint, slopes, tilts, np.abs(load), drawn, slope * velocity[:, joint - 1], rubs)
    more = {name: signals[name] for name in ("acceleration", "time", "travel", "temperature")}
    more["bodies"] = of_body(HANGING, joint, (position.T, 0.0 * position.T, 0.0 * position.T))
    ways, run = way * full, 0.0 * full
    return Samples(joint, position, velocity, direction=ways, elapsed=signals["time"], run=run, loads=loads, **more)
