"""Recipes: YAML files that state an arm; what they may hold, in SI; where they are found; texts to start from."""

import hashlib
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, Self, cast

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo, model_validator

from pumaid.errors import RecipeError, Where, meant
from pumaid.io.forms import (
    AS_LIST,
    MAX_BYTES,
    AngleUnit,
    ArmForm,
    Fault,
    Finite,
    PayloadForm,
    StrictForm,
    Vector,
    Words,
    arm_of,
    check,
    file_name,
    like,
    parsed_yaml,
    read_bytes,
    refusal,
    validated,
)
from pumaid.io.log_form import LogForm, log_format
from pumaid.maths import Floats
from pumaid.robot import (
    QUANTITIES,
    Box,
    Capsule,
    EffectChoice,
    Joint,
    Point,
    Robot,
    Safety,
    numbered,
    placement,
    turn_of_z,
)
from pumaid.units import factor

#: The recipe's name in an experiment's folder.
RECIPE_NAME = "recipe.yaml"
#: Longest link, m; larger numbers are in millimetres.
LONGEST_LINK = 20.0
#: Gravity, m/s2: 1.6 on the Moon, 25 on Jupiter.
LEAST_GRAVITY, MOST_GRAVITY = 1.5, 30.0
#: rad; limits and speeds beyond this are in degrees where the file does not state its unit.
WIDEST_UNSTATED = 4.0 * math.pi
#: Quarter turns (rad) in a file of degrees are radians, to this rounding.
QUARTERS, ROUNDING = tuple(quarter * math.pi / 2.0 for quarter in (1, 2, 3)), 5e-4
#: Smallest and largest size (SI) of a joint's number, by its key and whether it is of a slide; and what to do.
SIZES = {
    ("limits", False): (0.0, 200.0 * math.pi, "leave limits out for a joint that turns without end"),
    ("limits", True): (0.0, 100.0, "prismatic joints are in m; divide by 1000"),
    ("max_velocity", False): (1e-4, 1e3, "write a number above 0, or leave the key out"),
    ("max_velocity", True): (1e-9, 20.0, "prismatic joints are in m/s; divide by 1000"),
}

_METRES = "it in metres: divide millimetres by 1000"
_ANGLES = "write angles in one unit and state it at the top: units: {angle: deg}, or units: {angle: rad}"
_GEARS = "write r54 where joint 5's motor is turned by joint 4's, and r12_9 where a joint is above 9"


def _in_si(value: float, info: ValidationInfo) -> float:
    """rad, m, rad/s or m/s; angles in another unit than the file's, and limits and speeds of no joint, are refused."""
    key, arm, size = str(info.field_name), arm_of(info), abs(value)
    is_rail = info.data.get("type") == "prismatic" and (key, True) in SIZES
    unit, scale = ("m", 1.0) if is_rail else (arm.unit, factor(arm.unit))
    shown = f"{key} of {value:g} {unit}" + "/s" * (key == "max_velocity")
    is_quarter = unit == "deg" and any(abs(size - quarter) < ROUNDING for quarter in QUARTERS)
    if (is_quarter and key != "max_velocity") or (unit == "rad" and not arm.is_stated and size > WIDEST_UNSTATED):
        raise refusal(f"{shown} looks like {'rad' if is_quarter else 'degrees'}", _ANGLES)
    low, high, mend = SIZES.get((key, is_rail), (0.0, 2.0 * math.pi + ROUNDING, "write it within a turn"))
    if not low <= size * scale <= high:
        raise refusal(f"{shown} is not between {low / scale:g} and {high / scale:g}", mend)
    return value * scale


def is_joint_name(name: str) -> bool:
    """Whether a joint can have this name: a printable word that EFFECT@JOINT does not read as something else."""
    return (
        name.strip() != ""
        and name.isprintable()
        and len(name) <= 200
        and name.lower() != "all"
        and not re.search("[@,]", name)
        and not re.fullmatch(r"[\d.+-]+", name)
    )


def _effect_joint(joint: Any, info: ValidationInfo) -> int | None:
    names = arm_of(info).names
    number = names.index(joint) + 1 if joint in names else joint
    if joint == "all":
        return None
    if isinstance(number, bool) or not isinstance(number, int) or not 1 <= number <= len(names):
        raise refusal(
            f"there is no joint {str(joint)[:60]}",
            f"joints count from 1 to {len(names)}; {meant(joint, [*names, 'all'])}",
        )
    return number


def _coupling(key: str, info: ValidationInfo) -> tuple[int, int]:
    """Joints (driven, driving), from 1, that a key of `coupling` names: (5, 4) for r54, (12, 9) for r12_9."""
    match, n_joints = re.fullmatch(r"r([1-9])([1-9])|r([1-9]\d)_([1-9]\d?)", key), len(arm_of(info).names)
    pair = (int(match[1] or match[3]), int(match[2] or match[4])) if match else (0, 0)
    if not n_joints >= pair[0] > pair[1]:
        raise refusal(
            f"{key[:60]} does not name two of the {n_joints} joints, the driven one and one nearer to the base", _GEARS
        )
    return pair


Angle = Annotated[Finite, AfterValidator(_in_si)]
Length = Annotated[Finite, Field(ge=-LONGEST_LINK, le=LONGEST_LINK)]
GearRatio = Annotated[
    Finite,
    check(lambda ratio, _: 1e-3 <= abs(ratio) <= 1e5, "{} is no gear's ratio", "write motor turns per joint turn"),
]
Radius = Annotated[Finite, Field(gt=0, le=LONGEST_LINK)]
Triple = Annotated[tuple[Length, Length, Length], AS_LIST]
Link = Annotated[
    int,
    Field(strict=True),
    check(lambda link, arm: 0 <= link <= len(arm.names), "there is no link {}", "links count from 0 (the base) to {n}"),
]
JointName = Annotated[
    str, check(lambda name, _: is_joint_name(name), "'{}' cannot name a joint", "use a word, such as shoulder")
]
Direction = Annotated[Vector, check(lambda axis, _: any(axis), "the axis {} has no direction", "write it as [0, 0, 1]")]
Gravity = Annotated[
    Vector,
    check(
        lambda vector, _: LEAST_GRAVITY <= math.hypot(*vector) <= MOST_GRAVITY,
        "{} is no planet's gravity in m/s2",
        "upright it is [0, 0, -9.80665]",
    ),
]
Limits = Annotated[
    tuple[Angle, Angle],
    check(lambda pair, _: pair[0] < pair[1], "the limits are not [lowest, highest]", "write the lower one first"),
]


class PlacementForm(StrictForm):
    """The block `placement` of a joint: `origin` and `axis` of a URDF."""

    xyz: Triple = like("[x, y, z]   (m, not mm, in the frame before)")
    rpy: Annotated[tuple[Angle, Angle, Angle], AS_LIST] = like("[roll, pitch, yaw]", default=(0, 0, 0))
    axis: Direction = like("[0, 0, 1]", default=(0, 0, 1))


class JointForm(StrictForm):
    """One entry of `joints`."""

    type: Literal["revolute", "prismatic"] = like("revolute   (or prismatic)")
    placement: PlacementForm | None = like("{xyz: [0, 0, 0.1], rpy: [0, 0, 0], axis: [0, 0, 1]}", default=None)
    alpha: Angle | None = None
    a: Length | None = like(_METRES, default=None)
    d: Length | None = like(_METRES, default=None)
    theta: Angle | None = None
    name: JointName | None = None
    limits: Limits | None = like("[lowest, highest]", default=None, strict=False)
    max_velocity: Annotated[Angle, Field(gt=0)] | None = None
    gear_ratio: GearRatio | None = None
    log_name: Words | None = None

    @model_validator(mode="after")
    def _is_placed_once(self) -> Self:
        constants = ("alpha", "a", "d", "theta")
        stated = {key for key in constants if getattr(self, key) is not None}
        needed = {*constants} - {"theta" if self.type == "revolute" else "d"}
        if stated if self.placement is not None else needed - stated:
            mend = " and ".join(f"{key}: 0" for key in constants if key in needed - stated)
            raise refusal(
                f"a joint needs {', '.join(sorted(needed))}, or a placement and none of these",
                f"add {mend} if it is zero, or place the joint with placement alone: {{xyz: ..., rpy: ..., axis: ...}}",
            )
        return self


class EffectForm(StrictForm):
    """One entry of `effects`."""

    effect: Words = like("NAME in {effect: NAME, joint: 3}; pumaid effects lists the names")
    joint: Annotated[Any, BeforeValidator(_effect_joint)] = None
    shape: Annotated[
        dict[str, Finite],
        BeforeValidator(lambda x: {key: numbered(key, y) for key, y in x.items()} if isinstance(x, dict) else x),
    ] = like("{velocity: 0.1}", default={})


class BoxForm(StrictForm):
    """One entry of `safety.boxes`."""

    name: Words | None = None
    min: Triple = like("[x, y, z]   (the lowest corner, m, not mm, in base axes)")
    max: Triple = like("[x, y, z]   (the highest corner, m, not mm, in base axes)")


Inside = check(
    lambda box, _: all(low < high for low, high in zip(box.min, box.max, strict=True)),
    "the box has no inside: {}",
    "write the lower corner as min and the upper as max",
)


class CapsuleForm(StrictForm):
    """One entry of `safety.capsules`."""

    link: Link = like("the link that carries the capsule; 0 is the base")
    start: Triple = like("[x, y, z]   (m, not mm, in the link's frame)")
    end: Triple = like("[x, y, z]   (m, not mm, in the link's frame)")
    radius: Radius = like(_METRES)


class SafetyForm(StrictForm):
    """The block `safety`."""

    floor: Length | None = like("0   (m above the base's origin; null where there is none)", default=None)
    links: dict[Link, Radius] = like("{0: 0.1, 1: 0.08, 2: 0.06}, radius in m by link", default={})
    capsules: list[CapsuleForm] = like(
        "[{link: 2, start: [0, 0, 0], end: [0.4, 0, 0], radius: 0.06}]", default=[], max_length=200
    )
    tool: Triple | None = like("[x, y, z]   (m, not mm, in the last link's frame)", default=None)
    boxes: list[Annotated[BoxForm, Inside]] = like(
        "[{name: table, min: [-1, -1, -1], max: [1, 1, 0]}]", default=[], max_length=100
    )
    margin: Annotated[Finite, Field(ge=0, le=1)] = 0.02
    ignore: list[Annotated[tuple[Link, Link], AS_LIST]] = like("[[4, 6]], pairs of links", default=[])


class RecipeForm(StrictForm):
    """The whole file."""

    name: Words = like("a name, such as my arm")
    gravity: Gravity = like("[0, 0, -9.80665]   (m/s2 in base axes; this is upright)")
    joints: list[JointForm] = like(
        "1 to 50 lines such as - {type: revolute, alpha: 0, a: 0, d: 0}, base to tip", min_length=1, max_length=50
    )
    units: dict[Literal["angle"], AngleUnit] = like("{angle: deg}", default={})
    convention: Literal["modified", "standard"] = "modified"
    log: LogForm = like("its keys below it, indented", default=LogForm())
    effects: list[EffectForm] = like("[{effect: NAME, joint: 3}]", default=[])
    safety: SafetyForm = like(
        "its keys below it, indented: floor, links, capsules, tool, boxes, margin", default=SafetyForm()
    )
    coupling: dict[Annotated[str, AfterValidator(_coupling)], Finite] = Field({})
    files: dict[str, dict[Literal["payload"], PayloadForm]] = like(
        "{tool_*.csv: {payload: {mass: 0.5, at: [0.1, 0, 0]}}}", default={}
    )
    source: Any = ""
    notes: Any = ""
    licence: Any = ""


def faults_between(form: RecipeForm, names: tuple[str, ...]) -> Iterator[Fault]:
    """Faults that show only when two values are seen together; `names` are the joints'."""
    lower, pairs = [name.lower() for name in names], cast(Iterable[tuple[int, int]], form.coupling)
    yield from (
        (
            ("joints", index),
            f"joints {lower.index(name) + 1} and {index + 1} have the same name",
            "give each its own name",
        )
        for index, name in enumerate(lower)
        if name in lower[:index]
    )
    yield from (
        (
            ("joints", number - 1, "gear_ratio"),
            f"joint {number} takes part in coupling, and has no gear ratio",
            "add gear_ratio: motor turns per joint turn",
        )
        for number in sorted({number for pair in pairs for number in pair})
        if form.joints[number - 1].gear_ratio is None
    )
    is_standard = form.convention == "standard"
    rows = form.joints if is_standard else form.joints[::-1]  # in a table of the other kind the first may be zero
    bends = [abs(math.sin(joint.alpha or 0.0)) > ROUNDING for joint in rows]
    if {joint.type for joint in rows[:2]} == {"revolute"} and rows[0].a == 0.0 and bends[-1] > bends[0]:
        first, kind = (1, "modified") if is_standard else (len(rows) - 1, "standard")
        yield (
            ("joints", first - is_standard, "alpha"),
            f"joints {first} and {first + 1} turn about one line, since alpha and a between them are 0",
            f"if the joints are a {kind} Denavit-Hartenberg table write convention: {kind}",
        )
    if is_standard and any(joint.placement for joint in form.joints):
        yield ("convention",), "a joint with a placement is in no standard table", "place all joints in one way"
    log, taken = form.log, {*form.log.time}
    if len(taken) < len(log.time):
        yield ("log", "time"), f"time takes column {log.time[0]} twice", "write one column, or [seconds, fraction]"
    for key in QUANTITIES:
        template = getattr(getattr(log, key), "column", "")
        columns = {template.format(joint=k + 1, joint0=k, name=name) for k, name in enumerate(names) if template}
        if columns & taken:
            yield (
                ("log", key),
                f"{key} takes column {min(columns & taken)}, which another quantity has already",
                "give each quantity its own columns",
            )
        taken |= columns


def read_recipe(path: Path) -> Robot:
    """Read a robot from its recipe, a YAML file as ``docs/recipes.md`` describes it; ``-`` is standard input.

    The robot is in SI; its `origin` is the file's name, its `digest` the SHA-256 of its bytes.

    Raises
    ------
    RecipeError, or Faults of several
        Every fault of the file, each with line and path (``joints[3].alpha``).
    """
    return parsed_recipe(read_bytes(Path(path), kind=RecipeError, most=MAX_BYTES), file_name(path))


def parsed_recipe(content: bytes, name: str) -> Robot:
    """The robot of a recipe with this content; `name` is that of the file, for messages."""
    document = parsed_yaml(content, name)
    if isinstance(document.data.get("kind"), str):
        raise RecipeError(
            "recipe-wrong",
            f"this is a {document.data['kind']} file, not a recipe",
            Where(file=name),
            "give the robot's recipe",
        )
    arm = ArmForm(document.data)
    form = validated(
        RecipeForm,
        document,
        "recipe-wrong",
        context=arm,
        between=partial(faults_between, names=arm.names),
        once=_ANGLES,
    )
    joints, turns = _joints(form, arm.names)
    robot = Robot(
        form.name,
        joints,
        form.gravity,
        log_format(form.log, tuple(joint.log_name or name for joint, name in zip(form.joints, arm.names, strict=True))),
        tuple(EffectChoice(choice.effect, choice.joint, choice.shape) for choice in form.effects),
        Path(name).name,
        hashlib.sha256(content).hexdigest(),
        effect_lines=tuple(document.line_of(("effects", index)) for index in range(len(form.effects))),
        coupling=cast(dict[tuple[int, int], float], form.coupling),
        safety=_safety(form.safety, turns),
        tip=tuple(map(tuple, turns[-1].tolist())),
    )
    loads = {name: (load.mass, *load.at) for name, file in form.files.items() for load in file.values()}
    return replace(robot, payloads={name: robot.carried(load) for name, load in loads.items()})


def _joints(arm: RecipeForm, names: Sequence[str]) -> tuple[tuple[Joint, ...], list[Floats]]:
    """The joints, and by link, the base first, the (4, 4) frame about whose z it moves in the one that is stated."""
    joints, turns, before = [], [np.eye(4)], {"alpha": 0.0, "a": 0.0}
    for number, (form, name) in enumerate(zip(arm.joints, names, strict=True), start=1):
        constants = form.model_dump(exclude={"type", "name", "placement", "log_name"}, exclude_none=True)
        turn = np.eye(4)
        if arm.convention == "standard":  # a row's alpha and a lead from the line about which its joint moves
            to_next = {key: constants[key] for key in before}
            turn[:] = np.linalg.inv(Joint(number, name, form.type, **to_next).frame)
            constants, before = constants | before, to_next
        if form.placement is not None:
            turn[:3, :3] = turn_of_z(form.placement.axis)
            frame = turns[-1].T @ placement(form.placement.xyz, form.placement.rpy) @ turn
            constants["placement"] = tuple(map(tuple, frame.tolist()))
        turns.append(turn)
        joints.append(Joint(number, name, form.type, **constants))
    return tuple(joints), turns


def _safety(form: SafetyForm, turns: Sequence[Floats]) -> Safety | None:
    """Places in the links' frames are turned into frames about whose z the links move."""
    if not form.model_fields_set:
        return None
    return Safety(
        tuple(Box(box.name or f"box {k}", box.min, box.max) for k, box in enumerate(form.boxes, start=1)),
        _placed(form.tool or (0.0, 0.0, 0.0), turns[-1]) if form.tool or turns[-1][:3, 3].any() else None,
        form.margin,
        tuple((min(pair), max(pair)) for pair in form.ignore),
        form.floor,
        tuple(sorted(form.links.items())),
        tuple(
            Capsule(c.link, _placed(c.start, turns[c.link]), _placed(c.end, turns[c.link]), c.radius)
            for c in form.capsules
        ),
    )


def _placed(point: Point, turn: Floats) -> Point:
    """A point (m) of a stated frame in the one about whose z the link moves, which is `turn` in the stated one."""
    x, y, z, _ = (np.linalg.inv(turn) @ (*point, 1.0)).tolist()
    return x, y, z


def find_recipe(given: Path | None, logs: Sequence[Path] = ()) -> Path:
    """Find the recipe that belongs to some logs (files, folders or globs as the user gave them).

    The first of: `given` (a file, or the name of a shipped recipe such as ``puma560``); ``recipe.yaml`` in the folder
    of each of the logs; beside that folder; in the working folder. Standard input (``-``) has no folder.

    Raises
    ------
    RecipeError [recipe-not-found]
        There is none (the message lists the places searched), or the logs' folders hold recipes that differ.
    """
    if given is not None:
        return _given(given)
    folders = list(dict.fromkeys(_folder_of(Path(log)) for log in logs if str(log) != "-"))
    above = [folder / ".." if str(folder) == "." else folder.parent for folder in folders]
    tiers = [dict.fromkeys(place / RECIPE_NAME for place in places) for places in (folders, above, [Path()])]
    for candidates in tiers:
        recipes = [candidate for candidate in candidates if candidate.is_file()]
        if len({recipe.read_bytes() for recipe in recipes}) > 1:
            what = f"the logs' folders hold different recipes: {', '.join(map(str, recipes))}"
            raise RecipeError(
                "recipe-not-found", what, Where(), "say which with --recipe FILE, or run the logs of each robot apart"
            )
        if recipes:
            return recipes[0]
    searched = dict.fromkeys(candidate for candidates in tiers for candidate in candidates)
    what = f"no {RECIPE_NAME} found; searched {', '.join(map(str, searched))}"
    named = [str(path) for place in searched for path in sorted(place.parent.glob("*recipe*.y*ml"))]
    raise RecipeError(
        "recipe-not-found",
        what,
        Where(),
        f"name one, as --recipe {(*named, 'ur5e')[0]} (pumaid init --list has all), or write one: pumaid init asks, or"
        " pumaid init --urdf arm.urdf",
    )


def _given(given: Path) -> Path:
    shipped = shipped_recipes()
    place = given / RECIPE_NAME if given.is_dir() else given
    if str(given) == "-" or place.exists():
        return place
    if str(given) in shipped:
        return shipped[str(given)]
    raise RecipeError(
        "recipe-not-found",
        f"no recipe is at {given}",
        Where(file=str(given)),
        f"{meant(given.stem, list(shipped))} (pumaid init --list)",
    )


def _folder_of(log: Path) -> Path:
    place = next(path for path in (log, *log.parents) if not re.search(r"[*?\[]", str(path)))
    return place if place != log or log.is_dir() else log.parent


def shipped_recipes() -> dict[str, Path]:
    """The recipes that come with pumaid, by name: the installed package's, or the checkout's."""
    folder = Path(__file__).resolve().parents[1] / "recipes"
    if not folder.is_dir():
        folder = folder.parents[1] / "recipes"
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def started_from(name: str) -> str:
    """The text of the shipped recipe `name` with remarks on what to change; KeyError where there is none."""
    text = shipped_recipes()[name].read_text(encoding="utf-8")
    has = {f"has_{block}": f"{block}:" in text for block in ("log", "safety")}
    return recipe_text(f"pumaid init {name}", body=text.rstrip(), joints=[""] * text.count("{name:"), **has)


def blank(n_joints: int) -> str:
    """The text of a recipe for an arm of `n_joints` revolute joints with made-up twists, to be filled in."""
    return recipe_text(
        f"pumaid init blank --joints {n_joints}",
        joints=[
            f"{{name: joint{n}, type: revolute, theta: 0, alpha: {0 if n == 1 else -90 * (-1) ** n}, a: 0.0, d: 0.0,"
            " limits: [-180, 180], max_velocity: 90}"
            for n in range(1, n_joints + 1)
        ],
    )


def recipe_text(origin: str, *, joints: Sequence[str], **parts: Any) -> str:
    """A recipe's text with remarks that tell what else it may hold.

    `origin` is what it was started from, one line; `parts` fill the template ``recipe.yaml.txt``.
    """
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("pumaid.io"),
        autoescape=False,  # plain text
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("recipe.yaml.txt").render(
        origin=origin, joints=joints, ones=", ".join(["1"] * len(joints)), **parts
    )
