"""``pumaid plan``: the runs that show every parameter of an arm."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import rich_click as click

from pumaid.cli import options
from pumaid.cli.output import progress, spare_inputs, write_result
from pumaid.cli.planning import (
    ATTENTION,
    PLAN_FORMS,
    draw_plan,
    make_plan,
    plan_form,
    print_plan,
    refuse_contradictions,
)

_FORMS = click.Choice(PLAN_FORMS)


@click.command()
@click.argument("recipe", type=options.FILE, required=False, metavar="[RECIPE]")
@click.option("--minutes", type=float, metavar="M", help="Robot time, moves included.")
@click.option(
    "--speeds",
    callback=options.separated(click.FLOAT),
    metavar="S,S,S",
    help="Shares of each joint's top speed, 3 or more.",
)
@click.option("--postures", type=int, metavar="N", help="Postures a joint, at least. [default: 4]")
@click.option("--replicates", type=int, metavar="N", help="Passes over the arm. [default: 2 or more]")
@click.option("--prior", type=options.FILE, metavar="MODEL", help="Plan for the arm that this model describes.")
@click.option(
    "--payload",
    callback=options.separated(click.FLOAT, 4),
    metavar="KG,X,Y,Z",
    help="The last link carries KG at X,Y,Z (m).",
)
@click.option("--for", metavar="EFFECT", help="Runs that show EFFECT[@JOINT].")
@click.option("--against", metavar="EFFECT", help="With --for: runs that tell it from this.")
@click.option("--size", type=float, metavar="A", help="With --for: its first parameter, SI.")
@click.option("--logs", type=options.LOGS, multiple=True, metavar="LOGS", help="With --for: what was run already.")
@click.option("--check", type=options.FILE, metavar="PLAN", help="What PLAN promises; exit code 1 if it lacks any.")
@click.option("--format", "form", type=_FORMS, default="yaml", metavar="FORM", help="yaml, csv, urscript or ros2.")
@options.picture_option
@options.force_option
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
    as_json: bool,
    **asked: Any,
) -> bool:
    """Plan the runs that tell most of an arm in the time that it has.

    With --for: runs that show one effect or tell it from a rival. With --check: what a plan promises and lacks. RECIPE
    is a file or the name of a shipped one; else recipe.yaml here.

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

    refuse_contradictions(asked)
    given = asked["check"]
    if given is not None and recipe is None:
        recipe = Experiment((str(given),)).recipe_path  # a plan lies beside its recipe
    experiment = Experiment(recipe=recipe)
    robot, path, (suffix, text_of) = experiment.robot, output, plan_form(form)
    if given is None:
        text_of(Plan(robot.name, ()), robot)  # an arm that the form cannot move is refused before the work
        path = output or (experiment.folder / PLAN_NAME).with_suffix(suffix)
    read = replace(experiment, logs=asked["logs"]).files(asked["prior"], given)
    spare_inputs([path, picture], [file for file in read if file.name != PLAN_NAME or file == given])
    if path is not None and not force:
        refuse_to_replace(path)
    with progress("planning") as step:
        plan = make_plan(robot, recipe, options=asked, tell=lambda text: step(0.0, text))
    is_piped = str(path) == "-"
    if path is not None and not is_piped:
        write_result(path, text_of(plan, robot), "plan")
    if picture is not None:
        draw_plan(picture, plan, robot)
    print_plan(plan, robot, form=form, as_json=as_json, is_piped=is_piped)
    return given is not None and any(note.slug in ATTENTION for note in plan.notes)
