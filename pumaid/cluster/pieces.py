"""Large files read in pieces, each by itself, and put together again."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from itertools import islice

import numpy as np

from pumaid.cluster.part import Part, joined, read_part
from pumaid.cluster.whole import Whole
from pumaid.errors import LogError, PumaidError
from pumaid.files.parts import FilePart, file_parts
from pumaid.files.remote import Remote
from pumaid.files.table import LogPath, LogReader
from pumaid.motion.options import SegmentOptions
from pumaid.records import Log, Robot

#: Sampling intervals, and seconds, up to which one piece goes on in the next.
_NEAR_INTERVALS, _NEAR_SECONDS = 5.0, 0.05

#: Files for each reader from which small ones are not cut, and the bytes up to which a file is small: there is enough
#: to share out then, and what lies around a cut is looked at by itself.
_ENOUGH, SMALL = 4, 16 << 20

#: What is read of a piece; none of a part that means nothing without what comes before.
Found = Part | PumaidError | None


@dataclass(frozen=True, slots=True)
class Reading:
    """How pieces are read.

    Attributes
    ----------
    robot
        The arm that the recipe says these are logs of.
    options
        Thresholds of the segmentation.
    extra
        Columns to read besides.
    """

    robot: Robot
    options: SegmentOptions
    extra: tuple[str, ...] = ()

    def piece(self, path: LogPath) -> Part | None:
        """Read a file or a part of one; None for a part that means nothing without what comes before.

        Parameters
        ----------
        path
            A file, or some of its row groups.

        Raises
        ------
        LogError
            As the reader does where a file is bad.
        """
        if not isinstance(path, FilePart):
            return self.file(path)
        reader = LogReader((path,), self.robot, extra=self.extra, is_part=True)
        try:
            part = read_part(reader, self.robot, self.options)
        except LogError:
            return None
        return part if reader.is_plain else None

    def file(self, path: LogPath) -> Part:
        """Read a file at once.

        Parameters
        ----------
        path
            The file.

        Raises
        ------
        LogError
            As the reader does where the file is bad.
        """
        return read_part(LogReader((path,), self.robot, extra=self.extra, is_part=True), self.robot, self.options)

    def tried(self, path: LogPath) -> Found:
        """As `piece`; a refusal is returned, to be raised where the part would have come.

        Parameters
        ----------
        path
            A file, or some of its row groups.
        """
        try:
            return self.piece(path)
        except PumaidError as error:
            return error

    def joined(self, *found: Found) -> Found:
        """Consecutive parts as one, or the first refusal.

        Parameters
        ----------
        found
            Whole files, or parts joined of some.
        """
        refused = next((one for one in found if isinstance(one, PumaidError)), None)
        if refused is not None:
            return refused
        parts = (one for one in found if isinstance(one, Part))
        return reduce(partial(joined, robot=self.robot, options=self.options), parts)


def raised(found: Found) -> Part | None:
    """What was read; a refusal is raised.

    Parameters
    ----------
    found
        As `Reading.tried` returns it.

    Raises
    ------
    PumaidError
        It was refused.
    """
    if isinstance(found, PumaidError):
        raise found
    return found


def pieces_of(path: LogPath, *, each: float = 0.0) -> Sequence[LogPath]:
    """What is read by itself of a file.

    Parameters
    ----------
    path
        As `expand` gives it.
    each
        How many files there are for each reader.
    """
    if isinstance(path, FilePart) or (each >= _ENOUGH and size_of(path) <= SMALL):
        return [path]
    return file_parts(path)


def size_of(path: LogPath) -> int:
    """Bytes of a log, 0 where that cannot be told, which who reads it will find."""
    try:
        return path.size if isinstance(path, Remote) else int(path.stat().st_size)
    except OSError:
        return 0


def file_taken(whole: Whole, found: Iterator[Part | None], count: int, *, again: Callable[[], Part | None]) -> Whole:
    """A whole with one more file, of which the pieces come one after the other; its memory is that of a few.

    Parameters
    ----------
    whole
        Of the files before; it must not be used any more.
    found
        What `Reading.piece` made of the pieces, in order.
    count
        How many of them are of this file.
    again
        Reads the file at once, which is done where its pieces do not fit.

    Raises
    ------
    LogError
        As `found` and `again` do.
    """
    before = whole.copy() if count > 1 else whole
    fits, last = True, None
    for part in islice(found, count):
        fits = fits and part is not None and (last is None or _fits(last, part))
        if fits and part is not None:
            whole.add(part, goes_on=last is not None)
            last = part
    if fits:
        return whole
    at_once = again()
    if at_once is not None:
        before.add(at_once)
    return before


def _fits(first: Part, second: Part) -> bool:
    """Whether a file goes on from one piece in the next with nothing to note: no gap, no step back, no wrap."""
    before, after = _last(first), next(iter(second.head), None)
    if before is None or after is None or first.evidence.notes != second.evidence.notes:
        return False
    usual = first.evidence.files[0].interval
    step = float(after.time[0] - before.time[-1])
    way = np.abs(after.position[0] - before.position[-1])
    return 0 < step <= max(_NEAR_INTERVALS * usual, _NEAR_SECONDS) and not bool(np.any(way >= math.pi))


def _last(part: Part) -> Log | None:
    logs = part.head if part.is_open else part.tail
    return logs[-1] if logs else None
