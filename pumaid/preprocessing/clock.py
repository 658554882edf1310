"""When samples were taken: by their time stamps, or evenly where the motion shows that the stamps alone are uneven."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Run
from pumaid.errors import Note, Where
from pumaid.maths.slope import filtered
from pumaid.preprocessing.speed import SURE

Floats = NDArray[np.float64]

#: Unevenness of stamps, RMS as a share of their interval, that no speed and no acceleration suffers from.
EVEN = 0.01
#: Samples on either side of the local cubics that part the stamps' unevenness into what is fast and what is slow. What
#: is slower than the last is the clock's own drift, and taken at its word.
HALVES = (4, 16, 64)
#: The same of means, for stamps that are those of an even clock, rounded.
BEAT = 128
#: Steps above so many intervals may stand for lost samples; so many stamps on either side tell it from a late stamp.
LONG, BESIDE = 1.45, 8
#: Samples that are summed together, so that their common errors count as one, and fewest such groups that tell it.
GROUP, FEWEST = 32, 6
#: Share of these groups that must be uneven alike: stalls of the recorder now and then are no rounding.
SPREAD = 0.3
#: Samples that are looked at together, and how often at most; they lie evenly over the stretch.
LOOK, MOST = 128 * GROUP, 8
#: Samples on either side by which the speed is told, and how many of its standard deviations it must have.
AROUND, CLEAR = 8, 10.0
#: Share of the unevenness up to which stamps are corrected; what is shown nearly whole is taken for right.
MOSTLY = 0.7
#: Largest standard error of that share from which anything is told; one that is less than nothing by more is an error.
TOLD = 0.15
#: s; finest resolution of stamps that is looked for, and how many of its steps a rounded even clock is off at most.
FINEST, ROUNDED = 1e-6, 0.75


def sampled(time: Floats, position: Floats) -> tuple[Floats, float]:
    """When samples were taken.

    Stamps are rounded, or written when a message arrives, while the samples themselves are taken evenly; or the samples
    are uneven and the stamps tell it. In the first case positions of a moving joint are smooth from sample to sample,
    in the second they show what the stamps show, times the speed. By how much of it they do (1 for stamps that are
    right, 0 for an even clock) is the slope of a straight line through both, one for each band of frequencies: a clock
    that wanders and is rounded has both. What is surely not shown is taken out.

    Parameters
    ----------
    time
        (N,) s, rising, a stretch without gaps.
    position
        (N, J) rad or m.

    Returns
    -------
    time, error
        (N,) s, rising; and the RMS by which the stamps differ from it (s), zero where they are right or no motion
        tells.
    """
    if len(time) < GROUP * FEWEST:
        return time, 0.0
    steps = np.diff(time)
    least, most = float(steps.min()), float(steps.max())
    # Where even the longest step is no longer, none is lost and the interval is at least the shortest.
    if most - least <= EVEN * least:
        return time, 0.0
    lost, interval = _lost(time, steps)
    if most - least <= EVEN * interval:
        return time, 0.0
    ahead = time - time[0] - np.concatenate([[0.0], np.cumsum(1.0 + lost)]) * interval
    parts = _parted(ahead)
    uneven = np.sum(parts, axis=0)
    if _rms(uneven) <= EVEN * interval or _spread(parts[0]) < SPREAD:
        return time, 0.0
    shares, errors = _shown(uneven, position, interval=interval, lost=lost)
    wrong = np.zeros(len(time))
    is_told = errors < TOLD
    # Less than nothing is shown by a wrong count of samples only.
    if not is_told[0] or (shares[is_told] + SURE * errors[is_told] < -TOLD).any():
        return time, 0.0
    rounded = ahead - _even(ahead)
    if np.abs(rounded).max() <= ROUNDED * _resolution(steps):
        # An even clock explains all stamps, the slow beat of both, too, that no motion is calm enough to tell.
        parts, shares, errors = [rounded], shares[:1], errors[:1]
    for part, share, error in zip(parts, shares, errors, strict=True):
        if share + SURE * error >= MOSTLY:
            break  # a clock that wanders does so slowly
        wrong += (1.0 - max(share, 0.0)) * part
    out = time - wrong
    return (out, _rms(wrong)) if wrong.any() and (np.diff(out) > 0).all() else (time, 0.0)


def notes(runs: Sequence[Run]) -> tuple[Note, ...]:
    """A note if an even clock was taken for some runs."""
    moved = [run for run in runs if run.stamp_error > 0.0]
    if not moved:
        return ()
    error = 1e3 * math.sqrt(sum(run.stamp_error**2 for run in moved) / len(moved))
    text = (
        f"in {len(moved)} of {len(runs)} runs the positions show that samples were taken more evenly than their time"
        f" stamps say, which are {error:.2g} ms RMS off: speeds and accelerations are taken by the evener clock; if"
        " you can, log the instant of sampling in microseconds"
    )
    return (Note("clock-evened", text, Where(file=moved[0].origin, row=moved[0].first_row)),)


def _lost(time: Floats, steps: Floats) -> tuple[Floats, float]:
    """(N-1,) samples that are missing in each step, and the interval (s) of all.

    A late stamp is followed by short steps; behind a lost sample all later stamps are ahead.
    """
    size = len(time)
    lost = np.zeros(len(steps))
    interval = float(np.median(time[2 * BESIDE :] - time[: -2 * BESIDE])) / (2 * BESIDE)
    long = np.flatnonzero(steps > LONG * interval)
    if len(long):
        ahead = time - time[0] - np.arange(size) * interval
        beside = np.arange(BESIDE)
        before = np.median(ahead[np.maximum(0, long[:, None] - beside)], axis=1)
        behind = np.median(ahead[np.minimum(size - 1, long[:, None] + 1 + beside)], axis=1)
        lost[long] = np.maximum(0.0, np.round(np.minimum(behind - before, steps[long] - interval) / interval))
    return lost, float(time[-1] - time[0]) / (len(steps) + float(lost.sum()))


def _even(values: Floats) -> Floats:
    """(N,) means over `BEAT` neighbours on either side, and of these again; straight lines at the ends."""
    size = len(values)
    half = min(BEAT, (size - 1) // 2)
    width = 2 * half + 1
    t = np.arange(-half, half + 1.0)
    for _ in range(2):
        total = np.concatenate([[0.0], np.cumsum(values)])
        smooth = np.empty(size)
        smooth[half : size - half] = (total[width:] - total[:-width]) / width
        for part, ends in ((slice(None, width), slice(None, half)), (slice(-width, None), slice(size - half, None))):
            line = float(values[part].mean()) + float(t @ values[part]) / float(t @ t) * t
            smooth[ends] = line[:half] if part.start is None else line[-half:]
        values = smooth
    return values


def _spread(values: Floats) -> float:
    """Share of (N,) values' groups that have their squares: 1 where all are alike, next to 0 where one has them all."""
    squares = np.add.reduceat(values * values, np.arange(0, len(values), GROUP))
    return float(squares.sum() ** 2 / (len(squares) * (squares @ squares)))


def _resolution(steps: Floats) -> float:
    """By how much stamps differ at least where they are rounded (s), from (N,) steps."""
    sizes = np.unique(np.round(steps[:LOOK] / FINEST))
    return float(np.diff(sizes).min(initial=np.inf)) * FINEST if len(sizes) > 1 else 0.0


def _parted(values: Floats) -> list[Floats]:
    """(N,) values in bands, the fastest first; what is slower than all is left out."""
    parts = []
    for half in HALVES:
        slower = filtered(values, 2 * half + 1, 0)
        parts.append(values - slower)
        values = slower
    return parts


def _rms(values: Floats) -> float:
    return math.sqrt(float(np.mean(values * values)))


def _shown(uneven: Floats, position: Floats, *, interval: float, lost: Floats) -> tuple[Floats, Floats]:
    """How much of each band of the stamps' unevenness the positions show, and the standard errors; infinite if untold.

    Parameters
    ----------
    uneven, position, lost
        (N,) s, (N, J), (N-1,) samples lost before the next.
    interval
        Of the samples, s.
    """
    last = len(uneven) - LOOK
    starts = np.unique(np.linspace(0, max(0, last), min(MOST, -(-len(uneven) // LOOK))).astype(np.int64))
    sums = [
        found
        for start in starts.tolist()
        for column in position[start : start + LOOK].T
        if (
            found := _sums(uneven[start : start + LOOK], column, interval=interval, lost=lost[start : start + LOOK - 1])
        )
        is not None
    ]
    untold = np.ones(len(HALVES)), np.full(len(HALVES), np.inf)
    if not sums:
        return untold
    both = np.concatenate(sums, axis=2)
    total = both.sum(axis=2)
    # As many groups as if all weighed the same.
    if total[1].min() <= 0.0 or total[1, 0] ** 2 < FEWEST * float(np.sum(both[1, 0] ** 2)):
        return untold
    shares = total[0] / total[1]
    errors = np.empty(len(HALVES))
    for band, (half, rest) in enumerate(zip(HALVES, both[0] - shares[:, None] * both[1], strict=True)):
        # What is slow is common to several groups.
        common = np.add.reduceat(rest, np.arange(0, len(rest), max(1, 2 * half // GROUP)))
        errors[band] = math.sqrt(float(common @ common)) / total[1, band]
    return shares, errors


def _sums(uneven: Floats, position: Floats, *, interval: float, lost: Floats) -> Floats | None:
    """(2, B, G) sums of a straight line through the origin, by band and group of samples; None where nothing moves."""
    size = len(position)
    noise = _rms(np.diff(position, 3)) / math.sqrt(20.0)
    span = 2 * AROUND * interval
    speed = np.zeros(size)
    speed[AROUND:-AROUND] = (position[2 * AROUND :] - position[: -2 * AROUND]) / span
    speed[np.abs(speed) <= CLEAR * noise * math.sqrt(2.0) / span] = 0.0
    if noise == 0.0 or not speed.any():
        return None
    near = np.concatenate([[0.0], np.cumsum(lost)])
    whole = np.ones(size, dtype=np.bool_)
    whole[AROUND:-AROUND] = near[2 * AROUND :] == near[: -2 * AROUND]
    groups = np.arange(0, size, GROUP)
    out = np.empty((2, len(HALVES), len(groups)))
    for band, (seen, told) in enumerate(zip(_parted(position / noise), _parted(speed * uneven / noise), strict=True)):
        told = np.where(whole & (speed != 0.0), told, 0.0)
        out[:, band] = np.add.reduceat(told * seen, groups), np.add.reduceat(told * told, groups)
    return out
