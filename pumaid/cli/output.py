"""Where words go: results to standard output, everything else to standard error."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import rich_click as click

from pumaid import __version__
from pumaid.errors import Note, ResultError, Where, visible

if TYPE_CHECKING:
    from pumaid.dataset import Dataset
    from pumaid.estimate import Estimate
    from pumaid.robot import Robot

Step = Callable[[float, str], None]


def say(text: str = "") -> None:
    """A result for people, on standard output."""
    click.echo(visible(text))


def content(text: str | bytes) -> None:
    """What another command would find in a file, on standard output, to the letter."""
    click.echo(text.encode("utf-8") if isinstance(text, str) else text, nl=False)


def remark(text: str) -> None:
    """Progress, or where a file went, on standard error."""
    click.echo(visible(text), err=True)


def notes(several: Iterable[Note]) -> None:
    """Notes and warnings of a result, on standard error, each once; one line for what is true of several joints."""
    from pumaid.reporting.text import merge_notes

    for line in dict.fromkeys(visible(str(note)) for note in merge_notes(several)):
        head, _, rest = line.partition("]: ")
        click.echo(click.style(head + "]", fg="yellow") + ": " + rest, err=True)


def tables(*parts: Any) -> None:
    """Tables and paragraphs, those that are there, on standard output, with an empty line between them.

    They are as wide as the terminal; in a pipe `WIDTH` characters, uncoloured.
    """
    from rich.console import Console

    from pumaid.reporting.table import WIDTH

    console = Console(file=sys.stdout, highlight=False)
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console.width = WIDTH
    for number, part in enumerate(part for part in parts if part is not None):
        if number:
            say()
        if isinstance(part, str):
            say(part)
        else:
            console.print(part)


def write_result(path: Path, data: str | bytes, what: str = "") -> None:
    """Write a file, and say that `what` is there; ``-`` is standard output."""
    from pumaid.io.write import write_file

    if str(path) == "-":
        content(data)
        return
    write_file(path, data)
    if what:
        remark(f"{what} written to {path}")


def write_picture(path: Path, drawing: Any) -> None:
    """Write a drawing in the form of the file's name, and say so."""
    write_result(path, drawing.file(path.suffix.lstrip(".").lower()), "picture")


def document(content: Mapping[str, Any]) -> None:
    """The one JSON document of ``--json``; arrays become lists, numbers that JSON lacks become null.

    Kind, format and version stand first in every document; the version is ours where the document does not say.
    """
    from pumaid.results.documents import as_text

    head = {"kind": content["kind"], "format": content["format"], "pumaid": __version__}
    click.echo(as_text(head | dict(content), ascii_only=True), nl=False)


def effect_files() -> tuple[Path, ...]:
    """The files that ``--effects`` named in this command."""
    context = click.get_current_context(silent=True)
    return () if context is None else context.meta.get("pumaid.effects", ())


def spare_inputs(places: Iterable[Path | None], read: Iterable[Path | None]) -> None:
    """Refuse to write over what the command reads, under that name or another, before anything is computed.

    `places` is where the command writes (``-`` and none are no files), `read` the files that it works from; the user's
    own effects are taken for granted. ResultError [output-is-input] where a place is one of the files.
    """
    inputs = [path for path in (*read, *effect_files()) if path is not None and str(path) != "-"]
    for place in places:
        if place is None or str(place) == "-":
            continue
        real, is_there = os.path.realpath(place), place.exists()
        taken = [
            path
            for path in inputs
            if os.path.realpath(path) == real or (is_there and path.exists() and path.samefile(place))
        ]
        if taken:
            what = f"{place} is an input (log, recipe, plan, model ...), which a result must not replace"
            also = "" if taken[0] == place else f": it is {taken[0]}"
            raise ResultError("output-is-input", what + also, Where(file=str(place)), "write to another file")


@contextmanager
def progress(title: str, *, total: float | None = None) -> Iterator[Step]:
    """A progress line on standard error, only where it is a terminal.

    Yields ``step(done, text)``: how much of `total` (in any unit, None: unknown) is done, and words on what is at hand.
    """
    if not sys.stderr.isatty():
        yield lambda done, text: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    words = TextColumn("{task.fields[text]}", markup=False)  # names in them may look like styles
    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), words)
    with Progress(*columns, TimeElapsedColumn(), console=Console(stderr=True), transient=True) as shown:
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


def identified(dataset: Dataset, robot: Robot, **choices: Any) -> Estimate:
    """A model of the runs, as `pumaid.identify` makes it, with progress."""
    from pumaid.estimation.estimate import identify

    with progress("identifying", total=robot.n_joints) as step:
        return identify(dataset, robot, progress=lambda joint, text: step(robot.n_joints - joint, text), **choices)
