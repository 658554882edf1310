"""Samples cut into runs (one joint alone at constant velocity, or from rest to rest) and what is left out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Log
from pumaid.preprocessing.clock import sampling_times
from pumaid.preprocessing.constant_velocity import ConstantVelocity, constant_velocities
from pumaid.preprocessing.differentiate import Ticks, usual_step
from pumaid.preprocessing.movement import REST, SEVERAL, JointMovement, Movement, motion_of, movements
from pumaid.preprocessing.options import BOTH, CONSTANT, LARGEST, STROKE, SegmentOptions
from pumaid.preprocessing.stroke import Smooth, sliding, smooth

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: A time step above so many usual ones, and above so many seconds, is a gap.
GAP_STEPS, GAP_TIME = 5.0, 0.05
#: s; shortest motion of one joint between motions of several; a shorter one is a chance: the others just turn back.
LONE = 1.0
#: Fewest samples from which a speed can be taken.
FEWEST = 6


@dataclass(frozen=True, eq=False, slots=True)
class Piece:
    """Samples [start, stop): a run of `kind`, or left out for `reason`.

    `joints` move in it; `figure` is the number that the reason depends on; `course` is a stroke's smoothed motion.
    """

    start: int
    stop: int
    joints: tuple[int, ...] = ()
    kind: str = ""
    reason: str = ""
    figure: float = 0.0
    course: Smooth | None = None

    def within(self, start: int, stop: int) -> Piece:
        """The part of the piece between two samples; empty where it has none."""
        start = max(start, self.start)
        stop = max(start, min(stop, self.stop))
        return replace(self, start=start, stop=stop, course=self.course and self.course.within(start, stop))


@dataclass(frozen=True, eq=False, slots=True)
class Stretch:
    """Consecutive samples, cut into pieces.

    Attributes
    ----------
    log
        N samples.
    index
        (N,) their numbers in the block that they come from.
    pieces
        In order; together they hold every sample once.
    time
        (N,) s at which the samples were taken, which stamps need not be.
    stamp_error
        RMS by which the stamps differ from `time`, s.
    motion
        What the joints do; None where samples are too few, or no numbers.
    last
        Sample with which the last movement begins.
    """

    log: Log
    index: Ints
    pieces: tuple[Piece, ...]
    time: Floats
    stamp_error: float = 0.0
    motion: JointMovement | None = None
    last: int = 0


def stretches(log: Log, options: SegmentOptions) -> Iterator[Stretch]:
    """The gapless stretches of some consecutive samples; every sample is in one of them.

    Parameters
    ----------
    log
        Samples of one recording, SI.
    options
        Thresholds.
    """
    good = np.isfinite(log.time) & (np.abs(log.position) < LARGEST).all(axis=1)
    yield from (_unusable(log, part, "not-a-number") for part in _consecutive(np.flatnonzero(~good)))
    index = np.flatnonzero(good)
    time = log.time[index]
    steps = np.diff(time)
    broken = (steps > max(GAP_STEPS * usual_step(time), GAP_TIME)) | (steps <= 0)
    for part in np.split(index, np.flatnonzero(broken) + 1):
        if len(part) >= FEWEST:
            yield _cut(log.part(part), part, options)
        elif len(part):
            yield _unusable(log, part, "gap")


def _consecutive(index: Ints) -> list[Ints]:
    return [part for part in np.split(index, np.flatnonzero(np.diff(index) > 1) + 1) if len(part)]


def _unusable(log: Log, index: Ints, reason: str) -> Stretch:
    part = log.part(index)
    return Stretch(part, index, (Piece(0, len(index), reason=reason),), part.time)


def _cut(log: Log, index: Ints, options: SegmentOptions) -> Stretch:
    """A stretch without gaps as kept and left-out pieces, in order."""
    time, error = sampling_times(log.time, log.position)
    motion = motion_of(Ticks.of(time, log.position), options)
    whole = Stretch(log, index, (), time, error, motion, int(motion.ticks.edges[movements(motion.code)[-1].start]))
    edges, pieces = motion.ticks.edges, []
    for movement in movements(motion.code):
        start, stop = int(edges[movement.start]), int(edges[movement.stop])
        if movement.code == REST:
            pieces.append(Piece(start, stop, reason="rest"))
        elif movement.code == SEVERAL:
            moving = motion.moving[movement.start : movement.stop].sum(axis=0)
            order = np.argsort(-moving, kind="stable")
            pieces.append(Piece(start, stop, tuple(int(j) + 1 for j in order if moving[j]), reason="several-joints"))
        else:
            pieces += _of_movement(whole, motion, movement, options)
    return replace(whole, pieces=tuple(_joined(_disjoint(pieces))))


def _of_movement(whole: Stretch, motion: JointMovement, movement: Movement, options: SegmentOptions) -> list[Piece]:
    """Runs and left-out pieces of a movement of one joint."""
    start, stop = _bounds(motion, movement)
    joint, position = movement.joint, whole.log.position[:, movement.joint - 1]
    way = abs(float(position[stop - 1] - position[start]))
    if way < options.rest_speed * options.min_duration:
        return [Piece(start, stop, reason="rest")]
    found: list[ConstantVelocity] = []
    if options.kinds != STROKE:
        ticks = (movement.start, movement.stop)
        found = constant_velocities(motion.ticks, ticks, (whole.time, position), joint=joint, options=options)
    runs = [run for run in found if _is_long(whole.time, position, run, options)]
    share = sum(abs(position[run.stop - 1] - position[run.start]) for run in runs) / way
    is_whole = movement.before is not None and movement.after is not None
    duration = float(whole.time[stop - 1] - whole.time[start])
    if movement.before == movement.after == SEVERAL and duration < LONE:
        return [Piece(start, stop, (joint,), reason="between-several", figure=way)]
    if runs and (share >= options.plateau_share or not is_whole or options.kinds == CONSTANT):
        pieces = [Piece(run.start, run.stop, (joint,), kind=CONSTANT, figure=run.velocity) for run in runs]
        return _with_ramps((start, stop), [_unless_drifting(motion, piece, options) for piece in pieces], joint)
    if options.kinds in (STROKE, BOTH) and movement.from_rest and way >= options.min_travel:
        return _of_stroke(whole, motion, movement, options)
    reason = "too-short" if found or duration < 2 * options.min_duration else "speed-not-constant"
    return [Piece(start, stop, (joint,), reason=reason, figure=way)]


def _bounds(motion: JointMovement, movement: Movement) -> tuple[int, int]:
    edges = motion.ticks.edges
    return int(edges[movement.start]), int(edges[movement.stop])


def _is_long(time: Floats, position: Floats, run: ConstantVelocity, options: SegmentOptions) -> bool:
    first, last = run.start, run.stop - 1
    is_far = abs(float(position[last] - position[first])) >= options.min_travel
    return is_far and time[last] - time[first] >= options.min_duration and run.stop - first >= options.min_samples


def _unless_drifting(motion: JointMovement, piece: Piece, options: SegmentOptions) -> Piece:
    """The piece, or its rejection because a held joint went too far."""
    ticks = motion.ticks
    low, high = np.searchsorted(ticks.edges, [piece.start, piece.stop])
    position = ticks.position[low : max(high, low + 1)]
    drift = np.abs(position[-1] - position[0])
    drift[piece.joints[0] - 1] = 0.0
    worst = int(np.argmax(drift))
    if drift[worst] <= options.held_drift:
        return piece
    joints = (piece.joints[0], worst + 1)
    return Piece(piece.start, piece.stop, joints, reason="drift-of-held-joint", figure=float(drift[worst]))


def _of_stroke(whole: Stretch, motion: JointMovement, movement: Movement, options: SegmentOptions) -> list[Piece]:
    """A movement from rest to rest as a stroke between its ends, in which friction may not slide yet."""
    low, high = bounds = _bounds(motion, movement)
    joint, ticks = movement.joint, motion.ticks
    noise = float(ticks.noise[joint - 1]) * float(ticks.edges[1] - ticks.edges[0]) ** 0.5
    course = smooth(whole.time, whole.log.position[:, joint - 1], bounds=bounds, noise=noise)
    direction = 1 if movement.code > 0 else -1
    start, stop = sliding(course, direction, options)
    if stop - start < options.min_samples or whole.time[stop - 1] - whole.time[start] < options.min_duration:
        return [Piece(low, high, (joint,), reason="too-short")]
    part = course.within(start, stop)
    peak = float(np.abs(part.velocity).max())
    stroke = Piece(start, stop, (joint,), kind=STROKE, figure=direction * peak, course=part)
    ends = [Piece(a, b, (joint,), reason="low-speed", figure=peak) for a, b in ((low, start), (stop, high)) if b > a]
    return sorted([*ends, _unless_drifting(motion, stroke, options)], key=lambda piece: piece.start)


def _with_ramps(bounds: tuple[int, int], pieces: list[Piece], joint: int) -> list[Piece]:
    """The pieces of a movement and, between them, its ramps."""
    out, at = [], bounds[0]
    for piece in pieces:
        if piece.start > at:
            out.append(Piece(at, piece.start, (joint,), reason="ramp"))
        out.append(piece)
        at = piece.stop
    return out if at >= bounds[1] else [*out, Piece(at, bounds[1], (joint,), reason="ramp")]


def _disjoint(pieces: list[Piece]) -> list[Piece]:
    """The pieces without overlap; where a run reaches into its neighbour, the neighbour yields."""
    out: list[Piece] = []
    for piece in pieces:
        while piece.kind and out and not out[-1].kind and out[-1].stop > piece.start:
            yielding = out.pop()
            if yielding.start < piece.start:
                out.append(replace(yielding, stop=piece.start))
        start = max(piece.start, out[-1].stop if out else 0)
        if piece.stop > start:
            out.append(piece.within(start, piece.stop))
    return out


def _joined(pieces: list[Piece]) -> list[Piece]:
    """The pieces, neighbours that are left out for the same reason as one."""
    out: list[Piece] = []
    for piece in pieces:
        last = out[-1] if out else None
        if last is not None and piece.reason and last.reason == piece.reason:
            joints = tuple(dict.fromkeys((*last.joints, *piece.joints)))
            out[-1] = replace(last, stop=piece.stop, joints=joints, figure=max(last.figure, piece.figure))
        else:
            out.append(piece)
    return out
