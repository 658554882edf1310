"""Recipes: YAML files that state an arm; found, checked as a whole, turned into SI; texts to start from."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Sequence
from pathlib import Path

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedSeq

from pumaid.errors import RecipeError, Where
from pumaid.io.forms import Wording, file_name, nearest, read_yaml, refuse, shown, validated
from pumaid.io.recipe_schema import (
    EXAMPLES,
    ArmForm,
    JointForm,
    LogForm,
    RecipeForm,
    SafetyForm,
    coupled,
    faults_between,
)
from pumaid.robot import Box, EffectChoice, Joint, LogFormat, Point, Robot, Safety, Sphere
from pumaid.units import factor

#: The recipe's name in an experiment's folder.
RECIPE_NAME = "recipe.yaml"
WORDING = Wording(RecipeError, EXAMPLES)

_HEAD = """\
# A recipe for pumaid: how the joints of one arm stand to one another, and how its logs are written.
# Started from: {origin}
# Every key is explained in docs/recipes.md; what follows a # is a remark.
# Before you plan motions for a real arm, put its own limits and speeds here, and its gravity where it does not stand
# upright.

"""

_LOG = """
# How the logs are written. These values hold where a line is left out; take away the # of the lines you change.
# {{joint}} counts from 1, {{joint0}} from 0, {{name}} is the joint's name; velocity and temperature may be absent.
# log:
#   time: t
#   position: "q{{joint}}"
#   velocity: "qd{{joint}}"
#   current: "i{{joint}}"
#   temperature: "temp{{joint}}"
#   units: {{time: s, position: rad, velocity: rad/s, current: A}}    # or ms, deg, deg/s, mA ...
#   signs:                                 # -1 where the log counts the other way than this recipe
#     position: [{ones}]
#     current: [{ones}]
"""

_EFFECTS = """
# Physics beyond the paper's model (gravity, Coulomb and viscous friction); pumaid effects lists the names.
# effects:
#   - {effect: NAME, joint: 3}    # a joint's number from 1, its name, or all
"""

_SAFETY = """
# What the arm must not touch when it runs a plan (docs/planning.md); without it only limits and speeds are kept.
# safety:
#   tool: [0, 0, 0.1]    # the tip in the last link's frame, m
#   boxes: [{name: table, min: [-1, -1, -1], max: [1, 1, -0.1]}]    # in axes of the base, m
#   spheres: [{link: 3, centre: [0, 0, 0], radius: 0.08}]    # in the frame of the link, m; link 0 is the base
"""

_BLANK = """\
name: my arm
gravity: [0.0, 0.0, -9.80665]    # m/s2 in axes of the base; this is an arm that stands upright
units: {angle: deg}              # unit of the angles in this file: deg or rad
source: where the numbers below are from

# One line a joint, base to tip, in modified Denavit-Hartenberg parameters (Craig): alpha and a lead from the joint
# before to this one, d and theta belong to this one. From a standard table take alpha and a of the row above.
#   type          revolute or prismatic
#   theta, alpha  angles; theta of a revolute joint is added to the measured position
#   a, d          m; d of a prismatic joint is added to the measured position
#   limits        [lowest, highest] measured position, m for a prismatic joint; may be absent
#   max_velocity  a second, m/s for a prismatic joint; may be absent
#   gear_ratio    motor turns per joint turn; may be absent
joints:
"""
_BLANK_JOINT = (
    "  - {{name: joint{number}, type: revolute, theta: 0, alpha: {alpha}, a: 0.0, d: 0.0, "
    "limits: [-180, 180], max_velocity: 90}}\n"
)


def read_recipe(path: Path) -> Robot:
    """Read a robot from its recipe, a YAML file as ``docs/recipes.md`` describes it; ``-`` is standard input.

    The robot is in SI; its `origin` is the file's name, its `digest` the SHA-256 of its bytes.

    Raises
    ------
    RecipeError, or Faults of several
        Every fault of the file, each with line and path (``joints[3].alpha``).
    """
    document = read_yaml(Path(path))
    name, data = file_name(path), document.data
    where = Where(file=name, line=document.line_of(()))
    if not isinstance(data, dict):
        mend = "start from: pumaid init puma560 -o recipe.yaml"
        raise RecipeError("recipe-bad-value", f"the file holds {shown(data)}, not keys and values", where, mend)
    if isinstance(data.get("kind"), str):
        what = f"this is a {data['kind']} file, not a recipe"
        raise RecipeError("recipe-bad-value", what, where, "give the robot's recipe")
    arm = ArmForm.of(data)
    form, faults = validated(RecipeForm, data, wording=WORDING, context=arm)
    if form is not None:
        faults = list(faults_between(form, arm.names))
    if faults or document.doubled or form is None:
        degrees = [fault for fault in faults if fault.slug == "recipe-angle-unit"]
        refuse(name, document, [fault for fault in faults if fault not in degrees[1:]], wording=WORDING)
    lines = tuple(document.line_of(("effects", index)) for index in range(len(form.effects)))
    x, y, z = form.gravity
    joints = tuple(_joint(number, joint, factor(arm.unit)) for number, joint in enumerate(form.joints, start=1))
    return Robot(
        form.name,
        joints,
        (x, y, z),
        _log_format(form.log, joints),
        tuple(EffectChoice(choice.effect, choice.joint, choice.shape) for choice in form.effects),
        Path(path).name,
        hashlib.sha256(document.content).hexdigest(),
        effect_lines=lines,
        coupling={pair: ratio for key, ratio in form.coupling.items() if (pair := coupled(key)) is not None},
        safety=_safety(form.safety),
    )


def _joint(number: int, form: JointForm, to_rad: float) -> Joint:
    scale = to_rad if form.type == "revolute" else 1.0
    return Joint(
        number=number,
        name=form.name or f"joint{number}",
        kind=form.type,
        theta=(form.theta or 0.0) * to_rad,
        alpha=form.alpha * to_rad,
        a=form.a,
        d=form.d or 0.0,
        limits=None if form.limits is None else (form.limits[0] * scale, form.limits[1] * scale),
        max_velocity=None if form.max_velocity is None else form.max_velocity * scale,
        gear_ratio=form.gear_ratio,
    )


def _log_format(form: LogForm, joints: tuple[Joint, ...]) -> LogFormat:
    """With units filled in: velocity follows position, prismatic joints default to metres."""
    units = form.units
    position, prismatic = units.position or "rad", units.prismatic_position or "m"
    is_rail = not any(joint.is_revolute for joint in joints)
    if is_rail and units.position is not None:
        prismatic = position
    per_second = {unit: f"{unit}/s" for unit in ("rad", "deg", "m", "mm")}
    prismatic_velocity = units.prismatic_velocity or per_second[prismatic]
    if is_rail and units.velocity is not None:
        prismatic_velocity = units.velocity
    words = {
        "time": units.time,
        "position": position,
        "velocity": units.velocity or per_second.get(position, "rad/s"),
        "prismatic_position": prismatic,
        "prismatic_velocity": prismatic_velocity,
        "current": units.current,
        "temperature": units.temperature,
    }
    stated = {"position": form.signs.position, "current": form.signs.current}
    signs = {key: tuple(map(round, values)) for key, values in stated.items() if values is not None}
    names = tuple(joint.name for joint in joints)
    return LogFormat(form.time, form.position, form.velocity, form.current, form.temperature, words, signs, names)


def _safety(form: SafetyForm | None) -> Safety | None:
    """Lengths are in m whatever the file's unit of angles."""
    if form is None:
        return None
    boxes = tuple(
        Box(box.name or f"box {number}", _point(box.min), _point(box.max))
        for number, box in enumerate(form.boxes, start=1)
    )
    spheres = tuple(Sphere(sphere.link, _point(sphere.centre), sphere.radius) for sphere in form.spheres)
    tool = None if form.tool is None else _point(form.tool)
    return Safety(boxes, spheres, tool, form.margin, tuple((min(pair), max(pair)) for pair in form.ignore))


def _point(values: list[float]) -> Point:
    x, y, z = map(float, values)
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
    searched: list[Path] = []
    for places in (folders, above, [Path()]):
        candidates = [place / RECIPE_NAME for place in dict.fromkeys(places)]
        searched += [candidate for candidate in candidates if candidate not in searched]
        recipes = [candidate for candidate in candidates if candidate.is_file()]
        if len({recipe.read_bytes() for recipe in recipes}) > 1:
            what = f"the logs' folders hold different recipes: {', '.join(map(str, recipes))}"
            mend = "say which with --recipe FILE, or run the logs of each robot apart"
            raise RecipeError("recipe-not-found", what, Where(), mend)
        if recipes:
            return recipes[0]
    named = [
        path for place in searched for path in sorted(place.parent.glob("*.y*ml")) if "recipe" in path.name.lower()
    ]
    hint = f"name it with --recipe {named[0]}" if named else "write one with: pumaid init puma560 -o recipe.yaml"
    what = f"no {RECIPE_NAME} found; searched {', '.join(map(str, searched))}"
    raise RecipeError("recipe-not-found", what, Where(), f"{hint}, or name one with --recipe FILE")


def _given(given: Path) -> Path:
    if str(given) == "-" or (given.exists() and not given.is_dir()):
        return given
    if given.is_dir() and (given / RECIPE_NAME).is_file():
        return given / RECIPE_NAME
    shipped = shipped_recipes()
    if str(given) in shipped:
        return shipped[str(given)]
    near = nearest(given.name.removesuffix(".yaml"), shipped) if given.parent == Path() else None
    mend = "check the path; pumaid init --list names shipped recipes"
    mend = f"did you mean the shipped recipe {near}?" if near else mend
    reason = f"{given} is a folder without {RECIPE_NAME}" if given.is_dir() else f"there is no file {given}"
    raise RecipeError("recipe-not-found", reason, Where(file=str(given)), mend)


def _folder_of(log: Path) -> Path:
    """The folder that a file, a folder or a glob stands for."""
    while any(letter in log.name for letter in "*?["):
        log = log.parent
        if not any(letter in log.name for letter in "*?["):
            return log
    return log if log.is_dir() else log.parent


def shipped_recipes() -> dict[str, Path]:
    """The recipes that come with pumaid, by name: the installed package's, or the checkout's."""
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "recipes", package.parent / "recipes"):
        recipes = sorted(folder.glob("*.yaml"))
        if recipes:
            return {path.stem: path for path in recipes}
    return {}


def started_from(name: str) -> str:
    """The text of the shipped recipe `name` with remarks on what to change.

    Raises
    ------
    KeyError
        No recipe of that name is shipped.
    """
    text = shipped_recipes()[name].read_text(encoding="utf-8")
    ones = ", ".join(["1"] * text.count("{name:"))
    log = "" if "log:" in text else _LOG.format(ones=ones)
    return _HEAD.format(origin=f"pumaid init {name}") + text.rstrip() + "\n" + log + _EFFECTS + _SAFETY


def blank(n_joints: int) -> str:
    """The text of a recipe for an arm of `n_joints` revolute joints with made-up twists, to be filled in."""
    lines = [_BLANK_JOINT.format(number=n, alpha=0 if n == 1 else -90 * (-1) ** n) for n in range(1, n_joints + 1)]
    return remarked(_BLANK + "".join(lines), n_joints, origin=f"pumaid init blank --joints {n_joints}")


def remarked(body: str, n_joints: int, *, origin: str) -> str:
    """A recipe's text (name, gravity and joints) with the remarks above and below that tell what else it may hold.

    `origin` is what it was started from, one line.
    """
    log = _LOG.format(ones=", ".join(["1"] * n_joints))
    return _HEAD.format(origin=origin) + body + log + _EFFECTS + _SAFETY


def with_gravity(path: Path, gravity: tuple[float, float, float]) -> str:
    """A recipe's text with its gravity (m/s2, in base axes) replaced; comments and order stay."""
    yaml = YAML(typ="rt")
    yaml.preserve_quotes = True
    yaml.width = 4096
    content = yaml.load(path.read_text(encoding="utf-8"))
    values = CommentedSeq(gravity)
    values.fa.set_flow_style()
    content["gravity"] = values
    out = io.StringIO()
    yaml.dump(content, out)
    return out.getvalue()
