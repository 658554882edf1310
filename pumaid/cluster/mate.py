"""One more process that reads pieces of logs, and the way what it read takes to this one."""

from __future__ import annotations

import gc
import io
import os
import signal
import sys
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from multiprocessing.context import ForkProcess, SpawnProcess
from multiprocessing.reduction import ForkingPickler
from queue import Queue
from threading import Thread
from typing import Any
from warnings import catch_warnings, simplefilter

from pumaid.cluster.pieces import Found, Reading
from pumaid.files.table import LogPath

#: Whether a process begins with all that this one has loaded.
CAN_FORK = sys.platform == "linux"


class Mate:
    """One more process that reads pieces, until it is left; it ends with the process that asked for it."""

    def __init__(self, reading: Reading) -> None:
        # What is loaded is there at once where a process can be forked; nothing else runs yet where it is.
        self._here, there = Pipe()
        process = ForkProcess if CAN_FORK else SpawnProcess
        self._process = process(target=_serve, args=(there, self._here, reading), daemon=True)
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

    def ask(self, piece: LogPath) -> None:
        """Have it read a piece after those that it was asked for before.

        Raises
        ------
        OSError
            The process has ended.
        """
        self._here.send(piece)

    def leave(self) -> None:
        """Have it end when it has read what it was asked for.

        Raises
        ------
        OSError
            The process has ended.
        """
        self._here.send(None)

    def take(self) -> Found:
        """What it read of the first piece that was not taken yet, or what it raises.

        Raises
        ------
        OSError, EOFError
            The process has ended.
        """
        found: Found = _received(self._here)
        return found


def _serve(there: Connection, here: Connection, reading: Reading) -> None:
    """Read pieces until it is left; Ctrl-C is for the process that asks."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    here.close()
    found = Queue[Found](maxsize=1)
    # The next piece is read while the last one is on its way.
    Thread(target=_send_all, args=(there, found), daemon=True).start()
    # Whatever it is, the first process meets it, too, when it reads the piece itself, and tells it.
    with suppress(Exception):
        for piece in iter(there.recv, None):
            found.put(reading.tried(piece))
    os._exit(0)  # what it holds goes with it; nothing has to be taken apart


def _send_all(there: Connection, found: Queue[Found]) -> None:
    try:
        while True:
            _send(there, found.get())
    finally:
        os._exit(1)  # who asked for it reads what did not come


def _send(there: Connection, thing: Found) -> None:
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
