"""One run at a time in a folder: what is read there, numbered and written belongs to one run only."""

from __future__ import annotations

import importlib
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from pumaid.errors import ResultError, Where

#: s; longest wait for another run, which writes for a fraction of a second, and how often it is looked.
PATIENCE, PAUSE = 20.0, 0.02


@contextmanager
def alone(folder: Path, *, patience: float = PATIENCE) -> Iterator[None]:
    """Keep other runs of the program out of a folder while the block lasts.

    The folder itself is locked, so nothing is left behind; the system lets go of it when a run ends, however it ends.
    Where a disk or system knows no such locks (Windows) the block runs without one, and where the folder cannot be made
    the writing itself tells what is wrong.

    Parameters
    ----------
    folder
        Made if it is missing.
    patience
        s; how long to wait for another run.

    Raises
    ------
    ResultError [results-busy]
        Another run does not let go in that time.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        yield
        return
    try:
        _wait(_locker(handle), folder, patience)
        yield
    finally:
        os.close(handle)


def _locker(handle: int) -> Callable[[], None]:
    """A call that locks or raises: `BlockingIOError` where another run has the lock."""
    try:
        fcntl = importlib.import_module("fcntl")
    except ImportError:
        return lambda: None
    return lambda: fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _wait(lock: Callable[[], None], folder: Path, patience: float) -> None:
    end = time.monotonic() + patience
    while True:
        try:
            return lock()
        except BlockingIOError:
            if time.monotonic() > end:
                what = f"another run of pumaid has been writing to {folder} for {patience:g} s"
                mend = "wait until it is over, or write elsewhere with --results"
                raise ResultError("results-busy", what, Where(file=str(folder)), mend) from None
        except OSError:
            return None
        time.sleep(PAUSE)
