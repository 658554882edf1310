"""What may stand in a recipe: keys, types and ranges of each value on its own."""

from __future__ import annotations

import math
import re
import string
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from pumaid.units import UNITS

#: Longest a link can be (m); a larger number is in millimetres.
LONGEST_LINK = 20.0
#: Farthest a prismatic joint can go (m), and fastest (m/s).
LONGEST_RAIL, FASTEST_RAIL = 100.0, 20.0
#: Gravity on the Moon is 1.6 m/s2 and on Jupiter 25; anything outside is in another unit.
LEAST_GRAVITY, MOST_GRAVITY = 1.5, 30.0

_PI = re.compile(r"\s*([+-]?)\s*(?:(\d+(?:\.\d*)?)\s*\*?\s*)?pi\s*(?:/\s*(\d+(?:\.\d*)?))?\s*")


def refusal(slug: str, what: str, mend: str = "") -> PydanticCustomError:
    """A pydantic error that carries our slug, sentence and mend; braces in the texts are kept as they are."""
    return PydanticCustomError("pumaid", "{what}", {"slug": slug, "what": what, "mend": mend})


def is_pi_expression(value: object) -> bool:
    """Whether `value` is text such as ``-pi/2`` or ``3*pi/4``."""
    return isinstance(value, str) and _PI.fullmatch(value) is not None


def _angle(value: Any) -> Any:
    match = _PI.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        return value
    sign, times, over = match.groups()
    if over is not None and float(over) == 0.0:
        raise refusal("recipe-bad-value", f"{value!r} divides by zero", "write a number")
    return (-1.0 if sign == "-" else 1.0) * float(times or 1.0) * math.pi / float(over or 1.0)


def _link_length(value: float) -> float:
    if abs(value) > LONGEST_LINK:
        raise refusal(
            "recipe-bad-value",
            f"{value:g} m is longer than {LONGEST_LINK:g} m",
            "lengths are in metres; divide by 1000",
        )
    return value


def _in_order(limits: list[float]) -> list[float]:
    low, high = limits
    if low >= high:
        raise refusal(
            "recipe-bad-value", f"the limits [{low:g}, {high:g}] are not [lowest, highest]", "write the lower one first"
        )
    return limits


def _gravity(vector: list[float]) -> list[float]:
    size = math.hypot(*vector)
    if size == 0.0:
        raise refusal(
            "recipe-bad-value",
            "gravity is zero, so no link's weight can be identified",
            "for a robot that stands upright: [0, 0, -9.80665]",
        )
    if not LEAST_GRAVITY <= size <= MOST_GRAVITY:
        raise refusal(
            "recipe-bad-value",
            f"gravity of {size:g} m/s2 is not between {LEAST_GRAVITY:g} and {MOST_GRAVITY:g}",
            "give it in m/s2, as a vector in base axes: [0, 0, -9.80665] upright",
        )
    return vector


def _gear_ratio(ratio: float) -> float:
    if ratio == 0.0:
        raise refusal(
            "recipe-bad-value", "a gear ratio of 0 moves nothing", "write motor turns per joint turn, such as 101"
        )
    if not 1e-3 <= abs(ratio) <= 1e5:
        raise refusal(
            "recipe-bad-value", f"no gear has a ratio of {ratio:g}", "write motor turns per joint turn, such as 101"
        )
    return ratio


def _margin(value: float) -> float:
    if not 0.0 <= value <= 1.0:
        raise refusal(
            "recipe-bad-value", f"a margin of {value:g} m is not between 0 and 1 m", "write metres, such as 0.02"
        )
    return value


def _words(text: str) -> str:
    if not text.strip() or not text.isprintable():
        raise refusal(
            "recipe-bad-value", f"the name {text[:40]!r} is empty or has unprintable characters", "write a word"
        )
    return text


def _joint_name(name: str) -> str:
    if name.lower() == "all" or "@" in name or "," in name or re.fullmatch(r"[\d.+-]+", name):
        raise refusal(
            "recipe-bad-value",
            f"{name!r} cannot name a joint, because EFFECT@JOINT would read it as something else",
            "use a word, such as shoulder",
        )
    return name


def places(template: str) -> set[str]:
    """Names in braces of a column template; refuses (as pydantic does) what is neither {joint}, {joint0} nor {name}."""
    found = set()
    try:
        for _, place, form, conversion in string.Formatter().parse(template):
            if place is None:
                continue
            numeric = place in ("joint", "joint0") and re.fullmatch(r"(0?\d)?d?", form or "") is not None
            if conversion or not (numeric or (place == "name" and not form)):
                raise ValueError(place)
            found.add(place)
    except ValueError as error:
        raise refusal(
            "recipe-bad-value",
            f"the column template {template!r} cannot be used",
            "write {joint} (counts from 1), {joint0} (from 0) or {name} where the joint goes, such as q{joint}",
        ) from error
    return found


def _template(template: str) -> str:
    places(template)
    return template


def _plain_column(column: str) -> str:
    if places(column):
        raise refusal("recipe-bad-value", f"the time column {column!r} holds a joint", "name one column, such as t")
    return column


def _plus_or_minus(sign: float) -> float:
    if sign not in (1.0, -1.0):
        raise refusal("recipe-bad-value", f"{sign:g} is not a sign", "write 1 or -1 for each joint")
    return sign


def _number_or_word(joint: Any) -> Any:
    if isinstance(joint, bool) or not isinstance(joint, int | str):
        raise refusal("recipe-wrong-type", f"{joint!r} is not a joint", "write its number from 1, its name, or all")
    return joint


def _effect_name(name: str) -> str:
    word, at, joint = name.partition("@")
    if not re.fullmatch(r"[A-Za-z]\w*", name):
        mend = f"write {{effect: {word}, joint: {joint}}}" if at else "pumaid effects lists the names"
        raise refusal("recipe-bad-value", f"{name[:40]!r} is no effect's name", mend)
    return name


def _text_or_texts(text: Any) -> Any:
    lines = text if isinstance(text, list) else [text]
    if not all(isinstance(line, str) for line in lines):
        raise refusal("recipe-wrong-type", "this is neither text nor a list of texts", 'put the text in quotes: "..."')
    return text


def _unit_of(*dimensions: str) -> AfterValidator:
    def check(word: str) -> str:
        fitting = [unit for unit, (dimension, _) in UNITS.items() if dimension in dimensions]
        if word not in fitting:
            meant = UNITS.get(word)
            what = (
                f"{word!r} is a unit of {meant[0]}, not of {' or '.join(dimensions)}"
                if meant
                else f"{word[:40]!r} is no unit of {' or '.join(dimensions)}"
            )
            raise PydanticCustomError(
                "pumaid", "{what}", {"slug": "recipe-unit", "what": what, "mend": "", "word": word, "known": fitting}
            )
        return word

    return AfterValidator(check)


Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Angle = Annotated[Finite, BeforeValidator(_angle)]
Length = Annotated[Finite, AfterValidator(_link_length)]
Positive = Annotated[Finite, Field(gt=0)]
Words = Annotated[str, Field(strict=True, max_length=200), AfterValidator(_words)]
Template = Annotated[Words, AfterValidator(_template)]
_BLOCKS = (
    *("units", "log", "signs", "effects", "shape", "coupling", "source", "notes", "licence"),
    *("safety", "boxes", "spheres", "ignore"),
)

Point = Annotated[list[Length], Field(min_length=3, max_length=3)]
Link = Annotated[int, Field(strict=True)]
Signs = list[Annotated[Finite, AfterValidator(_plus_or_minus)]]


class _Form(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)

    @model_validator(mode="before")
    @classmethod
    def _leave_out_empty_blocks(cls, data: Any) -> Any:
        """A block whose lines are all commented out reads as empty, and means its default."""
        if not isinstance(data, dict):
            return data
        return {key: value for key, value in data.items() if value is not None or key not in _BLOCKS}


class JointForm(_Form):
    """One entry of `joints`."""

    type: Literal["revolute", "prismatic"]
    alpha: Angle
    a: Length
    d: Length | None = None
    theta: Angle | None = None
    name: Annotated[Words, AfterValidator(_joint_name)] | None = None
    limits: Annotated[list[Angle], Field(min_length=2, max_length=2), AfterValidator(_in_order)] | None = None
    max_velocity: Annotated[Positive, BeforeValidator(_angle)] | None = None
    gear_ratio: Annotated[Finite, AfterValidator(_gear_ratio)] | None = None


class FileUnits(_Form):
    """The block `units`."""

    angle: Literal["rad", "deg"] = "rad"


class LogUnits(_Form):
    """The block `log.units`."""

    time: Annotated[str, _unit_of("time")] = "s"
    position: Annotated[str, _unit_of("angle", "length")] | None = None
    velocity: Annotated[str, _unit_of("angular velocity", "linear velocity")] | None = None
    prismatic_position: Annotated[str, _unit_of("length")] | None = None
    prismatic_velocity: Annotated[str, _unit_of("linear velocity")] | None = None
    current: Annotated[str, _unit_of("current")] = "A"
    temperature: Annotated[str, _unit_of("temperature")] = "degC"


class LogSigns(_Form):
    """The block `log.signs`."""

    position: Signs | None = None
    current: Signs | None = None


class LogForm(_Form):
    """The block `log`."""

    time: Annotated[Words, AfterValidator(_plain_column)] = "t"
    position: Template = "q{joint}"
    velocity: Template | None = "qd{joint}"
    current: Template = "i{joint}"
    temperature: Template | None = "temp{joint}"
    units: LogUnits = LogUnits()
    signs: LogSigns = LogSigns()


class EffectForm(_Form):
    """One entry of `effects`."""

    effect: Annotated[Words, AfterValidator(_effect_name)]
    joint: Annotated[Any, BeforeValidator(_number_or_word)] = "all"
    shape: dict[str, Finite] = {}


class BoxForm(_Form):
    """One entry of `safety.boxes`."""

    name: Words | None = None
    min: Point
    max: Point


class SphereForm(_Form):
    """One entry of `safety.spheres`."""

    link: Link
    centre: Point
    radius: Annotated[Positive, AfterValidator(_link_length)]


class SafetyForm(_Form):
    """The block `safety`."""

    tool: Point | None = None
    boxes: Annotated[list[BoxForm], Field(max_length=100)] = []
    spheres: Annotated[list[SphereForm], Field(max_length=200)] = []
    margin: Annotated[Finite, AfterValidator(_margin)] = 0.02
    ignore: list[Annotated[list[Link], Field(min_length=2, max_length=2)]] = []


class RecipeForm(_Form):
    """The whole file."""

    name: Words
    gravity: Annotated[list[Finite], Field(min_length=3, max_length=3), AfterValidator(_gravity)]
    joints: Annotated[list[JointForm], Field(min_length=1, max_length=50)]
    units: FileUnits = FileUnits()
    log: LogForm = LogForm()
    effects: list[EffectForm] = []
    safety: SafetyForm | None = None
    coupling: dict[str, Finite] = {}
    source: Annotated[Any, BeforeValidator(_text_or_texts)] = ""
    notes: Annotated[Any, BeforeValidator(_text_or_texts)] = ""
    licence: Annotated[Any, BeforeValidator(_text_or_texts)] = ""
