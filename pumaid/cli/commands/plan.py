"""``pumaid plan``: the runs that show every parameter of an arm."""

from __future__ import annotations

from pathlib import Path

import rich_click as click

from pumaid.cli.options import json_option, output_option, seed_option
from pumaid.cli.output import document, notes, picture_form, remark, say, table
from pumaid.cli.plan_files import PLAN_FORMS, draw_plan, formed, plan_suffix
from pumaid.cli.progress import progress


def _shares(_: click.Context, __: click.Parameter, text: str | None) -> tuple[float, ...] | None:
    try:
        return None if text is None else tuple(float(part) for part in text.split(","))
    except ValueError:
        raise click.BadParameter(f"{text!r} is not a list of numbers such as 0.1,0.3,0.8") from None


@click.command()
@click.argument("recipe", type=click.Path(path_type=Path), required=False, metavar="[RECIPE]")
@click.option("--minutes", type=float, metavar="M", help="Time that the robot may take, moves included.")
@click.option("--speeds", callback=_shares, metavar="S,S,S", help="Shares of each joint's highest speed, 3 or more.")
@click.option("--postures", type=int, metavar="N", help="Postures of the other joints, for each joint. [default: 3]")
@click.option("--replicates", type=int, metavar="N", help="How often each run is made. [default: 2]")
@click.option(
    "--format", "form", type=click.Choice(PLAN_FORMS), default="yaml", show_default=True, help="Form of the plan."
)
@click.option("--picture", type=click.Path(path_type=Path), metavar="FILE", help="Draw it: .png, .svg or .pdf.")
@click.option("--timetable", "with_times", is_flag=True, help="List when each block of runs is made.")
@click.option("--force", is_flag=True, help="Replace a plan that is there already.")
@output_option("The plan to write; - for standard output. Default: plan.yaml beside the recipe.")
@seed_option
@json_option
def command(
    *,
    recipe: Path | None,
    minutes: float | None,
    speeds: tuple[float, ...] | None,
    postures: int | None,
    replicates: int | None,
    form: str,
    picture: Path | None,
    with_times: bool,
    force: bool,
    output: Path | None,
    seed: int,
    as_json: bool,
) -> None:
    """Plan the runs that show every parameter which an arm has.

    Chooses, for every joint, postures of the others, span and speeds within the recipe's limits, orders the runs so
    that repeats lie far apart in time, keeps some for judging, and says what each posture is for, how well each
    parameter will be known, and what no run can show on this arm.

    RECIPE is a file or the name of a shipped one; else recipe.yaml here.

    \b
    Example:
      pumaid plan recipe.yaml --minutes 30
      pumaid plan puma560 --seed 3 -o plan.yaml
      pumaid plan recipe.yaml --format csv -o plan.csv
      pumaid plan ur5e --format urscript --picture postures.png --timetable
    """
    from pumaid.cli.reading import experiment_folder, read_robot
    from pumaid.files.atomic import write_whole
    from pumaid.files.plan import PLAN_NAME, plan_document, refuse_to_replace
    from pumaid.programs.steps import run_times
    from pumaid.records import Plan
    from pumaid.show.plans import plan_table
    from pumaid.show.timetable import timetable_table
    from pumaid.verbs.plan import plan

    robot = read_robot(recipe)
    picture_form(picture)
    formed(Plan(robot.name, ()), robot, form)  # an arm that the form cannot move is refused before the work
    path = output or (experiment_folder(recipe) / PLAN_NAME).with_suffix(plan_suffix(form))
    if not force:
        refuse_to_replace(path)
    with progress("choosing postures"):
        found = plan(
            robot, minutes=minutes, speeds=speeds, postures_per_joint=postures, replicates=replicates, seed=seed
        )
    notes(found.notes)
    text = formed(found, robot, form)
    if as_json:
        document(plan_document(found, robot))
    elif str(path) == "-":
        say(text.rstrip("\n"))
    else:
        table(plan_table(found, robot))
        if with_times:
            table(timetable_table(found, robot, times=run_times(robot, found)))
    if str(path) != "-":
        write_whole(path, text)
        remark(f"plan written to {path}")
    if picture is not None:
        draw_plan(picture, found, robot)
