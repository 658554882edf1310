"""Speed from position: means over short ticks, straight lines through a few of them, and how noisy those are."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.maths.short import lengths, mean
from pumaid.maths.slope import filtered

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: s; short against every ramp of a real arm, long enough to average tens of samples at 1 kHz.
TICK = 0.02
#: s; longest span of a straight line that a moving joint is looked for with: pauses shorter than it may be missed.
LONGEST_FIT = 0.5
#: Standard deviations of a speed that count as surely moving (one false alarm in about 1e5 ticks).
SURE = 4.5
#: Samples of one joint looked at together: with their differences they stay in the processor's cache.
CACHED = 16_384
#: Median absolute third difference of white noise of unit standard deviation.
THIRD_DIFFERENCE = math.sqrt(20.0) * 0.6745
#: Share by which steps of time of an even clock differ; their mean is then found fifty times sooner than their median.
_EVEN = 1e-3
#: Share by which others than gaps differ from their median.
_USUAL = 0.25
#: Digits of a count of samples that are no rounding of times in microseconds.
_DIGITS = 3


@dataclass(frozen=True, eq=False, slots=True)
class Ticks:
    """K means over equal numbers of samples of a stretch without gaps.

    Attributes
    ----------
    edges
        (K+1,) sample indices of the ticks' borders.
    time, position
        (K,) s and (K, J) rad or m.
    interval
        Mean distance of ticks, s.
    noise
        (J,) standard deviation of a tick's mean, rad or m, quantisation included.
    quantum
        (J,) smallest step that the position makes, rad or m (next to zero where it is not quantised).
    """

    edges: Ints
    time: Floats
    position: Floats
    interval: float
    noise: Floats
    quantum: Floats

    def __len__(self) -> int:
        return len(self.time)

    @classmethod
    def of(cls, time: Floats, position: Floats, *, step: float) -> Ticks:
        """Reduce (N,) times and (N, J) positions, N at least 2; `step` (s) is the usual one of time."""
        size = max(1, whole(TICK / step))
        starts = np.arange(0, max(1, len(time) - size // 2), size)
        counts = lengths(starts, len(time))
        centre = position[0]
        means = np.add.reduceat(position - centre, starts, axis=0) / counts[:, None] + centre
        tick_time = time[0] + np.add.reduceat(time - time[0], starts) / counts
        quantum = np.array([_smallest_step(column) for column in position.T])
        noise = quantum / math.sqrt(12.0)
        if len(means) > 4:
            noise = np.maximum(noise, np.median(np.abs(np.diff(means, 3, axis=0)), axis=0) / THIRD_DIFFERENCE)
        interval = float((tick_time[-1] - tick_time[0]) / max(1, len(means) - 1)) or TICK
        return cls(np.append(starts, len(time)), tick_time, means, interval, noise, quantum)

    def fit_error(self, joint: int, half: int) -> float:
        """Standard deviation of the slope of a straight line through ``2 half + 1`` ticks, rad/s or m/s."""
        width = 2 * half + 1
        return float(self.noise[joint - 1]) / (self.interval * math.sqrt(width * (width * width - 1) / 12.0))

    def half_width(self, joint: int, wanted: float, longest: float = LONGEST_FIT) -> int:
        """Fewest ticks on either side for which the slope's error is at most `wanted` (rad/s or m/s)."""
        most = max(1, whole(longest / self.interval / 2))
        half = 1
        while half < most and self.fit_error(joint, half) > wanted:
            half += 1
        return half


def whole(count: float) -> int:
    """Nearest whole number to a count of samples, the upper one of two.

    Counts come from times, which are rounded: a tick at 125 Hz is 2.5 samples, and must not be two in one file and
    three in the next.
    """
    return math.floor(round(count, _DIGITS) + 0.5)


def at_least(count: float) -> int:
    """The same upwards."""
    return math.ceil(round(count, _DIGITS))


def usual_step(time: Floats) -> float:
    """Mean step of (N,) times (s), gaps and repeats left out; 0 where there is none."""
    steps = np.diff(time)
    if not len(steps):
        return 0.0
    least, most = float(steps.min()), float(steps.max())
    if most > 0.0 and most - least <= _EVEN * most:
        return float(time[-1] - time[0]) / len(steps)
    # Of stamps that are rounded (float32, microseconds) the median is one of few values, none of them the clock's.
    median = float(np.median(steps))
    usual = steps[np.abs(steps - median) <= _USUAL * abs(median)]
    return float(usual.mean()) if len(usual) else median


def _smallest_step(values: Floats) -> float:
    """Smallest change from one of (N,) values to the next, above 1e-9; zero where nothing changes."""
    least = math.inf
    for low in range(0, len(values) - 1, CACHED):
        part = values[low : low + CACHED + 1]
        steps = np.abs(part[1:] - part[:-1])
        smallest = float(steps.min())
        if smallest <= 1e-9:
            smallest = float(np.where(steps > 1e-9, steps, np.inf).min())
        least = min(least, smallest)
    return least if math.isfinite(least) else 0.0


def slopes(time: Floats, values: Floats, half: int) -> Floats:
    """Slope of the straight line through each instant's neighbours.

    Parameters
    ----------
    time
        (K,) s, rising, spacing may be irregular.
    values
        (K,) .
    half
        Neighbours on either side; fewer at the ends.

    Returns
    -------
    slope
        (K,) per s; exact where the values are linear in time.
    """
    return next(slopes_by(time, values, (half,)))


def slopes_by(time: Floats, values: Floats, halves: Sequence[int]) -> Iterator[Floats]:
    """The same with one number of neighbours after the other."""
    if len(time) < 2:
        yield from (np.zeros(len(time)) for _ in halves)
        return
    size, most = len(time), max(halves)
    # Sums of t, y, t^2 and t y up to each instant, the first and the last of them as often as windows reach beyond the
    # ends; a window's are differences of two.
    total = np.zeros((4, size + 1 + 2 * most))
    inside = total[:, most + 1 : most + 1 + size]
    t, y = np.subtract(time, mean(time), out=inside[0]), np.subtract(values, mean(values), out=inside[1])
    np.multiply(t, t, out=inside[2])
    np.multiply(t, y, out=inside[3])
    np.cumsum(inside, axis=1, out=inside)
    total[:, most + 1 + size :] = inside[:, -1:]
    for half in halves:
        ahead, behind = most + half + 1, most - half
        sum_t, sum_y, sum_tt, sum_ty = total[:, ahead : ahead + size] - total[:, behind : behind + size]
        n = np.full(size, 2.0 * half + 1.0)
        short = np.arange(half, 0, -1)[:size]
        n[: len(short)] -= short
        n[size - len(short) :] -= short[::-1]
        yield np.asarray((sum_ty - sum_t * sum_y / n) / (sum_tt - sum_t * sum_t / n))


def cubic_width(window: float, step: float) -> int:
    """Samples, `step` (s) apart, that a local cubic over `window` (s) goes through; odd, at least five."""
    return max(5, 2 * whole(window / step / 2) + 1)


def derivatives(time: Floats, position: Floats, window: float) -> tuple[Floats, Floats]:
    """Velocity and acceleration by local cubic fits over `window` seconds.

    The position is brought onto an even grid first, so jittered times are fine; constant speed and constant
    acceleration pass unbent.

    Parameters
    ----------
    time
        (N,) s, rising.
    position
        (N,) rad or m.
    window
        Span of each fit (s).

    Returns
    -------
    velocity, acceleration
        (N,) per s and per s2.

    Source
    ------
    A. Savitzky, M. J. E. Golay, Smoothing and Differentiation of Data by Simplified Least Squares Procedures (1964).
    """
    if len(time) < 6:
        rate = slopes(time, position, 2)
        return rate, np.zeros(len(time))
    step = float(time[-1] - time[0]) / (len(time) - 1)
    even = time[0] + step * np.arange(len(time))
    on_grid = np.interp(even, time, position)
    width = min(cubic_width(window, step), len(time) - 1 + len(time) % 2)
    velocity, acceleration = filtered(on_grid, width, 1) / step, filtered(on_grid, width, 2) / step**2
    return np.interp(time, even, velocity), np.interp(time, even, acceleration)
