"""``pumaid diagnose``: which physics is missing from a model, how sure that is, and what would decide."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import rich_click as click

from pumaid.cli import options
from pumaid.cli.output import (
    attention,
    document,
    notes,
    picture_form,
    remark,
    spare_inputs,
    table,
    write_picture,
)

if TYPE_CHECKING:
    from pumaid.diagnosis.records import Diagnosis
    from pumaid.experiment import Reading
    from pumaid.robot import Robot


@click.command()
@options.model_argument
@options.logs_argument
@options.recipe_option
@options.suspect_option
@options.effects_option
@click.option("--apply", "is_applied", is_flag=True, help="Add what is found, refit, and go on until nothing is left.")
@click.option("--plan", type=click.Path(path_type=Path), metavar="FILE", help="Write the runs that would decide.")
@click.option("--force", is_flag=True, help="Replace a plan that is there already.")
@click.option("--picture", type=click.Path(path_type=Path), metavar="FILE", help="Draw it: .png, .svg or .pdf.")
@options.output_option("The diagnosis as JSON; - for standard output. Default: diagnosis.json in the results folder.")
@options.results_option
@options.heldout_option
@options.units_option
@options.trust_option
@options.reading_options
@options.json_option
@options.check_option
@click.pass_context
def command(
    context: click.Context,
    *,
    model: Path,
    logs: tuple[str, ...],
    recipe: Path | None,
    suspect: tuple[str, ...],
    is_applied: bool,
    plan: Path | None,
    force: bool,
    picture: Path | None,
    output: Path | None,
    results: Path | None,
    heldout: tuple[str, ...],
    units: str,
    trust: bool,
    reading: Reading,
    as_json: bool,
    check: bool,
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
    from functools import partial

    from pumaid.cli.additions import Typed, added, diagnosed, with_earlier
    from pumaid.diagnosis.document import DIAGNOSIS_NAME, diagnosis_document, write_diagnosis
    from pumaid.experiment import check_logs, check_model, read_dataset, read_files, read_known_model, results_folder
    from pumaid.io.write import refuse_to_replace
    from pumaid.reporting.figures.diagnosis import diagnosis_figure, has_figure
    from pumaid.reporting.table import Paragraph

    form, is_quiet = picture_form(picture), as_json or str(output) == "-"
    folder = results_folder(results, recipe, logs)
    current = folder / "model.json" if is_applied else None
    if plan is not None and not force:
        refuse_to_replace(plan)
    if output or plan or picture:
        spare_inputs([output, plan, picture], read_files(logs, recipe, model, current))
    estimate = read_known_model(model)
    robot, dataset = read_dataset(
        logs, recipe, trust=trust, heldout=heldout, reading=reading, results=results, extra=suspect
    )
    check_model(estimate, robot, (recipe, logs))
    check_logs(estimate, dataset, trust=trust)
    typed = Typed(logs, recipe, heldout, context.meta.get("pumaid.effects", ()))
    again = partial(diagnosed, dataset=dataset, robot=robot, suspects=suspect, typed=typed)
    diagnosis = again(estimate)
    if current is not None:
        tell = remark if is_quiet else lambda text: table(Paragraph(text))
        diagnosis, estimate = added(diagnosis, estimate, dataset, robot=robot, model=current, again=again, tell=tell)
    path = output or folder / DIAGNOSIS_NAME
    diagnosis = with_earlier(diagnosis, estimate, folder / DIAGNOSIS_NAME)
    notes(dict.fromkeys((*dataset.notes, *diagnosis.notes)))
    if str(output) != "-":
        write_diagnosis(path, diagnosis)
    if is_quiet:
        document(diagnosis_document(diagnosis))
    else:
        _show(diagnosis, robot, units=units, model=current)
    if str(output) != "-":
        remark(f"diagnosis written to {path}")
    if picture is not None and has_figure(diagnosis):
        write_picture(picture, diagnosis_figure(diagnosis, robot, units), form)
    elif picture is not None:
        remark(f"nothing was found that could be drawn: {picture} is not written")
    if plan is not None:
        _write_plan(plan, diagnosis, robot)
    if check and (diagnosis.findings or any(joint.verdict != "adequate" for joint in diagnosis.joints)):
        attention()


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
