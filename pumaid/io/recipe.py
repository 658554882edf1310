"""Recipes: YAML files that state an arm; found, checked as a whole, turned into SI; texts to start from."""

import hashlib
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pumaid.errors import RecipeError, Where, nearest
from pumaid.io.forms import MAX_BYTES, file_name, parsed_yaml, read_bytes, validated
from pumaid.io.recipe_schema import ArmForm, JointForm, LogForm, RecipeForm, SafetyForm, coupled, faults_between
from pumaid.kinematics import placement, turn_of_z
from pumaid.maths import Floats
from pumaid.robot import Box, EffectChoice, Joint, LogFormat, Point, Robot, Safety, Sphere

#: The recipe's name in an experiment's folder.
RECIPE_NAME = "recipe.yaml"


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
    data, where = document.data, Where(file=name, line=document.line_of(()))
    if isinstance(data.get("kind"), str):
        what = f"this is a {data['kind']} file, not a recipe"
        raise RecipeError("recipe-bad-value", what, where, "give the robot's recipe")
    arm = ArmForm.of(data)
    between = partial(faults_between, names=arm.names)
    form = validated(RecipeForm, document, name, kind=RecipeError, context=arm, between=between)
    joints, turns = _joints(form.joints, arm.names)
    return Robot(
        form.name,
        joints,
        form.gravity,
        _log_format(form.log, joints),
        tuple(EffectChoice(choice.effect, choice.joint, choice.shape) for choice in form.effects),
        Path(name).name,
        hashlib.sha256(content).hexdigest(),
        effect_lines=tuple(document.line_of(("effects", index)) for index in range(len(form.effects))),
        coupling={pair: ratio for key, ratio in form.coupling.items() if (pair := coupled(key)) is not None},
        safety=_safety(form.safety, turns),
    )


def _joints(forms: Sequence[JointForm], names: Sequence[str]) -> tuple[tuple[Joint, ...], list[Floats]]:
    """The joints, and by link, the base first, the (4, 4) frame about whose z it moves in the one that is stated."""
    joints, turns = [], [np.eye(4)]
    for number, (form, name) in enumerate(zip(forms, names, strict=True), start=1):
        constants = form.model_dump(exclude={"type", "name", "placement"}, exclude_none=True)
        turn = np.eye(4)
        if form.placement is not None:
            turn[:3, :3] = turn_of_z(form.placement.axis)
            frame = turns[-1].T @ placement(form.placement.xyz, form.placement.rpy) @ turn
            constants["placement"] = tuple(map(tuple, frame.tolist()))
        turns.append(turn)
        joints.append(Joint(number, name, form.type, **constants))
    return tuple(joints), turns


def _log_format(form: LogForm, joints: tuple[Joint, ...]) -> LogFormat:
    """With units filled in: velocity follows position, prismatic joints default to metres."""
    position = form.units.position or "rad"
    velocity = form.units.velocity or f"{position}/s"
    sliding = form.units.prismatic_position or (position if position in ("m", "mm") else "m")
    units = {
        "position": position,
        "velocity": velocity,
        "prismatic_position": sliding,
        "prismatic_velocity": velocity if velocity in ("m/s", "mm/s") else f"{sliding}/s",
    }
    return LogFormat(
        **form.model_dump(exclude={"units", "signs"}),
        units=units | form.units.model_dump(exclude_none=True),
        signs=form.signs.model_dump(exclude_none=True),
        names=tuple(joint.name for joint in joints),
    )


def _safety(form: SafetyForm, turns: Sequence[Floats]) -> Safety | None:
    """Places in the links' frames are turned into frames about whose z the links move."""
    if form == SafetyForm():
        return None

    def placed(link: int, point: Point) -> Point:
        x, y, z = (turns[link][:3, :3].T @ point).tolist()
        return x, y, z

    return Safety(
        tuple(Box(box.name or f"box {k}", box.min, box.max) for k, box in enumerate(form.boxes, start=1)),
        tuple(Sphere(ball.link, placed(ball.link, ball.centre), ball.radius) for ball in form.spheres),
        None if form.tool is None else placed(len(turns) - 1, form.tool),
        form.margin,
        tuple((min(pair), max(pair)) for pair in form.ignore),
    )


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
    named = [path for place in searched for path in sorted(place.parent.glob("*recipe*.y*ml"))]
    hint = f"name it with --recipe {named[0]}" if named else "write one with: pumaid init puma560 -o recipe.yaml"
    what = f"no {RECIPE_NAME} found; searched {', '.join(map(str, searched))}"
    raise RecipeError("recipe-not-found", what, Where(), f"{hint}, or name one with --recipe FILE")


def _given(given: Path) -> Path:
    shipped = shipped_recipes()
    if given.is_dir() and (given / RECIPE_NAME).is_file():
        return given / RECIPE_NAME
    if str(given) == "-" or (given.exists() and not given.is_dir()):
        return given
    if str(given) in shipped:
        return shipped[str(given)]
    near = nearest(given.name.removesuffix(".yaml"), shipped) if given.parent == Path() else None
    mend = f"did you mean the shipped recipe {near}?" if near else "pumaid init --list names shipped recipes"
    raise RecipeError("recipe-not-found", f"no recipe is at {given}", Where(file=str(given)), mend)


def _folder_of(log: Path) -> Path:
    """The folder that a file, a folder or a glob stands for."""
    place = log
    while any(letter in str(place) for letter in "*?["):
        place = place.parent
    return place if place != log or log.is_dir() else log.parent


def shipped_recipes() -> dict[str, Path]:
    """The recipes that come with pumaid, by name: the installed package's, or the checkout's."""
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "recipes", package.parent / "recipes"):
        recipes = sorted(folder.glob("*.yaml"))
        if recipes:
            return {path.stem: path for path in recipes}
    return {}


def started_from(name: str) -> str:
    """The text of the shipped recipe `name` with remarks on what to change; KeyError where there is none."""
    text = shipped_recipes()[name].read_text(encoding="utf-8")
    joints = [""] * text.count("{name:")
    return recipe_text(f"pumaid init {name}", body=text.rstrip(), joints=joints, has_log="log:" in text)


def blank(n_joints: int) -> str:
    """The text of a recipe for an arm of `n_joints` revolute joints with made-up twists, to be filled in."""
    joints = [
        f"{{name: joint{n}, type: revolute, theta: 0, alpha: {0 if n == 1 else -90 * (-1) ** n}, a: 0.0, d: 0.0,"
        " limits: [-180, 180], max_velocity: 90}"
        for n in range(1, n_joints + 1)
    ]
    return recipe_text(f"pumaid init blank --joints {n_joints}", joints=joints)


def recipe_text(origin: str, *, joints: Sequence[str], **parts: Any) -> str:
    """A recipe's text with remarks that tell what else it may hold.

    `origin` is what it was started from, one line; `parts` fill the template ``recipe.yaml.txt``.
    """
    import jinja2

    loader = jinja2.PackageLoader("pumaid.io")
    environment = jinja2.Environment(
        loader=loader, autoescape=False, trim_blocks=True, lstrip_blocks=True
    )  # plain text
    ones = ", ".join(["1"] * len(joints))
    return environment.get_template("recipe.yaml.txt").render(origin=origin, joints=joints, ones=ones, **parts)
