"""Large files read in pieces, each by itself, and put together again."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from itertools import pairwise

import numpy as np

from pumaid.cluster.part import Part, joined, read_part
from pumaid.errors import LogError
from pumaid.files.parts import FilePart, file_parts
from pumaid.files.table import LogPath, LogReader
from pumaid.motion.options import SegmentOptions
from pumaid.records import Log, Robot

#: Sampling intervals, and seconds, up to which one piece goes on in the next.
_NEAR_INTERVALS, _NEAR_SECONDS = 5.0, 0.05


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
        reader = LogReader((path,), self.robot, extra=self.extra, is_part=True)
        if not isinstance(path, FilePart):
            return read_part(reader, self.robot, self.options)
        try:
            part = read_part(reader, self.robot, self.options)
        except LogError:
            return None
        return part if reader.is_plain else None

    def file(self, path: LogPath, *pieces: Part | None) -> Part:
        """A file of which all pieces were read; read again as a whole where they do not fit.

        Parameters
        ----------
        path
            The file.
        pieces
            All of it, in order.

        Raises
        ------
        LogError
            As the reader does where the file is bad.
        """
        known = [piece for piece in pieces if piece is not None]
        if len(known) < len(pieces) or not all(_fits(*pair) for pair in pairwise(known)):
            whole = LogReader((path,), self.robot, extra=self.extra, is_part=True)
            return read_part(whole, self.robot, self.options)
        if len(known) == 1:
            return known[0]
        part = self.joined(*known)
        files = part.evidence.files
        facts = replace(files[0], rows=sum(one.rows for one in files), last_time=files[-1].last_time)
        return replace(part, evidence=replace(part.evidence, files=(facts,), notes=known[0].evidence.notes))

    def joined(self, *parts: Part) -> Part:
        """Consecutive parts as one."""
        return reduce(partial(joined, robot=self.robot, options=self.options), parts)


def pieces_of(path: LogPath) -> Sequence[LogPath]:
    """What can be read by itself of a file.

    Parameters
    ----------
    path
        As `expand` gives it.
    """
    return [path] if isinstance(path, FilePart) else file_parts(path)


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
