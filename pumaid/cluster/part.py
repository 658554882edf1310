"""What one pass leaves of some of the files of an experiment, such that parts can be joined."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from pumaid.errors import Note
from pumaid.files.table import LogPath, LogReader
from pumaid.motion.options import SegmentOptions
from pumaid.motion.tally import Tally
from pumaid.records import Evidence, FileFacts, Log, Reject, Robot, Run
from pumaid.verbs.segment import RESTFUL, segment

#: s between the last sample of a file and the first of the next from which no motion can go on from one to the other.
FAR = 1.0


@dataclass(frozen=True, eq=False, slots=True)
class Part:
    """A part of the logs.

    Attributes
    ----------
    evidence
        Runs and rejects, their clocks counted from the part's first; notes as each file has them.
    tally
        Sums by which it is judged what the columns mean.
    clocks
        How many recordings began in it.
    """

    evidence: Evidence
    tally: Tally
    clocks: int

    @property
    def edge(self) -> Edge:
        """What the neighbours must know."""
        rows = [facts for facts in self.evidence.files if facts.rows]
        everything = sorted([*self.evidence.runs, *self.evidence.rejects], key=lambda one: (one.clock, one.start))
        if not rows or not everything:
            return Edge(None, None, True, True)
        first, last = everything[0], everything[-1]
        return Edge(rows[0].first_time, rows[-1].last_time, _rests(first), _rests(last))


@dataclass(frozen=True, slots=True)
class Edge:
    """First and last time of a part (s; None without samples), and whether the arm rests there for long enough."""

    first_time: float | None
    last_time: float | None
    begins_at_rest: bool
    ends_at_rest: bool

    def goes_on_in(self, following: Edge) -> bool:
        """Whether a motion may go on from this part in the following one, so that the two must be read together."""
        if self.last_time is None or following.first_time is None:
            return False
        gap = following.first_time - self.last_time
        return 0.0 < gap <= FAR and not (self.ends_at_rest and following.begins_at_rest)


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
    logs = _Tallied(LogReader(paths, robot, is_part=True), robot)
    evidence = segment(logs, robot, options=options)
    return Part(replace(evidence, notes=logs.reader.raw_notes), logs.tally, logs.clocks)


class _Tallied:
    """A stream of logs of which sums are kept, and its recordings counted."""

    def __init__(self, reader: LogReader, robot: Robot) -> None:
        self.reader, self.tally, self.clocks = reader, Tally(robot), 1

    @property
    def files(self) -> tuple[FileFacts, ...]:
        return self.reader.files

    @property
    def notes(self) -> tuple[Note, ...]:
        return self.reader.raw_notes

    def __iter__(self) -> Iterator[Log]:
        for log in self.reader:
            self.clocks += log.starts_clock
            self.tally.take(log)
            yield log


def _rests(one: Run | Reject) -> bool:
    """Whether a stretch is a rest in which the segmentation may end a window."""
    return isinstance(one, Reject) and one.reason == "rest" and one.duration >= RESTFUL


def joined(first: Part, second: Part) -> Part:
    """Two consecutive parts as one; joining is associative.

    Parameters
    ----------
    first, second
        In the order of their files; no motion goes on from the one in the other.
    """
    before, after = first.edge.last_time, second.edge.first_time
    follows = before is not None and after is not None and after > before
    shift = first.clocks - (1 if follows or before is None else 0)
    runs = tuple(replace(run, clock=run.clock + shift) for run in second.evidence.runs)
    rejects = tuple(replace(reject, clock=reject.clock + shift) for reject in second.evidence.rejects)
    a, b = first.evidence, second.evidence
    evidence = Evidence((*a.runs, *runs), (*a.rejects, *rejects), (*a.files, *b.files), (*a.notes, *b.notes))
    return Part(evidence, first.tally.with_more(second.tally), shift + second.clocks)
