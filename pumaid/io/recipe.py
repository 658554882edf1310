"""Recipes: YAML files that state an arm; found, read, checked as a whole, turned into SI."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

from pydantic import ValidationError

from pumaid.errors import Faults, PumaidError, RecipeError, Where
from pumaid.io.coupling import ratios_of
from pumaid.io.recipe_checks import faults_between_values
from pumaid.io.recipe_faults import Fault, dotted, told, translated, without_echoes
from pumaid.io.recipe_schema import JointForm, LogForm, RecipeForm
from pumaid.io.safety import safety_of
from pumaid.io.yaml_lines import Document, nearest, read_yaml
from pumaid.robot import EffectChoice, Joint, LogFormat, Robot
from pumaid.units import factor

#: The recipe's name in an experiment's folder.
RECIPE_NAME = "recipe.yaml"
#: Most faults of one file that are told; the rest is counted.
MOST_FAULTS = 20


def read_recipe(path: Path) -> Robot:
    """Read a robot from its recipe.

    Angles are turned from the file's unit to rad; every fault of the file is found before any is told.

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
    RecipeError
        The file has one fault.
    Faults
        The file has several; each is a `RecipeError` with file, line and path (``joints[3].alpha``).
    """
    document = read_yaml(Path(path))
    name = "standard input" if str(path) == "-" else str(path)
    data = document.root.plain()
    if not isinstance(data, dict):
        mend = "start from: pumaid init puma560 -o recipe.yaml"
        what = f"the file holds {told(data)}, not keys and values"
        raise RecipeError("recipe-wrong-type", what, Where(file=name, line=document.root.line), mend)
    if isinstance(data.get("kind"), str):
        what = f"this is a {data['kind']} file, not a recipe"
        line = document.root.line_of(["kind"])
        raise RecipeError("recipe-wrong-type", what, Where(file=name, line=line), "give the robot's recipe")
    form: RecipeForm | None = None
    found: list[Fault] = []
    try:
        form = RecipeForm.model_validate(data)
    except ValidationError as error:
        found += [translated(dict(entry)) for entry in error.errors(include_url=False)]
    at_fault = {fault.path for fault in found}
    found += [fault for fault in faults_between_values(data) if fault.path not in at_fault]
    found = without_echoes(found)
    if found or document.doubled or form is None:
        _refuse(name, document, found)
    lines = tuple(document.root.line_of(("effects", index)) for index in range(len(form.effects)))
    return replace(_robot(form, Path(path).name, hashlib.sha256(document.content).hexdigest()), effect_lines=lines)


def _refuse(file: str, document: Document, found: list[Fault]) -> NoReturn:
    """Tell every fault, in the order of the file's lines."""
    faults: list[PumaidError] = list(document.doubled)
    for fault in found:
        path = fault.path
        joint = path[1] + 1 if len(path) > 1 and path[0] == "joints" and isinstance(path[1], int) else None
        where = Where(file=file, line=document.root.line_of(path), joint=joint, field=dotted(path))
        faults.append(RecipeError(fault.slug, fault.what, where, fault.mend))
    faults.sort(key=lambda fault: fault.where.line or 0)
    if len(faults) > MOST_FAULTS:
        last = faults[MOST_FAULTS - 1]
        more = f"{last.what} (and {len(faults) - MOST_FAULTS} more faults)"
        faults = [*faults[: MOST_FAULTS - 1], RecipeError(last.slug, more, last.where, last.mend)]
    raise faults[0] if len(faults) == 1 else Faults(faults)


def _robot(form: RecipeForm, origin: str, digest: str) -> Robot:
    """The arm in SI from a form without faults."""
    to_rad = factor(form.units.angle)
    joints = tuple(_joint(number, joint, to_rad) for number, joint in enumerate(form.joints, start=1))
    by_name = {joint.name: joint.number for joint in joints}
    effects = tuple(
        EffectChoice(
            choice.effect, None if choice.joint == "all" else by_name.get(str(choice.joint), choice.joint), choice.shape
        )
        for choice in form.effects
    )
    x, y, z = form.gravity
    log = _log_format(form.log, joints)
    ratios = ratios_of(form.coupling)
    return Robot(
        form.name, joints, (x, y, z), log, effects, origin, digest, coupling=ratios, safety=safety_of(form.safety)
    )


def _joint(number: int, form: JointForm, to_rad: float) -> Joint:
    # pi/2 and the like are rad already; they are refused in a file whose unit is deg.
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
    position = units.position or "rad"
    prismatic = units.prismatic_position or "m"
    if not any(joint.is_revolute for joint in joints) and units.position is not None:
        prismatic = position
    per_second = {unit: f"{unit}/s" for unit in ("rad", "deg", "m", "mm")}
    velocity = units.velocity or per_second.get(position, "rad/s")
    prismatic_velocity = units.prismatic_velocity or per_second[prismatic]
    if not any(joint.is_revolute for joint in joints) and units.velocity is not None:
        prismatic_velocity = units.velocity
    words = {
        "time": units.time,
        "position": position,
        "velocity": velocity,
        "prismatic_position": prismatic,
        "prismatic_velocity": prismatic_velocity,
        "current": units.current,
        "temperature": units.temperature,
    }
    signs = {
        name: tuple(round(sign) for sign in values)
        for name in ("position", "current")
        if (values := getattr(form.signs, name)) is not None
    }
    names = tuple(joint.name for joint in joints)
    return LogFormat(form.time, form.position, form.velocity, form.current, form.temperature, words, signs, names)


def find_recipe(given: Path | None, logs: Sequence[Path] = ()) -> Path:
    """Find the recipe that belongs to some logs.

    The first of: `given`; ``recipe.yaml`` in the folder of each of the logs; beside that folder; in the working folder.

    Parameters
    ----------
    given
        What the user named: a file, or the name of a shipped recipe such as ``puma560``; or none.
    logs
        Files, folders or globs as the user gave them; ``-`` (standard input) has no folder.

    Returns
    -------
    path
        An existing file.

    Raises
    ------
    RecipeError [recipe-not-found]
        There is none; the message lists the places searched.
    RecipeError [recipe-ambiguous]
        The logs' folders hold recipes that differ.
    """
    if given is not None:
        return _given(given)
    folders = list(dict.fromkeys(_folder_of(Path(log)) for log in logs if str(log) != "-"))
    searched: list[Path] = []
    for places in (folders, [folder / ".." if str(folder) == "." else folder.parent for folder in folders], [Path()]):
        candidates = [place / RECIPE_NAME for place in dict.fromkeys(places)]
        searched += [candidate for candidate in candidates if candidate not in searched]
        found = [candidate for candidate in candidates if candidate.is_file()]
        if found:
            return _only_one(found)
    stray = [
        other for path in searched for other in sorted(path.parent.glob("*.y*ml")) if "recipe" in other.name.lower()
    ]
    hint = f"name it with --recipe {stray[0]}" if stray else "write one with: pumaid init puma560 -o recipe.yaml"
    what = f"no {RECIPE_NAME} found; searched {', '.join(str(path) for path in searched)}"
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
    mend = (
        f"did you mean the shipped recipe {near}?"
        if near
        else "check the path; pumaid init --list names shipped recipes"
    )
    reason = f"{given} is a folder without {RECIPE_NAME}" if given.is_dir() else f"there is no file {given}"
    raise RecipeError("recipe-not-found", reason, Where(file=str(given)), mend)


def _folder_of(log: Path) -> Path:
    """The folder that a file, a folder or a glob stands for."""
    while any(letter in log.name for letter in "*?["):
        log = log.parent
        if not any(letter in log.name for letter in "*?["):
            return log
    return log if log.is_dir() else log.parent


def _only_one(found: list[Path]) -> Path:
    contents = {path.read_bytes() for path in found}
    if len(contents) > 1:
        what = f"the logs' folders hold different recipes: {', '.join(str(path) for path in found)}"
        mend = "say which with --recipe FILE, or run the logs of each robot apart"
        raise RecipeError("recipe-ambiguous", what, Where(), mend)
    return found[0]


def shipped_recipes() -> dict[str, Path]:
    """The recipes that come with pumaid, by name: the installed package's, or the checkout's."""
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "recipes", package.parent / "recipes"):
        found = sorted(folder.glob("*.yaml"))
        if found:
            return {path.stem: path for path in found}
    return {}
