"""Samples cut into runs (one joint alone at constant velocity, or from rest to rest) and what is left out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Log
from pumaid.preprocessing.clock import sampling_times
from pumaid.preprocessing.constant_velocity import ConstantVelocity, constant_velocities
from pumaid.preprocessing.differentiate import Ticks, slopes, usual_step
from pumaid.preprocessing.options import BOTH, CONSTANT, LARGEST, STROKE, SegmentOptions
from pumaid.preprocessing.strokes import SmoothedMotion, sliding, smooth

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: A time step above so many usual ones, and above so many seconds, is a gap.
GAP_STEPS, GAP_TIME = 5.0, 0.05
#: s; shortest motion of one joint between motions of several; a shorter one is a chance: the others just turn back.
LONE = 1.0
#: Fewest samples from which a speed can be taken.
FEWEST = 6
#: Standard deviations of a speed that count as surely moving (one false alarm in about 1e5 ticks).
SURE = 4.5
#: Codes of a tick beside +joint and -joint.
REST, SEVERAL = 0, 1_000_000
#: s within which a held joint's slip ends, and its way as a share of what a held joint may drift during a run.
SLIP, SLIP_SHARE = 0.25, 0.25


@dataclass(frozen=True, eq=False, slots=True)
class Piece:
    """Samples [start, stop): a run of `kind`, or left out for `reason`.

    `joints` move in it; `figure` is the number that the reason depends on; `smoothed` is a stroke's motion.
    """

    start: int
    stop: int
    joints: tuple[int, ...] = ()
    kind: str = ""
    reason: str = ""
    figure: float = 0.0
    smoothed: SmoothedMotion | None = None

    def within(self, start: int, stop: int) -> Piece:
        """The part of the piece between two samples; empty where it has none."""
        start = max(start, self.start)
        stop = max(start, min(stop, self.stop))
        return replace(self, start=start, stop=stop, smoothed=self.smoothed and self.smoothed.within(start, stop))


@dataclass(frozen=True, eq=False, slots=True)
class JointMovement:
    """What every joint does at each of K ticks.

    `velocity` (K, J) rad/s or m/s; `code` (K,) is `REST`, +joint or -joint by direction, or `SEVERAL`;
    `moving` (K, J) says which joints move.
    """

    ticks: Ticks
    velocity: Floats
    code: Ints
    moving: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Movement:
    """Ticks [start, stop) of one code, with the codes on either side (None at the end of the data)."""

    start: int
    stop: int
    code: int
    before: int | None
    after: int | None

    @property
    def from_rest(self) -> bool:
        """Whether it begins at rest or at a reversal, and ends so."""
        ends_of_motion = (REST, -self.code)
        return self.before in ends_of_motion and self.after in ends_of_motion


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
    """The gapless stretches of some consecutive samples (SI) of one recording; every sample is in one of them."""
    good = np.isfinite(log.time) & (np.abs(log.position) < LARGEST).all(axis=1)
    bad = np.flatnonzero(~good)
    for part in np.split(bad, np.flatnonzero(np.diff(bad) > 1) + 1):
        if len(part):
            yield _unusable(log, part, "not-a-number")
    index = np.flatnonzero(good)
    time = log.time[index]
    steps = np.diff(time)
    broken = (steps > max(GAP_STEPS * usual_step(time), GAP_TIME)) | (steps <= 0)
    for part in np.split(index, np.flatnonzero(broken) + 1):
        if len(part) >= FEWEST:
            yield _cut(log.part(part), part, options)
        elif len(part):
            yield _unusable(log, part, "gap")


def _unusable(log: Log, index: Ints, reason: str) -> Stretch:
    part = log.part(index)
    return Stretch(part, index, (Piece(0, len(index), reason=reason),), part.time)


def _cut(log: Log, index: Ints, options: SegmentOptions) -> Stretch:
    """A stretch without gaps as runs and left-out pieces, in order."""
    time, error = sampling_times(log.time, log.position)
    motion = motion_of(Ticks.of(time, log.position), options)
    parts, edges = movements(motion.code), motion.ticks.edges
    whole = Stretch(log, index, (), time, error, motion, int(edges[parts[-1].start]))
    pieces: list[Piece] = []
    for movement in parts:
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


def motion_of(ticks: Ticks, options: SegmentOptions) -> JointMovement:
    """Tell rest, one joint and several apart at every tick.

    A joint moves where its speed is surely above `rest_speed` and above `held_share` of the fastest joint's; the line
    behind a joint's speed is just long enough to see `rest_speed` through its noise and quantisation.
    """
    velocity, floor = np.empty_like(ticks.position), np.empty(ticks.position.shape[1])
    for joint in range(1, len(floor) + 1):
        half = ticks.half_width(joint, options.rest_speed / SURE)
        velocity[:, joint - 1] = slopes(ticks.time, ticks.position[:, joint - 1], half)
        # One count back and forth tilts the line by at most 1.5 counts over its length.
        flicker = 2.0 * ticks.quantum[joint - 1] / (ticks.interval * (2 * half + 1))
        floor[joint - 1] = max(options.rest_speed, SURE * ticks.slope_error(joint, half), flicker)
    speed = np.abs(velocity)
    moving = speed > np.maximum(floor, options.held_share * speed.max(axis=1)[:, None])
    fastest, count = speed.argmax(axis=1), moving.sum(axis=1)
    signed = np.where(velocity[np.arange(len(speed)), fastest] > 0, 1, -1) * (fastest + 1)
    code = np.where(count == 0, REST, np.where(count == 1, signed, SEVERAL)).astype(np.int64)
    return JointMovement(ticks, velocity, _without_slips(code, ticks, options), moving)


def _without_slips(code: Ints, ticks: Ticks, options: SegmentOptions) -> Ints:
    """Codes in which a held joint that gives way by little, for a moment, does not end the motion of another.

    The moving joint changes the held joints' load, until it passes what their friction holds.
    """
    out = code.copy()
    for part in movements(code):
        if part.code != SEVERAL or part.before != part.after or part.before in (None, REST):
            continue
        low, high = max(0, part.start - 1), min(len(ticks) - 1, part.stop)
        way = np.ptp(ticks.position[low : high + 1], axis=0)
        way[abs(int(part.before)) - 1] = 0.0
        if ticks.time[high] - ticks.time[low] <= SLIP and way.max() <= SLIP_SHARE * options.held_drift:
            out[part.start : part.stop] = part.before
    return out


def movements(code: Ints) -> list[Movement]:
    """Ranges of equal code, in order."""
    borders = np.concatenate([[0], np.flatnonzero(np.diff(code)) + 1, [len(code)]]).tolist()
    codes: list[int | None] = [None, *code[borders[:-1]].tolist(), None]
    return [
        Movement(start, stop, int(codes[k + 1] or 0), before=codes[k], after=codes[k + 2])
        for k, (start, stop) in enumerate(pairwise(borders))
    ]


def _of_movement(whole: Stretch, motion: JointMovement, movement: Movement, options: SegmentOptions) -> list[Piece]:
    """Runs and left-out pieces of a movement of one joint."""
    start, stop = (int(motion.ticks.edges[tick]) for tick in (movement.start, movement.stop))
    joint = abs(movement.code)
    time, position = whole.time, whole.log.position[:, joint - 1]
    way = abs(float(position[stop - 1] - position[start]))
    if way < options.rest_speed * options.min_duration:
        return [Piece(start, stop, reason="rest")]
    constant: list[ConstantVelocity] = []
    if options.kinds != STROKE:
        ticks = (movement.start, movement.stop)
        constant = constant_velocities(motion.ticks, ticks, (time, position), joint=joint, options=options)
    runs = [run for run in constant if _is_long(time, position, run, options)]
    share = sum(abs(position[run.stop - 1] - position[run.start]) for run in runs) / way
    is_whole = movement.before is not None and movement.after is not None
    duration = float(time[stop - 1] - time[start])
    if movement.before == movement.after == SEVERAL and duration < LONE:
        return [Piece(start, stop, (joint,), reason="between-several", figure=way)]
    if runs and (share >= options.plateau_share or not is_whole or options.kinds == CONSTANT):
        pieces = [Piece(run.start, run.stop, (joint,), kind=CONSTANT, figure=run.velocity) for run in runs]
        return _between((start, stop), [_unless_drifting(motion.ticks, piece, options) for piece in pieces], "ramp")
    if options.kinds in (STROKE, BOTH) and movement.from_rest and way >= options.min_travel:
        return _of_stroke(whole, motion.ticks, movement, options)
    reason = "too-short" if constant or duration < 2 * options.min_duration else "speed-not-constant"
    return [Piece(start, stop, (joint,), reason=reason, figure=way)]


def _is_long(time: Floats, position: Floats, run: ConstantVelocity, options: SegmentOptions) -> bool:
    first, last = run.start, run.stop - 1
    is_far = abs(float(position[last] - position[first])) >= options.min_travel
    return is_far and time[last] - time[first] >= options.min_duration and run.stop - first >= options.min_samples


def _unless_drifting(ticks: Ticks, piece: Piece, options: SegmentOptions) -> Piece:
    """The piece, or its rejection because a held joint went too far."""
    low, high = np.searchsorted(ticks.edges, [piece.start, piece.stop])
    position = ticks.position[low : max(high, low + 1)]
    drift = np.abs(position[-1] - position[0])
    drift[piece.joints[0] - 1] = 0.0
    worst = int(np.argmax(drift))
    if drift[worst] <= options.held_drift:
        return piece
    joints = (piece.joints[0], worst + 1)
    return Piece(piece.start, piece.stop, joints, reason="drift-of-held-joint", figure=float(drift[worst]))


def _of_stroke(whole: Stretch, ticks: Ticks, movement: Movement, options: SegmentOptions) -> list[Piece]:
    """A movement from rest to rest as a stroke between its ends, in which friction may not slide yet."""
    low, high = bounds = int(ticks.edges[movement.start]), int(ticks.edges[movement.stop])
    joint, direction = abs(movement.code), 1 if movement.code > 0 else -1
    noise = float(ticks.noise[joint - 1]) * float(ticks.edges[1] - ticks.edges[0]) ** 0.5
    smoothed = smooth(whole.time, whole.log.position[:, joint - 1], bounds=bounds, noise=noise)
    start, stop = sliding(smoothed, direction, options)
    if stop - start < options.min_samples or whole.time[stop - 1] - whole.time[start] < options.min_duration:
        return [Piece(low, high, (joint,), reason="too-short")]
    smoothed = smoothed.within(start, stop)
    peak = float(np.abs(smoothed.velocity).max())
    stroke = Piece(start, stop, (joint,), kind=STROKE, figure=direction * peak, smoothed=smoothed)
    return _between(bounds, [_unless_drifting(ticks, stroke, options)], "low-speed", peak)


def _between(bounds: tuple[int, int], runs: list[Piece], reason: str, figure: float = 0.0) -> list[Piece]:
    """Runs of one movement and, before, between and behind them, what is left out for a reason."""
    out, at = [], bounds[0]
    for run in runs:
        if run.start > at:
            out.append(Piece(at, run.start, run.joints[:1], reason=reason, figure=figure))
        out.append(run)
        at = run.stop
    return out if at >= bounds[1] else [*out, Piece(at, bounds[1], runs[0].joints[:1], reason=reason, figure=figure)]


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
