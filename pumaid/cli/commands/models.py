"""``pumaid segment``, ``identify``, ``compare`` and ``diagnose``: from logs to a model, and what it lacks."""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import rich_click as click

from pumaid.cli import options
from pumaid.cli.output import document, effect_files, notes, remark, show, spare_inputs, write_result

if TYPE_CHECKING:
    from pumaid.diagnosis.records import Diagnosis
    from pumaid.experiment import Experiment
    from pumaid.robot import Robot


@click.command()
@options.logs_argument
@click.option("--rejects", is_flag=True, help="List all that was left out, and why.")
@options.picture_option
@options.units_option
@options.experiment_options(has_heldout=False, has_results=False)
@options.json_option
def segment(
    *,
    experiment: Experiment,
    rejects: bool,
    picture: Path | None,
    units: str,
    as_json: bool,
) -> None:
    """Find the runs in logs: one joint alone, at constant speed or from rest to rest.

    Prints each run, what the runs of each joint amount to, and why the rest was left out.

    \b
    Example:
      pumaid segment logs/
      pumaid segment logs/ --units deg --picture runs.png
      pumaid segment logs/ --json | jq '.runs[] | {joint, speed, samples}'
    """
    from pumaid.reporting import documents, run_tables

    spare_inputs([picture], experiment.files() if picture else [])
    robot, dataset = experiment.robot, experiment.dataset()
    notes(dataset.notes)
    if picture is not None:
        from pumaid.reporting.figures.experiment import run_figure

        write_result(picture, run_figure(dataset, robot, units).file(picture.suffix[1:].lower()), "picture")
    if as_json:
        document(
            documents.segments_document(dataset, robot),
            "segments",
            robot=robot,
            logs={facts.name: facts.digest for facts in dataset.files},
        )
    else:
        show(
            run_tables.run_table(dataset, robot, units=units),
            run_tables.runs_by_joint_table(dataset, robot, units=units),
            run_tables.rejection_table(dataset, is_whole=rejects),
        )


@click.command()
@options.logs_argument
@click.option(
    "--add",
    multiple=True,
    metavar="EFFECT[@JOINT]",
    help="Physics to add, as stribeck@3; repeatable.",
)
@options.effects_option
@click.option("--recursive", is_flag=True, help="Stop after the n-to-1 recursion.")
@options.output_option("The model; else results/model.json; - prints it.")
@click.option(
    "--motion",
    type=click.Choice(["any", "constant"]),
    default="any",
    show_default=True,
    help="Motion to fit.",
)
@options.units_option
@options.experiment_options()
@options.json_option
def identify(
    *,
    experiment: Experiment,
    add: tuple[str, ...],
    recursive: bool,
    output: Path | None,
    motion: str,
    units: str,
    as_json: bool,
) -> None:
    """Identify gravity, inertia, friction and gain ratios from logged currents.

    Finds what can be fitted in the logs (runs at constant speed, strokes, blocks of any motion), solves the joints from
    the tip to the base, refines all of them together by maximum likelihood, prints the parameter table and writes the
    model. Effects that are added are fitted together with all the rest, their nonlinear parameters too.

    \b
    Example:
      pumaid identify logs/
      pumaid identify logs/ --units deg -o results/first.json
      pumaid identify logs/ --add stribeck@3 --add ripple@elbow:frequency=58
      pumaid identify s3://bucket/logs --dask tcp://10.0.0.5:8786
      pumaid identify - --recipe recipe.yaml --json < log.csv | jq '.ratios'
    """
    from pumaid.cli.additions import identified, typed_words
    from pumaid.dataset import CONSTANT
    from pumaid.effect_spec import chosen_by
    from pumaid.reporting import tables, text
    from pumaid.results import documents, history

    spare_inputs([output], experiment.files() if output else [])
    robot = experiment.robot
    effects = chosen_by(robot, add)
    dataset = experiment.dataset()
    if motion == CONSTANT:
        dataset = replace(dataset, runs=tuple(run for run in dataset.runs if run.kind == CONSTANT))
    estimate = identified(dataset, robot, effects=effects, recursive=recursive, trust=experiment.trust)
    notes(dict.fromkeys((*dataset.notes, *estimate.notes)))
    path = output or experiment.results_folder / "model.json"
    if output is None:
        history.keep(path, estimate)
    elif str(output) != "-":
        documents.write_model(path, estimate)
    if as_json or str(output) == "-":
        document(documents.model_document(estimate))
    else:
        sums = tables.combination_table(estimate)
        parts = tables.parameter_table(estimate, robot, units), sums and sums.columns([0, 2, 3])
        show(*parts, unit=text.current_unit(estimate.notes))
    if str(output) != "-":
        words = shlex.join(["pumaid", "diagnose", str(path), *typed_words(experiment, effect_files())])
        remark(f"model written to {path}; next: {words}")


@click.command()
@click.option("--worst", type=click.IntRange(min=0), default=5, metavar="N", help="Runs to list.")
@options.model_on_logs
def compare(
    *,
    model: Path,
    experiment: Experiment,
    worst: int,
    units: str,
    as_json: bool,
    check: bool,
) -> bool:
    """Hold a model against logs, also ones that it never saw, and see where it fails.

    \b
    Example:
      pumaid compare results/model.json logs/
      pumaid compare results/model.json new_logs/ --worst 10
      pumaid compare results/model.json logs/ --json | jq '.joints[].rmse'
    """
    from pumaid.diagnosis.compare import compare
    from pumaid.reporting import documents, tables, text

    estimate, robot, dataset = experiment.model(model), experiment.robot, experiment.dataset()
    comparison = compare(estimate, dataset, robot)
    notes((*estimate.notes, *comparison.notes))
    if as_json:
        document(documents.comparison_document(comparison), "comparison", robot=robot, logs=comparison.logs)
    else:
        count = min(worst, len(comparison.runs))
        worst_runs = tables.worst_runs_table(comparison, robot, count=count, units=units) if count else None
        parts = tables.comparison_table(comparison, robot), tables.budget_table(comparison, robot), worst_runs
        show(*parts, unit=text.current_unit(estimate.notes))
    return check and any(text.is_above_floor(score.rmse, score.noise_floor) for score in comparison.joints)


@click.command()
@click.option("--suspect", multiple=True, metavar="COLUMN", help="A column that may be the cause.")
@click.option("--apply", "is_applied", is_flag=True, help="Add what is found, refit, repeat.")
@click.option("--plan", type=options.FILE, metavar="FILE", help="Write the runs that would decide.")
@options.force_option
@options.output_option("The JSON; else results/diagnosis.json; - prints it.")
@options.results_option
@options.picture_option
@options.model_on_logs
def diagnose(
    *,
    model: Path,
    experiment: Experiment,
    suspect: tuple[str, ...],
    is_applied: bool,
    plan: Path | None,
    force: bool,
    output: Path | None,
    picture: Path | None,
    units: str,
    as_json: bool,
    check: bool,
) -> bool:
    """Learn which physical effect a model lacks, how sure that is, and what adding it would bring.

    Tries every effect of the catalogue at every joint: which is missing, which others these data cannot tell from it,
    the runs that would, and the command that adds it. With --apply each step is kept (pumaid history).

    \b
    Example:
      pumaid diagnose results/model.json logs/
      pumaid diagnose results/model.json logs/ --apply --picture missing.png
      pumaid diagnose results/model.json logs/ --suspect supply_voltage
      pumaid diagnose results/model.json logs/ --json | jq '.findings[].effect'
    """
    from pumaid.cli.additions import diagnosed
    from pumaid.diagnosis.records import DIAGNOSIS_NAME, diagnosis_document, write_diagnosis
    from pumaid.reporting import tables, text
    from pumaid.reporting.diagnosis import diagnosis_parts
    from pumaid.results.history import ladder_of

    is_quiet, is_written = as_json or str(output) == "-", str(output) != "-"
    folder, places = experiment.results_folder, [output, plan, picture]
    current = folder / "model.json" if is_applied else None
    path = output or folder / DIAGNOSIS_NAME
    spare_inputs(places, experiment.files(model, current) if any(places) else [], new=() if force else (plan,))
    diagnosis, robot = diagnosed(model, experiment, suspect, current=current, is_quiet=is_quiet), experiment.robot
    if is_written:
        write_diagnosis(path, diagnosis)
    if picture is not None:
        from pumaid.reporting.figures.model import diagnosis_figure  # waits for matplotlib

        drawing = diagnosis_figure(diagnosis, robot, units)
        if drawing is not None:
            write_result(picture, drawing.file(picture.suffix[1:].lower()), "picture")
        else:
            remark(f"nothing was found that could be drawn: {picture} is not written")
    if plan is not None:
        _write_plan(plan, diagnosis, robot)
    if is_quiet:
        document(diagnosis_document(diagnosis))
    else:
        steps = ladder_of(current) if current is not None and diagnosis.applied else None
        parts = ["", tables.history_table(steps)] if steps else None, diagnosis_parts(diagnosis, robot, units=units)
        show(*parts, unit=text.current_unit(experiment.model(model).notes))
    if is_written:
        remark(f"diagnosis written to {path}")
    return check and (bool(diagnosis.findings) or any(joint.verdict != "adequate" for joint in diagnosis.joints))


def _write_plan(path: Path, diagnosis: Diagnosis, robot: Robot) -> None:
    from pumaid.diagnosis.discrimination import plan_of_findings
    from pumaid.io.plan_file import plan_text

    made = plan_of_findings(diagnosis.findings, robot)
    if made.motions:
        write_result(path, plan_text(made, robot, format="csv" if path.suffix.lower() == ".csv" else "yaml"), "plan")
    else:
        remark(f"there is nothing that more runs would decide: {path} is not written")
