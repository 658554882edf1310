"""Cut logs into runs: the one pass over the samples."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from pumaid.motion.block import Block, Buffer
from pumaid.motion.cutting import Piece, Whole, clipped, is_measured, pieces, wholes
from pumaid.motion.harvest import Harvest
from pumaid.motion.options import DEFAULTS, SegmentOptions
from pumaid.motion.seam import RESTFUL, are_apart, first_side, last_side
from pumaid.records import Evidence, Log, Robot

__all__ = ["SegmentOptions", "segment"]

#: s; what a window sees of its neighbours, longer than any line that a speed is judged by.
CONTEXT = 2.0


def segment(
    logs: Iterable[Log],
    robot: Robot,
    *,
    options: SegmentOptions = DEFAULTS,
    progress: Callable[[int], None] | None = None,
) -> Evidence:
    """Find the stretches in which one joint moves alone, and reduce each to a triangle and cells.

    Speed is judged from position. A movement of one joint yields its stretches of constant speed; where they are too
    small a part of it and it goes from rest to rest, all of it is a stroke. The rest is left out, with its reason.
    Samples are held in a window of bounded size only; how the logs are cut into batches changes nothing. Files that
    begin and end at rest are looked at one by one.

    Parameters
    ----------
    logs
        Consecutive batches, SI. `starts_clock` begins a new recording; within one, a run may go on from file to file.
        What the iterable tells of its files (`files`, `notes`, `extra`) is taken over.
    robot
        Supplies the joints' kinds.
    options
        Thresholds.
    progress
        Called with the number of samples reduced so far.

    Returns
    -------
    evidence
        Runs and rejects in order of time; together they hold every sample once.

    Raises
    ------
    ValueError
        The logs have another number of joints than the robot.

    Source
    ------
    The method page, section 2: within a run the current is C cos q + S sin q + friction.
    """
    harvest = Harvest(robot, options)
    buffer = Buffer(clock=0)
    done, seam = 0, None
    for log in logs:
        if log.position.shape[1] != robot.n_joints:
            raise ValueError(f"{log.origin} has {log.position.shape[1]} joints, {robot.name} has {robot.n_joints}")
        if log.starts_clock and len(buffer):
            done += _at_seam(buffer, harvest, seam)
            done += _reduce(buffer, harvest, size=len(buffer), ends=True)
            buffer, seam = Buffer(clock=buffer.clock + 1), None
        elif len(log) and len(buffer) and log.origin != buffer.origin:
            done += _at_seam(buffer, harvest, seam)
            seam = len(buffer)
        buffer.add(log)
        if seam is not None:
            time, _ = buffer.head(seam, RESTFUL)
            if time[-1] - time[0] < RESTFUL:
                continue
            done += _at_seam(buffer, harvest, seam)
            seam = None
        while len(buffer) >= options.window:
            done += _reduce(buffer, harvest, size=options.window, ends=False)
            if progress is not None:
                progress(done)
    done += _at_seam(buffer, harvest, seam)
    done += _reduce(buffer, harvest, size=len(buffer), ends=True)
    if progress is not None:
        progress(done)
    runs, rejects = harvest.finish()
    files, notes, extra = (tuple(getattr(logs, name, ())) for name in ("files", "notes", "extra"))
    return Evidence(runs, rejects, files, notes, extra)


def _at_seam(buffer: Buffer, harvest: Harvest, seam: int | None) -> int:
    """Where sample `seam` begins a file: what lies before it is reduced by itself if no motion can go on across.

    So files can be looked at one by one, on several machines, and the runs stay the same to the bit.
    """
    if seam is None or seam <= buffer.lead:
        return 0
    options = harvest.options
    before = last_side(*buffer.tail(seam, RESTFUL), options)
    after = first_side(*buffer.head(seam, RESTFUL), options)
    if not are_apart(before, after):
        return 0
    done = _reduce(buffer, harvest, size=seam, ends=True)
    harvest.part()
    buffer.begin_anew()
    return done


def _reduce(buffer: Buffer, harvest: Harvest, *, size: int, ends: bool) -> int:
    """Reduce the first `size` samples, or as many as end at a rest; returns the samples accounted for."""
    if size == 0:
        return 0
    block = buffer.block(size, ends)
    good = is_measured(block)
    kept, index = (block, np.arange(size)) if good.all() else (_only(block, good), np.flatnonzero(good))
    whole_stretches, fragments = wholes(kept, harvest.options) if len(index) else ([], [])
    found: list[tuple[Whole | None, Piece]] = [(None, piece) for piece in fragments]
    found += [(whole, piece) for whole in whole_stretches for piece in pieces(whole, harvest.options)]
    found.sort(key=lambda item: item[1].start)
    cut, lead = (len(index), 0) if ends else _cut(kept, [piece for _, piece in found])
    for whole, piece in found:
        part = clipped(piece, kept.lead, cut)
        if part.stop > part.start:
            harvest.add(kept, whole, part, goes_on=part.stop == cut and not ends)
    last = size if cut == len(index) else int(index[cut])
    _leave_garbage(block, good, harvest, last=last)
    dropped = last if lead == 0 else int(index[cut - lead])
    buffer.drop(dropped, last - dropped)
    return last - block.lead


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


def _cut(block: Block, found: list[Piece]) -> tuple[int, int]:
    """Where a full window ends, and how many samples before that the next one sees again."""
    size = len(block)
    if size < 2:
        return size, 0
    context = min(size // 8, int(np.ceil(CONTEXT / max(1e-9, float(np.median(np.diff(block.time)))))))
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
