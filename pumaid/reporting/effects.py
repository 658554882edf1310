"""What is known of an effect, as plain values: for the command line, other programs and the manual."""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterable
from typing import Any

from pumaid.effects import Effect, Parameter, Scope, Shape
from pumaid.reporting.signature import Signature, signature
from pumaid.robot import Joint, Robot

#: Three turning joints, a slide, two turning joints: any arm's kinds of joints, none of them upright.
ARM = Robot(
    "any arm",
    tuple(
        Joint(number, kind, kind, alpha=0.3 * number, a=0.3, gear_ratio=60.0)
        for number, kind in enumerate(["revolute"] * 3 + ["prismatic"] + ["revolute"] * 2, start=1)
    ),
)

#: Joints of that arm that stand for their kinds; neither is the first nor the last, which are special to some effects.
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
    owners = {"arm": 0} if effect.scope is Scope.ARM else {"revolute": TURNING, "prismatic": SLIDING}
    refusals = {kind: effect.applies(ARM, number) for kind, number in owners.items()}
    acts = {kind: number for kind, number in owners.items() if refusals[kind] is None}
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
        "parameters": list(_parameters(effect, acts)),
        "shapes": list(_shapes(effect, acts)),
        "not_at": {kind: _any_joint(kind, reason) for kind, reason in refusals.items() if reason is not None},
        "source": effect.source,
        "command": command(effect),
        "signature": _drawn(signature(effect)),
    }


def command(effect: Effect) -> str:
    """What a user types to have the effect in a model; empty for the effects that every model has."""
    if effect.base:
        return ""
    if effect.scope is Scope.ARM:
        return f"pumaid identify logs/ --add {effect.name}"
    needed = [shape for shape in effect.shapes(ARM, TURNING) if shape.name == "on"]
    shape = "".join(f":{one.name}={TURNING - 1:d}" for one in needed)
    return f"pumaid identify logs/ --add {effect.name}@{TURNING}{shape}"


def bounds(low: float | None, high: float | None) -> str:
    """Bounds in words.

    Examples
    --------
    >>> bounds(0.5, 2.0), bounds(None, None), bounds(0.0, None)
    ('0.5 to 2', 'any', '0 or more')
    """
    if low is None and high is None:
        return "any"
    if high is None:
        return f"{low:g} or more"
    return f"{high:g} or less" if low is None else f"{low:g} to {high:g}"


def merged(found: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Parameters or shapes, those that a revolute and a prismatic joint have alike told once for ``any``."""
    alike: dict[str, dict[str, Any]] = {}
    for one in found:
        same = repr({key: value for key, value in one.items() if key != "owner"})
        alike[same] = one | ({"owner": "any"} if same in alike else {})
    return list(alike.values())


def _parameters(effect: Effect, acts: dict[str, int]) -> Iterable[dict[str, Any]]:
    for kind, number in acts.items():
        unit = ARM.joint(number or TURNING).position_unit
        for one in effect.parameters(ARM, number):
            yield {"owner": kind, "symbol": one.symbol.format(n="N")} | _common(one, unit)


def _shapes(effect: Effect, acts: dict[str, int]) -> Iterable[dict[str, Any]]:
    for kind, number in acts.items():
        unit = ARM.joint(number or TURNING).position_unit
        for one in effect.shapes(ARM, number):
            yield {"owner": kind, "is_searched": one.is_searched} | _common(one, unit)


def _common(one: Parameter | Shape, unit: str) -> dict[str, Any]:
    low, high = (limit if math.isfinite(limit) else None for limit in (one.low, one.high))
    told = {"name": one.name, "unit": one.unit.format(unit=unit), "meaning": one.meaning}
    return told | {"low": low, "high": high, "example": one.example}


def _any_joint(kind: str, reason: str) -> str:
    """A reason that names a joint of `ARM`, said of any joint of its kind."""
    number = {"revolute": TURNING, "prismatic": SLIDING}.get(kind)
    return reason.replace(f"joint {number}", "the joint")


def _drawn(shown: Signature) -> dict[str, Any]:
    step = 4  # a fifth of a letter's width in the plot of the command line
    return {
        "variable": shown.variable,
        "unit": shown.unit,
        "values": shown.values[::step],
        "forward": shown.forward[::step],
        "backward": shown.backward[::step],
        "at": shown.text,
    }
