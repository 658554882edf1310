"""``pumaid compare``: a model against measurement, on any logs."""

import rich_click as click

from pumaid.cli import options
from pumaid.cli.output import document, notes, remark, tables, write_picture


@click.command()
@click.option("--worst", type=click.IntRange(min=0), default=5, help="How many runs to list.")
@options.model_on_logs
def command(*, request: options.ModelOnLogs, worst: int) -> bool:
    """Hold a model against logs, also ones that it never saw, and see where it fails.

    \b
    Example:
      pumaid compare results/model.json logs/
      pumaid compare results/model.json new_logs/ --worst 10 --picture misfit.svg
      pumaid compare results/model.json logs/ --json | jq '.joints[] | {joint, rmse, noise_floor}'
    """
    request.spare_inputs([request.picture])
    estimate, robot, dataset = request.read()
    from pumaid.diagnosis.compare import compare
    from pumaid.reporting.documents import comparison_document
    from pumaid.reporting.tables import budget_table, comparison_table, worst_runs_table
    from pumaid.reporting.text import is_above_floor
    from pumaid.results.documents import heading

    comparison, units = compare(estimate, dataset, robot), request.units
    notes((*estimate.notes, *comparison.notes))
    if request.picture is not None and comparison.runs:
        from pumaid.reporting.figures.model import residual_figure
        from pumaid.reporting.page import ReportContext

        context = ReportContext(robot, estimate, dataset, comparison, units)
        write_picture(request.picture, residual_figure(context, context.moving()))
    elif request.picture is not None:
        remark(f"no run was found, so there is no misfit to draw: {request.picture} is not written")
    if request.as_json:
        document(heading("comparison", robot=robot, logs=comparison.logs) | comparison_document(comparison))
    else:
        is_listed = worst and comparison.runs
        worst_runs = worst_runs_table(comparison, robot, count=worst, units=units) if is_listed else None
        tables(comparison_table(comparison, robot), budget_table(comparison, robot), worst_runs)
    return request.check and any(is_above_floor(score.rmse, score.noise_floor) for score in comparison.joints)
