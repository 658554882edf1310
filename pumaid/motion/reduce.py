"""Samples of a piece reduced to a triangle and to cells."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pumaid.maths.short import lengths
from pumaid.maths.triangle import Triangle
from pumaid.motion.block import LARGEST, Block
from pumaid.motion.cutting import Piece
from pumaid.motion.parallel import of_stroke
from pumaid.records import CONSTANT_COLUMNS, Cells, Robot, run_columns

Floats = NDArray[np.float64]

#: Which samples of a block: all from one to another, or their indices.
Chosen = slice | NDArray[np.int64]


def usable(block: Block, piece: Piece) -> Chosen:
    """The samples whose own current is a number; none where it is 0 throughout (the motor is off)."""
    current = block.current[piece.start : piece.stop, piece.joints[0] - 1]
    if not current.any():
        return np.zeros(0, dtype=np.int64)
    if _all_below(current, LARGEST):
        return slice(piece.start, piece.stop)
    return piece.start + np.flatnonzero(np.abs(current) < LARGEST)


def _all_below(values: Floats, largest: float) -> bool:
    """Whether all are numbers between the largest and its negative; one that is none makes the extremes none, too."""
    return bool(values.max() < largest and values.min() > -largest)


def _within(samples: Chosen, piece: Piece) -> Chosen:
    """The same samples as counted from the piece's first."""
    return slice(None) if isinstance(samples, slice) else samples - piece.start


def triangle(block: Block, piece: Piece, robot: Robot, *, samples: Chosen) -> Triangle:
    """The run's triangle over the columns that its kind has."""
    joint = piece.joints[0]
    turns = robot.joint(joint).is_revolute
    if piece.course is not None:
        whole = slice(piece.start, piece.stop)
        known = np.full(piece.stop - piece.start, np.nan)
        known[_within(samples, piece)] = block.current[samples, joint - 1]
        return of_stroke(piece.course, block.position[whole, joint - 1], known, turns=turns)
    position, current = block.position[samples, joint - 1], block.current[samples, joint - 1]
    return Triangle.of(CONSTANT_COLUMNS, run_columns(position, turns=turns), current)


def cells(block: Block, piece: Piece, rate: tuple[Floats, Floats], *, samples: Chosen, most: int) -> Cells:
    """Means over at most `most` equal spans of time.

    Parameters
    ----------
    block, piece
        The samples.
    rate
        (K,) times and (K, J) velocities of all joints to interpolate.
    samples
        Those to use, in order, at least one.
    most
        Cells at most.
    """
    own = piece.joints[0] - 1
    time = block.time[samples]
    number = min(most, len(time))
    starts = np.arange(number) if number == len(time) else _spans(time, number)
    count = lengths(starts, len(time))
    middle = time[0] + np.add.reduceat(time - time[0], starts) / count
    current = _known_means(block.current[samples], starts, count)
    spread = block.current[samples, own] - np.repeat(current[:, own], count)
    square = np.add.reduceat(spread * spread, starts) / count
    if not np.isfinite(square).all():
        spread = np.nan_to_num(spread)
        square = np.add.reduceat(spread * spread, starts) / count
    velocity = _between(middle, rate)
    acceleration = np.zeros(len(starts))
    if piece.course is not None:
        at = _within(samples, piece)
        velocity[:, own] = np.add.reduceat(piece.course.velocity[at], starts) / count
        acceleration = np.add.reduceat(piece.course.acceleration[at], starts) / count
    warmth = np.full(len(starts), np.nan)
    if block.temperature is not None:
        warmth = _known_means(block.temperature[samples, own][:, None], starts, count)[:, 0]
    return Cells(
        count=count,
        time=middle,
        position=_means(block.position[samples], starts, count),
        velocity=velocity,
        acceleration=acceleration,
        current=current,
        variance=square,
        temperature=warmth,
        extra=None if block.extra is None else _known_means(block.extra[samples], starts, count, largest=np.inf),
    )


def _each_once(rising: NDArray[np.int64]) -> NDArray[np.int64]:
    """Rising numbers without repeats."""
    return rising[np.append(True, rising[1:] != rising[:-1])]


def _means(values: Floats, starts: NDArray[np.int64], count: NDArray[np.int64]) -> Floats:
    """(M, J) means of the `count` (M,) values from each start on."""
    return np.asarray(np.add.reduceat(values, starts, axis=0) / count[:, None])


def _known_means(
    values: Floats, starts: NDArray[np.int64], count: NDArray[np.int64], *, largest: float = LARGEST
) -> Floats:
    """The same of the numbers below `largest` only; NaN where there are none."""
    if _all_below(values, largest):
        return _means(values, starts, count)
    good = np.abs(values) < largest
    known = np.add.reduceat(good.astype(float), starts, axis=0)
    total = np.add.reduceat(np.where(good, values, 0.0), starts, axis=0)
    return np.divide(total, known, out=np.full(total.shape, np.nan), where=known > 0)


def _between(time: Floats, rate: tuple[Floats, Floats]) -> Floats:
    """(M, J) values of (K,) times and (K, J) values at other times: on straight lines, held at the ends."""
    known, values = rate
    if len(known) < 2:
        return np.repeat(values, len(time), axis=0)
    left = np.searchsorted(known[1:-1], time)
    right = left + 1
    share = (time - known[left]) / (known[right] - known[left])
    share = np.minimum(np.maximum(share, 0.0), 1.0)[:, None]
    return np.asarray(values[left] * (1.0 - share) + values[right] * share)


def coarser(parts: list[Cells], most: int, *, joint: int) -> Cells:
    """The cells of consecutive pieces, in which `joint` (from 1) moves, as one set of at most `most`."""
    whole = parts[0] if len(parts) == 1 else _together(parts)
    if len(whole) <= most:
        return whole
    count, starts = whole.count, _spans(whole.time, most)
    total = np.add.reduceat(count, starts)

    def mean(values: Floats) -> Floats:
        weight = count if values.ndim == 1 else count[:, None]
        sums = np.add.reduceat(values * weight, starts, axis=0)
        return np.asarray(sums / (total if values.ndim == 1 else total[:, None]))

    own, middle = whole.current[:, joint - 1], mean(whole.current)
    between = own - np.repeat(middle[:, joint - 1], lengths(starts, len(count)))
    return Cells(
        count=total,
        time=mean(whole.time),
        position=mean(whole.position),
        velocity=mean(whole.velocity),
        acceleration=mean(whole.acceleration),
        current=middle,
        variance=mean(whole.variance + between * between),
        temperature=mean(whole.temperature),
        extra=None if whole.extra is None else _known_mean(whole.extra, starts, count),
    )


def _together(parts: list[Cells]) -> Cells:
    """Consecutive cells as one set."""
    names = [name for name in Cells.__dataclass_fields__ if name != "extra"]
    joined: list[Any] = [np.concatenate([getattr(part, name) for part in parts]) for name in names]
    known = [part.extra for part in parts if part.extra is not None]
    joined.append(np.concatenate(known) if len(known) == len(parts) else None)
    return Cells(*joined)


def _spans(time: Floats, most: int) -> NDArray[np.int64]:
    """Where at most `most` equal spans of (M,) rising times begin, those without an instant left out."""
    borders = time[0] + np.arange(most) * ((time[-1] - time[0]) / most)
    return _each_once(np.searchsorted(time, borders))


def _known_mean(values: Floats, starts: NDArray[np.int64], count: NDArray[np.int64]) -> Floats:
    """(M, E) means of cells of `count` samples each, those without a number left out."""
    weight = np.where(np.isfinite(values), count[:, None], 0)
    total = np.add.reduceat(weight, starts, axis=0)
    sums = np.add.reduceat(np.nan_to_num(values) * weight, starts, axis=0)
    return np.divide(sums, total, out=np.full(sums.shape, np.nan), where=total > 0)
