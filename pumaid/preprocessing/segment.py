"""The one pass over the samples: a stream of batches cut into runs, in memory of bounded size."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from pumaid.dataset import Dataset, Log, Reject, Run
from pumaid.preprocessing import clock
from pumaid.preprocessing.binning import records
from pumaid.preprocessing.options import DEFAULTS, SegmentOptions
from pumaid.preprocessing.room import OF_REJECTS, OF_RUNS, Room
from pumaid.preprocessing.stretches import Piece, Stretch, stretches
from pumaid.robot import Robot

__all__ = ["SegmentOptions", "Segmenter", "segment"]

#: s of rest in whose middle a stream may be cut without loss.
RESTFUL = 0.4
#: Samples before a cut elsewhere that the next window sees again.
CONTEXT = 1024


def segment(
    logs: Iterable[Log],
    robot: Robot,
    *,
    options: SegmentOptions = DEFAULTS,
    progress: Callable[[int], None] | None = None,
) -> Dataset:
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
    progress
        Called with the number of samples reduced so far.

    Returns
    -------
    dataset
        Runs and rejects in order of time; together they hold every sample once.

    Raises
    ------
    ValueError
        The logs have another number of joints than the robot.
    """
    segmenter = Segmenter(robot, options)
    for log in logs:
        segmenter.add(log)
        if progress is not None:
            progress(segmenter.done)
    runs, rejects = segmenter.close()
    if progress is not None:
        progress(segmenter.done)
    files, notes, extra = (tuple(getattr(logs, name, ())) for name in ("files", "notes", "extra"))
    return Dataset(runs, rejects, files, (*notes, *clock.notes(runs)), extra)


class Segmenter:
    """Takes consecutive batches and leaves runs and rejects.

    Parameters
    ----------
    robot
        Supplies the joints' kinds.
    options
        Thresholds.

    Attributes
    ----------
    clock
        Number of the last sample's recording, from 0.
    done
        Samples accounted for.
    """

    def __init__(self, robot: Robot, options: SegmentOptions = DEFAULTS) -> None:
        self.clock, self.done = 0, 0
        self._robot, self._options = robot, options
        self._runs, self._rejects = Room[Run](OF_RUNS), Room[Reject](OF_REJECTS)
        self._batches: list[Log] = []
        self._context = 0  # samples at the front that are accounted for
        self._has_begun = False

    def add(self, log: Log) -> None:
        """Take a batch.

        Raises
        ------
        ValueError
            It has another number of joints than the robot.
        """
        if log.position.shape[1] != self._robot.n_joints:
            raise ValueError(
                f"{log.origin} has {log.position.shape[1]} joints, {self._robot.name} has {self._robot.n_joints}"
            )
        if log.starts_clock or (self._batches and log.origin != self._batches[0].origin):
            self._window(len(self), ends=True)
            self.clock += log.starts_clock and self._has_begun
        if len(log):
            self._has_begun = True
            self._batches.append(log)
        while len(self) >= self._options.window:
            self._window(self._options.window, ends=False)

    def __len__(self) -> int:
        return sum(map(len, self._batches))

    def close(self) -> tuple[tuple[Run, ...], tuple[Reject, ...]]:
        """Runs and rejects in order of clock and time; they hold every sample once."""
        self._window(len(self), ends=True)
        rejects = sorted(self._rejects.records, key=lambda item: (item.clock, item.start, item.first_row))
        return tuple(self._runs.records), tuple(rejects)

    def _window(self, size: int, *, ends: bool) -> None:
        """Account for the first `size` samples: all of them where the stream `ends`, else up to a good place."""
        if not self._batches:
            return
        log = Log.joined(self._batches)
        found = list(stretches(log.part(slice(0, size)), self._options))
        cut, context = (size, 0) if ends else _place_to_cut(found, size)
        for stretch in found:
            low, high = np.searchsorted(stretch.index, [self._context, cut])
            for piece in stretch.pieces:
                part = piece.within(int(low), int(high))
                if part.stop > part.start:
                    self._record(stretch, part)
        self.done += cut - self._context
        self._context = context
        rest = log.part(slice(cut - context, None))
        self._batches = [rest] if cut < len(log) else []

    def _record(self, stretch: Stretch, piece: Piece) -> None:
        for record in records(stretch, piece, self._robot, options=self._options, clock=self.clock):
            if isinstance(record, Run):
                self._runs.add(record)
            else:
                self._rejects.add(record)


def _place_to_cut(found: list[Stretch], size: int) -> tuple[int, int]:
    """Where a full window ends, and how many samples before that the next one sees again.

    In the middle of the last rest in its second half, else where the last movement begins, else at its end.
    """
    for stretch in reversed(found):
        for piece in reversed(stretch.pieces):
            middle = int(stretch.index[(piece.start + piece.stop) // 2])
            duration = stretch.log.time[piece.stop - 1] - stretch.log.time[piece.start]
            if piece.reason == "rest" and middle > size // 2 and duration > RESTFUL:
                return middle, 0
    border = max(int(stretch.index[stretch.last]) for stretch in found)
    return (border, min(CONTEXT, border // 2)) if border > size // 2 else (size, 0)
