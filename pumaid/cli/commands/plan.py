"""``pumaid plan``: the runs that show every parameter of an arm."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import rich_click as click

from pumaid.cli.options import json_option, output_option, seed_option
from pumaid.cli.output import attention, picture_form, spare_inputs
from pumaid.cli.plan_files import PLAN_FORMS, draw_plan, formed, plan_suffix, tilted_path, told, written
from pumaid.cli.planning import Ask, check_together, checked, listed, needs_attention, planned, recipe_as_set_up
from pumaid.cli.progress import progress


@click.command()
@click.argument("recipe", type=click.Path(path_type=Path), required=False, metavar="[RECIPE]")
@click.option("--minutes", type=float, metavar="M", help="Time that the robot may take, moves included.")
@click.option(
    "--speeds",
    callback=listed(),
    metavar="S,S,S",
    help="Shares of each joint's highest speed, 3 or more; all are used.",
)
@click.option(
    "--postures", type=int, metavar="N", help="Postures of the others, for each joint, at least. [default: 4]"
)
@click.option("--replicates", type=int, metavar="N", help="Passes over the arm. [default: 2, more in long plans]")
@click.option(
    "--criterion",
    type=click.Choice(["geometric", "worst"]),
    default="geometric",
    show_default=True,
    help="What is made small: the geometric mean of the predicted standard errors, or nearly the worst of them.",
)
@click.option("--prior", type=click.Path(path_type=Path), metavar="MODEL", help="Plan for the arm of an earlier model.")
@click.option("--payload", callback=listed(4), metavar="KG,X,Y,Z", help="The last link carries so much there (m).")
@click.option("--tilt", callback=listed(2), metavar="X,Y", help="The base stands tilted about x, then about y, deg.")
@click.option("--for", "wanted", metavar="EFFECT[@JOINT]", help="Plan the runs that show an effect.")
@click.option("--against", metavar="EFFECT[@JOINT]", help="With --for: the runs that tell it from this one.")
@click.option("--size", type=float, metavar="A", help="With --for: of the effect's first parameter, SI.")
@click.option("--logs", multiple=True, metavar="LOGS", help="With --for: what was run already; may be repeated.")
@click.option(
    "--check",
    "given",
    type=click.Path(path_type=Path),
    metavar="PLAN",
    help="Say what this plan promises and lacks; exit code 1 where something asks for attention.",
)
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
    form: str,
    picture: Path | None,
    with_times: bool,
    force: bool,
    output: Path | None,
    given: Path | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Plan the runs that tell most of an arm in the time that it has.

    Chooses, for every joint, postures of the others, spans, speeds and repeats within the recipe's limits, so that the
    predicted standard errors are as small as they get; orders the runs so that repeats lie far apart in time, keeps
    some for judging, and says what each posture is for, how well each parameter will be known, and what no run can show
    on this arm. With --for it plans the runs that show an effect or tell it from a rival; with --check it looks at a
    plan that is there.

    RECIPE is a file or the name of a shipped one; else recipe.yaml here.

    \b
    Example:
      pumaid plan recipe.yaml --minutes 30
      pumaid plan puma560 --seed 3 -o plan.yaml
      pumaid plan recipe.yaml --prior results/model.json --criterion worst
      pumaid plan --for stribeck@3 --against viscous_power --logs logs/
      pumaid plan ur5e --payload 0.5,0.1,0,0 --picture postures.png --timetable
      pumaid plan --check plan.yaml
      pumaid plan --check plan.yaml --format urscript -o plan.script
    """
    from pumaid.cli.reading import experiment_folder, read_files, read_robot, recipe_path
    from pumaid.io.plan import PLAN_NAME, refuse_to_replace
    from pumaid.records import Plan

    if given is not None and recipe is None:
        recipe = recipe_path(None, [str(given)])  # a plan lies beside its recipe
    ask = Ask(recipe=recipe, **options)
    check_together(ask, given)
    robot = read_robot(recipe)
    picture_form(picture)
    read = read_files(ask.logs, recipe, ask.prior, given)
    inputs = [path for path in read if path.name != PLAN_NAME or path == given]
    if given is not None:
        spare_inputs([output, picture], inputs)
        if output is not None and not force:
            refuse_to_replace(output)
        with progress("looking at the plan") as step:
            found = checked(robot, given, ask, tell=lambda text: step(0.0, text))
        if output is not None:
            written(output, found, robot, form=form, tilted=None)
        if picture is not None:
            draw_plan(picture, found, robot)
        told(output, found, robot, form=form, as_json=as_json, with_times=with_times)
        return attention() if needs_attention(found) else None
    formed(Plan(robot.name, ()), robot, form)  # an arm that the form cannot move is refused before the work
    path = output or (experiment_folder(recipe) / PLAN_NAME).with_suffix(plan_suffix(form))
    spare_inputs([path, tilted_path(path) if ask.tilt else None, picture], inputs)
    for one in (path, tilted_path(path)) if ask.tilt is not None else (path,):
        if not force:
            refuse_to_replace(one)
    with progress("planning") as step:
        found = planned(robot, ask, lambda text: step(0.0, text))
    written(path, found, robot, form=form, tilted=recipe_as_set_up(robot, recipe, ask))
    if picture is not None:
        draw_plan(picture, found, robot)
    told(path, found, robot, form=form, as_json=as_json, with_times=with_times)
    return None
