"""The first step of every command that reads logs: recipe, one pass over the logs, what looked suspicious in them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pumaid.cli.progress import progress

if TYPE_CHECKING:
    from pumaid.records import Evidence, Robot

#: The plan's name in an experiment folder; its held-out runs are kept from fitting.
PLAN_NAME = "plan.yaml"


def read_robot(recipe: Path | None, logs: Sequence[str] = ()) -> Robot:
    """The arm of some logs.

    Parameters
    ----------
    recipe
        ``--recipe``, or none: the recipe is looked for near the logs.
    logs
        As the user typed them.
    """
    from pumaid.files.recipe import find_recipe, read_recipe

    return read_recipe(find_recipe(recipe, [Path(log) for log in logs]))


def read_evidence(logs: Sequence[str], recipe: Path | None) -> tuple[Robot, Evidence]:
    """All that later steps know of some logs, read in one pass.

    Parameters
    ----------
    logs
        As the user typed them: files, folders, globs, ``-``.
    recipe
        ``--recipe``, or none.

    Returns
    -------
    robot, evidence
        Runs that the plan beside the recipe keeps for judging are marked as held out.
    """
    from pumaid.files.paths import expand
    from pumaid.files.table import LogReader
    from pumaid.verbs.segment import segment

    robot = read_robot(recipe, logs)
    reader = LogReader(expand(logs), robot)
    with progress("reading logs") as step:
        evidence = segment(reader, robot, progress=lambda rows: step(rows, f"{rows:,} rows"))
    return robot, _with_plan(evidence, robot)


def results_folder(given: Path | None, robot: Robot) -> Path:
    """Where results go: what ``--results`` says, else ``results`` beside the recipe.

    A recipe that ships with pumaid, or that is no file, has no experiment around it; then the working folder is it.

    Parameters
    ----------
    given
        ``--results``, or none.
    robot
        Knows where its recipe lies.
    """
    from pumaid.files.recipe import shipped_recipes

    if given is not None:
        return given
    origin = Path(robot.origin)
    shipped = {path.resolve() for path in shipped_recipes().values()}
    is_own = origin.is_file() and origin.resolve() not in shipped
    return (origin.parent if is_own else Path()) / "results"


def _with_plan(evidence: Evidence, robot: Robot) -> Evidence:
    path = Path(robot.origin).parent / PLAN_NAME
    if not robot.origin or not path.is_file():
        return evidence
    from pumaid.files.plan import read_plan
    from pumaid.motion.planned import mark_heldout

    return mark_heldout(evidence, read_plan(path, robot))
