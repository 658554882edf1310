"""Faults of a recipe that show only when two of its values are seen together."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

from pydantic_core import PydanticCustomError

from pumaid.io.coupling import coupling_faults
from pumaid.io.recipe_faults import Fault
from pumaid.io.recipe_schema import FASTEST_RAIL, LONGEST_RAIL, is_pi_expression, places
from pumaid.io.safety import safety_faults
from pumaid.io.yaml_lines import nearest
from pumaid.units import UNITS, factor

#: A twist beyond one turn (rad) is in the wrong unit.
ONE_TURN = 2.0 * math.pi
#: Limits beyond this many rad, in a file that does not state its unit, are degrees.
WIDEST_UNSTATED = 4.0 * math.pi
#: Limits beyond this (rad) are a mistake whatever the unit, and so is a highest speed outside these (rad/s).
WIDEST, SLOWEST, FASTEST = 100.0 * ONE_TURN, 1e-4, 1e3
#: Degrees that are really rad: quarter turns in rad as people round them (four decimals).
QUARTERS = tuple(quarter * math.pi / 2.0 for quarter in (1, 2, 3))
ROUNDING = 5e-4

_QUANTITIES = {"position": "q{joint}", "velocity": "qd{joint}", "current": "i{joint}", "temperature": "temp{joint}"}


def faults_between_values(data: dict[Any, Any]) -> Iterator[Fault]:
    """Every such fault of a recipe's plain data; values of a wrong type are passed over, the schema tells of them."""
    joints = data.get("joints")
    joints = joints if isinstance(joints, list) else []
    units = _mapping(data, "units")
    yield from _names(joints)
    for index, joint in enumerate(joints):
        if isinstance(joint, dict):
            yield from _offsets(index, joint)
            yield from _slides(index, joint)
    yield from _angles(joints, units)
    log = _mapping(data, "log")
    yield from _columns(log, joints)
    yield from _log_units(log, joints)
    yield from _signs(log, len(joints))
    yield from _effects(data.get("effects"), joints)
    yield from safety_faults(data.get("safety"), len(joints))
    yield from coupling_faults(_mapping(data, "coupling"), joints)


def _mapping(data: dict[Any, Any], key: str) -> dict[Any, Any]:
    value = data.get(key)
    return value if isinstance(value, dict) else {}


def joint_name(index: int, joint: Any) -> str:
    """The joint's name, or the one it gets where the recipe names none."""
    name = joint.get("name") if isinstance(joint, dict) else None
    return name if isinstance(name, str) else f"joint{index + 1}"


def _names(joints: list[Any]) -> Iterator[Fault]:
    seen: dict[str, int] = {}
    for index, joint in enumerate(joints):
        name = joint_name(index, joint)
        first = seen.setdefault(name.lower(), index)
        if first != index:
            what = f"joints {first + 1} and {index + 1} are both named {name}"
            yield Fault(("joints", index, "name"), "recipe-duplicate", what, "give each joint its own name")


def _offsets(index: int, joint: dict[Any, Any]) -> Iterator[Fault]:
    needed = {"revolute": "d", "prismatic": "theta"}.get(str(joint.get("type")))
    if needed is not None and joint.get(needed) is None:
        mend = f"add {needed}: 0 if it is zero; only the offset of the joint's own motion may be left out"
        what = f"a {joint['type']} joint has a constant {needed}, and the key is missing"
        yield Fault(("joints", index, needed), "recipe-missing-key", what, mend)


def _angles(joints: list[Any], units: dict[Any, Any]) -> Iterator[Fault]:
    """Angles in the other unit than the file says; what looks like degrees in a file of rad is one fault."""
    unit = units.get("angle", "rad")
    degrees: list[Fault] = []
    for path, value in _angle_values(joints):
        if is_pi_expression(value) and unit == "deg":
            what = f"{value} is in rad, and this file's angles are in deg"
            yield Fault(path, "recipe-angle-unit", what, "write degrees")
        elif not is_number(value):
            continue
        elif unit == "rad":
            degrees += _like_degrees(path, float(value), stated="angle" in units)
            yield from _beyond(path, float(value), unit)
        elif unit == "deg":
            yield from _like_rad(path, float(value))
            yield from _beyond(path, float(value), unit)
    if degrees:
        first, others = degrees[0], len(degrees) - 1
        yield first._replace(what=first.what + (f" ({others} more like it)" if others else ""))


def is_number(value: Any) -> bool:
    """Whether YAML read a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _angle_values(joints: list[Any]) -> Iterator[tuple[tuple[str | int, ...], Any]]:
    for index, joint in enumerate(joints):
        if not isinstance(joint, dict):
            continue
        yield ("joints", index, "alpha"), joint.get("alpha")
        yield ("joints", index, "theta"), joint.get("theta")
        if joint.get("type") == "revolute":
            yield from _motion_values(index, joint)


def _motion_values(index: int, joint: dict[Any, Any]) -> Iterator[tuple[tuple[str | int, ...], Any]]:
    limits = joint.get("limits")
    for place, value in enumerate(limits if isinstance(limits, list) else []):
        yield ("joints", index, "limits", place), value
    yield ("joints", index, "max_velocity"), joint.get("max_velocity")


def _like_degrees(path: tuple[str | int, ...], value: float, *, stated: bool) -> Iterator[Fault]:
    key = str(path[2])
    mend = "add units: {angle: deg} at the top, or write the angles in rad"
    if key in ("alpha", "theta") and abs(value) > ONE_TURN:
        yield Fault(path, "recipe-angle-unit", f"{key} of {value:g} rad is more than a turn: degrees?", mend)
    elif key in ("limits", "max_velocity") and not stated and abs(value) > WIDEST_UNSTATED:
        unit = "rad" if key == "limits" else "rad/s"
        what = f"{key} of {value:g} {unit}, in a file that does not say its unit: degrees?"
        yield Fault(path, "recipe-angle-unit", what, f"{mend}; if it is rad, say so: units: {{angle: rad}}")


def _like_rad(path: tuple[str | int, ...], value: float) -> Iterator[Fault]:
    key = str(path[2])
    if key in ("alpha", "theta") and abs(value) > 360.0:
        yield Fault(path, "recipe-angle-unit", f"{key} of {value:g} deg is more than a turn", "write it within 360")
    elif key != "max_velocity" and any(abs(abs(value) - quarter) < ROUNDING for quarter in QUARTERS):
        mend = "write degrees (90, not 1.5708), or take units: {angle: deg} away"
        yield Fault(path, "recipe-angle-unit", f"{key} of {value:g} deg is a quarter turn in rad", mend)


def _beyond(path: tuple[str | int, ...], value: float, unit: str) -> Iterator[Fault]:
    """Limits and speeds that no revolute joint has."""
    size = abs(value) * factor(unit)
    if path[2] == "limits" and size > WIDEST:
        what = f"limits of {value:g} {unit} are more than {WIDEST / ONE_TURN:g} turns"
        yield Fault(path, "recipe-bad-value", what, "leave limits out for a joint that turns without end")
    elif path[2] == "max_velocity" and value > 0 and not SLOWEST <= size <= FASTEST:
        what = f"no joint's highest speed is {value:g} {unit}/s"
        yield Fault(path, "recipe-bad-value", what, f"write it in {unit}/s, or leave the key out")


def _slides(index: int, joint: dict[Any, Any]) -> Iterator[Fault]:
    """Limits and speeds of a prismatic joint that are in millimetres, or angles."""
    if joint.get("type") != "prismatic":
        return
    for path, value in _motion_values(index, joint):
        most = FASTEST_RAIL if path[2] == "max_velocity" else LONGEST_RAIL
        unit = "m/s" if path[2] == "max_velocity" else "m"
        if is_pi_expression(value):
            yield Fault(
                path, "recipe-wrong-type", f"{value} is an angle, and the joint slides", f"write a number in {unit}"
            )
        elif is_number(value) and abs(value) > most:
            what = f"{path[2]} of {value:g} {unit} is beyond {most:g} {unit}"
            yield Fault(path, "recipe-bad-value", what, f"prismatic joints are in {unit}; divide by 1000")


def _columns(log: dict[Any, Any], joints: list[Any]) -> Iterator[Fault]:
    """Templates that give two quantities or joints one column."""
    owners: Counter[str] = Counter()
    time = log.get("time", "t")
    owners[str(time)] += 1
    for quantity, usual in _QUANTITIES.items():
        template = log.get(quantity, usual)
        if not isinstance(template, str):
            continue
        with suppress(PydanticCustomError):
            places(template)
            yield from _clashes(quantity, template, joints, owners)


def _clashes(quantity: str, template: str, joints: list[Any], owners: Counter[str]) -> Iterator[Fault]:
    names = [
        template.format(joint=index + 1, joint0=index, name=joint_name(index, joint))
        for index, joint in enumerate(joints)
    ]
    if len(set(names)) < len(names):
        what = f"{template} names the same column for every joint"
        mend = "write {joint} (from 1), {joint0} (from 0) or {name} where the joint goes, such as q{joint}"
        yield Fault(("log", quantity), "recipe-duplicate", what, mend)
        return
    taken = next((name for name in names if owners[name]), None)
    owners.update(names)
    if taken is not None:
        what = f"{quantity} takes column {taken}, which another quantity has already"
        yield Fault(("log", quantity), "recipe-duplicate", what, "give each quantity its own columns")


def _log_units(log: dict[Any, Any], joints: list[Any]) -> Iterator[Fault]:
    """Units of an angle for joints that slide, and the other way round."""
    units = _mapping(log, "units")
    kinds = {str(joint.get("type")) for joint in joints if isinstance(joint, dict)}
    for quantity, turning, sliding in (
        ("position", "angle", "length"),
        ("velocity", "angular velocity", "linear velocity"),
    ):
        dimension = UNITS[word][0] if isinstance(word := units.get(quantity), str) and word in UNITS else None
        path = ("log", "units", quantity)
        if dimension == sliding and "revolute" in kinds:
            mend = f"give {quantity} a unit of {turning}; prismatic joints have prismatic_{quantity}"
            yield Fault(path, "recipe-unit", f"{word} is a unit of {sliding}, and the arm has revolute joints", mend)
        if dimension == turning and kinds == {"prismatic"}:
            mend = f"give it a unit of {sliding}"
            yield Fault(path, "recipe-unit", f"{word} is a unit of {turning}, and every joint is prismatic", mend)
        other = f"prismatic_{quantity}"
        if other in units and kinds == {"revolute"}:
            what = f"{other} is given, and the arm has no prismatic joint"
            yield Fault(("log", "units", other), "recipe-unit", what, "take it away")
    if units.get("position") == "rev" and "velocity" not in units:
        mend = "add velocity: rpm, deg/s or rad/s to log.units"
        yield Fault(
            ("log", "units", "position"), "recipe-unit", "position is in rev, and the unit of velocity is missing", mend
        )


def _signs(log: dict[Any, Any], n_joints: int) -> Iterator[Fault]:
    for quantity, signs in _mapping(log, "signs").items():
        if isinstance(signs, list) and len(signs) != n_joints:
            what = f"{len(signs)} signs for {n_joints} joints"
            yield Fault(
                ("log", "signs", quantity), "recipe-bad-value", what, "write 1 or -1 for each joint, base to tip"
            )


def _effects(effects: Any, joints: list[Any]) -> Iterator[Fault]:
    """Effects at joints that the arm has not, and the same effect twice at a joint."""
    names = [joint_name(index, joint) for index, joint in enumerate(joints)]
    seen: set[tuple[str, str]] = set()
    for index, choice in enumerate(effects if isinstance(effects, list) else []):
        if not isinstance(choice, dict):
            continue
        joint = choice.get("joint", "all")
        path = ("effects", index, "joint")
        if isinstance(joint, int) and not isinstance(joint, bool) and not 1 <= joint <= len(names):
            yield Fault(path, "recipe-bad-value", f"there is no joint {joint}", f"joints count from 1 to {len(names)}")
        if isinstance(joint, str) and joint != "all" and joint not in names:
            near = nearest(joint, [*names, "all"])
            mend = f"did you mean {near}?" if near else f"one of {', '.join(names)}, a number from 1, or all"
            yield Fault(path, "recipe-unknown-word", f"there is no joint named {joint[:60]}", mend)
        number = names.index(joint) + 1 if joint in names else joint
        key = (str(choice.get("effect")), f"{number} {choice.get('shape')}")
        if key in seen:
            yield Fault(
                ("effects", index), "recipe-duplicate", f"{key[0]} at joint {joint} is given twice", "remove one"
            )
        seen.add(key)
