"""``pumaid plan``: the runs that show every parameter of an arm."""

from __future__ import annotations

from pathlib import Path

import rich_click as click

from pumaid.cli.options import json_option, output_option, seed_option
from pumaid.cli.output import document, notes, remark, say, table
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
    "--format", "form", type=click.Choice(["yaml", "csv"]), default="yaml", show_default=True, help="Form of the plan."
)
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
    """
    from pumaid.cli.reading import experiment_folder, read_robot
    from pumaid.files.plan import PLAN_NAME, plan_document, plan_text, refuse_to_replace, write_plan
    from pumaid.show.plans import plan_table
    from pumaid.verbs.plan import plan

    robot = read_robot(recipe)
    path = output or (experiment_folder(recipe) / PLAN_NAME).with_suffix(f".{form}")
    if not force:
        refuse_to_replace(path)
    with progress("choosing postures"):
        found = plan(
            robot, minutes=minutes, speeds=speeds, postures_per_joint=postures, replicates=replicates, seed=seed
        )
    notes(found.notes)
    if as_json:
        document(plan_document(found, robot))
    elif str(path) == "-":
        say(plan_text(found, robot, format=form).rstrip("\n"))
    else:
        table(plan_table(found, robot))
    if str(path) != "-":
        write_plan(path, found, robot, format=form)
        remark(f"plan written to {path}")
