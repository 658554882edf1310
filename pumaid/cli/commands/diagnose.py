"""``pumaid diagnose``: which physics is missing from a model, how sure that is, and what would decide."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import rich_click as click

from pumaid.cli.options import (
    check_option,
    effects_option,
    heldout_option,
    json_option,
    logs_argument,
    model_argument,
    output_option,
    reading_options,
    recipe_option,
    results_option,
    suspect_option,
    trust_option,
    units_option,
)
from pumaid.cli.output import attention, document, notes, picture_form, remark, spare_inputs, table

if TYPE_CHECKING:
    from pumaid.experiment import Reading
    from pumaid.records import Diagnosis
    from pumaid.robot import Robot


@click.command()
@model_argument
@logs_argument
@recipe_option
@suspect_option
@effects_option
@click.option("--apply", "is_applied", is_flag=True, help="Add what is found, refit, and go on until nothing is left.")
@click.option("--plan", type=click.Path(path_type=Path), metavar="FILE", help="Write the runs that would decide.")
@click.option("--force", is_flag=True, help="Replace a plan that is there already.")
@click.option("--picture", type=click.Path(path_type=Path), metavar="FILE", help="Draw it: .png, .svg or .pdf.")
@output_option("The diagnosis as JSON; - for standard output. Default: diagnosis.json in the results folder.")
@results_option
@heldout_option
@units_option
@trust_option
@reading_options
@json_option
@check_option
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
    from pumaid.diagnosis.document import DIAGNOSIS_NAME, diagnosis_document
    from pumaid.experiment import check_logs, check_model, read_dataset, read_files, read_known_model, results_folder
    from pumaid.io.write import refuse_to_replace

    form, quiet = picture_form(picture), as_json or str(output) == "-"
    if plan is not None and not force:
        refuse_to_replace(plan)
    if output or plan or picture:
        current = results_folder(results, recipe, logs) / "model.json" if is_applied else None
        spare_inputs([output, plan, picture], read_files(logs, recipe, model, current))
    estimate = read_known_model(model)
    robot, dataset = read_dataset(
        logs, recipe, trust=trust, heldout=heldout, reading=reading, results=results, extra=suspect
    )
    check_model(estimate, robot, (recipe, logs))
    check_logs(estimate, dataset, trust=trust)
    folder = results_folder(results, recipe, logs)
    typed = Typed(logs, recipe, heldout, context.meta.get("pumaid.effects", ()))
    again = partial(diagnosed, dataset=dataset, robot=robot, suspects=suspect, typed=typed)
    found = again(estimate)
    if is_applied:
        tell, current = remark if quiet else _say, folder / "model.json"
        found, estimate = added(found, estimate, dataset, robot=robot, model=current, again=again, tell=tell)
    found = with_earlier(found, estimate, folder / DIAGNOSIS_NAME)
    notes(dict.fromkeys((*dataset.notes, *found.notes)))
    path = output or folder / DIAGNOSIS_NAME
    done = [] if str(output) == "-" else [_kept(path, found)]
    done += [] if picture is None else [_draw(picture, found, robot, form=form, units=units)]
    done += [] if plan is None else [_plan(plan, found, robot)]
    if quiet:
        document(diagnosis_document(found))
    else:
        _tell(found, robot, units=units, ladder=folder / "model.json" if is_applied else None)
    for sentence in done:
        remark(sentence)
    if check and (found.findings or any(joint.verdict != "adequate" for joint in found.joints)):
        attention()


def _say(sentence: str) -> None:
    """A sentence of the result, wrapped."""
    from pumaid.reporting.table import Paragraph

    table(Paragraph(sentence))


def _tell(found: Diagnosis, robot: Robot, *, units: str, ladder: Path | None) -> None:
    """What was found; before it the ladder that ends at the model file `ladder`, where effects were added."""
    from pumaid.reporting.tables import history_table
    from pumaid.reporting.terminal import diagnosis_parts
    from pumaid.results.history import ladder_of

    steps = None if ladder is None or not found.applied else ladder_of(ladder)
    if steps is not None:
        table("")
        table(history_table(steps))
        table("")
    for part in diagnosis_parts(found, robot, units=units):
        table(part)


def _kept(path: Path, found: Diagnosis) -> str:
    """Write the diagnosis, and say so."""
    from pumaid.diagnosis.document import write_diagnosis

    write_diagnosis(path, found)
    return f"diagnosis written to {path}"


def _draw(picture: Path, found: Diagnosis, robot: Robot, *, form: str, units: str) -> str:
    """Draw what was found, and say so."""
    from pumaid.io.write import write_file
    from pumaid.reporting.figures.diagnosis import diagnosis_figure, has_figure

    if not has_figure(found):
        return f"nothing was found that could be drawn: {picture} is not written"
    write_file(picture, diagnosis_figure(found, robot, units).file(form))
    return f"picture written to {picture}"


def _plan(path: Path, found: Diagnosis, robot: Robot) -> str:
    """Write the runs that would decide, as often as it takes, and say so."""
    from pumaid.cli.deciding import deciding
    from pumaid.io.plan_file import write_plan
    from pumaid.reporting.formatting import plural

    made = deciding(found.findings, robot)
    if not made.motions:
        return f"there is nothing that more runs would decide: {path} is not written"
    write_plan(path, made, robot, format="csv" if path.suffix.lower() == ".csv" else "yaml")
    return f"plan of {plural(len(made.motions), 'run')} written to {path}"
