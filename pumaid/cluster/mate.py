"""One more process that does tasks, and the way what comes of them takes to this one."""

from __future__ import annotations

import gc
import io
import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from multiprocessing.context import ForkProcess, SpawnProcess
from multiprocessing.reduction import ForkingPickler
from queue import Queue
from threading import Thread
from typing import Any
from warnings import catch_warnings, simplefilter

Work = Callable[[Any], Any]

#: Whether a process begins with all that this one has loaded.
CAN_FORK = sys.platform == "linux"


class Mate:
    """One more process that does tasks, until it is left; it ends with the process that asked for it.

    Parameters
    ----------
    work
        What is done with a task; where no process can be forked it must be one that can be pickled.
    """

    def __init__(self, work: Work) -> None:
        # What is loaded is there at once where a process can be forked; nothing else runs yet where it is.
        self._here, there = Pipe()
        process = ForkProcess if CAN_FORK else SpawnProcess
        self._process = process(target=_serve, args=(there, self._here, work), daemon=True)
        with catch_warnings():
            # Python warns of threads that a forked process lacks; those of Arrow and OpenBLAS expect it.
            simplefilter("ignore", DeprecationWarning)
            # What is loaded is no garbage; looking for it there would copy all its pages into the other process.
            gc.freeze()
            self._process.start()
            gc.unfreeze()
        there.close()

    def __enter__(self) -> Mate:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.join()
        # The connection is closed with the last who holds it; another thread may just find that nobody answers.

    @property
    def pid(self) -> int | None:
        """Number of the process."""
        return self._process.pid

    @property
    def is_alive(self) -> bool:
        """Whether the process runs."""
        return self._process.is_alive()

    def ask(self, task: Any) -> None:
        """Have it do a task after those that it was asked for before.

        Raises
        ------
        OSError
            The process has ended.
        """
        self._here.send(task)

    def leave(self) -> None:
        """Have it end when it has done what it was asked for.

        Raises
        ------
        OSError
            The process has ended.
        """
        self._here.send(None)

    def take(self) -> Any:
        """What came of the first task of which that was not taken yet.

        Raises
        ------
        OSError, EOFError
            The process has ended.
        """
        return _received(self._here)


def _serve(there: Connection, here: Connection, work: Work) -> None:
    """Do tasks until it is left; Ctrl-C is for the process that asks."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    here.close()
    found = Queue[Any](maxsize=1)
    # The next task is done while what came of the last one is on its way.
    Thread(target=_send_all, args=(there, found), daemon=True).start()
    # Whatever it is, the first process meets it, too, when it does the task itself, and tells it.
    with suppress(Exception):
        for task in iter(there.recv, None):
            found.put(work(task))
    os._exit(0)  # what it holds goes with it; nothing has to be taken apart


def _send_all(there: Connection, found: Queue[Any]) -> None:
    try:
        while True:
            _send(there, found.get())
    finally:
        os._exit(1)  # who asked for it does what did not come


def _send(there: Connection, thing: Any) -> None:
    """Send it such that long arrays are copied neither here nor there."""
    plain, buffers = io.BytesIO(), list[Any]()
    ForkingPickler(plain, 5, True, buffers.append).dump(thing)
    views = [buffer.raw() for buffer in buffers]
    there.send([view.nbytes for view in views])
    there.send_bytes(plain.getbuffer())
    for view in views:
        there.send_bytes(view)


def _received(here: Connection) -> Any:
    sizes = here.recv()
    plain = here.recv_bytes()
    buffers = [bytearray(size) for size in sizes]
    for buffer in buffers:
        here.recv_bytes_into(buffer)
    return ForkingPickler.loads(plain, buffers=buffers)
