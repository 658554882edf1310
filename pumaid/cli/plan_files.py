"""What ``pumaid plan`` writes besides its table: the plan in a form that a robot runs, and pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pumaid.cli.output import remark

if TYPE_CHECKING:
    from pumaid.records import Plan
    from pumaid.robot import Robot

#: Forms of a plan; the last two are programs, which are not read back.
PLAN_FORMS = ("yaml", "csv", "urscript", "ros2")


def plan_suffix(form: str) -> str:
    """How the name of a plan's file ends: ``.yaml``, ``.csv``, ``.script`` or ``.ros2.yaml``."""
    from pumaid.design.robot_programs import PROGRAMS

    return PROGRAMS[form][0] if form in PROGRAMS else f".{form}"


def tilted_path(path: Path) -> Path:
    """Where the recipe of a tilted arm goes: beside its plan at `path`."""
    return path.with_name(f"{path.stem}-recipe.yaml")


def formed(plan: Plan, robot: Robot, form: str) -> str:
    """The text of a plan's file.

    Parameters
    ----------
    plan, robot
        The plan and its arm.
    form
        One of `PLAN_FORMS`.

    Raises
    ------
    ModelError [program-other-robot]
        The form is for another kind of arm.
    """
    from pumaid.design.robot_programs import PROGRAMS
    from pumaid.io.plan import plan_text

    return PROGRAMS[form][1](plan, robot) if form in PROGRAMS else plan_text(plan, robot, format=form)


def shown(found: Plan, robot: Robot, *, as_json: bool, with_times: bool = False) -> None:
    """Tell the user a plan: as one JSON document, or as tables.

    Parameters
    ----------
    found, robot
        The plan and its arm.
    as_json
        Whether as a document.
    with_times
        Whether with the timetable.
    """
    from pumaid.cli.output import document, notes, table
    from pumaid.io.plan import plan_document
    from pumaid.reporting.plans import plan_table
    from pumaid.reporting.timetable import timetable_table
    from pumaid.trajectory import run_times

    notes(found.notes)
    if as_json:
        document(plan_document(found, robot))
        return
    table(plan_table(found, robot))
    if with_times:
        table(timetable_table(found, robot, times=run_times(robot, found)))


def told(path: Path | None, found: Plan, robot: Robot, *, form: str, as_json: bool, with_times: bool) -> None:
    """Tell the user a plan: where it is written to standard output nothing but the plan, else as `shown` does.

    Parameters
    ----------
    path
        Where the plan goes, or none.
    found, robot
        The plan and its arm.
    form
        One of `PLAN_FORMS`.
    as_json, with_times
        As in `shown`.
    """
    from pumaid.cli.output import content, notes

    if str(path) != "-" or as_json:
        shown(found, robot, as_json=as_json, with_times=with_times)
        return
    notes(found.notes)
    content(formed(found, robot, form).rstrip("\n") + "\n")


def written(path: Path, found: Plan, robot: Robot, *, form: str, tilted: str | None) -> None:
    """Write a plan, and beside it the recipe of a tilted arm.

    Parameters
    ----------
    path
        Of the plan; ``-`` writes nothing.
    found, robot
        The plan and its arm.
    form
        One of `PLAN_FORMS`.
    tilted
        The recipe's text for the arm as it will stand, or none.
    """
    from pumaid.io.write import write_file

    if str(path) == "-":
        return
    if tilted is not None:
        beside = tilted_path(path)
        write_file(beside, tilted)
        remark(f"recipe of the tilted arm written to {beside}: simulate and identify these runs with it")
    write_file(path, formed(found, robot, form))
    remark(f"plan written to {path}")


def draw_plan(path: Path, plan: Plan, robot: Robot) -> None:
    """Write two pictures: the arm in every posture to `path`, the timetable beside it (``NAME-timetable.png``).

    Parameters
    ----------
    path
        ``.png``, ``.svg`` or ``.pdf``.
    plan, robot
        The plan and its arm.
    """
    from pumaid.cli.output import picture_form
    from pumaid.io.write import write_file
    from pumaid.reporting import postures, timetable
    from pumaid.trajectory import run_times

    form = picture_form(path)
    write_file(path, postures.drawn(plan, robot, form))
    beside = path.with_name(f"{path.stem}-timetable{path.suffix}")
    write_file(beside, timetable.drawn(plan, robot, form, times=run_times(robot, plan)))
    remark(f"pictures written to {path} and {beside}")
