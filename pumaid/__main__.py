"""``python -m pumaid``, and the program ``pumaid``."""

import os
import signal
import sys
from io import TextIOWrapper


def run() -> None:
    """Run the command line with three standard streams, also where the caller closed them.

    Ctrl-C ends the program as quietly while it is being loaded, or winds up, as in between.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:  # the lowest free descriptor, which is this one, leads nowhere
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_RDWR), mode))
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
