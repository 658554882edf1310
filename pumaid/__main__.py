"""``python -m pumaid``, and the program ``pumaid``."""

import io
import os
import signal
import sys


class _Deaf(io.FileIO):
    """Standard error that may be full or have lost its reader: a message that nobody hears changes no exit code."""

    def write(self, data: object) -> int:
        try:
            return super().write(data)  # type: ignore[arg-type]
        except OSError:
            return memoryview(data).nbytes  # type: ignore[arg-type]


def run() -> None:
    """Run the command line with three standard streams, also where the caller closed them.

    Were their descriptors left free, the next file that is opened would get them. Ctrl-C ends the program as quietly
    while it is being loaded, or winds up, as in between.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_WRONLY)  # gets the lowest free descriptor, which is this one
    sys.stdin = sys.stdin or os.fdopen(0, closefd=False, encoding="utf-8")
    sys.stdout = sys.stdout or os.fdopen(1, "w", closefd=False, encoding="utf-8")
    if sys.stderr is None or not sys.stderr.isatty():
        deaf = io.BufferedWriter(_Deaf(2, "w", closefd=False))
        sys.stderr = io.TextIOWrapper(deaf, "utf-8", errors="backslashreplace", line_buffering=True)
    try:
        from pumaid.cli import main

        main()
    except KeyboardInterrupt:
        sys.exit(130)
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


if __name__ == "__main__":
    run()
