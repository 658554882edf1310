"""``pumaid plan``: the runs that show every parameter of an arm."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import rich_click as click

from pumaid.cli import options
from pumaid.cli.output import attention, picture_form, progress, spare_inputs
from pumaid.cli.planning import (
    ATTENTION,
    PLAN_FORMS,
    PlanOptions,
    draw_plan,
    formed,
    make_plan,
    numbers,
    plan_suffix,
    print_plan,
    write_plan,
)

_PATH = click.Path(path_type=Path)


@click.command()
@click.argument("recipe", type=_PATH, required=False, metavar="[RECIPE]")
@click.option("--minutes", type=float, metavar="M", help="Robot time, moves included.")
@click.option("--speeds", callback=numbers(), metavar="S,S,S", help="Shares of each joint's top speed, 3 or more.")
@click.option("--postures", type=int, metavar="N", help="Postures a joint, at least. [default: 4]")
@click.option("--replicates", type=int, metavar="N", help="Passes over the arm. [default: 2 or more]")
@click.option(
    "--criterion",
    type=click.Choice(["geometric", "worst"]),
    default="geometric",
    metavar="MEAN",
    help="Error that is made small: geometric or worst.",
)
@click.option("--prior", type=_PATH, metavar="MODEL", help="Plan for the arm that this model describes.")
@click.option("--payload", callback=numbers(4), metavar="KG,X,Y,Z", help="The last link carries KG at X,Y,Z (m).")
@click.option("--tilt", callback=numbers(2), metavar="X,Y", help="Tilt of the base about x and y (deg).")
@click.option("--for", "wanted", metavar="EFFECT", help="Runs that show EFFECT[@JOINT].")
@click.option("--against", metavar="EFFECT", help="With --for: runs that tell it from this.")
@click.option("--size", type=float, metavar="A", help="With --for: its first parameter, SI.")
@click.option("--logs", multiple=True, metavar="LOGS", help="With --for: what was run already.")
@click.option("--check", "given", type=_PATH, metavar="PLAN", help="What PLAN promises; exit code 1 if it lacks any.")
@click.option(
    "--format",
    "form",
    type=click.Choice(PLAN_FORMS),
    default="yaml",
    metavar="FORM",
    help="yaml, csv, urscript or ros2.",
)
@click.option("--picture", type=_PATH, metavar="FILE", help="Draw it: .png, .svg or .pdf.")
@click.option("--force", is_flag=True, help="Replace a plan that is there already.")
@options.output_option("The plan to write, or -. [default: plan.yaml]")
@options.seed_option
@options.json_option
def command(
    *,
    recipe: Path | None,
    form: str,
    picture: Path | None,
    force: bool,
    output: Path | None,
    given: Path | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Plan the runs that tell most of an arm in the time that it has.

    With --for: the runs that show one effect or tell it from a rival. With --check: what a plan promises and lacks.
    RECIPE is a file or the name of a shipped one; else recipe.yaml here.

    \b
    Example:
      pumaid plan recipe.yaml --minutes 30 --prior results/model.json
      pumaid plan --for stribeck@3 --against viscous_power --logs logs/
      pumaid plan ur5e --payload 0.5,0.1,0,0 --picture postures.png
      pumaid plan --check plan.yaml --format urscript -o plan.script
    """
    from pumaid.experiment import Experiment
    from pumaid.io.plan_file import PLAN_NAME
    from pumaid.io.write import refuse_to_replace
    from pumaid.trajectory import Plan

    if given is not None and recipe is None:
        recipe = Experiment((str(given),)).recipe_path  # a plan lies beside its recipe
    asked = PlanOptions(recipe=recipe, **options)
    asked.refuse_contradictions(given)
    robot = Experiment(recipe=recipe).robot
    picture_form(picture)
    read = Experiment(asked.logs, recipe).files(asked.prior, given)
    path = output
    if given is None:
        formed(Plan(robot.name, ()), robot, form)  # an arm that the form cannot move is refused before the work
        path = output or (Experiment(recipe=recipe).folder / PLAN_NAME).with_suffix(plan_suffix(form))
    tilted = None
    if path is not None and given is None and asked.tilt is not None:
        tilted = path.with_name(f"{path.stem}-recipe.yaml")
    spare_inputs([path, tilted, picture], [file for file in read if file.name != PLAN_NAME or file == given])
    for place in (path, tilted):
        if place is not None and not force:
            refuse_to_replace(place)
    with progress("planning") as step:
        plan = make_plan(robot, asked, given, tell=lambda text: step(0.0, text))
    if path is not None and str(path) != "-":
        write_plan(path, plan, robot, form=form, tilted=None if tilted is None else (tilted, asked))
    if picture is not None:
        draw_plan(picture, plan, robot)
    print_plan(plan, robot, form=form, as_json=as_json, is_piped=str(path) == "-")
    return attention() if given is not None and any(note.slug in ATTENTION for note in plan.notes) else None
