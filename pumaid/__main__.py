"""``python -m pumaid``, and the program ``pumaid``."""

import os
import signal
import sys
from io import BufferedWriter, FileIO, TextIOWrapper
from typing import Any


class Remarks(FileIO):
    """Standard error: where it cannot be written, what was to be told is lost, and the work goes on."""

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except OSError:
            return len(data)


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
    encoding = sys.stderr.encoding if sys.stderr else "utf-8"
    remarks = BufferedWriter(Remarks(2, "w", closefd=False))
    sys.stderr = TextIOWrapper(remarks, encoding, line_buffering=True)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal that lacks a letter shows ? rather than our failure
    try:
        from pumaid.cli import group

        group.main(prog_name="pumaid")
    except KeyboardInterrupt:
        sys.exit(130)
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


if __name__ == "__main__":
    run()
