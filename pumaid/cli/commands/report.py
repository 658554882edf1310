"""``pumaid report``: one page, the tables and the figures of an experiment."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import rich_click as click

from pumaid.cli import options
from pumaid.cli.output import content, document, notes, remark, spare_inputs
from pumaid.cli.progress import progress

if TYPE_CHECKING:
    from pumaid.dataset import Dataset
    from pumaid.experiment import Reading
    from pumaid.reporting.context import ReportContext
    from pumaid.robot import Robot

TABLES = ("text", "csv", "parquet", "latex", "markdown", "json")
FIGURES = ("png", "svg", "pdf")


@click.command()
@click.argument("model", type=click.Path(path_type=Path, allow_dash=True), required=False, metavar="[MODEL]")
@click.argument("logs", nargs=-1, metavar="[LOGS...]")
@options.recipe_option
@options.effects_option
@options.output_option("The page or table; - for standard output. Default: report.html in the results folder.")
@options.results_option
@click.option(
    "--table", "form", type=click.Choice(TABLES), metavar="FORM", help=f"Only the parameter table: {', '.join(TABLES)}."
)
@click.option(
    "--figures", type=click.Path(path_type=Path), metavar="FOLDER", help="Where figures go; else results/figures."
)
@click.option("--format", "forms", default="png,svg,pdf", show_default=True, help="Forms of the figures; '' for none.")
@options.units_option
@options.heldout_option
@options.trust_option
@options.reading_options
@options.json_option
def command(
    *,
    model: Path | None,
    logs: tuple[str, ...],
    recipe: Path | None,
    output: Path | None,
    results: Path | None,
    form: str | None,
    figures: Path | None,
    forms: str,
    units: str,
    heldout: tuple[str, ...],
    trust: bool,
    reading: Reading,
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
    from pumaid.experiment import experiment_folder, read_dataset, read_files

    near = logs or ((str(model.parent.parent / "logs"),) if model and str(model) != "-" else ("logs",))
    home = experiment_folder(recipe, near)
    source = model or home / "results" / "model.json"
    _check_stdout(form, output, as_json=as_json)
    chosen, where = _forms(forms), logs or (str(home / "logs"),)
    inputs = read_files(near if form else where, recipe, source, source.parent / "diagnosis.json")
    spare_inputs([output], inputs)
    if form is not None:
        _table(source, near, recipe=recipe, form=form, units=units, output=output)
        return
    read = partial(read_dataset, where, recipe, trust=trust, heldout=heldout, reading=reading, results=results)
    told = _story(source, read, place=(recipe, where), units=units)
    folder = results or home / "results"
    made = _made(told, folder, figures=figures or folder / "figures", forms=chosen, page=output)
    spare_inputs([path for path, _ in made], inputs)
    _write(made)
    remark(f"report written to {made[-1][0]}")
    remark(f"{len(made) - 1} tables and figures written to {folder}")
    if as_json:
        from pumaid.results.documents import heading

        files = {"files": [str(path) for path, _ in made]}
        document(heading("report", robot=told.robot, logs=told.comparison.logs) | files)


def _check_stdout(form: str | None, output: Path | None, *, as_json: bool) -> None:
    """Refuse two things that both want standard output."""
    if as_json and form is not None:
        raise click.UsageError("--json tells what a report wrote, --table prints a table: for JSON give --table json.")
    if as_json and str(output) == "-":
        raise click.UsageError("--json and -o - both want standard output; give one of them.")


def _forms(text: str) -> list[str]:
    """``png,svg`` as a list."""
    forms = [word.strip().lower() for word in text.split(",") if word.strip()]
    wrong = [word for word in forms if word not in FIGURES]
    if wrong:
        raise click.BadParameter(f"'{wrong[0]}' is none of {', '.join(FIGURES)}", param_hint="--format")
    return list(dict.fromkeys(forms))


def _table(
    source: Path, near: Sequence[str], *, recipe: Path | None, form: str, units: str, output: Path | None
) -> None:
    """Only the parameter table."""
    from pumaid.experiment import check_model, read_known_model, read_robot
    from pumaid.io.write import write_file
    from pumaid.reporting.export import parameters_as

    estimate, robot = read_known_model(source), read_robot(recipe, near)
    check_model(estimate, robot, (recipe, near))
    made = parameters_as(estimate, robot, form, units=units)
    if output is None or str(output) == "-":
        content(made)
    else:
        write_file(output, made)
        remark(f"table written to {output}")


def _story(
    source: Path,
    read: Callable[[], tuple[Robot, Dataset]],
    *,
    place: tuple[Path | None, Sequence[str]],
    units: str,
) -> ReportContext:
    """What the report tells of: the model on the logs, and the models before it."""
    from pumaid.diagnosis.compare import compare
    from pumaid.experiment import check_model, read_known_model
    from pumaid.reporting.context import ReportContext
    from pumaid.results.history import ladder_of

    estimate = read_known_model(source)
    robot, dataset = read()
    check_model(estimate, robot, place)
    comparison = compare(estimate, dataset, robot)
    notes((*dataset.notes, *estimate.notes, *comparison.notes))
    told = ReportContext(robot, estimate, dataset, comparison, units, ladder=ladder_of(source))
    return _diagnosed(told, source.parent)


def _diagnosed(told: ReportContext, results: Path) -> ReportContext:
    """The story with the diagnosis that stands beside the model; one that cannot be read is told and left out."""
    from dataclasses import replace

    from pumaid.diagnosis.document import DIAGNOSIS_NAME, read_diagnosis, stale
    from pumaid.errors import Note, ResultError

    path = results / DIAGNOSIS_NAME
    if not path.is_file():
        return told
    try:
        found = read_diagnosis(path)
    except ResultError as error:
        notes([Note("diagnosis-damaged", f"{error.what}; the page leaves it out", error.where)])
        return told
    if len(found.joints) != told.robot.n_joints:
        what = f"{path} is of an arm with {len(found.joints)} joints, this one has {told.robot.n_joints}"
        notes([Note("diagnosis-damaged", f"{what}; the page leaves it out")])
        return told
    return replace(told, diagnosis=found, stale=stale(found, told.estimate, told.comparison.logs))


def _made(
    told: ReportContext, folder: Path, *, figures: Path, forms: Sequence[str], page: Path | None
) -> list[tuple[Path, bytes]]:
    """Every file with its content, the page last; nothing is written."""
    from pumaid.reporting.export import export
    from pumaid.reporting.figures.style import INLINE
    from pumaid.reporting.page import all_figures

    made: list[tuple[Path, bytes]] = []
    drawn = ((drawing.name, drawing.files([*forms, INLINE])) for drawing in all_figures(told))
    with progress("drawing") as step:
        for number, (name, data) in enumerate(export(told, drawn)):
            step(number, name)
            part, _, rest = name.partition("/")
            place = figures / rest if part == "figures" else folder / name
            made.append((page or place if name == "report.html" else place, data))
    return made


def _write(made: Sequence[tuple[Path, bytes]]) -> None:
    """Write everything or nothing; the page, if it goes to standard output, once the rest is written."""
    from pumaid.io.write import write_file

    for path, data in made:
        if str(path) != "-":
            write_file(path, data)
    page, told = made[-1]
    if str(page) == "-":
        content(told)
