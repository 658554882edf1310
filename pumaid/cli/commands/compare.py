"""``pumaid compare``: a model against measurement, on any logs."""

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
    reading_options,
    recipe_option,
    trust_option,
    units_option,
)
from pumaid.cli.output import attention, document, notes, picture_form, remark, spare_inputs, table

if TYPE_CHECKING:
    from pumaid.experiment import Reading
    from pumaid.reporting.context import ReportContext


@click.command()
@model_argument
@logs_argument
@recipe_option
@effects_option
@click.option("--worst", type=click.IntRange(min=0), default=5, show_default=True, help="How many runs to list.")
@click.option(
    "--picture",
    "--figure",
    "picture",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Draw it: .png, .svg or .pdf.",
)
@units_option
@heldout_option
@trust_option
@reading_options
@json_option
@check_option
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
    from pumaid.reporting.documents import comparison_document
    from pumaid.reporting.tables import comparison_table, outside_table, worst_runs_table
    from pumaid.reporting.terminal import budget_parts
    from pumaid.reporting.text import is_above_floor
    from pumaid.results.documents import heading
    from pumaid.verbs.compare import compare

    check_model(estimate, robot, (recipe, logs))
    comparison = compare(estimate, dataset, robot)
    notes((*estimate.notes, *comparison.notes))
    if picture is not None and comparison.runs:
        from pumaid.reporting.context import ReportContext

        _draw(picture, ReportContext(robot, estimate, dataset, comparison, units), form=form)
    elif picture is not None:
        remark(f"no run was found, so there is no misfit to draw: {picture} is not written")
    if as_json:
        document(heading("comparison", robot=robot, logs=comparison.logs) | comparison_document(comparison))
    else:
        table(comparison_table(comparison, robot))
        for part in budget_parts(comparison, robot):
            table(part)
        tables = [outside_table(comparison, robot)]
        tables += [worst_runs_table(comparison, robot, count=worst, units=units)] if worst and comparison.runs else []
        for item in tables:
            if item is not None:
                table("")
                table(item)
    if check and any(is_above_floor(score.rmse, score.noise_floor) for score in comparison.joints):
        attention()


def _draw(picture: Path, told: ReportContext, *, form: str) -> None:
    from pumaid.io.write import write_file
    from pumaid.reporting.figures.residuals import overview_figure

    write_file(picture, overview_figure(told).file(form))
    remark(f"picture written to {picture}")
