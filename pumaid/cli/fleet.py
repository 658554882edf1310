"""``pumaid identify`` over a folder of robots: one model each, and where they differ."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pumaid.cli.output import document, notes, table
from pumaid.errors import Faults, LogError, Note, PumaidError, Where

if TYPE_CHECKING:
    from pumaid.records import Estimate, Robot


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
    """
    folder = Path(logs[0])
    if len(logs) != 1 or not folder.is_dir():
        if asked:
            what = "a fleet is one folder with one sub-folder a robot"
            raise LogError("no-fleet", what, Where(file=logs[0]), "name that folder, and no other logs")
        return []
    robots = _robots(folder)
    own = [(one / "recipe.yaml").is_file() for one in robots]
    if not asked and (len(robots) < 2 or not all(own) or recipe is not None):
        return []
    if len(robots) < 2:
        what = f"{folder} has {len(robots)} sub-folders with logs, and a fleet has two robots at least"
        raise LogError("no-fleet", what, Where(file=str(folder)), "leave --fleet away for one robot")
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
    from pumaid.files.paths import expand, natural

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


def identified(
    robots: Sequence[Stable], one: Callable[[Stable], tuple[Robot, Estimate]]
) -> tuple[dict[str, Estimate], dict[str, PumaidError]]:
    """Models by robot, and what refused those that have none.

    Parameters
    ----------
    robots
        The fleet.
    one
        Identifies one robot and writes its model.
    """
    models: dict[str, Estimate] = {}
    refused: dict[str, PumaidError] = {}
    for robot in robots:
        try:
            models[robot.name] = one(robot)[1]
        except PumaidError as error:
            refused[robot.name] = error
    return models, refused


def comparable(models: dict[str, Estimate]) -> list[dict[str, Estimate]]:
    """Models in groups of the same parameters, the largest first: robots of different arms cannot be compared."""
    groups: dict[tuple[object, ...], dict[str, Estimate]] = {}
    for name, model in models.items():
        key = (tuple(sorted(value.name for value in model.values)), tuple(one.effect for one in model.effects))
        groups.setdefault(key, {})[name] = model
    return sorted(groups.values(), key=len, reverse=True)


def compared(models: dict[str, Estimate], refused: dict[str, PumaidError], *, units: str, as_json: bool) -> None:
    """Print where robots differ, as tables or as one document.

    Parameters
    ----------
    models
        By robot.
    refused
        Robots without a model.
    units
        ``"rad"`` or ``"deg"``.
    as_json
        Whether ``--json`` was given.
    """
    from pumaid.files.fleet import fleet_document
    from pumaid.show.fleet import differences_grid, robots_grid
    from pumaid.show.forms import Shown
    from pumaid.verbs.fleet import fleet

    groups = comparable(models)
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
