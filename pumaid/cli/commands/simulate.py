"""``pumaid simulate``: a virtual robot executes a plan and writes logs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import rich_click as click

from pumaid.cli import options
from pumaid.cli.output import document, notes, progress, remark, spare_inputs, tables

if TYPE_CHECKING:
    from pumaid.robot import Robot
    from pumaid.simulation import Truth

_FORMS = click.Choice(["parquet", "csv"])
_COUNT = click.IntRange(min=1)


@click.command()
@click.argument("recipe", type=options.FILE, required=False, metavar="[RECIPE]")
@click.option("--plan", type=options.FILE_OR_PIPE, metavar="FILE", help="The plan; else plan.yaml beside the recipe.")
@options.output_option("Folder of the logs, else logs beside the recipe; - for one CSV on standard output.")
@click.option(
    "--truth", type=options.FILE, metavar="FILE", help="A truth.json, or table1 (the paper's PUMA); else drawn."
)
@click.option(
    "--hide", multiple=True, metavar="EFFECT[@JOINT]", help="It has stribeck@3:a=0.2,velocity=0.1; repeatable."
)
@options.effects_option
@click.option("--rate", type=float, default=250.0, metavar="HZ", help="Samples a second.")
@click.option("--noise", type=click.FloatRange(min=0), metavar="A", help="Noise of every current; 0 for none at all.")
@click.option("--format", "form", type=_FORMS, default="parquet", help="Form of the log files.")
@click.option("--no-velocity", is_flag=True, help="Leave velocities out of the logs.")
@click.option("--temperature", "has_temperature", is_flag=True, help="Write the motors' temperatures, too.")
@click.option("--runs-per-file", type=_COUNT, default=40, metavar="N", help="Planned runs in one log file.")
@options.force_option
@options.seed_option
@options.json_option
def command(
    *,
    recipe: Path | None,
    plan: Path | None,
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
    from pumaid.reporting.run_tables import session_table
    from pumaid.results.documents import heading
    from pumaid.results.truth_file import as_json as truth_json
    from pumaid.simulation.session import simulate

    if as_json and str(output) == "-":
        raise click.UsageError("--json prints a document, and -o - a log: standard output holds one of them.")
    experiment = Experiment(recipe=recipe)
    folder = output or experiment.folder / "logs"
    spare_inputs([folder / "truth.json"] if str(folder) != "-" else [], [truth])
    robot = experiment.robot
    read = read_plan(plan or experiment.folder / PLAN_NAME, robot)
    notes(note for note in read.notes if note.slug == "plan-other-robot")
    virtual = _virtual_robot(robot, truth, hide=hide, noise=noise, seed=seed)
    logs = simulate(robot, read, seed=seed, truth=virtual, has_velocity=not no_velocity, **logging)
    with progress("simulating", total=read.duration or None) as step:
        exact = truth_json(virtual, seed=seed)
        watch = lambda seconds: step(seconds, f"{seconds:.0f} s of robot time")  # noqa: E731
        files = write_session(folder, logs, robot, form=form, force=force, truth=exact, progress=watch)
    if str(folder) == "-":
        return
    if as_json:
        entries = [dict(zip(("file", "samples", "start", "end"), entry, strict=True)) for entry in files]
        document(heading("simulation") | {"robot": robot.name, "seed": seed, "files": entries})
    else:
        tables(session_table(files))
    remark(f"logs and truth.json written to {folder}")


def _virtual_robot(robot: Robot, truth: Path | None, *, hide: Sequence[str], noise: float | None, seed: int) -> Truth:
    """The virtual robot of a truth.json or of the paper, else one that is drawn, with what it hides and its noise."""
    from pumaid.io.write import read_truth
    from pumaid.results.truth_file import as_json, from_json
    from pumaid.simulation import draw, table1
    from pumaid.simulation.hidden_effects import parse

    if truth is None:
        virtual = draw(robot, seed)
    else:
        virtual = from_json(as_json(table1.puma560()) if str(truth) == "table1" else read_truth(truth), robot)
    virtual = virtual.hiding([parse(text, robot) for text in hide]) if hide else virtual
    if noise is not None and not math.isfinite(noise):
        raise click.BadParameter(f"{noise} is no noise", param_hint="--noise")
    return virtual if noise is None else virtual.with_noise(noise)
