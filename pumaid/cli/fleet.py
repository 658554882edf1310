"""``pumaid identify`` over a folder of robots: one model each, and where they differ."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pumaid.cli.output import document, notes, table
from pumaid.errors import Faults, LogError, Note, PumaidError, Where

if TYPE_CHECKING:
    from pumaid.records import Estimate, Robot

#: What calibrating each robot may change of an arm: rad, and share of its reach.
CALIBRATED = 0.05


@dataclass(frozen=True, slots=True)
class Stable:
    """One robot of a fleet: its name, its logs, its recipe (None: looked for near the logs) and its results."""

    name: str
    logs: Path
    recipe: Path | None
    results: Path


def stables(logs: Sequence[str], recipe: Path | None, results: Path | None, *, asked: bool) -> list[Stable]:
    """The robots of a fleet; none where the logs are those of one robot.

    A folder is a fleet where every sub-folder that holds logs has a recipe of its own, or where it is said to be one.
    Logs beside the sub-folders are told: they belong to no robot.

    Parameters
    ----------
    logs
        As the user typed them.
    recipe
        ``--recipe``, or none.
    results
        ``--results``, or none.
    asked
        Whether ``--fleet`` says that it is one.

    Raises
    ------
    LogError [no-fleet]
        It is said to be one, and is not: no single folder, or fewer than two sub-folders with logs.
    LogError [fleet-unclear]
        Some sub-folders have a recipe of their own and some have none: days of one robot, or several robots?
    """
    folder = Path(logs[0])
    if len(logs) != 1 or not folder.is_dir():
        if asked:
            what = "a fleet is one folder with one sub-folder a robot"
            raise LogError("no-fleet", what, Where(file=logs[0]), "name that folder, and no other logs")
        return []
    robots = _robots(folder)
    own = [(one / "recipe.yaml").is_file() for one in robots]
    if not asked and recipe is None and len(robots) > 1 and any(own) and not all(own):
        raise _unclear(folder, robots, own)
    if not asked and (len(robots) < 2 or not all(own) or recipe is not None):
        return []
    if len(robots) < 2:
        what = f"{folder} has {len(robots)} sub-folders with logs, and a fleet has two robots at least"
        raise LogError("no-fleet", what, Where(file=str(folder)), "leave --fleet away for one robot")
    _tell_loose(folder, robots)
    return [
        Stable(
            one.name,
            one,
            recipe or (one / "recipe.yaml" if has_own else None),
            (results or folder / "results") / one.name if results or not has_own else one / "results",
        )
        for one, has_own in zip(robots, own, strict=True)
    ]


def _robots(folder: Path) -> list[Path]:
    """Sub-folders with logs, in natural order."""
    from pumaid.io.paths import expand, natural

    found = []
    for one in sorted((one for one in folder.iterdir() if one.is_dir()), key=lambda one: natural(one.name)):
        if one.name.startswith(".") or one.name == "results":
            continue
        try:
            expand([one])
        except LogError:
            continue
        found.append(one)
    return found


def _unclear(folder: Path, robots: Sequence[Path], own: Sequence[bool]) -> LogError:
    """A folder that may be one robot's or several robots'."""
    has, lacks = ([one.name for one, known in zip(robots, own, strict=True) if known is had] for had in (True, False))
    what = f"in {folder} {_listed(has)} has a recipe.yaml of its own, and {_listed(lacks)} has none"
    mend = "a robot each: put recipe.yaml there, too, or give --fleet; all of one robot: name its recipe with --recipe"
    return LogError("fleet-unclear", what, Where(file=str(folder)), mend)


def _tell_loose(folder: Path, robots: Sequence[Path]) -> None:
    """Say which logs in a fleet's folder belong to no robot."""
    from pumaid.io.paths import expand

    logs = [path for path in expand([folder]) if isinstance(path, Path)]
    loose = [path.name for path in logs if not any(one in path.parents for one in robots)]
    if loose:
        text = (
            f"{_listed(loose)} in {folder} belongs to no robot of the fleet and is left out; put it into a sub-folder"
        )
        notes([Note("fleet-loose-logs", text, Where(file=str(folder)))])


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def identified(
    robots: Sequence[Stable], one: Callable[[Stable], tuple[Robot, Estimate]]
) -> tuple[dict[str, tuple[Robot, Estimate]], dict[str, PumaidError]]:
    """Arms and models by robot, and what refused those that have none.

    Parameters
    ----------
    robots
        The fleet.
    one
        Identifies one robot and writes its model.
    """
    models: dict[str, tuple[Robot, Estimate]] = {}
    refused: dict[str, PumaidError] = {}
    for robot in robots:
        try:
            models[robot.name] = one(robot)
        except PumaidError as error:
            refused[robot.name] = error
    return models, refused


def comparable(models: Mapping[str, tuple[Robot, Estimate]]) -> list[dict[str, Estimate]]:
    """Models in groups of the same parameters, the largest first: robots of different arms cannot be compared.

    Parameters
    ----------
    models
        By robot. Arms are the same where their joints are, but for what a calibration of each robot changes; effects
        where they are, and the shapes that were given for them.
    """
    groups: list[tuple[Robot, list[object], dict[str, Estimate]]] = []
    for name, (robot, model) in models.items():
        key = _parameters(model)
        for first, known, group in groups:
            if known == key and _is_same_arm(robot, first):
                group[name] = model
                break
        else:
            groups.append((robot, key, {name: model}))
    return sorted((group for _, _, group in groups), key=len, reverse=True)


def _parameters(model: Estimate) -> list[object]:
    """What the parameters of a model mean: their names, and the shapes of effects that were not fitted."""
    from pumaid.records import GIVEN

    given = [(one.name, f"{one.value:.6g}") for one in model.values if one.state == GIVEN and one.value is not None]
    return [sorted(one.name for one in model.values), sorted(given)]


def _is_same_arm(robot: Robot, other: Robot) -> bool:
    """Whether the joints are the same but for `CALIBRATED`."""
    if [one.kind for one in robot.joints] != [one.kind for one in other.joints]:
        return False
    pairs, reach = list(zip(robot.joints, other.joints, strict=True)), sum(abs(j.a) + abs(j.d) for j in other.joints)
    turns = [turn for one, its in pairs for turn in (one.theta - its.theta, one.alpha - its.alpha)]
    moves = [move for one, its in pairs for move in (one.a - its.a, one.d - its.d)]
    is_turned = any(abs(math.remainder(turn, math.tau)) > CALIBRATED for turn in turns)
    return not is_turned and all(abs(move) <= CALIBRATED * reach for move in moves)


def _tell_alike(models: Mapping[str, Estimate]) -> None:
    """Say which robots have logs in common, byte for byte."""
    seen: dict[str, str] = {}
    for name, model in models.items():
        other = next((seen[digest] for digest in model.logs.values() if digest in seen), None)
        if other is not None:
            file = next(file for file, digest in model.logs.items() if digest in seen)
            text = f"{name} has a log of {other}, byte for byte ({file}): one of the two is another robot's"
            notes([Note("fleet-same-logs", text, Where(file=file))])
        seen |= dict.fromkeys(model.logs.values(), name)


def compared(
    known: Mapping[str, tuple[Robot, Estimate]], refused: dict[str, PumaidError], *, units: str, as_json: bool
) -> None:
    """Print where robots differ, as tables or as one document.

    Parameters
    ----------
    known
        Arms and models by robot.
    refused
        Robots without a model.
    units
        ``"rad"`` or ``"deg"``.
    as_json
        Whether ``--json`` was given.
    """
    from pumaid.io.fleet import fleet_document
    from pumaid.reporting.fleet import differences_grid, robots_grid
    from pumaid.reporting.forms import Shown
    from pumaid.verbs.fleet import fleet

    groups, models = comparable(known), {name: model for name, (_, model) in known.items()}
    _tell_alike(models)
    found = [fleet(group) for group in groups if len(group) > 1]
    alone = [name for group in groups if len(group) == 1 for name in group]
    if len(groups) > 1 or alone:
        kinds = "; ".join(", ".join(group) for group in groups)
        notes([Note("fleet-mixed", f"robots of different arms are compared among their own kind only: {kinds}")])
    if as_json:
        document(fleet_document(found, models, refused))
        return
    for one in found:
        table(Shown(robots_grid(one)))
        table("")
        table(Shown(differences_grid(one, units)))


def told_refusals(refused: dict[str, PumaidError]) -> None:
    """Raise what refused robots of a fleet, each with its name; the others' models are written by then.

    Raises
    ------
    Faults
        There was any.
    """
    if not refused:
        return
    faults = []
    for name, error in refused.items():
        for fault in error.faults if isinstance(error, Faults) else (error,):
            faults.append(type(fault)(fault.slug, f"{name}: {fault.what}", fault.where, fault.mend))
    raise Faults(faults)
