"""What one pass leaves of some of the files of an experiment, such that parts can be joined."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pumaid.errors import Note
from pumaid.files.evidence_npz import read_evidence, write_evidence
from pumaid.files.table import LogPath, LogReader
from pumaid.motion.block import Buffer
from pumaid.motion.options import SegmentOptions
from pumaid.motion.seam import RESTFUL, Side, are_apart, first_side, last_side
from pumaid.motion.suspicion import Sums
from pumaid.records import Evidence, FileFacts, Log, Robot
from pumaid.verbs.segment import segment


@dataclass(frozen=True, eq=False, slots=True)
class Part:
    """A part of the logs.

    Attributes
    ----------
    evidence
        Runs and rejects, their clocks counted from the part's first; notes as each file has them.
    sums
        By which it is judged what the columns mean.
    clocks
        How many recordings began in it.
    first, last
        Its ends; None without samples.
    """

    evidence: Evidence
    sums: Sums
    clocks: int
    first: Side | None
    last: Side | None

    def __reduce__(self) -> tuple[object, ...]:
        """Between processes runs travel as a few long arrays; one by one they would be ten small ones each."""
        stream = io.BytesIO()
        write_evidence(stream, self.evidence)
        return _arrived, (stream.getvalue(), self.sums, self.clocks, self.first, self.last)


def _arrived(stored: bytes, *more: Any) -> Part:
    """A part that came from another process."""
    evidence = read_evidence(io.BytesIO(stored))
    if evidence is None:
        raise ValueError("a part of the logs arrived broken")
    return Part(evidence, *more)


def read_part(paths: Sequence[LogPath], robot: Robot, options: SegmentOptions) -> Part:
    """Read and segment some consecutive files.

    Parameters
    ----------
    paths
        At least one.
    robot
        The arm that the recipe says these are logs of.
    options
        Thresholds of the segmentation.

    Raises
    ------
    LogError
        As the reader does where a file alone is bad.
    """
    logs = _Tallied(LogReader(paths, robot, is_part=True), robot, options)
    evidence = segment(logs, robot, options=options)
    return Part(replace(evidence, notes=logs.reader.raw_notes), logs.sums, logs.clocks, *logs.sides())


class _Tallied:
    """A stream of logs of which sums are kept, recordings counted, and both ends looked at."""

    def __init__(self, reader: LogReader, robot: Robot, options: SegmentOptions) -> None:
        self.reader, self.sums, self.clocks = reader, Sums(robot), 1
        self._options = options
        self._head, self._tail = Buffer(0), Buffer(0)

    @property
    def files(self) -> tuple[FileFacts, ...]:
        return self.reader.files

    @property
    def notes(self) -> tuple[Note, ...]:
        return self.reader.raw_notes

    def __iter__(self) -> Iterator[Log]:
        for log in self.reader:
            self.clocks += log.starts_clock
            self.sums.take(log)
            self._look(log)
            yield log
        self.sums.close()

    def _look(self, log: Log) -> None:
        if not len(log):
            return
        if not len(self._head) or np.ptp(self._head.head(0, RESTFUL)[0]) < RESTFUL:
            self._head.add(log)
        if log.starts_clock:
            self._tail = Buffer(0)
        self._tail.add(log)
        while len(self._tail) > len(log):
            time, _ = self._tail.tail(len(self._tail), RESTFUL)
            if time[-1] - time[0] < RESTFUL or len(time) >= len(self._tail):
                break
            self._tail.drop(len(self._tail) - len(time), 0)

    def sides(self) -> tuple[Side | None, Side | None]:
        """Both ends; None without samples."""
        if not len(self._tail):
            return None, None
        first = first_side(*self._head.head(0, RESTFUL), self._options)
        return first, last_side(*self._tail.tail(len(self._tail), RESTFUL), self._options)


def goes_on(before: Side | None, after: Side | None) -> bool:
    """Whether a motion may go on from one part in the next, so that the two must be read together."""
    if before is None or after is None:
        return before is not after
    return after.time > before.time and not are_apart(before, after)


def joined(first: Part, second: Part) -> Part:
    """Two consecutive parts as one; joining is associative.

    Parameters
    ----------
    first, second
        In the order of their files; no motion goes on from the one in the other.
    """
    before, after = first.last, second.first
    follows = before is not None and after is not None and after.time > before.time
    shift = first.clocks - (1 if follows or before is None or after is None else 0)
    runs = tuple(replace(run, clock=run.clock + shift) for run in second.evidence.runs)
    rejects = tuple(replace(reject, clock=reject.clock + shift) for reject in second.evidence.rejects)
    a, b = first.evidence, second.evidence
    evidence = Evidence((*a.runs, *runs), (*a.rejects, *rejects), (*a.files, *b.files), (*a.notes, *b.notes))
    ends = first.first or second.first, second.last or first.last
    sums = deepcopy(first.sums)  # a part may be joined again, where a worker is lost
    sums.absorb(deepcopy(second.sums))
    return Part(evidence, sums, shift + second.clocks, *ends)
