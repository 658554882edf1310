"""``pumaid diagnose``: which physics is missing from a model, how sure that is, and what would decide."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import rich_click as click

from pumaid.cli import options
from pumaid.cli.output import document, effect_files, notes, progress, remark, tables, write_picture

if TYPE_CHECKING:
    from pumaid.diagnosis.records import Diagnosis
    from pumaid.estimate import Estimate
    from pumaid.robot import Robot


@click.command()
@options.suspect_option
@click.option("--apply", "is_applied", is_flag=True, help="Add what is found, refit, repeat.")
@click.option("--plan", type=options.FILE, metavar="FILE", help="Write the runs that would decide.")
@options.force_option
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
) -> bool:
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
    from rich.console import Group

    from pumaid.diagnosis.records import DIAGNOSIS_NAME, diagnosis_document, write_diagnosis
    from pumaid.io.write import refuse_to_replace
    from pumaid.reporting.tables import diagnosis_parts, history_table
    from pumaid.results.history import ladder_of

    is_quiet, is_written = request.as_json or str(output) == "-", str(output) != "-"
    folder = request.experiment.results_folder
    current = folder / "model.json" if is_applied else None
    path = output or folder / DIAGNOSIS_NAME
    if plan is not None and not force:
        refuse_to_replace(plan)
    request.spare_inputs([output, plan, request.picture], current)
    diagnosis, robot = _diagnosis(request, suspect, folder / DIAGNOSIS_NAME, model=current, is_quiet=is_quiet)
    if is_written:
        write_diagnosis(path, diagnosis)
    if is_quiet:
        document(diagnosis_document(diagnosis))
    else:
        steps = ladder_of(current) if current is not None and diagnosis.applied else None
        ladder = Group("", history_table(steps)) if steps is not None else None
        tables(ladder, Group(*diagnosis_parts(diagnosis, robot, units=request.units)))
    if is_written:
        remark(f"diagnosis written to {path}")
    if request.picture is not None:
        from pumaid.reporting.figures.model import diagnosis_figure  # waits for matplotlib

        drawing = diagnosis_figure(diagnosis, robot, request.units)
        if drawing is not None:
            write_picture(request.picture, drawing)
        else:
            remark(f"nothing was found that could be drawn: {request.picture} is not written")
    if plan is not None:
        _write_plan(plan, diagnosis, robot)
    is_missing = bool(diagnosis.findings) or any(joint.verdict != "adequate" for joint in diagnosis.joints)
    return request.check and is_missing


def _diagnosis(
    request: options.ModelOnLogs, suspects: tuple[str, ...], earlier: Path, *, model: Path | None, is_quiet: bool
) -> tuple[Diagnosis, Robot]:
    """The diagnosis, with what it finds added to the file `model` if there is one, and the arm."""
    from pumaid.cli.additions import added, with_commands, with_earlier
    from pumaid.diagnosis.diagnose import diagnose
    from pumaid.experiment import check_logs
    from pumaid.reporting.table import Paragraph

    experiment, (estimate, robot, dataset) = request.experiment, request.read(suspect=suspects)
    check_logs(estimate, dataset, trust=experiment.trust)

    def again(model: Estimate) -> Diagnosis:
        with progress("diagnosing") as step:
            diagnosis = diagnose(model, dataset, robot, suspects=suspects, progress=lambda text: step(0.0, text))
        return with_commands(diagnosis, model, robot, experiment=experiment, effects=effect_files())

    diagnosis = again(estimate)
    if model is not None:
        tell = remark if is_quiet else lambda text: tables(Paragraph(text))
        diagnosis, estimate = added(diagnosis, estimate, dataset, robot=robot, model=model, again=again, tell=tell)
    notes(dict.fromkeys((*dataset.notes, *diagnosis.notes)))
    return with_earlier(diagnosis, estimate, earlier), robot


def _write_plan(path: Path, diagnosis: Diagnosis, robot: Robot) -> None:
    """Write the runs that would decide, as often as it takes."""
    from pumaid.diagnosis.discrimination import plan_of_findings
    from pumaid.io.plan_file import plan_text
    from pumaid.io.write import write_file
    from pumaid.reporting.text import plural

    made = plan_of_findings(diagnosis.findings, robot)
    if not made.motions:
        remark(f"there is nothing that more runs would decide: {path} is not written")
        return
    write_file(path, plan_text(made, robot, format="csv" if path.suffix.lower() == ".csv" else "yaml"))
    remark(f"plan of {plural(len(made.motions), 'run')} written to {path}")
