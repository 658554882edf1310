"""``python -m pumaid``, and the program ``pumaid``."""

from __future__ import annotations

import sys


def run() -> None:
    """Run the command line; Ctrl-C while the program is still being loaded ends it as quietly as later."""
    try:
        from pumaid.cli import main

        main()
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    run()
