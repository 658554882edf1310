"""What a recipe may hold: keys, types and ranges; each value is checked in the context of the whole arm, and in SI."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, cast

from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo

from pumaid.errors import meant
from pumaid.io.forms import Fault, Finite, StrictForm, refusal
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
#: Smallest and largest size (SI) of a joint's number, by its key and whether it is of a slide; and what to do.
_SIZES = {
    ("limits", False): (0.0, WIDEST, "leave limits out for a joint that turns without end"),
    ("limits", True): (0.0, LONGEST_RAIL, "prismatic joints are in m; divide by 1000"),
    ("max_velocity", False): (SLOWEST, FASTEST, "write a number above 0, or leave the key out"),
    ("max_velocity", True): (0.0, FASTEST_RAIL, "prismatic joints are in m/s; divide by 1000"),
}

_PI = re.compile(r"\s*([+-]?)\s*(?:(\d+(?:\.\d*)?)\s*\*?\s*)?pi\s*(?:/\s*([1-9]\d*(?:\.\d*)?))?\s*")
_TEMPLATE = re.compile(r"(?:[^{}]|\{\{|\}\}|\{joint0?(?::(?:0?\d)?d?)?\}|\{name\})*")
_METRES = "it in metres: divide millimetres by 1000"
_COLUMN = "write {joint} (counts from 1), {joint0} (from 0) or {name} where the joint goes, such as q{joint}"
#: Units of a log's quantities: dimensions of joints that turn, and of those that slide.
_DIMENSIONS = {
    "time": ("time", "time"),
    "position": ("angle", "length"),
    "velocity": ("angular velocity", "linear velocity"),
    "prismatic_position": ("", "length"),
    "prismatic_velocity": ("", "linear velocity"),
    "current": ("current", "current"),
    "temperature": ("temperature", "temperature"),
}


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
        angle = units.get("angle") if isinstance(units, dict) else None
        return cls(
            tuple(name if isinstance(name, str) else f"joint{k}" for k, name in enumerate(names, start=1)),
            frozenset(str(joint.get("type")) for joint in joints),
            "deg" if angle == "deg" else "rad",
            angle is not None,
        )


def _arm(info: ValidationInfo) -> ArmForm:
    return cast(ArmForm, info.context)


def _check(is_good: Callable[[Any], bool], what: str, mend: str) -> AfterValidator:
    """Refuses a value; ``{}`` in `what` stands for it."""

    def check(value: Any) -> Any:
        if not is_good(value):
            raise refusal(what.replace("{}", f"{value:g}" if isinstance(value, float) else str(value)[:60]), mend)
        return value

    return AfterValidator(check)


def _is_rail(info: ValidationInfo) -> bool:
    """Whether a value is a position or speed of a joint that slides."""
    return info.data.get("type") == "prismatic" and (info.field_name, True) in _SIZES


def _pi(value: Any, info: ValidationInfo) -> Any:
    """``-pi/2`` and the like as a number, in a file of radians."""
    match = _PI.fullmatch(value) if isinstance(value, str) else None
    if match is None or _is_rail(info):
        return value
    if _arm(info).unit == "deg":
        what = f"{value} is in rad, and this file's angles are in deg"
        raise refusal(what, "write degrees", slug="recipe-angle-unit")
    sign, times, over = match.groups()
    return float(f"{sign}1") * float(times or 1.0) * math.pi / float(over or 1.0)


def _in_si(value: float, info: ValidationInfo) -> float:
    """rad, m, rad/s or m/s; angles in another unit than the file's, and limits and speeds of no joint, are refused."""
    key, arm, size, is_rail = str(info.field_name), _arm(info), abs(value), _is_rail(info)
    is_speed, is_constant = key == "max_velocity", (key, True) not in _SIZES
    unit, scale = ("m", 1.0) if is_rail else (arm.unit, factor(arm.unit))
    shown = f"{key} of {value:g} {unit}" + "/s" * is_speed
    if not is_rail and unit == "rad" and size > (2.0 * math.pi if is_constant else WIDEST_UNSTATED):
        if is_constant or not arm.is_stated:
            mend = "add units: {angle: deg} at the top; or, if it is rad, say so: units: {angle: rad}"
            raise refusal(f"{shown} is too large: degrees?", mend, slug="recipe-angle-unit")
    elif unit == "deg" and not is_speed and any(abs(size - quarter) < ROUNDING for quarter in QUARTERS):
        mend = "write degrees (90, not 1.5708), or take units: {angle: deg} away"
        raise refusal(f"{shown} is a quarter turn in rad", mend, slug="recipe-angle-unit")
    low, high, mend = _SIZES.get((key, is_rail), (0.0, 2.0 * math.pi + ROUNDING, "write it within a turn"))
    if not low <= size * scale <= high:
        raise refusal(f"{shown} is not between {low / scale:g} and {high / scale:g}", mend)
    return value * scale


def _needed(value: Any, info: ValidationInfo) -> Any:
    """Refuse that a constant of a joint is missing: all of a Denavit-Hartenberg row but the offset of its motion."""
    key, is_placed = str(info.field_name), info.data.get("placement") is not None
    offsets = {"revolute": ("theta",), "prismatic": ("d",)}.get(str(info.data.get("type")), ("theta", "d"))
    if is_placed and value is not None:
        raise refusal(f"{key} stands beside a placement, which says it already", "take one of them away")
    if value is None and not is_placed and key not in offsets:
        mend = f"add {key}: 0 if it is zero, or place the joint with placement: {{xyz: ..., rpy: ..., axis: ...}}"
        raise refusal(f"the key {key} is missing", mend, slug="recipe-bad-key")
    return value


def _is_printable(text: str) -> bool:
    return bool(text.strip()) and text.isprintable()


def is_joint_name(name: str) -> bool:
    """Whether a joint can have this name: a printable word that EFFECT@JOINT does not read as something else."""
    is_word = _is_printable(name) and len(name) <= 200
    return is_word and name.lower() != "all" and not re.search("[@,]", name) and not re.fullmatch(r"[\d.+-]+", name)


def _template(template: str, info: ValidationInfo) -> str:
    """A column template: {joint}, {joint0} and {name} may stand in it, but for the time."""
    if not _TEMPLATE.fullmatch(template):
        raise refusal(f"the column template {template!r} cannot be used", _COLUMN)
    has_joint = re.search(r"\{(joint|name)", template) is not None
    if info.field_name == "time" and has_joint:
        raise refusal(f"the time column {template!r} holds a joint", "name one column, such as t")
    if info.field_name != "time" and len(_arm(info).names) > 1 and not has_joint:
        raise refusal(f"{template} names the same column for every joint", _COLUMN)
    return template


def _signs(signs: tuple[float, ...], info: ValidationInfo) -> tuple[int, ...]:
    if len(signs) != len(_arm(info).names) or not set(signs) <= {1.0, -1.0}:
        what = f"{len(signs)} values for {len(_arm(info).names)} joints, which must be signs"
        raise refusal(what, "write 1 or -1 for each joint, base to tip")
    return tuple(map(round, signs))


def _effect_joint(joint: Any, info: ValidationInfo) -> int | None:
    """The number of the joint at which an effect acts; None for all."""
    names = _arm(info).names
    if joint == "all":
        return None
    if isinstance(joint, str) and joint in names:
        return names.index(joint) + 1
    if isinstance(joint, bool) or not isinstance(joint, int) or not 1 <= joint <= len(names):
        mend = meant(joint, [*names, "all"]) if isinstance(joint, str) else f"joints count from 1 to {len(names)}"
        raise refusal(f"there is no joint {str(joint)[:60]}", mend)
    return joint


def _link(link: int, info: ValidationInfo) -> int:
    n_joints = len(_arm(info).names)
    if not 0 <= link <= n_joints:
        raise refusal(f"there is no link {link}", f"links count from 0 (the base) to {n_joints}")
    return link


def coupled(key: str) -> tuple[int, int] | None:
    """Joints (driven, driving), from 1, that a key of `coupling` names: (5, 4) for r54, (12, 9) for r12_9."""
    match = re.fullmatch(r"r([1-9])([1-9])|r([1-9]\d?)_([1-9]\d?)", key)
    return None if match is None else (int(match[1] or match[3]), int(match[2] or match[4]))


def _coupling(key: str, info: ValidationInfo) -> str:
    pair, n_joints = coupled(key), len(_arm(info).names)
    if pair is None or not n_joints >= pair[0] > pair[1]:
        mend = "write r54 where joint 5's motor is turned by joint 4's, and r12_9 where a joint is above 9"
        what = f"{key[:60]} does not name two of the {n_joints} joints, the driven one and one nearer to the base"
        raise refusal(what, mend, slug="recipe-bad-key" if pair is None else "recipe-bad-value")
    return key


def _unit(word: str, info: ValidationInfo) -> str:
    """A unit word of a quantity that joints of this arm have."""
    key, kinds = str(info.field_name), _arm(info).kinds
    turning, sliding = _DIMENSIONS[key]
    slides = kinds == {"prismatic"} or (key.startswith("prismatic_") and "prismatic" in kinds)
    fitting = [unit for unit, (dimension, _) in UNITS.items() if dimension == (sliding if slides else turning)]
    if word not in fitting:
        mend = meant(word, fitting) if fitting else "take it away: no joint of this arm slides"
        if sliding != turning and word in UNITS and UNITS[word][0] == sliding:
            mend += f"; of joints that slide give prismatic_{key}"
        raise refusal(f"{word[:40]!r} is no unit of {key} here", mend)
    return word


def _like(*examples: str, default: Any = ..., **more: Any) -> Any:
    """A field with what its value looks like."""
    return Field(default, examples=list(examples), **more)


#: Tuples are lists in a file.
AS_LIST = Field(strict=False)
Angle = Annotated[Finite, BeforeValidator(_pi), AfterValidator(_in_si)]
Length = Annotated[Finite, Field(ge=-LONGEST_LINK, le=LONGEST_LINK)]
GearRatio = Annotated[
    Finite, _check(lambda ratio: 1e-3 <= abs(ratio) <= 1e5, "{} is no gear's ratio", "write motor turns per joint turn")
]
Words = Annotated[
    str, Field(strict=True, max_length=200), _check(_is_printable, "the name '{}' is empty", "write a word")
]
Template = Annotated[Words, AfterValidator(_template)]
Triple = Annotated[tuple[Length, Length, Length], AS_LIST]
Vector = Annotated[tuple[Finite, Finite, Finite], AS_LIST]
Link = Annotated[int, Field(strict=True), AfterValidator(_link)]
Signs = Annotated[tuple[Finite, ...], AS_LIST, AfterValidator(_signs)]
Unit = Annotated[str, AfterValidator(_unit)]
JointName = Annotated[str, _check(is_joint_name, "'{}' cannot name a joint", "use a word, such as shoulder")]
EffectName = Annotated[
    Words,
    _check(
        lambda name: re.fullmatch(r"[A-Za-z]\w*", name) is not None,
        "'{}' is no effect's name",
        "write {effect: NAME, joint: 3}; pumaid effects lists the names",
    ),
]
Direction = Annotated[Vector, _check(any, "the axis {} has no direction", "write it as [0, 0, 1]")]
Gravity = Annotated[
    Vector,
    _check(
        lambda vector: LEAST_GRAVITY <= math.hypot(*vector) <= MOST_GRAVITY,
        "{} is no planet's gravity in m/s2",
        "upright it is [0, 0, -9.80665]",
    ),
]
Limits = Annotated[
    tuple[Angle, Angle],
    _check(lambda pair: pair[0] < pair[1], "the limits are not [lowest, highest]", "write the lower one first"),
]
Apart = Annotated[
    tuple[Link, Link],
    AS_LIST,
    _check(lambda pair: abs(pair[1] - pair[0]) > 1, "links {} are neighbours or one", "take the pair away"),
]


class PlacementForm(StrictForm):
    """The block `placement` of a joint: `origin` and `axis` of a URDF."""

    xyz: Triple = _like("[x, y, z]   (m, not mm, in the frame before)")
    rpy: Annotated[tuple[Angle, Angle, Angle], AS_LIST] = _like("[roll, pitch, yaw]", default=(0, 0, 0))
    axis: Direction = _like("[0, 0, 1]", default=(0, 0, 1))


class JointForm(StrictForm):
    """One entry of `joints`."""

    type: Literal["revolute", "prismatic"] = _like("revolute   (or prismatic)")
    placement: PlacementForm | None = _like("{xyz: [0, 0, 0.1], rpy: [0, 0, 0], axis: [0, 0, 1]}", default=None)
    alpha: Annotated[Angle | None, AfterValidator(_needed)] = Field(None, validate_default=True)
    a: Annotated[Length | None, AfterValidator(_needed)] = _like(_METRES, default=None, validate_default=True)
    d: Annotated[Length | None, AfterValidator(_needed)] = _like(_METRES, default=None, validate_default=True)
    theta: Annotated[Angle | None, AfterValidator(_needed)] = Field(None, validate_default=True)
    name: JointName | None = None
    limits: Limits | None = _like("[lowest, highest]", default=None, strict=False)
    max_velocity: Annotated[Angle, Field(gt=0)] | None = None
    gear_ratio: GearRatio | None = None


class FileUnits(StrictForm):
    """The block `units`."""

    angle: Literal["rad", "deg"] = "rad"


class LogUnits(StrictForm):
    """The block `log.units`."""

    time: Unit = "s"
    position: Unit | None = None
    velocity: Unit | None = None
    prismatic_position: Unit | None = None
    prismatic_velocity: Unit | None = None
    current: Unit = "A"
    temperature: Unit = "degC"


class LogSigns(StrictForm):
    """The block `log.signs`."""

    position: Signs | None = None
    current: Signs | None = None


class LogForm(StrictForm):
    """The block `log`."""

    time: Template = "t"
    position: Template = "q{joint}"
    velocity: Template | None = "qd{joint}"
    current: Template = "i{joint}"
    temperature: Template | None = "temp{joint}"
    units: LogUnits = LogUnits()
    signs: LogSigns = _like("{position: [1, -1, ...]}", default=LogSigns())


class EffectForm(StrictForm):
    """One entry of `effects`."""

    effect: EffectName = _like("a name that pumaid effects lists")
    joint: Annotated[Any, BeforeValidator(_effect_joint)] = None
    shape: dict[str, Finite] = _like("{velocity: 0.1}", default={})


class BoxForm(StrictForm):
    """One entry of `safety.boxes`."""

    name: Words | None = None
    min: Triple = _like("[x, y, z]   (the lowest corner, m, not mm, in base axes)")
    max: Triple = _like("[x, y, z]   (the highest corner, m, not mm, in base axes)")


Inside = _check(
    lambda box: all(low < high for low, high in zip(box.min, box.max, strict=True)),
    "the box has no inside: {}",
    "write the lower corner as min and the upper as max",
)


class SphereForm(StrictForm):
    """One entry of `safety.spheres`."""

    link: Link = _like("the link that carries the sphere; 0 is the base")
    centre: Triple = _like("[x, y, z]   (m, not mm, in the link's frame)")
    radius: Annotated[Finite, Field(gt=0, le=LONGEST_LINK)] = _like(_METRES)


class SafetyForm(StrictForm):
    """The block `safety`."""

    tool: Triple | None = _like("[x, y, z]   (m, not mm, in the last link's frame)", default=None)
    boxes: list[Annotated[BoxForm, Inside]] = _like(
        "[{name: table, min: [-1, -1, -1], max: [1, 1, 0]}]", default=[], max_length=100
    )
    spheres: list[SphereForm] = _like("[{link: 3, centre: [0.2, 0, 0], radius: 0.08}]", default=[], max_length=200)
    margin: Annotated[Finite, Field(ge=0, le=1)] = 0.02
    ignore: list[Apart] = _like("[[4, 6]], pairs of links", default=[])


class RecipeForm(StrictForm):
    """The whole file."""

    name: Words = _like("a name, such as my arm")
    gravity: Gravity = _like("[0, 0, -9.80665]   (m/s2 in base axes; this is upright)")
    joints: list[JointForm] = _like(
        "1 to 50 lines such as - {type: revolute, alpha: 0, a: 0, d: 0}, base to tip", min_length=1, max_length=50
    )
    units: FileUnits = _like("{angle: deg}", default=FileUnits())
    log: LogForm = _like("its keys below it, indented", default=LogForm())
    effects: list[EffectForm] = _like("[{effect: NAME, joint: 3}]", default=[])
    safety: SafetyForm = _like("its keys below it, indented: boxes, spheres, tool, margin", default=SafetyForm())
    coupling: dict[Annotated[str, AfterValidator(_coupling)], Finite] = Field({})
    source: Any = ""
    notes: Any = ""
    licence: Any = ""


def faults_between(form: RecipeForm, names: tuple[str, ...]) -> Iterator[Fault]:
    """Faults that show only when two values are seen together; `names` are the joints'."""
    boxes = [(box.name or f"box {k}").lower() for k, box in enumerate(form.safety.boxes, start=1)]
    pairs = [pair for key in form.coupling if (pair := coupled(key)) is not None]
    yield from _repeated([name.lower() for name in names], "joints", "have the same name")
    yield from _repeated([(choice.effect, choice.joint, choice.shape) for choice in form.effects], "effects", "are one")
    yield from _repeated(boxes, "safety", "boxes", "have the same name")
    yield from _repeated(pairs, "coupling", "couple the same joints")
    for number in sorted({number for pair in pairs for number in pair}):
        if form.joints[number - 1].gear_ratio is None:
            what = f"joint {number} takes part in coupling, and has no gear ratio"
            path = ("joints", number - 1, "gear_ratio")
            yield Fault(path, "recipe-bad-key", what, "add gear_ratio: motor turns per joint turn")
    log, taken = form.log, {form.log.time}
    for key in ("position", "velocity", "current", "temperature"):
        template = getattr(log, key) or ""
        columns = {template.format(joint=k + 1, joint0=k, name=name) for k, name in enumerate(names) if template}
        if columns & taken:
            what = f"{key} takes column {min(columns & taken)}, which another quantity has already"
            yield Fault(("log", key), "recipe-bad-value", what, "give each quantity its own columns")
        taken |= columns
    if log.units.position == "rev" and log.units.velocity is None:
        what, mend = "position is in rev, and the unit of velocity is missing", "add velocity: rpm, deg/s or rad/s"
        yield Fault(("log", "units", "position"), "recipe-bad-value", what, mend)


def _repeated(items: Sequence[Any], *words: str) -> Iterator[Fault]:
    """Entries that stand twice in a list; `words` are its path and what is said of them."""
    *path, alike = words
    for index, item in enumerate(items):
        if item in items[:index]:
            what = f"{path[-1]} {items.index(item) + 1} and {index + 1} {alike}"
            yield Fault((*path, index), "recipe-bad-value", what, "give each its own name, or take one away")
