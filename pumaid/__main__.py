"""``python -m pumaid``, and the program ``pumaid``."""

from __future__ import annotations

import atexit
import errno
import gc
import io
import os
import signal
import sys
from _thread import interrupt_main

#: Objects made and not let go between two looks for cycles that nobody holds: loading libraries makes a hundred
#: thousand of them, all of which stay, and looking at them again and again took a tenth of its time.
_BETWEEN_LOOKS = 50_000
#: s after which a Ctrl-C that was not heard is sent again.
_LATER = 0.01


class _Deaf(io.FileIO):
    """Standard error that may be full or have lost its reader: what worked has worked although nobody hears of it."""

    def write(self, data: object) -> int:
        try:
            return super().write(data)  # type: ignore[arg-type]
        except OSError:
            return memoryview(data).nbytes  # type: ignore[arg-type]


class _Closed(io.RawIOBase):
    """Standard input that the caller closed: reading it is refused in words that say so."""

    def readable(self) -> bool:
        return True

    def readinto(self, place: object) -> int:
        raise OSError(errno.EBADF, "standard input is closed", "standard input")


def open_streams() -> None:
    """Have all three standard streams, also where the caller closed them.

    A closed output is one that nobody reads; a closed input cannot be read, which whoever reads it then tells. Were
    their descriptors left free, the next file that is opened would get them.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            opened = os.open(os.devnull, os.O_WRONLY)
            os.dup2(opened, number)
            os.set_inheritable(number, True)
            if opened != number:
                os.close(opened)
    sys.stdin = sys.stdin or io.TextIOWrapper(io.BufferedReader(_Closed()), "utf-8")
    sys.stdout = sys.stdout or io.TextIOWrapper(io.BufferedWriter(io.FileIO(1, "w", closefd=False)), "utf-8")
    if sys.stderr is None or not sys.stderr.isatty():
        deaf = io.BufferedWriter(_Deaf(2, "w", closefd=False))
        encoding = getattr(sys.stderr, "encoding", None) or "utf-8"
        sys.stderr = io.TextIOWrapper(deaf, encoding, errors="backslashreplace", line_buffering=True)


def keep_interrupts() -> None:
    """Have Ctrl-C heard at any instant: one that arrives while Python lets an object go would be printed and lost."""
    before = sys.unraisablehook

    def hook(told: sys.UnraisableHookArgs) -> None:
        if not issubclass(told.exc_type, KeyboardInterrupt):
            before(told)
            return
        import threading

        def again() -> None:
            if hasattr(signal, "pthread_kill"):  # it wakes a wait, too
                signal.pthread_kill(main.ident or 0, signal.SIGINT)
            else:
                interrupt_main()

        main, later = threading.main_thread(), threading.Timer(_LATER, again)
        later.daemon = True
        later.start()

    sys.unraisablehook = hook


def run() -> None:
    """Run the command line; Ctrl-C while the program is still being loaded ends it as quietly as later."""
    gc.set_threshold(_BETWEEN_LOOKS)
    open_streams()
    keep_interrupts()
    left = [1]
    # Registered first, it is called last: after threads, other processes and temporary files were seen to.
    atexit.register(_leave, left)
    try:
        from pumaid.cli import main
        from pumaid.cli.loading import load_later

        load_later()
        main()
    except KeyboardInterrupt:
        left[0] = 130
        sys.exit(130)
    except SystemExit as end:
        left[0] = end.code if isinstance(end.code, int) else int(end.code is not None)
        raise
    finally:
        # What is done is done: Ctrl-C while Python winds up would end it without a word.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        # Everything goes with the process: looking through it once more for garbage took a tenth of a second.
        gc.freeze()


def _leave(code: list[int]) -> None:
    """End at once: taking a hundred thousand objects apart that all go with the process takes 0.04 s."""
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except (OSError, ValueError):
        return  # Python says what there is to say
    os._exit(code[0])


if __name__ == "__main__":
    run()
