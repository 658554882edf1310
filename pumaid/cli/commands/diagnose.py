"""``pumaid diagnose``: which physics is missing from a model, how sure that is, and what would decide."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import rich_click as click

from pumaid.cli import options
from pumaid.cli.output import attention, document, notes, picture_form, remark, table, write_picture

if TYPE_CHECKING:
    from pumaid.diagnosis.records import Diagnosis
    from pumaid.robot import Robot


@click.command()
@options.suspect_option
@click.option("--apply", "is_applied", is_flag=True, help="Add what is found, refit, and go on until nothing is left.")
@click.option("--plan", type=click.Path(path_type=Path), metavar="FILE", help="Write the runs that would decide.")
@click.option("--force", is_flag=True, help="Replace a plan that is there already.")
@options.output_option("The diagnosis as JSON; - for standard output. Default: diagnosis.json in the results folder.")
@options.results_option
@options.model_on_logs
def command(
    *,
    request: options.ModelOnLogs,
    suspect: tuple[str, ...],
    is_applied: bool,
    plan: Path | None,
    force: bool,
    output: Path | None,
) -> None:
    """Learn which physical effect a model lacks, how sure that is, and what adding it would bring.

    Tries every effect of the catalogue at every joint: which is missing, which others these data cannot tell from it,
    the runs that would, and the command that adds it. With --apply each step is kept; pumaid history undoes them.

    \b
    Example:
      pumaid diagnose results/model.json logs/
      pumaid diagnose results/model.json logs/ --apply --picture missing.png
      pumaid diagnose results/model.json logs/ --plan next.yaml --suspect supply_voltage
      pumaid diagnose results/model.json logs/ --json | jq '.findings[] | {effect, joint, p_value}'
    """
    from pumaid.diagnosis.records import DIAGNOSIS_NAME, diagnosis_document, write_diagnosis
    from pumaid.io.write import refuse_to_replace

    form, is_quiet = picture_form(request.picture), request.as_json or str(output) == "-"
    folder = request.experiment.results_folder
    current = folder / "model.json" if is_applied else None
    if plan is not None and not force:
        refuse_to_replace(plan)
    request.spare_inputs([output, plan, request.picture], current)
    diagnosis, robot = _diagnosis(request, suspect, folder, model=current, is_quiet=is_quiet)
    path = output or folder / DIAGNOSIS_NAME
    if str(path) != "-":
        write_diagnosis(path, diagnosis)
    if is_quiet:
        document(diagnosis_document(diagnosis))
    else:
        _show(diagnosis, robot, units=request.units, model=current)
    if str(path) != "-":
        remark(f"diagnosis written to {path}")
    if request.picture is not None:
        _draw(request.picture, diagnosis, robot, units=request.units, form=form)
    if plan is not None:
        _write_plan(plan, diagnosis, robot)
    if request.check and (diagnosis.findings or any(joint.verdict != "adequate" for joint in diagnosis.joints)):
        attention()


def _diagnosis(
    request: options.ModelOnLogs, suspect: tuple[str, ...], folder: Path, *, model: Path | None, is_quiet: bool
) -> tuple[Diagnosis, Robot]:
    """The diagnosis, with what it finds added to the file `model` if there is one, and the arm."""
    from pumaid.cli.additions import added, diagnosed, identify_command, with_earlier
    from pumaid.diagnosis.records import DIAGNOSIS_NAME
    from pumaid.experiment import check_logs
    from pumaid.reporting.table import Paragraph

    estimate, robot, dataset = request.read(suspect=suspect)
    check_logs(estimate, dataset, trust=request.experiment.trust)
    context = click.get_current_context(silent=True)
    effects = () if context is None else context.meta.get("pumaid.effects", ())
    experiment = request.experiment
    typed = identify_command(experiment.logs, recipe=experiment.recipe, heldout=experiment.heldout, effects=effects)
    again = partial(diagnosed, dataset=dataset, robot=robot, suspects=suspect, identify_again=typed)
    diagnosis = again(estimate)
    if model is not None:
        tell = remark if is_quiet else lambda text: table(Paragraph(text))
        diagnosis, estimate = added(diagnosis, estimate, dataset, robot=robot, model=model, again=again, tell=tell)
    notes(dict.fromkeys((*dataset.notes, *diagnosis.notes)))
    return with_earlier(diagnosis, estimate, folder / DIAGNOSIS_NAME), robot


def _draw(path: Path, diagnosis: Diagnosis, robot: Robot, *, units: str, form: str) -> None:
    """Draw what was found, if there is anything to draw."""
    from pumaid.reporting.figures.residuals import diagnosis_figure

    drawing = diagnosis_figure(diagnosis, robot, units)
    if drawing is not None:
        write_picture(path, drawing, form)
    else:
        remark(f"nothing was found that could be drawn: {path} is not written")


def _show(diagnosis: Diagnosis, robot: Robot, *, units: str, model: Path | None) -> None:
    """What was found; before it the ladder that ends at the file `model`, where effects were added."""
    from pumaid.reporting.tables import diagnosis_parts, history_table
    from pumaid.results.history import ladder_of

    steps = None if model is None or not diagnosis.applied else ladder_of(model)
    if steps is not None:
        table("")
        table(history_table(steps))
        table("")
    for part in diagnosis_parts(diagnosis, robot, units=units):
        table(part)


def _write_plan(path: Path, diagnosis: Diagnosis, robot: Robot) -> None:
    """Write the runs that would decide, as often as it takes."""
    from pumaid.diagnosis.plan_for_effect import plan_of_findings
    from pumaid.io.plan_file import write_plan
    from pumaid.reporting.formatting import plural

    made = plan_of_findings(diagnosis.findings, robot)
    if not made.motions:
        remark(f"there is nothing that more runs would decide: {path} is not written")
        return
    write_plan(path, made, robot, format="csv" if path.suffix.lower() == ".csv" else "yaml")
    remark(f"plan of {plural(len(made.motions), 'run')} written to {path}")
