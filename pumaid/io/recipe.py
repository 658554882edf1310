"""Recipes: YAML files that state an arm; found, checked as a whole, turned into SI."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

from pumaid.errors import RecipeError, Where
from pumaid.io.forms import Wording, refuse, shown, validated
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
from pumaid.io.yaml_file import file_name, nearest, read_yaml
from pumaid.robot import Box, EffectChoice, Joint, LogFormat, Point, Robot, Safety, Sphere
from pumaid.units import factor

#: The recipe's name in an experiment's folder.
RECIPE_NAME = "recipe.yaml"
WORDING = Wording(RecipeError, EXAMPLES)


def read_recipe(path: Path) -> Robot:
    """Read a robot from its recipe.

    Parameters
    ----------
    path
        A YAML file as ``docs/recipes.md`` describes it; ``-`` is standard input.

    Returns
    -------
    robot
        The arm in SI, with `origin` the file's name and `digest` the SHA-256 of its bytes.

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
    """Find the recipe that belongs to some logs.

    The first of: `given`; ``recipe.yaml`` in the folder of each of the logs; beside that folder; in the working folder.

    Parameters
    ----------
    given
        What the user named: a file, or the name of a shipped recipe such as ``puma560``; or none.
    logs
        Files, folders or globs as the user gave them; ``-`` (standard input) has no folder.

    Raises
    ------
    RecipeError [recipe-not-found]
        There is none; the message lists the places searched.
    RecipeError [recipe-not-found]
        The logs' folders hold recipes that differ.
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
