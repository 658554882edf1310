"""``pumaid simulate``: a virtual robot executes a plan and writes logs."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import rich_click as click

from pumaid.cli import options
from pumaid.cli.output import document, notes, progress, remark, spare_inputs, table

if TYPE_CHECKING:
    from pumaid.robot import Robot
    from pumaid.simulation import Truth


def _virtual_robot(robot: Robot, truth: Path | None, *, hide: tuple[str, ...], noise: float | None, seed: int) -> Truth:
    """The virtual robot that the options describe."""
    from pumaid.io.write import read_truth
    from pumaid.results.truth_file import as_json, from_json
    from pumaid.simulation import draw, table1
    from pumaid.simulation.hidden_effects import parse

    if noise is not None and not math.isfinite(noise):
        raise click.BadParameter(f"{noise} is no noise", param_hint="--noise")
    if truth is None:
        virtual = draw(robot, seed)
    else:
        virtual = from_json(as_json(table1.puma560()) if str(truth) == "table1" else read_truth(truth), robot)
    if hide:
        virtual = virtual.hiding([parse(text, robot) for text in hide])
    return virtual if noise is None else virtual.with_noise(noise)


@click.command()
@click.argument("recipe", type=click.Path(path_type=Path), required=False, metavar="[RECIPE]")
@click.option(
    "--plan",
    "plan_path",
    type=click.Path(path_type=Path, allow_dash=True),
    metavar="FILE",
    help="The plan, YAML or CSV; else plan.yaml beside the recipe.",
)
@options.output_option("Folder of the logs, else logs beside the recipe; - for one CSV on standard output.")
@click.option(
    "--truth",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="An earlier truth.json, or table1 (the paper's PUMA); else drawn from the seed.",
)
@click.option(
    "--hide",
    multiple=True,
    metavar="EFFECT[@JOINT]",
    help="Physics that the robot has: stribeck@3:a=0.2,velocity=0.1 ...; repeatable.",
)
@options.effects_option
@click.option("--rate", type=float, default=250.0, show_default=True, metavar="HZ", help="Samples a second.")
@click.option("--noise", type=click.FloatRange(min=0), metavar="A", help="Noise of every current; 0 for none at all.")
@click.option(
    "--format",
    "form",
    type=click.Choice(["parquet", "csv"]),
    default="parquet",
    show_default=True,
    help="Form of the log files.",
)
@click.option("--no-velocity", is_flag=True, help="Leave velocities out of the logs.")
@click.option("--temperature", "has_temperature", is_flag=True, help="Write the motors' temperatures, too.")
@click.option(
    "--runs-per-file",
    type=click.IntRange(min=1),
    default=40,
    show_default=True,
    metavar="N",
    help="Planned runs in one log file.",
)
@click.option("--force", is_flag=True, help="Replace the logs of an earlier simulation.")
@options.seed_option
@options.json_option
def command(
    *,
    recipe: Path | None,
    plan_path: Path | None,
    output: Path | None,
    truth: Path | None,
    hide: tuple[str, ...],
    noise: float | None,
    form: str,
    no_velocity: bool,
    force: bool,
    seed: int,
    as_json: bool,
    **logging: Any,
) -> None:
    """Let a virtual robot execute a plan in closed loop and write logs as a real one would.

    Its masses, motors, friction and noise are drawn from the seed and written to truth.json in the logs' folder. RECIPE
    is a file or the name of a shipped one; else recipe.yaml here.

    \b
    Example:
      pumaid simulate recipe.yaml --plan plan.yaml -o logs/ --seed 7
      pumaid simulate --hide stribeck@3:a=0.2 --hide spring@2 -o hidden/
      pumaid simulate -o - | pumaid identify -
    """
    from pumaid.experiment import Experiment
    from pumaid.io.plan_file import PLAN_NAME, read_plan
    from pumaid.io.write import write_session
    from pumaid.reporting.documents import session_document
    from pumaid.reporting.run_tables import session_table
    from pumaid.results.truth_file import as_json as as_json_truth
    from pumaid.simulation.session import simulate

    if as_json and str(output) == "-":
        raise click.UsageError("--json prints a document, and -o - a log: standard output holds one of them.")
    experiment = Experiment(recipe=recipe)
    folder = output or experiment.folder / "logs"
    spare_inputs([folder / "truth.json"] if str(folder) != "-" else [], [truth])
    robot = experiment.robot
    plan = read_plan(plan_path or experiment.folder / PLAN_NAME, robot)
    notes(note for note in plan.notes if note.slug == "plan-other-robot")
    virtual = _virtual_robot(robot, truth, hide=hide, noise=noise, seed=seed)
    logs = simulate(robot, plan, seed=seed, truth=virtual, has_velocity=not no_velocity, **logging)
    with progress("simulating", total=plan.duration or None) as step:
        files = write_session(
            folder,
            logs,
            robot,
            form=form,
            force=force,
            truth=as_json_truth(virtual, seed=seed),
            progress=lambda seconds: step(seconds, f"{seconds:.0f} s of robot time"),
        )
    if str(folder) == "-":
        return
    if as_json:
        document(session_document(robot.name, seed, files))
    else:
        table(session_table(files))
    remark(f"logs and truth.json written to {folder}")
