"""Runs and leftovers of one block after the other, joined where a stretch goes on across blocks."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Bins, Means, Reject, Run
from pumaid.maths.short import mean
from pumaid.maths.triangle import Triangle
from pumaid.preprocessing.block import Block
from pumaid.preprocessing.cutting import Piece, Whole
from pumaid.preprocessing.options import CONSTANT, SegmentOptions
from pumaid.preprocessing.reasons import Leftover
from pumaid.preprocessing.reduce import Chosen, bins, coarser, means, triangle, usable
from pumaid.preprocessing.room import OF_REJECTS, OF_RUNS, Room
from pumaid.preprocessing.speed import slopes
from pumaid.robot import Robot

Floats = NDArray[np.float64]

#: Pieces of an endless run that are kept apart before they are joined.
MOST_OPEN = 16
#: Ticks on either side of a straight line through a run's own ticks.
HALF = 2
#: Turns from which a run gets more bins, so that a ripple of 100 waves a turn is not averaged away, and the turns up
#: to which it does: what is kept of an endless run is bounded.
MANY_TURNS, MOST_TURNS = 2.0, 64.0


class Harvest:
    """What the segmentation has found so far; a few numbers a run, whatever the logs' length."""

    def __init__(self, robot: Robot, options: SegmentOptions) -> None:
        self.robot, self.options = robot, options
        self._runs, self._rejects = Room[Run](OF_RUNS), Room[Reject](OF_REJECTS)
        self._open: list[Run] = []
        self._last: Leftover | None = None

    def add(self, block: Block, whole: Whole | None, piece: Piece, *, goes_on: bool) -> None:
        """Reduce a piece; one that `goes_on` is joined with the next block's first."""
        if not piece.kind or whole is None:
            self._leave(self._leftover(block, whole, piece))
            return
        samples = usable(block, piece)
        kept = piece.stop - piece.start if isinstance(samples, slice) else len(samples)
        missing = piece.stop - piece.start - kept
        if missing:
            lost = Piece(piece.start, piece.stop, piece.joints, reason="no-current")
            self._leave(replace(self._leftover(block, whole, lost), samples=missing))
        if not kept:
            return
        run = self._run(block, whole, piece, samples)
        if self._open and not _continues(self._open[-1], run, self.options):
            self._close()
        if len(self._open) >= MOST_OPEN:
            self._open = [_joined(self._open, self.robot, self.options)]
        self._open.append(run)
        self._settle()
        if not goes_on:
            self._close()

    def finish(self) -> tuple[tuple[Run, ...], tuple[Reject, ...]]:
        """Runs and rejects in order of clock and time."""
        self.part()
        rejects = sorted(self._rejects.records, key=lambda item: (item.clock, item.start, item.first_row))
        return tuple(self._runs.records), tuple(rejects)

    def part(self) -> None:
        """What comes next is not joined with what came before."""
        self._close()
        self._settle()

    def _leave(self, leftover: Leftover) -> None:
        self._close()
        last = self._last
        if last is not None and (last.reason, last.clock) == (leftover.reason, leftover.clock):
            leftover = last.joined(leftover, self.options)
        else:
            self._settle()
        self._last = leftover

    def _settle(self) -> None:
        """What was left out last has come to its end."""
        if self._last is not None:
            self._rejects.add(self._last.reject(self.robot, self.options))
        self._last = None

    def _close(self) -> None:
        if self._open:
            self._runs.add(_joined(self._open, self.robot, self.options))
        self._open = []

    def _leftover(self, block: Block, whole: Whole | None, piece: Piece) -> Leftover:
        first, last = piece.start, piece.stop - 1
        parts: tuple[Means, ...] = ()
        if piece.joints and whole is not None:
            rate = (whole.ticks.time, whole.motion.velocity)
            parts = (means(block, piece, rate, most=self.options.reject_bins),)
        return Leftover(
            origin=block.origins[block.file[first]],
            last_origin=block.origins[block.file[last]],
            first_row=int(block.rows[first]),
            last_row=int(block.rows[last]),
            start=float(block.time[first]),
            end=float(block.time[last]),
            samples=piece.stop - piece.start,
            joints=piece.joints,
            reason=piece.reason,
            figure=piece.figure,
            clock=block.clock,
            bins=parts,
        )

    def _run(self, block: Block, whole: Whole, piece: Piece, samples: Chosen) -> Run:
        joint = piece.joints[0]
        ends = (samples.start, samples.stop - 1) if isinstance(samples, slice) else samples[[0, -1]]
        first, last = int(ends[0]), int(ends[1])
        rate = _rate(block, whole, piece)
        position = block.position[piece.start : piece.stop, joint - 1]
        most = _most(_ends(position), self.options, is_turning=self.robot.joint(joint).is_revolute)
        inside = bins(block, piece, rate, samples=samples, most=most)
        posture = (inside.position * inside.count[:, None]).sum(axis=0) / inside.count.sum()
        posture[joint - 1] = np.nan
        line = _line(block.time[piece.start : piece.stop], position)
        return Run(
            joint=joint,
            kind=piece.kind,
            origin=block.origins[block.file[first]],
            last_origin="" if block.file[first] == block.file[last] else block.origins[block.file[last]],
            first_row=int(block.rows[first]),
            last_row=int(block.rows[last]),
            start=float(block.time[first]),
            duration=float(block.time[last] - block.time[first]),
            posture=posture,
            span=_ends(position),
            speed=line if piece.kind == CONSTANT else _secant(block.time[piece.start : piece.stop], position),
            ripple=float(np.std(rate[1])),
            temperature=_warmth(inside),
            triangle=triangle(block, piece, self.robot, samples=samples),
            bins=inside,
            clock=block.clock,
            stamp_error=whole.stamp_error,
        )


def _rate(block: Block, whole: Whole, piece: Piece) -> tuple[Floats, Floats]:
    """Times and the moving joint's velocities: at the samples of a stroke, else at ticks, from inside the run only."""
    if piece.course is not None:
        return block.time[piece.start : piece.stop], piece.course.velocity
    ticks, joint = whole.ticks, piece.joints[0]
    edges = ticks.edges + whole.start
    low = int(np.searchsorted(edges, piece.start))
    high = int(np.searchsorted(edges, piece.stop, side="right")) - 1
    if high - low < 3:
        return ticks.time[:1], np.full(1, piece.figure)
    return ticks.time[low:high], slopes(ticks.time[low:high], ticks.position[low:high, joint - 1], HALF)


def _line(time: Floats, position: Floats) -> float:
    """Slope of the straight line through all samples, per s."""
    t = time - mean(time)
    spread = float(t @ t)
    return float(t @ (position - mean(position))) / spread if spread > 0 else 0.0


def _secant(time: Floats, position: Floats) -> float:
    return float((position[-1] - position[0]) / max(time[-1] - time[0], 1e-12))


def _ends(position: Floats) -> tuple[float, float]:
    return float(position[0]), float(position[-1])


def _most(span: tuple[float, float], options: SegmentOptions, *, is_turning: bool) -> int:
    """Most bins of a run from one end of `span` (rad or m) to the other."""
    turns = abs(span[1] - span[0]) / (2.0 * math.pi) if is_turning else 0.0
    return math.ceil(options.max_bins * min(max(turns, MANY_TURNS), MOST_TURNS) / MANY_TURNS)


def _warmth(inside: Bins) -> float:
    known = np.isfinite(inside.temperature)
    if not known.any():
        return math.nan
    return float(np.average(inside.temperature[known], weights=inside.count[known]))


def _continues(run: Run, following: Run, options: SegmentOptions) -> bool:
    """Whether two consecutive pieces are one run."""
    same = (run.joint, run.kind, run.direction, run.clock) == (
        following.joint,
        following.kind,
        following.direction,
        following.clock,
    )
    close = abs(run.speed - following.speed) <= 2 * options.speed_tolerance * abs(run.speed)
    return same and (close or run.kind != CONSTANT)


def _joined(parts: list[Run], robot: Robot, options: SegmentOptions) -> Run:
    if len(parts) == 1:
        return parts[0]
    first, last = parts[0], parts[-1]
    weights = np.array([part.samples for part in parts], dtype=float)
    speed = float(np.average([part.speed for part in parts], weights=weights))
    ripple = np.average([part.ripple**2 + (part.speed - speed) ** 2 for part in parts], weights=weights)
    span = (first.span[0], last.span[1])
    most = _most(span, options, is_turning=robot.joint(first.joint).is_revolute)
    inside = coarser([part.bins for part in parts], most)
    return replace(
        first,
        last_row=last.last_row,
        last_origin=(last.last_origin or last.origin) if (last.last_origin or last.origin) != first.origin else "",
        duration=last.start + last.duration - first.start,
        posture=np.average([part.posture for part in parts], axis=0, weights=weights),
        span=span,
        speed=speed,
        ripple=math.sqrt(float(ripple)),
        temperature=_warmth(inside),
        triangle=Triangle.merge(part.triangle for part in parts),
        bins=inside,
        stamp_error=max(part.stamp_error for part in parts),
    )
