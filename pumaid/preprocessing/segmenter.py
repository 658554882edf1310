"""The segmentation of a stream: windows of bounded size, cut where the arm rests near a seam of the logs."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from pumaid.dataset import Reject, Run
from pumaid.preprocessing.block import Block, Buffer
from pumaid.preprocessing.cutting import Piece, Whole, clipped, is_measured, pieces, wholes
from pumaid.preprocessing.harvest import Harvest
from pumaid.preprocessing.options import SegmentOptions
from pumaid.preprocessing.rest import RESTFUL, FirstRest, last_rest
from pumaid.preprocessing.speed import at_least, usual_step
from pumaid.records import Log
from pumaid.robot import Robot

#: s; what a window sees of its neighbours, longer than any line that a speed is judged by.
CONTEXT = 2.0


class Segmenter:
    """Takes consecutive batches and leaves runs and rejects.

    At a seam (a file begins, or a part of one that may be read by itself) the samples are cut at the last rest before
    and at the first rest behind it, so that what lies between rests near seams can be looked at by itself, by another
    process, and leaves the same to the bit. A motion without rest for a whole window is cut at the seam itself.

    Parameters
    ----------
    robot
        Supplies the joints' kinds.
    options
        Thresholds.
    clock
        Number of the recording that comes before, or goes on here; None where nothing does.
    is_part
        Whether this is a part of a longer stream: then what lies before the first rest and behind the last is left to
        who joins the parts.

    Attributes
    ----------
    head, tail
        Of a part: the samples at its ends that are not looked at; `tail` once it is closed.
    is_open
        Whether it is a part in which the arm did not rest so far; closed, all of it is `head`.
    done
        Samples accounted for.
    """

    def __init__(
        self, robot: Robot, options: SegmentOptions, *, clock: int | None = None, is_part: bool = False
    ) -> None:
        self.head: tuple[Log, ...] = ()
        self.tail: tuple[Log, ...] = ()
        self.is_open = is_part
        self.done = 0
        self._robot, self._options, self._is_part = robot, options, is_part
        self._harvest, self._buffer = Harvest(robot, options), Buffer(clock or 0)
        self._has_begun = clock is not None
        self._search: FirstRest | None = None
        self._seam = 0  # where it is in the buffer

    @property
    def clock(self) -> int:
        """Number of the last sample's recording."""
        return self._buffer.clock

    def take(self, logs: Iterable[Log], *, progress: Callable[[int], None] | None = None) -> None:
        """Take all batches, with a seam where a file begins or ends, or a part of one that may be read by itself.

        Parameters
        ----------
        logs
            Consecutive batches.
        progress
            Called with the number of samples reduced so far.

        Raises
        ------
        ValueError
            The logs have another number of joints than the robot.
        """
        origin = None
        for log in logs:
            if len(log) and (log.origin != origin or log.begins_part):
                self.seam()
                origin = log.origin
            self.add(log)
            if progress is not None:
                progress(self.done)
        self.seam()

    def seam(self) -> None:
        """The logs end here, or what comes next may be read by itself."""
        if self._search is None:
            self._part_at_last_rest()
        self._search, self._seam = FirstRest(self._options), len(self._buffer)

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
        if log.starts_clock and not self.is_open:
            self._restart()
        if not len(log):
            return
        self._has_begun = True
        self._buffer.add(log)
        if self._search is not None:
            self._look(self._search, log)
        while not self.is_open and (len(self._buffer) if self._search is None else self._seam) >= self._options.window:
            self._window()

    def close(self) -> tuple[tuple[Run, ...], tuple[Reject, ...]]:
        """Runs and rejects in order of clock and time; with `head` and `tail` they hold every sample once."""
        if self.is_open:
            self.head = self._buffer.parts
        elif self._is_part:
            # That a recording began with it is in the clock.
            self.tail = tuple(replace(log, starts_clock=False) for log in self._buffer.parts)
        else:
            self._cut(len(self._buffer))
        return self._harvest.finish()

    def _look(self, search: FirstRest, log: Log) -> None:
        """Cut at the first rest behind the seam, or at the seam if there is none for a whole window."""
        found = search.take(log.time, log.position)
        if found is None and search.decided <= self._options.window:
            return
        self._search = None
        at = self._seam + (found if found is not None and found <= self._options.window else 0)
        if not self.is_open:
            self._cut(max(0, at))
            return
        parts, self._buffer, self.is_open = self._buffer.split(at), Buffer(self.clock), False
        self.head = parts[0]
        for part in parts[1]:
            self.add(part)

    def _part_at_last_rest(self) -> None:
        if not len(self._buffer):
            return
        found = last_rest(*self._buffer.unseen(), self._options)
        if found is not None:
            self._cut(self._buffer.lead + found)
        elif self._buffer.lead:
            self._cut(len(self._buffer))
        self._harvest.part()

    def _restart(self) -> None:
        self._cut(len(self._buffer))
        self._buffer = Buffer(self.clock + self._has_begun)

    def _cut(self, size: int) -> None:
        """Account for the first `size` samples; what follows is looked at by itself."""
        while size >= self._options.window:
            size -= self._window()
        if size > self._buffer.lead:
            self._reduce(size, ends=True)
        elif self._buffer.lead:
            self._let_go(self._buffer.lead, 0)
        self._harvest.part()

    def _window(self) -> int:
        """Account for a window, or as much of it as ends at a rest; returns how many samples were let go."""
        return self._reduce(self._options.window, ends=False)

    def _reduce(self, size: int, *, ends: bool) -> int:
        """Reduce the first `size` samples, or as many as end at a rest; returns how many samples were let go."""
        block = self._buffer.block(size)
        good = is_measured(block)
        kept, index = (block, np.arange(size)) if good.all() else (_only(block, good), np.flatnonzero(good))
        usual = usual_step(kept.time)
        whole_stretches, fragments = wholes(kept, self._options, usual=usual) if len(index) else ([], [])
        found: list[tuple[Whole | None, Piece]] = [(None, piece) for piece in fragments]
        found += [(whole, piece) for whole in whole_stretches for piece in pieces(whole, self._options)]
        found.sort(key=lambda item: item[1].start)
        cut, lead = (len(index), 0) if ends else _cut(kept, [piece for _, piece in found], usual=usual)
        for whole, piece in found:
            part = clipped(piece, kept.lead, cut)
            if part.stop > part.start:
                self._harvest.add(kept, whole, part, goes_on=part.stop == cut and not ends)
        last = size if cut == len(index) else int(index[cut])
        _leave_garbage(block, good, self._harvest, last=last)
        dropped = last if lead == 0 else int(index[cut - lead])
        self._let_go(dropped, last - dropped)
        self.done += last - block.lead
        return dropped

    def _let_go(self, count: int, lead: int) -> None:
        self._buffer.drop(count, lead)
        self._seam -= count


def _only(block: Block, good: np.ndarray) -> Block:
    return replace(
        block,
        file=block.file[good],
        rows=block.rows[good],
        time=block.time[good],
        position=block.position[good],
        current=block.current[good],
        temperature=None if block.temperature is None else block.temperature[good],
        lead=int(np.count_nonzero(good[: block.lead])),
        extra=None if block.extra is None else block.extra[good],
    )


def _cut(block: Block, found: list[Piece], *, usual: float) -> tuple[int, int]:
    """Where a full window ends, and how many samples before that the next one sees again."""
    size = len(block)
    if size < 2:
        return size, 0
    context = min(size // 8, at_least(CONTEXT / max(1e-9, usual)))
    for piece in reversed(found):
        low, high = max(piece.start, size // 2), min(piece.stop, size - 1)
        if piece.reason == "rest" and high > low and block.time[high] - block.time[low] >= RESTFUL:
            return (low + high) // 2, 0
    return size - context, context


def _leave_garbage(block: Block, good: np.ndarray, harvest: Harvest, *, last: int) -> None:
    bad = np.flatnonzero(~good[:last])
    bad = bad[bad >= block.lead]
    if not len(bad):
        return
    for group in np.split(bad, np.flatnonzero(np.diff(bad) > 1) + 1):
        harvest.add(block, None, Piece(int(group[0]), int(group[-1]) + 1, reason="not-a-number"), goes_on=False)
