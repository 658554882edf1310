"""What the C library of Linux does with memory that is let go: kept for the next batch, or given back to the system."""

from __future__ import annotations

import ctypes
from contextlib import suppress

#: malloc.h: options M_MMAP_THRESHOLD, with the largest value that it knows, and M_TRIM_THRESHOLD, in bytes.
_MMAP, _LARGEST, _TRIM = -3, 32 << 20, -1
#: Bytes of free memory that a process keeps while it reads logs, and that it keeps as a guest on somebody's cluster.
_KEPT, _LEFT = 256 << 20, 64 << 10


def keep_memory() -> None:
    """Keep what is let go for the next batch: fresh pages cost a quarter of a short pass.

    Workers of a cluster give everything back at once, unless they are told otherwise; a pass then takes half as long
    again.
    """
    _told({_MMAP: _LARGEST, _TRIM: _KEPT})


def give_back_memory() -> None:
    """Give back what is kept now: what a pass held between runs that stay is there for what follows."""
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


def leave_memory() -> None:
    """Keep next to nothing any more, on a worker that others use, too."""
    _told({_TRIM: _LEFT})
    give_back_memory()


def _told(options: dict[int, int]) -> None:
    with suppress(OSError, AttributeError, TypeError):
        library = ctypes.CDLL(None)
        for option, size in options.items():
            library.mallopt(option, size)
