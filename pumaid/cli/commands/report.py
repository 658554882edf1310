"""``pumaid report``: one page, the tables and the figures of an experiment."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import rich_click as click

from pumaid.cli import options
from pumaid.cli.output import document, notes, progress, remark, spare_inputs, write_result

if TYPE_CHECKING:
    from pumaid.experiment import Experiment
    from pumaid.reporting.page import ReportContext

_TABLES = click.Choice(["text", "csv", "parquet", "latex", "markdown", "json"])
_TABLE_HELP = f"Only the parameter table: {', '.join(_TABLES.choices)}."
FIGURES = click.Choice(["png", "svg", "pdf"], case_sensitive=False)


@click.command()
@click.argument("model", type=options.FILE_OR_PIPE, required=False, metavar="[MODEL]")
@click.argument("logs", type=options.LOGS, nargs=-1, metavar="[LOGS...]")
@options.effects_option
@options.output_option("The page or table; - for standard output. Default: report.html in the results folder.")
@click.option("--table", "form", type=_TABLES, metavar="FORM", help=_TABLE_HELP)
@click.option("--figures", type=options.FILE, metavar="FOLDER", help="Figures; default results/figures.")
@click.option(
    "--format", "forms", default="png,svg,pdf", callback=options.separated(FIGURES), help="Of figures; or ''."
)
@options.units_option
@options.experiment_options()
@options.json_option
def command(
    *,
    model: Path | None,
    experiment: Experiment,
    output: Path | None,
    form: str | None,
    figures: Path | None,
    forms: tuple[str, ...],
    units: str,
    as_json: bool,
) -> None:
    """Write the report: one self-contained HTML page, the tables and the figures.

    MODEL is results/model.json beside the recipe, LOGS the folder logs/ there, where they are not given.

    \b
    Example:
      pumaid report
      pumaid report results/model.json new_logs/ -o new.html --units deg
      pumaid report --table latex > table.tex
      pumaid report --figures paper/ --format pdf
    """
    from pumaid.reporting.documents import parameters_as
    from pumaid.results.documents import heading

    if as_json and (form is not None or str(output) == "-"):
        raise click.UsageError("--json tells which files a report wrote; --table and -o - want standard output too.")
    place = str(model.parent.parent / "logs") if model and str(model) != "-" else "logs"
    near = replace(experiment, logs=experiment.logs or (place,))
    source = model or near.folder / "results" / "model.json"
    experiment = replace(near, logs=experiment.logs or (str(near.folder / "logs"),))
    inputs = experiment.files(source, source.parent / "diagnosis.json")
    spare_inputs([output], inputs)
    if form is not None:
        data = parameters_as(experiment.model(source), experiment.robot, form, units=units)
        write_result(output or Path("-"), data, "table")
        return
    from pumaid.reporting.page import report_files

    context = _context(source, experiment, units=units)
    files: list[tuple[Path, bytes]] = []
    with progress("drawing") as step:
        for number, (name, data) in enumerate(report_files(context, forms)):
            step(number, name)
            path = near.results_folder / name
            path = figures / path.name if figures and name.startswith("figures/") else path
            files.append((output or path if name == "report.html" else path, data))
    spare_inputs([path for path, _ in files], inputs)
    for path, data in files:
        write_result(path, data)
    remark(f"report written to {files[-1][0]}, with {len(files) - 1} tables and figures")
    if as_json:
        head = heading("report", robot=context.robot, logs=context.comparison.logs)
        document(head | {"files": [str(path) for path, _ in files]})


def _context(source: Path, experiment: Experiment, *, units: str) -> ReportContext:
    """The model on the logs, the models before it, and the diagnosis beside it unless that cannot be used."""
    from pumaid.diagnosis.compare import compare
    from pumaid.diagnosis.records import DIAGNOSIS_NAME, read_diagnosis, stale
    from pumaid.errors import Note, ResultError, Where
    from pumaid.reporting.page import ReportContext
    from pumaid.results.history import ladder_of

    estimate = experiment.model(source)
    robot, dataset = experiment.robot, experiment.dataset()
    comparison = compare(estimate, dataset, robot)
    notes((*dataset.notes, *estimate.notes, *comparison.notes))
    context = ReportContext(robot, estimate, dataset, comparison, units, ladder=ladder_of(source))
    path = source.parent / DIAGNOSIS_NAME
    if not path.is_file():
        return context
    try:
        diagnosis = read_diagnosis(path)
        if len(diagnosis.joints) != robot.n_joints:
            raise ResultError("diagnosis-damaged", f"{path} is of another arm", Where(file=str(path)))
    except ResultError as error:
        notes([Note("diagnosis-damaged", f"{error.what}; the page leaves it out", error.where)])
        return context
    return replace(context, diagnosis=diagnosis, stale=stale(diagnosis, estimate, comparison.logs))
