"""The block `log` of a recipe: what it may hold, and the format of logs that it says."""

import re
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, cast

from pydantic import AfterValidator, BeforeValidator, Field, ValidationError, ValidationInfo, model_validator

from pumaid.errors import meant
from pumaid.io.forms import AS_LIST, ArmForm, Finite, StrictForm, Words, arm_of, check, like, parsed_yaml, refusal
from pumaid.robot import QUANTITIES, Conversion, LogFormat, Robot
from pumaid.units import UNITS

_TEMPLATE = re.compile(r"(?:[^{}]|\{\{|\}\}|\{joint0?(?::(?:0?\d)?d?)?\}|\{name\})*")
_ENCODING = r"float|int\d\d?|uint\d\d?(-two-complement)?|sign-bit-\d\d?"
_COLUMN = (
    "write {joint} (counts from 1), {joint0} (from 0) or {name} where the joint goes, such as q{joint}; of the time one"
    " column, such as t"
)
#: Units of a log's quantities: dimensions of joints that turn, and of those that slide.
_DIMENSIONS = {
    "time": ("time", "time"),
    "position": ("angle", "length"),
    "velocity": ("angular velocity", "linear velocity"),
    "current": ("current", "current"),
    "temperature": ("temperature", "temperature"),
}


def _template(template: str, info: ValidationInfo) -> str:
    is_time, has_joint = info.field_name == "time", re.search(r"\{(joint|name)", template) is not None
    is_one = not has_joint and len(arm_of(info).names) > 1
    if not _TEMPLATE.fullmatch(template) or (has_joint if is_time else is_one):
        raise refusal(f"the column template {template!r} cannot be used", _COLUMN)
    return template


def _a_joint(values: tuple[float, ...], info: ValidationInfo) -> tuple[float, ...]:
    is_zero, n_joints = info.field_name == "scale" and 0.0 in values, len(arm_of(info).names)
    if is_zero or len(values) not in (1, n_joints):
        raise refusal(
            "a scale is zero" if is_zero else f"{len(values)} values of {info.field_name} for {n_joints} joints",
            "write one number, or a list with one a joint; a scale is not zero",
        )
    return values


def _units(words: dict[str, str], info: ValidationInfo) -> dict[str, str]:
    for key, word in words.items():
        turning, sliding = _DIMENSIONS[key.removeprefix("prismatic_")]
        slides = key.startswith("prismatic_") or arm_of(info).kinds == {"prismatic"}
        fitting = [unit for unit, (dimension, _) in UNITS.items() if dimension == (sliding if slides else turning)]
        if word not in fitting:
            raise refusal(
                f"{word[:40]!r} is no unit of {key} here",
                f"{meant(word, fitting)}; of joints that slide units are prismatic_position and prismatic_velocity",
            )
    return words


Template = Annotated[Words, AfterValidator(_template)]
Times = Annotated[
    tuple[Template, ...],
    AS_LIST,
    Field(min_length=1, max_length=2),
    BeforeValidator(lambda value: (value,) if isinstance(value, str) else value),
]
PerJoint = Annotated[
    tuple[Finite, ...],
    AS_LIST,
    BeforeValidator(lambda value: (value,) if isinstance(value, int | float) else value),
    AfterValidator(_a_joint),
]
Encoding = Annotated[
    Words,
    check(
        lambda word, _: re.fullmatch(_ENCODING, word),
        "{} is no way to write a sign that pumaid can read",
        "write float, int16, uint16-two-complement or sign-bit-10 (or another number of bits); sizes without sign do"
        " not tell which way a motor pushes",
    ),
]
Signs = Annotated[
    tuple[Finite, ...],
    AS_LIST,
    check(
        lambda signs, arm: len(signs) == len(arm.names) and {*signs} <= {1.0, -1.0},
        "{} is not a sign for each joint",
        "write 1 or -1 for each of the {n} joints, base to tip",
    ),
    AfterValidator(lambda signs: tuple(map(round, signs))),
]
Quantity = Literal["time", "position", "velocity", "prismatic_position", "prismatic_velocity", "current", "temperature"]


class ColumnForm(StrictForm):
    """The columns of one quantity, and what their numbers mean: (number - zero) * scale."""

    column: Template = like("q{joint}")
    scale: PerJoint = like("0.001533981   (or one a joint)", default=(1.0,))
    zero: PerJoint = like("2048   (or one a joint)", default=(0.0,))
    encoding: Encoding = "float"
    step: Annotated[Finite, Field(gt=0)] = 1.0

    def conversions(self, n_joints: int) -> tuple[Conversion, ...]:
        """What the numbers of each joint mean."""
        parts = (values * n_joints if len(values) == 1 else values for values in (self.scale, self.zero))
        return tuple(Conversion(scale, zero, self.encoding, self.step) for scale, zero in zip(*parts, strict=True))


Columns = Annotated[ColumnForm, BeforeValidator(lambda value: {"column": value} if isinstance(value, str) else value)]


@cache
def presets() -> dict[str, dict[str, Any]]:
    """The `log` blocks of what people own, by the names of their files and what else these are called."""
    out: dict[str, dict[str, Any]] = {}
    for path in sorted((Path(__file__).parent / "presets").glob("*.yaml")):
        data = parsed_yaml(path.read_bytes(), path.name).data
        out |= {str(name): data["log"] for name in (path.stem, *data.get("also", ()))}
    return out


class LogForm(StrictForm):
    """The block `log`; `commanded` is checked and not used, since every fit is of measured positions."""

    preset: Words | None = None
    topic: Words | None = None
    time: Times = like("t   (or [sec, nanosec])", default=("t",))
    position: Columns = ColumnForm(column="q{joint}")
    velocity: Columns | None = ColumnForm(column="qd{joint}")
    current: Columns = ColumnForm(column="i{joint}")
    temperature: Columns | None = ColumnForm(column="temp{joint}")
    commanded: Columns | None = None
    effort: Literal["current", "torque"] | None = None
    delay: Annotated[Finite, Field(ge=-0.5, le=0.5)] = 0.0
    units: Annotated[dict[Quantity, str], AfterValidator(_units)] = like(default={})
    signs: dict[Literal["position", "current"], Signs] = like("{position: [1, -1, ...]}", default={})

    @model_validator(mode="before")
    @classmethod
    def _over_preset(cls, data: Any) -> Any:
        if not isinstance(data, dict) or not isinstance(data.get("preset", data.get("topic")), str):
            return data
        name = data.get("preset", "joint-state").lower().replace("_", "-")
        if name not in presets():
            raise refusal(f"there is no preset {name[:60]}", meant(name, list(presets())))
        topic = f"/{str(data.get('topic', 'joint_states')).strip('/')}/"
        parts = presets()[name].items()
        out = {key: part.replace("/joint_states/", topic) if isinstance(part, str) else part for key, part in parts}
        for key, value in data.items():
            before, now = ({"column": part} if key in QUANTITIES and isinstance(part, str) else part
                           for part in (out.get(key), value))  # fmt: skip
            out[key] = before | now if isinstance(before, dict) and isinstance(now, dict) else value
        return out


def log_format(form: LogForm, names: tuple[str, ...]) -> LogFormat:
    """With units filled in: velocity follows position, prismatic joints default to metres."""
    forms = {key: getattr(form, key) for key in QUANTITIES}
    fields: dict[str, Any] = {key: item and item.column for key, item in forms.items()}
    conversions = {key: item.conversions(len(names)) for key, item in forms.items() if item}
    words = cast(dict[str, str], form.units)
    position = words.get("position", "rad")
    velocity = words.get("velocity", f"{position}/s")
    sliding = words.get("prismatic_position", position if position in ("m", "mm") else "m")
    fields["units"] = {
        "time": "s",
        **({"current": "Nm" if form.effort == "torque" else "A"} if form.effort else {}),
        "temperature": "degC",
        "position": position,
        "velocity": velocity,
        "prismatic_position": sliding,
        "prismatic_velocity": velocity if velocity in ("m/s", "mm/s") else f"{sliding}/s",
        **words,
    }
    changed = {key: values for key, values in conversions.items() if {*values} != {Conversion()}}
    time, fraction = (*form.time, "")[:2]
    fields |= {"signs": form.signs, "names": names, "fraction": fraction, "delay": form.delay}
    return LogFormat(time, **fields, conversions=changed)


def preset_formats(robot: Robot) -> dict[str, LogFormat]:
    """What the presets make of a robot's logs."""
    joints = [{"name": joint.name, "type": joint.kind} for joint in robot.joints]
    names = robot.log.names or tuple(joint.name for joint in robot.joints)
    out = dict[str, LogFormat]()
    for name in presets():
        with suppress(ValidationError):  # units of joints that turn, where all slide
            out[name] = log_format(LogForm.model_validate({"preset": name}, context=ArmForm({"joints": joints})), names)
    return out
