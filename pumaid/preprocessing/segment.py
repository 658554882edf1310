"""The one pass over the samples: a stream of batches cut into runs, in memory of bounded size."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Generic, TypeVar

import numpy as np

from pumaid.dataset import Dataset, Log, Reject, Run, coarser
from pumaid.preprocessing import clock
from pumaid.preprocessing.binning import records
from pumaid.preprocessing.options import DEFAULTS, SegmentOptions
from pumaid.preprocessing.stretches import Piece, Stretch, stretches
from pumaid.robot import Robot

__all__ = ["SegmentOptions", "segment"]

Record = TypeVar("Record", Run, Reject)

#: s of rest in whose middle a stream may be cut without loss.
RESTFUL = 0.4
#: Samples before a cut elsewhere that the next window sees again.
CONTEXT = 1024
#: Bins of all runs together (some 100 bytes each for six joints), and those that a run keeps in any case; the same of
#: what is no run, where all that is looked at is how large the model's error is.
RUN_BINS, REJECT_BINS = (1_500_000, 16), (300_000, 4)


def segment(logs: Iterable[Log], robot: Robot, *, options: SegmentOptions = DEFAULTS) -> Dataset:
    """Find the stretches in which one joint moves alone, and reduce each to bins.

    Speed is taken from position. A movement of one joint yields its stretches of constant velocity; where they are too
    small a part of it and it goes from rest to rest, all of it is a stroke. The rest is left out, with its reason.
    A run ends where a file ends.

    Parameters
    ----------
    logs
        Consecutive batches, SI. `starts_clock` begins a new recording.
        What the iterable tells of its files (`files`, `notes`, `extra`) is taken over.
    robot
        Supplies the joints' kinds.
    options
        Thresholds.

    Returns
    -------
    dataset
        Runs and rejects in order of time; together they hold every sample once.

    Raises
    ------
    ValueError
        The logs have another number of joints than the robot.
    """
    segmenter = _Segmenter(robot, options)
    for log in logs:
        segmenter.add(log)
    segmenter.window(len(segmenter), ends=True)
    rejects = sorted(segmenter.rejects.records, key=lambda item: (item.clock, item.start, item.first_row))
    runs = tuple(segmenter.runs.records)
    files, notes, extra = (tuple(getattr(logs, name, ())) for name in ("files", "notes", "extra"))
    return Dataset(runs, tuple(rejects), files, (*notes, *clock.notes(runs)), extra)


@dataclass(slots=True)
class BoundedRecords(Generic[Record]):
    """Records whose bins are halved while they have more than `limits[0]` of them together."""

    limits: tuple[int, int]
    records: list[Record] = field(default_factory=list)
    _bins: int = 0
    _size: int = 1 << 20  # of a record

    def add(self, record: Record) -> None:
        """Collect a record."""
        self.records.append(_halved(record, self._size))
        self._bins += _bin_count(self.records[-1])
        total, fewest = self.limits
        while self._bins > total and self._size > fewest:
            self._size = max(fewest, min(self._size, max(map(_bin_count, self.records))) // 2)
            self.records = [_halved(record, self._size) for record in self.records]
            self._bins = sum(map(_bin_count, self.records))


def _halved(record: Record, size: int) -> Record:
    return record if _bin_count(record) <= size else replace(record, bins=coarser(record.bins, size))  # type: ignore[type-var]


def _bin_count(record: Run | Reject) -> int:
    return 0 if record.bins is None else len(record.bins)


class _Segmenter:
    """Takes consecutive batches and leaves runs and rejects."""

    def __init__(self, robot: Robot, options: SegmentOptions) -> None:
        self.runs, self.rejects = BoundedRecords[Run](RUN_BINS), BoundedRecords[Reject](REJECT_BINS)
        self._robot, self._options = robot, options
        self._clock, self._has_begun = 0, False
        self._batches: list[Log] = []
        self._context = 0  # samples at the front that are accounted for

    def add(self, log: Log) -> None:
        """Take a batch."""
        if log.position.shape[1] != self._robot.n_joints:
            raise ValueError(
                f"{log.origin} has {log.position.shape[1]} joints, {self._robot.name} has {self._robot.n_joints}"
            )
        if log.starts_clock or (self._batches and log.origin != self._batches[0].origin):
            self.window(len(self), ends=True)
            self._clock += log.starts_clock and self._has_begun
        if len(log):
            self._has_begun = True
            self._batches.append(log)
        while len(self) >= self._options.window:
            self.window(self._options.window, ends=False)

    def __len__(self) -> int:
        return sum(map(len, self._batches))

    def window(self, size: int, *, ends: bool) -> None:
        """Account for the first `size` samples: all of them where the stream `ends`, else up to a good place."""
        if not self._batches:
            return
        log = Log.joined(self._batches)
        parts = list(stretches(log.part(slice(0, size)), self._options))
        cut, context = (size, 0) if ends else _place_to_cut(parts, size)
        for stretch in parts:
            low, high = np.searchsorted(stretch.index, [self._context, cut])
            pieces = (piece.within(int(low), int(high)) for piece in stretch.pieces)
            for piece in (piece for piece in pieces if piece.stop > piece.start):
                self._record(stretch, piece)
        self._context = context
        self._batches = [log.part(slice(cut - context, None))] if cut < len(log) else []

    def _record(self, stretch: Stretch, piece: Piece) -> None:
        for record in records(stretch, piece, self._robot, options=self._options, clock=self._clock):
            if isinstance(record, Run):
                self.runs.add(record)
            else:
                self.rejects.add(record)


def _place_to_cut(parts: list[Stretch], size: int) -> tuple[int, int]:
    """Where a full window ends, and how many samples before that the next one sees again.

    In the middle of the last rest in its second half, else where the last movement begins, else at its end.
    """
    for stretch in reversed(parts):
        for piece in reversed(stretch.pieces):
            middle = int(stretch.index[(piece.start + piece.stop) // 2])
            duration = stretch.log.time[piece.stop - 1] - stretch.log.time[piece.start]
            if piece.reason == "rest" and middle > size // 2 and duration > RESTFUL:
                return middle, 0
    border = max(int(stretch.index[stretch.last]) for stretch in parts)
    return (border, min(CONTEXT, border // 2)) if border > size // 2 else (size, 0)
