"""Samples of a piece reduced to a triangle and to bins."""

from __future__ import annotations

from dataclasses import fields
from itertools import accumulate, pairwise
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import CONSTANT_COLUMNS, Bins, Means, run_columns
from pumaid.maths.short import lengths
from pumaid.maths.triangle import Triangle
from pumaid.preprocessing.block import LARGEST, Block
from pumaid.preprocessing.cutting import Piece
from pumaid.preprocessing.parallel import of_stroke
from pumaid.robot import Robot

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]
Kept = TypeVar("Kept", Bins, Means)

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


def bins(block: Block, piece: Piece, rate: tuple[Floats, Floats], *, samples: Chosen, most: int) -> Bins:
    """Means of a run over at most `most` equal spans of time.

    Parameters
    ----------
    block, piece
        The samples.
    rate
        (K,) times and (K,) velocities of the moving joint to interpolate, where the piece is no stroke.
    samples
        Those to use, in order, at least one, all with a current.
    most
        Bins at most.
    """
    own, time = piece.joints[0] - 1, block.time[samples]
    starts, count, middle = _shared_out(time, most)
    measured = block.current[samples, own]
    current = _means(measured, starts, count)
    spread = measured - np.repeat(current, count)
    if piece.course is not None:
        at = _within(samples, piece)
        velocity = _means(piece.course.velocity[at], starts, count)
        acceleration = _means(piece.course.acceleration[at], starts, count)
    else:
        velocity, acceleration = _between(middle, rate), np.zeros(len(starts))
    warmth = np.full(len(starts), np.nan)
    if block.temperature is not None:
        warmth = _known_means(block.temperature[samples, own], starts, count)
    return Bins(
        count=count,
        time=middle,
        position=_means(block.position[samples], starts, count),
        velocity=velocity,
        acceleration=acceleration,
        current=current,
        variance=_means(spread * spread, starts, count),
        temperature=warmth,
        extra=None if block.extra is None else _known_means(block.extra[samples], starts, count, largest=np.inf),
    )


def means(block: Block, piece: Piece, rate: tuple[Floats, Floats], *, most: int) -> Means:
    """Means of all joints over at most `most` equal spans of time of what is no run.

    Parameters
    ----------
    block, piece
        The samples.
    rate
        (K,) times and (K, J) velocities of all joints to interpolate.
    most
        Spans at most.
    """
    samples = slice(piece.start, piece.stop)
    starts, count, middle = _shared_out(block.time[samples], most)
    return Means(
        count=count,
        time=middle,
        position=_means(block.position[samples], starts, count),
        velocity=_between(middle, rate),
        current=_known_means(block.current[samples], starts, count),
    )


def _shared_out(time: Floats, most: int) -> tuple[Counts, Counts, Floats]:
    """Where at most `most` equal spans of (N,) times begin, how many samples each has, and their mean times."""
    number = min(most, len(time))
    starts = np.arange(number) if number == len(time) else _spans(time, number)
    count = lengths(starts, len(time))
    return starts, count, time[0] + np.add.reduceat(time - time[0], starts) / count


def _each_once(rising: Counts) -> Counts:
    """Rising numbers without repeats."""
    return rising[np.append(True, rising[1:] != rising[:-1])]


def _each(weights: NDArray[Any], values: Floats) -> NDArray[Any]:
    """(M,) weights as (M,) or (M, J) values can be multiplied with."""
    return weights if values.ndim == 1 else weights[:, None]


def _means(values: Floats, starts: Counts, count: Counts) -> Floats:
    """(M,) or (M, J) means of the `count` (M,) values from each start on."""
    sums = np.add.reduceat(values, starts, axis=0)
    return np.asarray(sums / _each(count, sums))


def _known_means(values: Floats, starts: Counts, count: Counts, *, largest: float = LARGEST) -> Floats:
    """The same of the numbers below `largest` only; NaN where there are none."""
    if _all_below(values, largest):
        return _means(values, starts, count)
    good = np.abs(values) < largest
    known = np.add.reduceat(good.astype(float), starts, axis=0)
    total = np.add.reduceat(np.where(good, values, 0.0), starts, axis=0)
    return np.divide(total, known, out=np.full(total.shape, np.nan), where=known > 0)


def _between(time: Floats, rate: tuple[Floats, Floats]) -> Floats:
    """(M,) or (M, J) values of (K,) times and values there at other times: on straight lines, held at the ends."""
    known, values = rate
    if len(known) < 2:
        return np.repeat(values, len(time), axis=0)
    left = np.searchsorted(known[1:-1], time)
    right = left + 1
    share = (time - known[left]) / (known[right] - known[left])
    share = _each(np.minimum(np.maximum(share, 0.0), 1.0), values)
    return np.asarray(values[left] * (1.0 - share) + values[right] * share)


def coarser(parts: list[Kept], most: int) -> Kept:
    """The bins of consecutive pieces as one set of at most `most`."""
    whole = parts[0] if len(parts) == 1 else _together(parts)
    if len(whole) <= most:
        return whole
    count, starts = whole.count, _spans(whole.time, most)
    total = np.add.reduceat(count, starts)
    names = [item.name for item in fields(whole) if item.name not in ("count", "extra")]
    given = [getattr(whole, name) for name in names]
    # All columns at once: each call of numpy costs as much as the sums of one of them.
    table = np.concatenate([values.T if values.ndim > 1 else values[None] for values in given])
    means = np.add.reduceat(table * count, starts, axis=1) / total
    borders = accumulate((values.shape[1] if values.ndim > 1 else 1 for values in given), initial=0)
    found: dict[str, Any] = {
        name: np.ascontiguousarray(means[low:high].T) if values.ndim > 1 else means[low]
        for name, values, (low, high) in zip(names, given, pairwise(borders), strict=True)
    }
    if isinstance(whole, Bins):
        spread = whole.current - np.repeat(found["current"], lengths(starts, len(count)))
        found["variance"] = found["variance"] + np.add.reduceat(spread * spread * count, starts) / total
        if whole.extra is not None:
            found["extra"] = _known_mean(whole.extra, starts, count)
    return type(whole)(**found, count=total)


def _together(parts: list[Kept]) -> Kept:
    """Consecutive bins as one set."""
    columns = ([getattr(part, item.name) for part in parts] for item in fields(parts[0]))
    joined: list[Any] = [None if any(one is None for one in column) else np.concatenate(column) for column in columns]
    return type(parts[0])(*joined)


def _spans(time: Floats, most: int) -> Counts:
    """Where at most `most` equal spans of (M,) rising times begin, those without an instant left out."""
    borders = time[0] + np.arange(most) * ((time[-1] - time[0]) / most)
    return _each_once(np.searchsorted(time, borders))


def _known_mean(values: Floats, starts: Counts, count: Counts) -> Floats:
    """(M, E) means of bins of `count` samples each, those without a number left out."""
    weight = np.where(np.isfinite(values), count[:, None], 0)
    total = np.add.reduceat(weight, starts, axis=0)
    sums = np.add.reduceat(np.nan_to_num(values) * weight, starts, axis=0)
    return np.divide(sums, total, out=np.full(sums.shape, np.nan), where=total > 0)
