"""Large files read in pieces, each by itself, and put together again."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial, reduce

import numpy as np

from pumaid.cluster.part import Part, joined, lower, read_part
from pumaid.cluster.whole import Whole
from pumaid.errors import LogError, PumaidError
from pumaid.io.oddities import Oddities
from pumaid.io.parts import FilePart, file_parts
from pumaid.io.remote import Remote
from pumaid.io.table import LogPath, LogReader
from pumaid.preprocessing.options import SegmentOptions
from pumaid.robot import Robot

#: Files for each reader from which small ones are not cut, and the bytes of Parquet up to which a file is small: there
#: is enough to share out then, and what lies around a cut is looked at by itself.
_ENOUGH, SMALL = 4, 16 << 20

#: What is read of a piece; none of a part of a file that is refused by itself, of which the whole file has to tell.
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
        """Read a file or a part of one; None for a part that is refused by itself: the whole file has to tell.

        Parameters
        ----------
        path
            A file, or a part of one.

        Raises
        ------
        LogError
            As the reader does where a file is bad.
        """
        if not isinstance(path, FilePart):
            return self.file(path)
        reader = LogReader((path,), self.robot, extra=self.extra, is_part=True)
        try:
            return read_part(reader, self.robot, self.options)
        except LogError:
            return None

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
            A file, or a part of one.
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
    if isinstance(path, FilePart):
        return [path]
    return file_parts(path, whole=SMALL if each >= _ENOUGH else 0)


#: Bytes of a log, and what else tells that another one has its name: times of change (ns) and inode.
State = tuple[int, ...]


def state_of(path: LogPath) -> State:
    """What a log is known by before it is read; of a store its size alone.

    Where nothing can be told it has no bytes, and who reads it will find out why.
    """
    try:
        if isinstance(path, Remote):
            return (path.size,)
        state = path.stat()
        return int(state.st_size), int(state.st_mtime_ns), int(state.st_ctime_ns), int(state.st_ino)
    except OSError:
        return (0,)


def file_taken(
    whole: Whole,
    found: Iterator[Part | None],
    count: int,
    *,
    path: LogPath,
    state: State,
    again: Callable[[], Part],
) -> Whole:
    """A whole with one more file, of which the pieces come one after the other; its memory is that of a few.

    Parameters
    ----------
    whole
        Of the files before; it must not be used any more.
    found
        What `Reading.piece` made of the file's pieces, in order; not all are taken where they do not fit.
    count
        How many there are.
    path, state
        The file, and what it was known by when it was cut.
    again
        Reads the file at once, which is done where its pieces do not fit.

    Raises
    ------
    LogError
        As `found` and `again` do.
    """
    if count == 1:
        whole.add(next(found) or again())
        return whole
    before, fits, last, odd = whole.copy(), True, None, None
    for part in found:
        if part is None or part.odd is None:
            fits = False
        elif last is None or odd is None:
            fits, odd, last = part.odd.can_join, part.odd, part
            whole.add(part)
        elif not part.odd.n_rows:  # empty lines or comments
            odd.n_lines += part.odd.n_lines
        elif fits := odd.fit(part.odd) and _joins(last, part, odd):
            whole.add(lower(part, odd.n_lines - part.odd.n_lines), goes_on=True)
            last = part
        if not fits:
            break
    # One who writes a file while it is read, or puts another in its place, has changed what was cut.
    if fits and odd is not None and odd.intervals.is_settled and state_of(path) == state:
        whole.note(odd.notes())
        return whole
    before.add(again())
    return before


def _joins(first: Part, second: Part, odd: Oddities) -> bool:
    """Take what is odd about the next piece to that of those before, unless time steps back or a joint wraps there."""
    before = first.head if first.is_open else first.tail
    if not before or not second.head or second.odd is None or first.dataset.notes != second.dataset.notes:
        return False
    last, following = before[-1], second.head[0]
    border = float(last.time[-1]), float(following.time[0])
    if border[1] <= border[0] or bool(np.any(np.abs(following.position[0] - last.position[-1]) >= math.pi)):
        return False
    odd.join(second.odd, border=border)
    return True
