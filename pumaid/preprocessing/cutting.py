"""One block of samples cut into what is kept and what is left out, every sample in exactly one piece."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.preprocessing.block import LARGEST, Block
from pumaid.preprocessing.clock import sampled
from pumaid.preprocessing.movement import REST, SEVERAL, Course, Stretch, course, stretches
from pumaid.preprocessing.options import BOTH, CONSTANT, STROKE, SegmentOptions
from pumaid.preprocessing.plateau import Plateau, plateaus
from pumaid.preprocessing.speed import Ticks, usual_step
from pumaid.preprocessing.stroke import Smooth, sliding, smooth

Floats = NDArray[np.float64]

#: A step of time above so many usual ones, and above so many seconds, is a gap.
GAP_STEPS, GAP_TIME = 5.0, 0.05
#: s; shortest motion of one joint between motions of several; a shorter one is a chance (the others just turn back).
LONE = 1.0
#: Fewest samples from which a speed can be told.
FEWEST = 6


@dataclass(frozen=True, eq=False, slots=True)
class Piece:
    """Samples [start, stop) of a block: a run of `kind`, or left out for `reason`.

    `joints` move in it; `figure` is the number that the reason turns on; `course` holds a stroke's smoothed motion;
    """

    start: int
    stop: int
    joints: tuple[int, ...] = ()
    kind: str = ""
    reason: str = ""
    figure: float = 0.0
    course: Smooth | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Whole:
    """A stretch without gaps: samples [start, start + N) of a block, with what its joints do at the ticks.

    `time` is when samples were taken, `stamp_error` (s) by how much (RMS) that is not what the stamps say.
    """

    start: int
    time: Floats
    position: Floats
    motion: Course
    stamp_error: float = 0.0

    def __len__(self) -> int:
        return len(self.time)

    @property
    def ticks(self) -> Ticks:
        """Means over ticks; edges count from `start`."""
        return self.motion.ticks


def is_measured(block: Block) -> NDArray[np.bool_]:
    """(N,) whether time and every position of a sample are numbers that an arm can have."""
    good = np.isfinite(block.time)
    # A number that is none makes the smallest and the largest none, too.
    if len(good) and block.position.max() < LARGEST and block.position.min() > -LARGEST:
        return good
    return good & (np.abs(block.position) < LARGEST).all(axis=1)


def wholes(block: Block, options: SegmentOptions, *, usual: float) -> tuple[list[Whole], list[Piece]]:
    """Stretches without gaps, and what is too small to be one; `usual` (s) is the block's step of time."""
    steps = np.diff(block.time)
    broken = (steps > max(GAP_STEPS * usual, GAP_TIME)) | (steps <= 0)
    borders = np.concatenate([[0], np.flatnonzero(broken) + 1, [len(block)]])
    found, fragments = [], []
    for low, high in zip(borders[:-1].tolist(), borders[1:].tolist(), strict=True):
        if high - low < FEWEST:
            fragments.append(Piece(low, high, reason="gap"))
            continue
        time, position = block.time[low:high], block.position[low:high]
        time, error = sampled(time, position)
        step = usual if high - low == len(block) and not error else usual_step(time)
        found.append(Whole(low, time, position, course(Ticks.of(time, position, step=step), options), error))
    return found, fragments


def pieces(whole: Whole, options: SegmentOptions) -> list[Piece]:
    """All samples of a stretch without gaps as kept and left-out pieces, in order."""
    out: list[Piece] = []
    edges = whole.ticks.edges
    found = stretches(whole.motion.code)
    flat = _flat(whole, found, options)
    for number, stretch in enumerate(found):
        start, stop = int(edges[stretch.start]), int(edges[stretch.stop])
        if stretch.code == REST:
            out.append(Piece(start, stop, reason="rest"))
        elif stretch.code == SEVERAL:
            moving = whole.motion.moving[stretch.start : stretch.stop].sum(axis=0)
            order = np.argsort(-moving, kind="stable")
            out.append(Piece(start, stop, tuple(int(j) + 1 for j in order if moving[j]), reason="several-joints"))
        else:
            out.extend(_movement(whole, stretch, flat.get(number, []), options))
    return [shifted(piece, whole.start) for piece in _disjoint(out)]


def _movement(whole: Whole, stretch: Stretch, flat: list[Plateau], options: SegmentOptions) -> list[Piece]:
    start, stop = bounds = _bounds(whole, stretch)
    joint = stretch.joint
    position = whole.position[:, joint - 1]
    way = _way(whole, stretch)
    if way < options.rest_speed * options.min_duration:
        return [Piece(start, stop, reason="rest")]
    long_enough = [plateau for plateau in flat if _is_long(whole, plateau, joint, options)]
    share = sum(abs(position[p.stop - 1] - position[p.start]) for p in long_enough) / way
    is_whole = stretch.before is not None and stretch.after is not None
    enough = bool(long_enough) and (share >= options.plateau_share or not is_whole or options.kinds == CONSTANT)
    duration = float(whole.time[stop - 1] - whole.time[start])
    if stretch.before == stretch.after == SEVERAL and duration < LONE:
        return [Piece(start, stop, (joint,), reason="between-several", figure=way)]
    if enough:
        kept = [Piece(p.start, p.stop, (joint,), kind=CONSTANT, figure=p.level) for p in long_enough]
        return _with_rest(bounds, [_held(whole, piece, options) for piece in kept], joint)
    if options.kinds in (STROKE, BOTH) and stretch.from_rest and way >= options.min_travel:
        return _stroke(whole, stretch, bounds, options)
    reason = "too-short" if flat or duration < 2 * options.min_duration else "speed-not-constant"
    return [Piece(start, stop, (joint,), reason=reason, figure=way)]


def _bounds(whole: Whole, stretch: Stretch) -> tuple[int, int]:
    return int(whole.ticks.edges[stretch.start]), int(whole.ticks.edges[stretch.stop])


def _way(whole: Whole, stretch: Stretch) -> float:
    """How far the joint comes, rad or m."""
    start, stop = _bounds(whole, stretch)
    position = whole.position[:, stretch.joint - 1]
    return abs(float(position[stop - 1] - position[start]))


def _flat(whole: Whole, found: list[Stretch], options: SegmentOptions) -> dict[int, list[Plateau]]:
    """Plateaus of those stretches in which one joint moves, by the stretch's number."""
    if options.kinds == STROKE:
        return {}
    least = options.rest_speed * options.min_duration
    moving = [k for k, one in enumerate(found) if one.code not in (REST, SEVERAL) and _way(whole, one) >= least]
    flat = plateaus(whole.ticks, [found[k] for k in moving], (whole.time, whole.position), options=options)
    return dict(zip(moving, flat, strict=True))


def _is_long(whole: Whole, plateau: Plateau, joint: int, options: SegmentOptions) -> bool:
    first, last = plateau.start, plateau.stop - 1
    way = abs(float(whole.position[last, joint - 1] - whole.position[first, joint - 1]))
    duration = float(whole.time[last] - whole.time[first])
    count = plateau.stop - plateau.start
    return duration >= options.min_duration and way >= options.min_travel and count >= options.min_samples


def _held(whole: Whole, piece: Piece, options: SegmentOptions) -> Piece:
    """The piece, or its rejection because a held joint went too far."""
    edges = whole.ticks.edges
    low, high = np.searchsorted(edges, [piece.start, piece.stop])
    position = whole.ticks.position[low : max(high, low + 1)]
    drift = np.abs(position[-1] - position[0])
    drift[piece.joints[0] - 1] = 0.0
    worst = int(np.argmax(drift))
    if drift[worst] <= options.held_drift:
        return piece
    joints = (piece.joints[0], worst + 1)
    return Piece(piece.start, piece.stop, joints, reason="drift-of-held-joint", figure=float(drift[worst]))


def _stroke(whole: Whole, stretch: Stretch, bounds: tuple[int, int], options: SegmentOptions) -> list[Piece]:
    joint = stretch.joint
    size = int(whole.ticks.edges[1] - whole.ticks.edges[0])
    noise = float(whole.ticks.noise[joint - 1]) * size**0.5
    motion = smooth(whole.time, whole.position[:, joint - 1], bounds=bounds, noise=noise)
    direction = 1 if stretch.code > 0 else -1
    start, stop = sliding(motion, direction, options)
    if stop - start < options.min_samples or whole.time[stop - 1] - whole.time[start] < options.min_duration:
        return [Piece(*bounds, (joint,), reason="too-short", figure=0.0)]
    part = motion.within(start, stop)
    figure = direction * float(np.abs(part.velocity).max())
    piece = _held(whole, Piece(start, stop, (joint,), kind=STROKE, figure=figure, course=part), options)
    slow = [
        Piece(a, b, (joint,), reason="low-speed", figure=abs(figure))
        for a, b in ((bounds[0], start), (stop, bounds[1]))
    ]
    return [part for part in (slow[0], piece, slow[1]) if part.stop > part.start]


def _with_rest(bounds: tuple[int, int], kept: list[Piece], joint: int) -> list[Piece]:
    """The kept pieces of a movement and, between them, its ramps."""
    out, at = [], bounds[0]
    for piece in kept:
        if piece.start > at:
            out.append(Piece(at, piece.start, (joint,), reason="ramp"))
        out.append(piece)
        at = piece.stop
    if at < bounds[1]:
        out.append(Piece(at, bounds[1], (joint,), reason="ramp"))
    return out


def _disjoint(found: list[Piece]) -> list[Piece]:
    """The pieces without overlap; where a kept one reaches into a neighbour, the neighbour yields."""
    out: list[Piece] = []
    for piece in found:
        while piece.kind and out and not out[-1].kind and out[-1].stop > piece.start:
            yielding = out.pop()
            if yielding.start < piece.start:
                out.append(replace(yielding, stop=piece.start))
        start = max(piece.start, out[-1].stop if out else 0)
        if piece.stop > start:
            out.append(clipped(piece, start, piece.stop))
    return out


def clipped(piece: Piece, start: int, stop: int) -> Piece:
    """The part of a piece between two samples; a run that is cut goes on in the neighbouring block."""
    start, stop = max(start, piece.start), min(stop, piece.stop)
    if (start, stop) == (piece.start, piece.stop):
        return piece
    return replace(piece, start=start, stop=stop, course=piece.course.within(start, stop) if piece.course else None)


def shifted(piece: Piece, by: int) -> Piece:
    """The piece with sample numbers that count from `by` samples earlier."""
    if not by:
        return piece
    motion = piece.course and replace(piece.course, start=piece.course.start + by, stop=piece.course.stop + by)
    return replace(piece, start=piece.start + by, stop=piece.stop + by, course=motion)
