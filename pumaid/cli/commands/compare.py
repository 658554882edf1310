"""``pumaid compare``: a model against measurement, on any logs."""

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
    from pumaid.experiment import Reading


@click.command()
@options.model_argument
@options.logs_argument
@options.recipe_option
@options.effects_option
@click.option("--worst", type=click.IntRange(min=0), default=5, show_default=True, help="How many runs to list.")
@click.option(
    "--picture",
    "--figure",
    "picture",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Draw it: .png, .svg or .pdf.",
)
@options.units_option
@options.heldout_option
@options.trust_option
@options.reading_options
@options.json_option
@options.check_option
def command(
    *,
    model: Path,
    logs: tuple[str, ...],
    recipe: Path | None,
    worst: int,
    picture: Path | None,
    units: str,
    heldout: tuple[str, ...],
    trust: bool,
    reading: Reading,
    as_json: bool,
    check: bool,
) -> None:
    """Hold a model against logs, also ones that it never saw, and see where it fails.

    \b
    Example:
      pumaid compare results/model.json logs/
      pumaid compare results/model.json new_logs/ --worst 10 --picture misfit.svg
      pumaid compare results/model.json logs/ --json | jq '.joints[] | {joint, rmse, noise_floor}'
    """
    from pumaid.experiment import check_model, read_dataset, read_files, read_known_model

    form = picture_form(picture)
    spare_inputs([picture], read_files(logs, recipe, model) if picture else [])
    estimate = read_known_model(model)
    robot, dataset = read_dataset(logs, recipe, trust=trust, heldout=heldout, reading=reading)
    from pumaid.diagnosis.compare import compare
    from pumaid.reporting.context import ReportContext
    from pumaid.reporting.documents import comparison_document
    from pumaid.reporting.figures.residuals import overview_figure
    from pumaid.reporting.tables import budget_parts, comparison_table, outside_table, worst_runs_table
    from pumaid.reporting.text import is_above_floor
    from pumaid.results.documents import heading

    check_model(estimate, robot, (recipe, logs))
    comparison = compare(estimate, dataset, robot)
    notes((*estimate.notes, *comparison.notes))
    if picture is not None and comparison.runs:
        context = ReportContext(robot, estimate, dataset, comparison, units)
        write_picture(picture, overview_figure(context), form)
    elif picture is not None:
        remark(f"no run was found, so there is no misfit to draw: {picture} is not written")
    if as_json:
        document(heading("comparison", robot=robot, logs=comparison.logs) | comparison_document(comparison))
    else:
        table(comparison_table(comparison, robot))
        for part in budget_parts(comparison, robot):
            table(part)
        is_listed = worst and comparison.runs
        worst_runs = worst_runs_table(comparison, robot, count=worst, units=units) if is_listed else None
        for extra in filter(None, (outside_table(comparison, robot), worst_runs)):
            table("")
            table(extra)
    if check and any(is_above_floor(score.rmse, score.noise_floor) for score in comparison.joints):
        attention()
