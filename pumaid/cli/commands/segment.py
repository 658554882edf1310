"""``pumaid segment``: the runs in some logs, why the rest was left out, and a picture of both."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import rich_click as click

from pumaid.cli import options
from pumaid.cli.output import content, document, notes, spare_inputs, tables, write_picture

if TYPE_CHECKING:
    from pumaid.experiment import Experiment

#: What a threshold may be.
_SHARE = click.FloatRange(0.0, 1.0, min_open=True, max_open=True)
_POSITIVE = click.FloatRange(0.0, min_open=True)


@click.command()
@options.logs_argument
@click.option(
    "--kinds",
    type=click.Choice(["both", "constant", "stroke", "block"]),
    metavar="KIND",
    default="both",
    help="both, constant (speed), stroke (rest to rest) or block (any motion).",
)
@click.option("--min-duration", type=_POSITIVE, metavar="S", help="Shortest run, s. [default: 0.2]")
@click.option("--min-travel", type=_POSITIVE, metavar="X", help="Shortest way of a run, rad or m. [default: 0.02]")
@click.option("--speed-tolerance", type=_SHARE, metavar="SHARE", help="Spread of one constant speed. [default: 0.03]")
@click.option("--held-share", type=_SHARE, metavar="SHARE", help="Speed of a held joint, as share. [default: 0.02]")
@click.option("--held-drift", type=_POSITIVE, metavar="X", help="Way of a held joint, rad or m. [default: 0.02]")
@click.option("--rejects", is_flag=True, help="List every stretch that was left out, with its rows and the reason.")
@options.picture_option
@click.option("--csv", "as_csv", is_flag=True, help="Print the runs as CSV, in SI.")
@options.units_option
@options.experiment_options(has_heldout=False, has_results=False)
@options.json_option
def command(
    *,
    experiment: Experiment,
    rejects: bool,
    picture: Path | None,
    as_csv: bool,
    units: str,
    as_json: bool,
    **thresholds: Any,
) -> None:
    """Find the runs in logs: one joint alone, at constant speed or from rest to rest.

    Prints each run, what the runs of each joint amount to, and why the rest was left out.

    \b
    Example:
      pumaid segment logs/
      pumaid segment logs/ --units deg --picture runs.png
      pumaid segment logs/ --json | jq '.runs[] | {joint, speed, samples}'
    """
    from pumaid.preprocessing.binning import SegmentOptions
    from pumaid.reporting.documents import frame_as, runs_frame, segments_document
    from pumaid.reporting.run_tables import rejection_table, run_table, runs_by_joint_table
    from pumaid.results.documents import heading

    if as_json and as_csv:
        raise click.UsageError("--json and --csv both want standard output; give one of them")
    spare_inputs([picture], experiment.files() if picture else [])
    chosen = SegmentOptions(**{name: value for name, value in thresholds.items() if value is not None})
    robot, dataset = experiment.robot, experiment.dataset(options=chosen)
    notes(dataset.notes)
    if picture is not None:
        from pumaid.reporting.figures.experiment import run_figure

        write_picture(picture, run_figure(dataset, robot, units))
    if as_json:
        digests = {facts.name: facts.digest for facts in dataset.files}
        document(heading("segments", robot=robot, logs=digests) | segments_document(dataset, robot))
    elif as_csv:
        content(frame_as(runs_frame(dataset.runs, robot), "csv"))
    else:
        parts = [run_table(dataset, robot, units=units), runs_by_joint_table(dataset, robot, units=units)]
        tables(*parts, rejection_table(dataset, is_whole=rejects))
