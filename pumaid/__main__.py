"""``python -m pumaid``, and the program ``pumaid``."""

from __future__ import annotations

import gc
import signal
import sys

#: Objects made and not let go between two looks for cycles that nobody holds: loading libraries makes a hundred
#: thousand of them, all of which stay, and looking at them again and again took a tenth of its time.
_BETWEEN_LOOKS = 50_000


def run() -> None:
    """Run the command line; Ctrl-C while the program is still being loaded ends it as quietly as later."""
    gc.set_threshold(_BETWEEN_LOOKS)
    try:
        from pumaid.cli import main

        main()
    except KeyboardInterrupt:
        sys.exit(130)
    finally:
        # What is done is done: Ctrl-C while Python winds up would end it without a word.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        # Everything goes with the process: looking through it once more for garbage took a tenth of a second.
        gc.freeze()


if __name__ == "__main__":
    run()
