"""Logs read ahead: a second thread reads and cleans the next batches while the ones before are looked at."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from queue import Empty, Queue
from threading import Event

from pumaid.errors import Note
from pumaid.records import FileFacts, Log

#: Batches that may wait; more would only cost memory.
WAITING = 2
#: s; how often one who gives up looks whether the reader has ended.
_PATIENCE = 0.05


class Ahead:
    """The same batches in the same order, read by a second thread while the first one works on those before.

    Decoding, and arithmetic on whole batches, leave Python's lock to the other thread. What the stream below raises is
    raised here, where its batch would have come. If iteration is given up, by an error or Ctrl-C, the thread ends.

    Parameters
    ----------
    logs
        Consecutive batches. What the iterable tells of its files (`files`, `notes`, `extra`) is taken over.

    Examples
    --------
    >>> evidence = segment(Ahead(Watch(LogReader(paths, robot), robot)), robot)  # doctest: +SKIP
    """

    def __init__(self, logs: Iterable[Log]) -> None:
        self._logs = logs

    @property
    def files(self) -> tuple[FileFacts, ...]:
        """Facts of the files, complete once the stream has ended."""
        return tuple(getattr(self._logs, "files", ()))

    @property
    def notes(self) -> tuple[Note, ...]:
        """Notes of the stream below, complete once it has ended."""
        return tuple(getattr(self._logs, "notes", ()))

    @property
    def extra(self) -> tuple[str, ...]:
        """Names of the columns that the stream below reads besides."""
        return tuple(getattr(self._logs, "extra", ()))

    def __iter__(self) -> Iterator[Log]:
        waiting: Queue[Log | None] = Queue(WAITING)
        unwanted = Event()
        with ThreadPoolExecutor(1, thread_name_prefix="read-ahead") as pool:
            done = pool.submit(_read, self._logs, waiting, unwanted)
            try:
                while (log := waiting.get()) is not None:
                    yield log
                done.result()
            finally:
                unwanted.set()
                while not done.done():
                    _take_one(waiting)


def _read(logs: Iterable[Log], waiting: Queue[Log | None], unwanted: Event) -> None:
    try:
        for log in logs:
            waiting.put(log)
            if unwanted.is_set():
                return
    finally:
        waiting.put(None)


def _take_one(waiting: Queue[Log | None]) -> None:
    """Make room for a reader that waits to tell that it has ended."""
    with suppress(Empty):
        waiting.get(timeout=_PATIENCE)
