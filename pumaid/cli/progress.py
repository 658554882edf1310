"""A progress line on standard error, only where it is a terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from pumaid.errors import visible

Step = Callable[[float, str], None]


def _nothing(done: float, text: str) -> None:
    """What progress is where nobody watches."""


@contextmanager
def progress(title: str, *, total: float | None = None) -> Iterator[Step]:
    """Show long work.

    Parameters
    ----------
    title
        What is being done.
    total
        Amount of work, in any unit; None where it is not known beforehand.

    Yields
    ------
    step
        ``step(done, text)``: how much of `total` is done, and a few words on what is at hand.
    """
    if not sys.stderr.isatty():
        yield _nothing
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
