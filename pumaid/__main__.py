"""``python -m pumaid``, and the program ``pumaid``."""

from __future__ import annotations

import os
import sys
from pathlib import Path

#: Exit code of a program that Ctrl-C ended, as shells count it.
INTERRUPTED = 130


def open_streams() -> None:
    """Have all three standard streams: one that the caller closed leads nowhere, and is empty if it is read."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open(mode))  # noqa: SIM115 - it stays open as long as the program runs


def run() -> None:
    """Run the command line; Ctrl-C while the program is still being loaded ends it without a traceback."""
    open_streams()
    try:
        from pumaid.cli import main

        main()
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    run()
