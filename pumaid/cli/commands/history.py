"""``pumaid history``: every model of an experiment, what each added, and the error after; undo."""

from pathlib import Path

import rich_click as click

from pumaid.cli import options
from pumaid.cli.output import document, notes, remark, tables, write_picture


@click.command()
@click.argument("folder", type=options.FILE, default=Path(), metavar="[FOLDER]")
@options.results_option
@options.effects_option
@click.option("--restore", type=click.IntRange(min=1), metavar="N", help="Make model N the current one again.")
@options.picture_option
@options.json_option
def command(*, folder: Path, results: Path | None, restore: int | None, picture: Path | None, as_json: bool) -> None:
    """Tell the error ladder of an experiment: each model, what it added, and the error after.

    FOLDER is the experiment's, or its results; the working folder where not given. Every model that identify and
    diagnose --apply wrote is kept in results/models. Errors are those of the runs that were fitted and of those that
    were held out; the noise floor is what repeated runs differ by, which no model can pass.

    \b
    Example:
      pumaid history
      pumaid history my_arm --picture ladder.svg
      pumaid history --restore 2
      pumaid history --json | jq '.ladders[0].models[] | {model, added, rmse, heldout}'
    """
    from pumaid.reporting.documents import history_document
    from pumaid.reporting.tables import history_joint_table, history_table
    from pumaid.results.documents import heading
    from pumaid.results.history import read_history
    from pumaid.results.history import restore as restore_model

    is_results = (folder / "models").is_dir() or folder.name == "results"
    place = results or (folder if is_results else folder / "results")
    if restore is not None:
        remark(f"model {restore} is the current one again: {restore_model(place, restore)}")
    history = read_history(place)
    notes(history.notes)
    if picture is not None:
        from pumaid.reporting.figures.model import history_figure

        write_picture(picture, history_figure(history.ladders[0]))
    if as_json:
        document(heading("history") | history_document(history))
    else:
        first, *incomparable = history.ladders
        tables(history_table(first), history_joint_table(first), *map(history_table, incomparable))
