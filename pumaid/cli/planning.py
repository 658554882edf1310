"""What ``pumaid plan`` is asked, what answers it, and the files that it writes."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import rich_click as click

from pumaid.cli.output import content, document, notes, tables, write_picture

if TYPE_CHECKING:
    from pumaid.robot import Robot
    from pumaid.trajectory import Plan

#: Forms of a plan; the last two are programs, which are not read back.
PLAN_FORMS = ("yaml", "csv", "urscript", "ros2")
#: Notes that ask for attention where a given plan is checked.
ATTENTION = ("plan-strikes", "plan-lacks", "plan-dark", "plan-unusable")
#: Options that shape a whole plan.
SHAPES = ("minutes", "speeds", "postures", "replicates")
#: Option -> the one without which it means nothing.
NEEDS = {"against": "for", "size": "for", "logs": "for"}
#: Two options, the second one of several, that do not go together, and why.
EXCLUDES = (
    ("check", ("for",), "--check looks at a plan; --for makes one"),
    ("check", SHAPES, "--check looks at a plan; it has its time, speeds and passes"),
    ("logs", SHAPES, "--for with --logs adds runs; options of a whole plan have no use"),
    ("for", ("payload",), "--for plans for the bare arm"),
)


def refuse_contradictions(options: dict[str, Any]) -> None:
    """Refuse options (name -> value) of which one needs another that is missing, or that do not go together."""
    given = {name for name, value in options.items() if value not in (None, ())}
    wrong = [f"--{name} goes with --{other}" for name, other in NEEDS.items() if name in given and other not in given]
    wrong += [reason for name, rivals, reason in EXCLUDES if name in given and given & set(rivals)]
    if given >= {"size", "against", "logs"}:
        wrong.append("--size goes without --logs where there is a rival: in logs an effect has the size that it has")
    if wrong:
        raise click.UsageError(wrong[0])


def make_plan(robot: Robot, recipe: Path | None, *, options: dict[str, Any], tell: Callable[[str], None]) -> Plan:
    """The plan that the options (name -> value) ask for, or the one that ``--check`` names with what it promises."""
    from pumaid.design.plan import check_plan, plan
    from pumaid.diagnosis.discrimination import plan_for_effect
    from pumaid.experiment import Experiment
    from pumaid.io.plan_file import read_plan
    from pumaid.robot import read_choice

    given = None if options["check"] is None else read_plan(options["check"], robot)
    prior = None if options["prior"] is None else Experiment(recipe=recipe).model(options["prior"])
    shared: dict[str, Any] = {"prior": prior, "seed": options["seed"], "tell": tell}
    if given is not None:
        return check_plan(robot, given, payload=options["payload"], **shared)

    def whole() -> Plan:
        shapes = {name: options[name] for name in SHAPES if name != "postures"}
        return plan(robot, postures_per_joint=options["postures"], payload=options["payload"], **shapes, **shared)

    if options["for"] is None:
        return whole()
    beside, logs = Experiment(recipe=recipe).recipe_path, options["logs"]
    return plan_for_effect(
        robot,
        read_choice(options["for"], robot, "--for"),
        against=options["against"] and read_choice(options["against"], robot, "--against"),
        size=options["size"],
        whole=whole,
        dataset=Experiment(logs, beside).dataset() if logs else None,
        **shared,
    )


def plan_form(form: str) -> tuple[str, Callable[[Plan, Robot], str]]:
    """How a file of a plan in one of `PLAN_FORMS` ends, and what writes its text.

    An arm that the form cannot move is refused (program-other-robot).
    """
    from pumaid.design.robot_programs import PROGRAMS
    from pumaid.io.plan_file import plan_text

    return PROGRAMS.get(form) or (f".{form}", partial(plan_text, format=form))


def draw_plan(path: Path, plan: Plan, robot: Robot) -> None:
    """Draw the arm in every posture."""
    from pumaid.reporting.figures.experiment import posture_figure

    write_picture(path, posture_figure(plan, robot))


def print_plan(plan: Plan, robot: Robot, *, form: str, as_json: bool, is_piped: bool) -> None:
    """Print a plan: as one JSON document, as its file's text where that goes to standard output, or as tables."""
    from pumaid.io.plan_file import plan_document
    from pumaid.reporting.run_tables import plan_tables

    notes(plan.notes)
    if as_json:
        document(plan_document(plan, robot))
    elif is_piped:
        content(plan_form(form)[1](plan, robot).rstrip("\n") + "\n")
    else:
        tables(*plan_tables(plan, robot))
