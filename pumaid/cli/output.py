"""Where words go: results to standard output, everything else to standard error."""

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rich_click as click

from pumaid.errors import Note, ResultError, Where, visible


def say(text: str = "") -> None:
    """A result for people, on standard output."""
    click.echo(visible(text))


def remark(text: str) -> None:
    """Progress, or where a file went, on standard error."""
    click.echo(visible(text), err=True)


def notes(several: Iterable[Note]) -> None:
    """Notes and warnings of a result, on standard error, each once; one line for what is true of several joints."""
    from pumaid.reporting import table, text

    merged = text.merge_notes(several)
    for line in dict.fromkeys(visible(table.renamed(str(note), text.current_unit(merged))) for note in merged):
        head, _, rest = line.partition("]: ")
        click.echo(click.style(head + "]", fg="yellow") + ": " + rest, err=True)


def show(*parts: Any, unit: str = "A") -> None:
    """Tables and paragraphs, those that are there, on standard output, with an empty line between them.

    Parts in a list have none between them. They are as wide as the terminal; in a pipe `WIDTH` characters, uncoloured.
    Currents are in `unit`.
    """
    from rich.console import Console, Group

    from pumaid.reporting.table import WIDTH, renamed

    console = Console(file=sys.stdout, highlight=False)
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console.width = WIDTH
    for number, part in enumerate(renamed(part, unit) for part in parts if part is not None):
        if number:
            say()
        if isinstance(part, str):
            say(part)
        else:
            console.print(Group(*part) if isinstance(part, list) else part)


def write_result(path: Path, data: str | bytes, what: str = "") -> None:
    """Write a file, and say that `what` is there; ``-`` is standard output, where it stands to the letter."""
    from pumaid.io.write import write_file

    if str(path) == "-":
        click.echo(data.encode("utf-8") if isinstance(data, str) else data, nl=False)
        return
    write_file(path, data)
    if what:
        remark(f"{what} written to {path}")


def document(content: Mapping[str, Any], kind: str = "", **about: Any) -> None:
    """The one JSON document of ``--json``; arrays become lists, numbers that JSON lacks become null.

    What `pumaid.results.documents.heading` says of its `kind` (else the content's own) stands first, with what it is
    `about`; the content's word stands where both say a thing.
    """
    from pumaid.results.documents import as_text, heading

    click.echo(as_text(heading(kind or content["kind"], **about) | dict(content), ascii_only=True), nl=False)


def effect_files() -> tuple[Path, ...]:
    """The files that ``--effects`` named in this command."""
    context = click.get_current_context(silent=True)
    return () if context is None else context.meta.get("pumaid.effects", ())


def spare_inputs(
    places: Iterable[Path | None], read: Iterable[Path | None], *, new: Iterable[Path | None] = ()
) -> None:
    """Refuse to write over what the command reads, under that name or another, before anything is computed.

    `places` is where the command writes (``-`` and none are no files), `read` the files that it works from; the user's
    own effects are taken for granted. ResultError [file-exists] where a place is one of the files, or
    where one of the places `new` is taken.
    """
    for place in new:
        if place is not None and str(place) != "-" and place.exists():
            raise ResultError(
                "file-exists",
                f"{place} is there already",
                Where(file=str(place)),
                "replace it with --force, or write to another file with -o",
            )
    inputs = [path for path in (*read, *effect_files()) if path is not None and str(path) != "-"]
    for place in (place for place in places if place is not None and str(place) != "-"):
        real, is_there = os.path.realpath(place), place.exists()
        taken = [
            path
            for path in inputs
            if os.path.realpath(path) == real or (is_there and path.exists() and path.samefile(place))
        ]
        if taken:
            what = f"{place} is an input (log, recipe, plan, model ...), which a result must not replace"
            also = "" if taken[0] == place else f": it is {taken[0]}"
            raise ResultError("file-exists", what + also, Where(file=str(place)), "write to another file")


@contextmanager
def progress(title: str, *, total: float | None = None) -> Iterator[Callable[[float, str], None]]:
    """A progress line on standard error, only where it is a terminal.

    Yields ``step(done, text)``: how much of `total` (in any unit, None: unknown) is done, and words on what is at hand.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    with Progress(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.fields[text]}", markup=False),  # names in them may look like styles
        TimeElapsedColumn(),
        console=Console(stderr=True),
        transient=True,
        disable=not sys.stderr.isatty(),
    ) as shown:
        task = shown.add_task(title, total=total, text="")

        def step(done: float, text: str) -> None:
            shown.update(task, completed=done, text=visible(text))

        yield step


def counted(done: int, count: int) -> None:
    """How many of the log files are read, on one line that goes when all are."""
    if sys.stderr.isatty():
        line = f"reading logs: {done} of {count} files"
        sys.stderr.write(f"\r{line}" if done < count else f"\r{' ' * len(line)}\r")
        sys.stderr.flush()
