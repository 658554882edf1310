"""``pumaid segment``: the runs in some logs, why the rest was left out, and a picture of both."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import rich_click as click

from pumaid.cli.options import (
    json_option,
    logs_argument,
    reading_options,
    recipe_option,
    trust_option,
    units_option,
)
from pumaid.cli.output import document, notes, picture_form, remark, say, spare_inputs, table

if TYPE_CHECKING:
    from pumaid.dataset import Dataset
    from pumaid.experiment import Reading
    from pumaid.robot import Robot

#: What a threshold may be.
_SHARE = click.FloatRange(0.0, 1.0, min_open=True, max_open=True)
_POSITIVE = click.FloatRange(0.0, min_open=True)


@click.command()
@logs_argument
@recipe_option
@click.option(
    "--kinds",
    type=click.Choice(["both", "constant", "stroke"]),
    default="both",
    show_default=True,
    help="Runs at constant speed, strokes from rest to rest, or both.",
)
@click.option("--min-duration", type=_POSITIVE, metavar="S", help="Shortest run, s. [default: 0.2]")
@click.option("--min-travel", type=_POSITIVE, metavar="X", help="Shortest way of a run, rad or m. [default: 0.02]")
@click.option("--speed-tolerance", type=_SHARE, metavar="SHARE", help="Spread of one constant speed. [default: 0.03]")
@click.option("--held-share", type=_SHARE, metavar="SHARE", help="Speed of a held joint, as share. [default: 0.02]")
@click.option("--held-drift", type=_POSITIVE, metavar="X", help="Way of a held joint, rad or m. [default: 0.02]")
@click.option("--rejects", is_flag=True, help="List every stretch that was left out, with its rows and the reason.")
@click.option("--picture", type=click.Path(path_type=Path), metavar="FILE", help="Draw it: .png, .svg or .pdf.")
@click.option("--csv", "as_csv", is_flag=True, help="Print the runs as CSV, in SI.")
@units_option
@trust_option
@reading_options
@json_option
def command(
    *,
    logs: tuple[str, ...],
    recipe: Path | None,
    rejects: bool,
    picture: Path | None,
    as_csv: bool,
    units: str,
    trust: bool,
    reading: Reading,
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
    from pumaid.experiment import read_files
    from pumaid.reporting.documents import runs_csv, segments_document
    from pumaid.results.documents import heading

    if as_json and as_csv:
        raise click.UsageError("--json and --csv both want standard output; give one of them")
    form = picture_form(picture)
    spare_inputs([picture], read_files(logs, recipe) if picture else [])
    robot, dataset = _read(logs, recipe, trust=trust, reading=reading, **thresholds)
    notes(dataset.notes)
    if picture is not None:
        _draw(picture, dataset, robot, form=form, units=units)
    if as_json:
        digests = {facts.name: facts.digest for facts in dataset.files}
        document(heading("segments", robot=robot, logs=digests) | segments_document(dataset, robot))
    elif as_csv:
        say(runs_csv(dataset, robot).rstrip("\n"))
    else:
        _tell(dataset, robot, units=units, rejects=rejects)


def _read(
    logs: tuple[str, ...], recipe: Path | None, *, trust: bool, reading: Reading, **thresholds: Any
) -> tuple[Robot, Dataset]:
    """The one pass with the thresholds that were given, and the plan's held-out runs marked."""
    from pumaid.experiment import read_dataset
    from pumaid.preprocessing.options import SegmentOptions

    options = SegmentOptions(**{name: value for name, value in thresholds.items() if value is not None})
    return read_dataset(logs, recipe, trust=trust, options=options, reading=reading)


def _tell(dataset: Dataset, robot: Robot, *, units: str, rejects: bool) -> None:
    from pumaid.reporting.run_tables import rejection_table, rejects_table, run_table, runs_by_joint_table

    parts = [run_table(dataset, robot, units=units)]
    parts += [runs_by_joint_table(dataset, robot, units=units), rejection_table(dataset)]
    parts += [rejects_table(dataset)] if rejects else []
    for index, part in enumerate(parts):
        if index:
            say()
        table(part)


def _draw(picture: Path, dataset: Dataset, robot: Robot, *, form: str, units: str) -> None:
    from pumaid.io.write import write_file
    from pumaid.reporting.figures.runs import run_figure

    write_file(picture, run_figure(dataset, robot, units).file(form))
    remark(f"picture written to {picture}")
