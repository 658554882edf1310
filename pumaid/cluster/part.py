"""What one pass leaves of a part of an experiment's logs, such that parts can be joined."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from operator import attrgetter
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Dataset, FileFacts, Reject, Run
from pumaid.io.oddities import Oddities
from pumaid.io.packing import packed, unpacked
from pumaid.io.table import LogReader
from pumaid.preprocessing.options import SegmentOptions
from pumaid.preprocessing.segmenter import Segmenter
from pumaid.preprocessing.suspicion import Sums
from pumaid.records import Log
from pumaid.robot import Robot

Kept = TypeVar("Kept", Run, Reject)


@dataclass(frozen=True, eq=False, slots=True)
class Part:
    """A part of the logs: what lies between its first and its last rest is looked at, its ends are not.

    Attributes
    ----------
    dataset
        Runs and rejects, their clocks counted from the first one's; notes as each file has them.
    sums
        By which it is judged what the columns mean.
    clocks
        How many recordings begin behind the first sample that was looked at, and before the tail.
    head, tail
        Samples that the parts before and behind complete.
    is_open
        Whether the arm never rests, so that all of it is head.
    odd
        What is odd about a part of a file; its own notes are then those on the columns.
    """

    dataset: Dataset
    sums: Sums
    clocks: int
    head: tuple[Log, ...]
    tail: tuple[Log, ...]
    is_open: bool
    odd: Oddities | None = None

    def __reduce__(self) -> tuple[object, ...]:
        """Between processes runs travel as a few long arrays, which a transport that can do so does not copy."""
        more = (self.sums, self.clocks, self.head, self.tail, self.is_open, self.odd)
        return _arrived, (packed(self.dataset), *more)


def _arrived(arrays: dict[str, NDArray[Any]], *more: Any) -> Part:
    """A part that came from another process."""
    return Part(unpacked(arrays), *more)


def read_part(reader: LogReader, robot: Robot, options: SegmentOptions) -> Part:
    """Read and segment some logs.

    Parameters
    ----------
    reader
        Of consecutive files or a part of one; it knows that these are not all.
    robot
        The arm that the recipe says these are logs of.
    options
        Thresholds of the segmentation.

    Raises
    ------
    LogError
        As the reader does where a file alone is bad.
    """
    logs = _Summed(reader, robot)
    segmenter = Segmenter(robot, options, is_part=True)
    segmenter.take(logs)
    runs, rejects = segmenter.close()
    if reader.odd is None:
        logs.sums.settle()
    dataset = Dataset(runs, rejects, reader.files, reader.raw_notes, reader.extra)
    ends = (segmenter.head, segmenter.tail, segmenter.is_open)
    return Part(dataset, logs.sums, segmenter.clock, *ends, reader.odd)


class _Summed:
    """A stream of logs of which sums are kept."""

    def __init__(self, logs: LogReader, robot: Robot) -> None:
        self._logs, self.sums = logs, Sums(robot)

    def __iter__(self) -> Iterator[Log]:
        for log in self._logs:
            self.sums.take(log)
            yield log


def joined(first: Part, second: Part, *, robot: Robot, options: SegmentOptions) -> Part:
    """Two consecutive parts as one; joining is associative.

    Parameters
    ----------
    first, second
        In the order of their files.
    robot, options
        As they were read with.
    """
    sums = first.sums.copy()  # a part may be joined again, where a worker is lost
    sums.absorb(second.sums.copy())
    head = behind(first.dataset.files, second, robot)
    if first.is_open:
        dataset = _together(first.dataset, second.dataset)
        return Part(dataset, sums, second.clocks, (*first.head, *head), second.tail, second.is_open)
    if second.is_open:
        dataset = _together(first.dataset, second.dataset)
        return Part(dataset, sums, first.clocks, first.head, (*first.tail, *head), is_open=False)
    middle, clock = between((*first.tail, *head), robot, options, clock=first.clocks)
    dataset = _together(first.dataset, middle, later(second.dataset, clock))
    return Part(dataset, sums, clock + second.clocks, first.head, second.tail, is_open=False)


def behind(before: Sequence[FileFacts], part: Part, robot: Robot) -> tuple[Log, ...]:
    """The head of a part that comes after some files; its first log tells where another recording begins with it.

    Parameters
    ----------
    before
        The files of the parts before.
    part
        The next one.
    robot
        As it was read with.
    """
    last = next((facts.last_time for facts in reversed(before) if facts.rows), None)
    first = next((facts.first_time for facts in part.dataset.files if facts.rows), None)
    if last is None or first is None or first > last:
        return part.head
    if part.head:
        return (replace(part.head[0], starts_clock=True), *part.head[1:])
    rows, values = np.zeros(0, dtype=np.int64), np.zeros((0, robot.n_joints))
    return (Log("", rows, np.zeros(0), values, None, values, starts_clock=True),)


def between(logs: Sequence[Log], robot: Robot, options: SegmentOptions, *, clock: int | None) -> tuple[Dataset, int]:
    """What is left of the samples between two rests, and the number of the last one's recording.

    Parameters
    ----------
    logs
        The tail of one part and the head of the next.
    robot, options
        As they were read with.
    clock
        Number of the recording before them; None where there is none.
    """
    segmenter = Segmenter(robot, options, clock=clock)
    for log in logs:
        segmenter.add(log)
    runs, rejects = segmenter.close()
    return Dataset(runs, rejects), segmenter.clock


def lower(part: Part, lines: int) -> Part:
    """The same where so many lines of its file lie before it.

    Parameters
    ----------
    part
        Of a text, its rows counted from its own first line.
    lines
        How many.
    """
    if not lines:
        return part
    dataset = _moved(part.dataset, first_row=lines, last_row=lines)
    head, tail = (tuple(replace(log, rows=log.rows + lines) for log in logs) for logs in (part.head, part.tail))
    return replace(part, dataset=dataset, head=head, tail=tail)


def later(dataset: Dataset, clock: int) -> Dataset:
    """The same where so many recordings began before.

    Parameters
    ----------
    dataset
        Clocks counted from its own first.
    clock
        How many.
    """
    return _moved(dataset, clock=clock) if clock else dataset


def _moved(dataset: Dataset, **by: int) -> Dataset:
    """The same with some numbers of all records so much larger."""
    runs, rejects = _all_moved(dataset.runs, by), _all_moved(dataset.rejects, by)
    return replace(dataset, runs=runs, rejects=rejects)


def _all_moved(records: Sequence[Kept], by: Mapping[str, int]) -> tuple[Kept, ...]:
    """In a third of the time that `dataclasses.replace` takes; of thousands of records that counts."""
    if not records:
        return ()
    names = [item.name for item in fields(records[0])]
    every, kind, places = attrgetter(*names), type(records[0]), {names.index(name): more for name, more in by.items()}
    out = []
    for record in records:
        values = list(every(record))
        for place, more in places.items():
            values[place] += more
        out.append(kind(*values))
    return tuple(out)


def _together(*parts: Dataset) -> Dataset:
    return Dataset(
        tuple(run for part in parts for run in part.runs),
        tuple(reject for part in parts for reject in part.rejects),
        tuple(facts for part in parts for facts in part.files),
        tuple(note for part in parts for note in part.notes),
        next((part.extra for part in parts if part.extra), ()),
    )
