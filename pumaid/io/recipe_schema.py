"""What a recipe may hold: keys, types and ranges; each value is checked in the context of the whole arm."""

from __future__ import annotations

import math
import re
import string
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self, cast

from pydantic import AfterValidator, BaseModel, BeforeValidator, Field, ValidationInfo, model_validator

from pumaid.io.forms import FORM, Fault, Finite, refusal, within
from pumaid.units import UNITS, factor

#: Longest link and rail (m), and fastest rail (m/s); larger numbers are in millimetres.
LONGEST_LINK, LONGEST_RAIL, FASTEST_RAIL = 20.0, 100.0, 20.0
#: Gravity, m/s2: 1.6 on the Moon, 25 on Jupiter.
LEAST_GRAVITY, MOST_GRAVITY = 1.5, 30.0
#: Limits (rad) beyond this are in degrees where the file does not state its unit; and beyond this in any case wrong.
WIDEST_UNSTATED, WIDEST = 4.0 * math.pi, 200.0 * math.pi
#: Slowest and fastest highest speed of a revolute joint, rad/s.
SLOWEST, FASTEST = 1e-4, 1e3
#: Quarter turns (rad) in a file of degrees are radians, to this rounding.
QUARTERS, ROUNDING = tuple(quarter * math.pi / 2.0 for quarter in (1, 2, 3)), 5e-4

#: Key -> what it looks like.
EXAMPLES = {
    "name": "a name, such as my arm",
    "gravity": "[0, 0, -9.80665]   (m/s2 in base axes; this is upright)",
    "joints": "1 to 50 lines such as - {type: revolute, alpha: 0, a: 0, d: 0}, base to tip",
    "type": "revolute   (or prismatic)",
    "alpha": "the twist before the joint, modified DH",
    "a": "the length before the joint, m, modified DH",
    "limits": "[lowest, highest]",
    "effects": "[{effect: NAME, joint: 3}]",
    "effect": "a name that pumaid effects lists",
    "shape": "{velocity: 0.1}",
    "units": "{angle: deg}",
    "signs": "{position: [1, -1, ...]}",
    "log": "its keys below it, indented",
    "safety": "its keys below it, indented: boxes, spheres, tool, margin",
    "boxes": "[{name: table, min: [-1, -1, -1], max: [1, 1, -0.02]}]",
    "spheres": "[{link: 3, centre: [0.2, 0, 0], radius: 0.08}]",
    "min": "[x, y, z]   (the lowest corner, m in base axes)",
    "max": "[x, y, z]   (the highest corner, m in base axes)",
    "link": "the link that carries the sphere; 0 is the base",
    "centre": "[x, y, z]   (m, in the link's frame)",
    "tool": "[x, y, z]   (m, in the last link's frame)",
    "radius": "the sphere's radius, m",
    "ignore": "[[4, 6]], pairs of links",
}
_PI = re.compile(r"\s*([+-]?)\s*(?:(\d+(?:\.\d*)?)\s*\*?\s*)?pi\s*(?:/\s*(\d+(?:\.\d*)?))?\s*")
_COLUMN = "write {joint} (counts from 1), {joint0} (from 0) or {name} where the joint goes, such as q{joint}"


@dataclass(frozen=True)
class ArmForm:
    """What a value is checked against: the joints' names and types, the unit of angles and whether it is stated."""

    names: tuple[str, ...]
    kinds: frozenset[str]
    unit: str
    is_stated: bool

    @classmethod
    def of(cls, data: dict[str, Any]) -> ArmForm:
        """From a recipe's plain data, whatever it holds."""
        entries, units = data.get("joints"), data.get("units")
        joints = [joint if isinstance(joint, dict) else {} for joint in (entries if isinstance(entries, list) else [])]
        names = [joint.get("name") for joint in joints]
        units = units if isinstance(units, dict) else {}
        return cls(
            tuple(name if isinstance(name, str) else f"joint{k}" for k, name in enumerate(names, start=1)),
            frozenset(str(joint.get("type")) for joint in joints),
            str(units.get("angle", "rad")),
            "angle" in units,
        )


def _arm(info: ValidationInfo) -> ArmForm:
    return cast(ArmForm, info.context)


def _is_rail(info: ValidationInfo) -> bool:
    """Whether a value is a position or speed of a joint that slides."""
    return info.data.get("type") == "prismatic" and info.field_name in ("limits", "max_velocity")


def _pi(value: Any, info: ValidationInfo) -> Any:
    """``-pi/2`` and the like as a number, in a file of radians."""
    match = _PI.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        return value
    if _is_rail(info):
        raise refusal("recipe-bad-value", f"{value} is an angle, and the joint slides", "write a number in m or m/s")
    if _arm(info).unit == "deg":
        raise refusal("recipe-angle-unit", f"{value} is in rad, and this file's angles are in deg", "write degrees")
    sign, times, over = match.groups()
    if over is not None and float(over) == 0.0:
        raise refusal("recipe-bad-value", f"{value!r} divides by zero", "write a number")
    return (-1.0 if sign == "-" else 1.0) * float(times or 1.0) * math.pi / float(over or 1.0)


def _plausible(value: float, info: ValidationInfo) -> float:
    """Refuse angles in another unit than the file's, and limits and speeds that no joint has."""
    key, arm, size = str(info.field_name), _arm(info), abs(value)
    per_s = "/s" if key == "max_velocity" else ""
    if _is_rail(info):
        highest = FASTEST_RAIL if per_s else LONGEST_RAIL
        if size > highest:
            what = f"{key} of {value:g} m{per_s} is beyond {highest:g} m{per_s}"
            raise refusal("recipe-bad-value", what, f"prismatic joints are in m{per_s}; divide by 1000")
        return value
    is_constant = key in ("alpha", "theta")
    if arm.unit == "rad" and size > (2.0 * math.pi if is_constant else WIDEST_UNSTATED):
        if is_constant or not arm.is_stated:
            what = f"{key} of {value:g} rad{per_s} is too large: degrees?"
            mend = "add units: {angle: deg} at the top; or, if it is rad, say so: units: {angle: rad}"
            raise refusal("recipe-angle-unit", what, mend)
    elif arm.unit == "deg" and is_constant and size > 360.0:
        raise refusal("recipe-angle-unit", f"{key} of {value:g} deg is more than a turn", "write it within 360")
    elif arm.unit == "deg" and not per_s and any(abs(size - quarter) < ROUNDING for quarter in QUARTERS):
        mend = "write degrees (90, not 1.5708), or take units: {angle: deg} away"
        raise refusal("recipe-angle-unit", f"{key} of {value:g} deg is a quarter turn in rad", mend)
    rad = size * factor(arm.unit) if arm.unit in ("rad", "deg") else size
    if key == "limits" and rad > WIDEST:
        what = f"limits of {value:g} {arm.unit} are more than {WIDEST / (2.0 * math.pi):g} turns"
        raise refusal("recipe-bad-value", what, "leave limits out for a joint that turns without end")
    if per_s and not SLOWEST <= rad <= FASTEST:
        what = f"no joint's highest speed is {value:g} {arm.unit}/s"
        raise refusal("recipe-bad-value", what, f"write a number above 0 in {arm.unit}/s, or leave the key out")
    return value


def _in_order(limits: list[float]) -> list[float]:
    low, high = limits
    if low >= high:
        what = f"the limits [{low:g}, {high:g}] are not [lowest, highest]"
        raise refusal("recipe-bad-value", what, "write the lower one first")
    return limits


def _gravity(vector: list[float]) -> list[float]:
    size = math.hypot(*vector)
    if not LEAST_GRAVITY <= size <= MOST_GRAVITY:
        what = f"gravity of {size:g} m/s2 is not between {LEAST_GRAVITY:g} and {MOST_GRAVITY:g}"
        raise refusal("recipe-bad-value", what, "give it in m/s2, as a vector in base axes: [0, 0, -9.80665] upright")
    return vector


def _printable(text: str) -> str:
    if not text.strip() or not text.isprintable():
        what = f"the name {text[:40]!r} is empty or has unprintable characters"
        raise refusal("recipe-bad-value", what, "write a word")
    return text


def _joint_name(name: str) -> str:
    if name.lower() == "all" or "@" in name or "," in name or re.fullmatch(r"[\d.+-]+", name):
        what = f"{name!r} cannot name a joint, because EFFECT@JOINT would read it as something else"
        raise refusal("recipe-bad-value", what, "use a word, such as shoulder")
    return name


def _template(template: str, info: ValidationInfo) -> str:
    """A column template: {joint}, {joint0} and {name} may stand in it, but for the time."""
    places = set()
    try:
        for _, place, form, conversion in string.Formatter().parse(template):
            is_numeric = place in ("joint", "joint0") and re.fullmatch(r"(0?\d)?d?", form or "") is not None
            if place is not None and (conversion or not (is_numeric or (place == "name" and not form))):
                raise ValueError(place)
            places.add(place)
    except ValueError as error:
        what = f"the column template {template!r} cannot be used"
        raise refusal("recipe-bad-value", what, _COLUMN) from error
    if info.field_name == "time" and places != {None}:
        what = f"the time column {template!r} holds a joint"
        raise refusal("recipe-bad-value", what, "name one column, such as t")
    if info.field_name != "time" and len(_arm(info).names) > 1 and not places - {None}:
        raise refusal("recipe-bad-value", f"{template} names the same column for every joint", _COLUMN)
    return template


def _signs(signs: list[float], info: ValidationInfo) -> list[float]:
    if len(signs) != len(_arm(info).names) or not set(signs) <= {1.0, -1.0}:
        what = f"{len(signs)} values for {len(_arm(info).names)} joints, which must be signs"
        raise refusal("recipe-bad-value", what, "write 1 or -1 for each joint, base to tip")
    return signs


def _effect_joint(joint: Any, info: ValidationInfo) -> int | None:
    """The number of the joint at which an effect acts; None for all."""
    names = _arm(info).names
    if isinstance(joint, bool) or not isinstance(joint, int | str):
        raise refusal("recipe-bad-value", f"{joint!r} is not a joint", "write its number from 1, its name, or all")
    if isinstance(joint, int) and not 1 <= joint <= len(names):
        raise refusal("recipe-bad-value", f"there is no joint {joint}", f"joints count from 1 to {len(names)}")
    if isinstance(joint, str) and joint != "all" and joint not in names:
        what = f"there is no joint named {joint[:60]}"
        raise refusal("recipe-bad-value", what, known=[*names, "all"], word=joint)
    return joint if isinstance(joint, int) else None if joint == "all" else names.index(joint) + 1


def _effect_name(name: str) -> str:
    word, at, joint = name.partition("@")
    if not re.fullmatch(r"[A-Za-z]\w*", name):
        mend = f"write {{effect: {word}, joint: {joint}}}" if at else "pumaid effects lists the names"
        raise refusal("recipe-bad-value", f"{name[:40]!r} is no effect's name", mend)
    return name


def _link(link: int, info: ValidationInfo) -> int:
    n_joints = len(_arm(info).names)
    if not 0 <= link <= n_joints:
        raise refusal("recipe-bad-value", f"there is no link {link}", f"links count from 0 (the base) to {n_joints}")
    return link


def _apart(links: list[int]) -> list[int]:
    if abs(links[0] - links[1]) <= 1:
        what = f"links {links[0]} and {links[1]} are neighbours or one, and are never checked against each other"
        raise refusal("recipe-bad-value", what, "take the pair away")
    return links


def coupled(key: str) -> tuple[int, int] | None:
    """Joints (driven, driving), from 1, that a key of `coupling` names: (5, 4) for r54, (12, 9) for r12_9."""
    match = re.fullmatch(r"r([1-9])([1-9])|r([1-9]\d?)_([1-9]\d?)", key)
    if match is None:
        return None
    driven, driving = (int(number) for number in match.groups() if number is not None)
    return driven, driving


def _coupling(key: str, info: ValidationInfo) -> str:
    pair, n_joints = coupled(key), len(_arm(info).names)
    mend = "write r54 where joint 5's motor is turned by joint 4's, and r12_9 where a joint is above 9"
    if pair is None:
        raise refusal("recipe-bad-key", f"{key[:60]} does not name two joints", mend)
    if max(pair) > n_joints:
        raise refusal("recipe-bad-value", f"there is no joint {max(pair)} for {key}", f"joints are 1 to {n_joints}")
    if pair[0] <= pair[1]:
        what = f"{key} has joint {pair[0]} driven by joint {pair[1]}, which is not nearer to the base"
        raise refusal("recipe-bad-value", what, mend)
    return key


def _unit_of(*dimensions: str) -> AfterValidator:
    """A unit word of one of the dimensions, the first of revolute joints, the second of prismatic ones."""

    def check(word: str, info: ValidationInfo) -> str:
        fitting = [unit for unit, (dimension, _) in UNITS.items() if dimension in dimensions]
        if word not in fitting:
            other = f"a unit of {UNITS[word][0]}" if word in UNITS else "no unit"
            what = f"{word[:40]!r} is {other}, and a unit of {' or '.join(dimensions)} is needed"
            raise refusal("recipe-bad-value", what, known=fitting, word=word)
        key, kinds, dimension = str(info.field_name), _arm(info).kinds, UNITS[word][0]
        if len(dimensions) == 2 and dimension == dimensions[1] and "revolute" in kinds:
            what = f"{word} is a unit of {dimension}, and the arm has revolute joints"
            mend = f"give {key} a unit of {dimensions[0]}; prismatic joints have prismatic_{key}"
            raise refusal("recipe-bad-value", what, mend)
        if len(dimensions) == 2 and dimension == dimensions[0] and kinds == {"prismatic"}:
            what = f"{word} is a unit of {dimension}, and every joint is prismatic"
            raise refusal("recipe-bad-value", what, f"give it a unit of {dimensions[1]}")
        if key.startswith("prismatic_") and kinds == {"revolute"}:
            raise refusal("recipe-bad-value", f"{key} is given, and the arm has no prismatic joint", "take it away")
        return word

    return AfterValidator(check)


Angle = Annotated[Finite, BeforeValidator(_pi), AfterValidator(_plausible)]
Length = Annotated[Finite, within(0, LONGEST_LINK, unit="m", mend="lengths are in metres; divide by 1000")]
Words = Annotated[str, Field(strict=True, max_length=200), AfterValidator(_printable)]
Template = Annotated[Words, AfterValidator(_template)]
Point = Annotated[list[Length], Field(min_length=3, max_length=3)]
Link = Annotated[int, Field(strict=True), AfterValidator(_link)]
Signs = Annotated[list[Finite], AfterValidator(_signs)]
GearRatio = Annotated[Finite, within(1e-3, 1e5, unit="", mend="write motor turns per joint turn, such as 101")]


class _StrictForm(BaseModel):
    model_config = FORM

    @model_validator(mode="before")
    @classmethod
    def _leave_out_empty(cls, data: Any) -> Any:
        """What is empty, as a block whose lines are all commented out, means its default; a quantity may be null."""
        if not isinstance(data, dict):
            return data
        nullable = ("velocity", "temperature")
        empty = [
            key for key, value in data.items() if value is None and key in cls.model_fields and key not in nullable
        ]
        return {key: value for key, value in data.items() if key not in empty}


class JointForm(_StrictForm):
    """One entry of `joints`."""

    type: Literal["revolute", "prismatic"]
    alpha: Angle
    a: Length
    d: Length | None = None
    theta: Angle | None = None
    name: Annotated[Words, AfterValidator(_joint_name)] | None = None
    limits: Annotated[list[Angle], Field(min_length=2, max_length=2), AfterValidator(_in_order)] | None = None
    max_velocity: Annotated[Angle, Field(gt=0)] | None = None
    gear_ratio: GearRatio | None = None

    @model_validator(mode="after")
    def _has_constants(self) -> Self:
        needed = "d" if self.type == "revolute" else "theta"
        if getattr(self, needed) is None:
            mend = f"add {needed}: 0 if it is zero; only the offset of the joint's own motion may be left out"
            raise refusal(
                "recipe-bad-key", f"a {self.type} joint has a constant {needed}, and the key is missing", mend
            )
        return self


class FileUnits(_StrictForm):
    """The block `units`."""

    angle: Literal["rad", "deg"] = "rad"


class LogUnits(_StrictForm):
    """The block `log.units`."""

    time: Annotated[str, _unit_of("time")] = "s"
    position: Annotated[str, _unit_of("angle", "length")] | None = None
    velocity: Annotated[str, _unit_of("angular velocity", "linear velocity")] | None = None
    prismatic_position: Annotated[str, _unit_of("length")] | None = None
    prismatic_velocity: Annotated[str, _unit_of("linear velocity")] | None = None
    current: Annotated[str, _unit_of("current")] = "A"
    temperature: Annotated[str, _unit_of("temperature")] = "degC"


class LogSigns(_StrictForm):
    """The block `log.signs`."""

    position: Signs | None = None
    current: Signs | None = None


class LogForm(_StrictForm):
    """The block `log`."""

    time: Template = "t"
    position: Template = "q{joint}"
    velocity: Template | None = "qd{joint}"
    current: Template = "i{joint}"
    temperature: Template | None = "temp{joint}"
    units: LogUnits = LogUnits()
    signs: LogSigns = LogSigns()


class EffectForm(_StrictForm):
    """One entry of `effects`."""

    effect: Annotated[Words, AfterValidator(_effect_name)]
    joint: Annotated[Any, BeforeValidator(_effect_joint)] = None
    shape: dict[str, Finite] = {}


class BoxForm(_StrictForm):
    """One entry of `safety.boxes`."""

    name: Words | None = None
    min: Point
    max: Point

    @model_validator(mode="after")
    def _has_inside(self) -> Self:
        for axis, low, high in zip("xyz", self.min, self.max, strict=True):
            if low >= high:
                what = f"along {axis} the box reaches from {low:g} to {high:g} m, so it has no inside"
                raise refusal("recipe-bad-value", what, "write the lower corner as min and the upper as max")
        return self


class SphereForm(_StrictForm):
    """One entry of `safety.spheres`."""

    link: Link
    centre: Point
    radius: Annotated[Length, Field(gt=0)]


class SafetyForm(_StrictForm):
    """The block `safety`."""

    tool: Point | None = None
    boxes: Annotated[list[BoxForm], Field(max_length=100)] = []
    spheres: Annotated[list[SphereForm], Field(max_length=200)] = []
    margin: Annotated[Finite, Field(ge=0, le=1)] = 0.02
    ignore: list[Annotated[list[Link], Field(min_length=2, max_length=2), AfterValidator(_apart)]] = []


class RecipeForm(_StrictForm):
    """The whole file."""

    name: Words
    gravity: Annotated[list[Finite], Field(min_length=3, max_length=3), AfterValidator(_gravity)]
    joints: Annotated[list[JointForm], Field(min_length=1, max_length=50)]
    units: FileUnits = FileUnits()
    log: LogForm = LogForm()
    effects: list[EffectForm] = []
    safety: SafetyForm | None = None
    coupling: dict[Annotated[str, AfterValidator(_coupling)], Finite] = {}
    source: Any = ""
    notes: Any = ""
    licence: Any = ""


def faults_between(form: RecipeForm, names: tuple[str, ...]) -> Iterator[Fault]:
    """Faults that show only when two values are seen together; `names` are the joints'."""
    yield from _repeated(names, "joints")
    yield from _columns(form.log, names)
    choices = [(choice.effect, choice.joint, choice.shape) for choice in form.effects]
    for index, choice in enumerate(choices):
        if choice in choices[:index]:
            yield Fault(("effects", index), "recipe-bad-value", f"{choice[0]} is given twice", "remove one")
    if form.safety is not None:
        boxes = [box.name or f"box {k}" for k, box in enumerate(form.safety.boxes, start=1)]
        yield from _repeated(boxes, "safety", "boxes")
    pairs = [pair for key in form.coupling if (pair := coupled(key)) is not None]
    for key, pair in zip(form.coupling, pairs, strict=True):
        if pairs.count(pair) > 1 and key != f"r{pair[0]}{pair[1]}":
            what = f"{key} couples joints that another key couples"
            yield Fault(("coupling", key), "recipe-bad-value", what, "take one away")
    for number in sorted({number for pair in pairs for number in pair}):
        if form.joints[number - 1].gear_ratio is None:
            what = f"joint {number} takes part in coupling, and has no gear ratio"
            path = ("joints", number - 1, "gear_ratio")
            yield Fault(path, "recipe-bad-key", what, "add gear_ratio: motor turns per joint turn")


def _repeated(names: Sequence[str], *path: str) -> Iterator[Fault]:
    """Names that stand twice in a list."""
    lower = [name.lower() for name in names]
    for index, name in enumerate(lower):
        if name in lower[:index]:
            what = f"{path[-1]} {lower.index(name) + 1} and {index + 1} are both named {names[index][:60]}"
            yield Fault((*path, index, "name"), "recipe-bad-value", what, "give each its own name")


def _columns(log: LogForm, names: tuple[str, ...]) -> Iterator[Fault]:
    """Columns that two quantities take."""
    taken = {log.time}
    for key in ("position", "velocity", "current", "temperature"):
        template = getattr(log, key) or ""
        columns = {template.format(joint=k + 1, joint0=k, name=name) for k, name in enumerate(names) if template}
        shared = sorted(columns & taken)
        taken |= columns
        if shared:
            what = f"{key} takes column {shared[0]}, which another quantity has already"
            yield Fault(("log", key), "recipe-bad-value", what, "give each quantity its own columns")
    if log.units.position == "rev" and log.units.velocity is None:
        what, mend = "position is in rev, and the unit of velocity is missing", "add velocity: rpm, deg/s or rad/s"
        yield Fault(("log", "units", "position"), "recipe-bad-value", what, mend)
