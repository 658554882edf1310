"""Whatever code of others raises, turned into a refusal: no other place of the library catches everything."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from pumaid.errors import ModelError, PumaidError

#: What is not theirs: the user's wish to stop, and a machine that has no more memory.
ESCAPES = (KeyboardInterrupt, MemoryError)


@contextmanager
def refused(refusal: Callable[[str], ModelError]) -> Iterator[None]:
    """Raise a refusal in place of anything that the block raises, be it a wish to leave the program.

    Parameters
    ----------
    refusal
        Makes it from the failure in words.
    """
    try:
        yield
    except (*ESCAPES, PumaidError):
        raise
    except BaseException as failure:
        raise refusal(told(failure)) from failure


def told(failure: BaseException) -> str:
    """A failure's kind, the first line of what it says, and for bad syntax the line of the file."""
    try:
        said = str(failure).strip().splitlines()[:1]
    except Exception:  # its own words fail, too
        said = []
    place = f", line {failure.lineno}" if isinstance(failure, SyntaxError) and failure.lineno else ""
    return ": ".join([type(failure).__name__, *said]) + place
