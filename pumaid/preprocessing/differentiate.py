"""Speed and acceleration from positions: straight lines through short means, and Savitzky-Golay filters.

And when samples were taken: at their time stamps, or evenly where the motion shows that only the stamps are not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pumaid.maths import Counts, Floats

#: s; short against the ramps of real arms, long enough to average tens of samples at 1 kHz.
TICK = 0.02
#: s; longest straight line by which a moving joint is told from one at rest: shorter pauses may be missed.
LONGEST_FIT = 0.5
#: Median absolute third difference of white noise of unit standard deviation.
THIRD_DIFFERENCE = math.sqrt(20.0) * 0.6745
#: Share of the median by which time steps may differ and still be ordinary ones, no gaps.
ORDINARY = 0.25

#: Windows (samples) of the cubics of `acceleration`; the one that shows the acceleration best is taken.
WINDOWS, ORDER = (9, 17, 33, 65), 3
#: Mean square of an acceleration, over that of the noise in it, from which it counts as measured.
SEEN = 10.0
#: Noise below this share of the largest position is rounding.
ROUNDING = 1e-12

#: Unevenness of stamps, RMS as a share of their interval, below which nothing needs to be done.
EVEN = 0.01
#: Samples on either side over which an even clock may drift, and half width of the cubics that filter out slow motion.
DRIFT, SLOW = 128, 16
#: Steps above so many intervals may stand for lost samples; so many stamps on either side tell it from a late stamp.
LONG, BESIDE = 1.45, 8
#: Samples on either side by which the speed is taken, and how many of its standard deviations it must have.
AROUND, CLEAR = 8, 14.0
#: Samples that are summed together, so that their common errors count as one, and fewest such groups.
GROUP, FEWEST = 32, 6
#: Share of the unevenness that the positions show, up to which stamps are corrected, and its largest standard error.
SHOWN, UNCERTAIN = 0.5, 0.15


@lru_cache(64)
def _cubics(window: int, derivative: int) -> Floats:
    """(window, window) matrix whose row k is the derivative, at sample k, of the least-squares cubic."""
    x = np.linspace(-1.0, 1.0, window)
    powers = np.polynomial.legendre.legvander(x, ORDER)
    coefficients = np.polynomial.legendre.legder(np.eye(ORDER + 1), derivative)
    read = np.polynomial.legendre.legval(x, coefficients).T
    return np.asarray(read / (window // 2) ** derivative @ np.linalg.pinv(powers))


def savitzky_golay(values: Floats, window: int, derivative: int) -> Floats:
    """(M,) local cubics through `window` (odd) equally spaced values each; at the ends the outermost are extended.

    `derivative` is 0 for smoothed values, 1 or 2 for derivatives with respect to the sample number.

    Source
    ------
    A. Savitzky and M. J. E. Golay, Anal. Chem. 36 (1964) 1627-1639.
    """
    rows, half = _cubics(window, derivative), window // 2
    inner = np.convolve(values, rows[half][::-1], mode="valid")
    return np.concatenate([rows[:half] @ values[:window], inner, rows[half + 1 :] @ values[-window:]])


def averaging_kernel(window: int) -> Floats:
    """(window - 2,) weights of sum 1 by which the cubics' second derivative averages plain second differences."""
    return np.cumsum(np.cumsum(_cubics(window, 2)[window // 2]))[:-2]


def cubic_window(seconds: float, step: float) -> int:
    """Samples, `step` (s) apart, of a local cubic over so many seconds: odd, at least five."""
    return max(5, 2 * round_half_up(seconds / step / 2) + 1)


def velocity(time: Floats, position: Floats, seconds: float) -> Floats:
    """(N,) velocity by local cubics over a span of time (s); of (N,) times (s), which may be uneven, and positions."""
    step = float(time[-1] - time[0]) / (len(time) - 1)
    even = time[0] + step * np.arange(len(time))
    window = min(cubic_window(seconds, step), len(time) - 1 + len(time) % 2)
    return np.interp(time, even, savitzky_golay(np.interp(even, time, position), window, 1) / step)


def acceleration(time: Floats, position: Floats) -> Floats:
    """(M,) second derivative of positions; zeros where it is below the sensor's noise.

    Noise in a regressor would look like a small, well-known inertia. The straight line through the positions is taken
    out first, because time steps that differ by a sample would look like acceleration.
    """
    best, clearest = np.zeros(len(time)), SEEN
    if len(time) < WINDOWS[0]:
        return best
    since = time - time.mean()
    bent = position - position.mean() - since * (since @ position) / (since @ since)
    step, floor = float(time[-1] - time[0]) / (len(time) - 1), ROUNDING * float(np.abs(position).max())
    for window in (window for window in WINDOWS if window <= len(time)):
        rough = bent - savitzky_golay(bent, window, 0)
        curved = savitzky_golay(bent, window, 2)
        noise = float(rough @ rough) / len(rough) * window / (window - ORDER - 1)
        # Mean variance of the second derivative of white noise of variance one.
        gains = np.sum(_cubics(window, 2) ** 2, axis=1)
        gain = gains.sum() + (len(time) - window) * gains[window // 2]
        carried = max(noise, floor**2) * float(gain) / len(time)
        square = float(curved @ curved) / len(curved)
        if square > clearest * carried:
            best, clearest = curved / step**2, square / carried
    return best


def round_half_up(count: float) -> int:
    """Nearest whole number of samples; halves, which rounded times blur, go up."""
    return math.floor(round(count, 3) + 0.5)


def usual_step(time: Floats) -> float:
    """Mean step of (N,) times (s) without gaps and repeats; 0 where there is none."""
    steps = np.diff(time)
    if not len(steps):
        return 0.0
    # The mean of ordinary steps: of rounded stamps the median is one of few values, none of them the clock's.
    median = float(np.median(steps))
    ordinary = steps[np.abs(steps - median) <= ORDINARY * abs(median)]
    return float(ordinary.mean()) if len(ordinary) else median


def slopes(time: Floats, values: Floats, half: int) -> Floats:
    """(K,) slopes of straight lines through each of (K,) rising times (s) and `half` neighbours on either side."""
    size = len(time)
    if size < 2:
        return np.zeros(size)
    t, y = time - time.mean(), values - values.mean()
    sums = np.zeros((5, size + 1))
    np.cumsum([np.ones(size), t, y, t * t, t * y], axis=1, out=sums[:, 1:])
    place = np.arange(size)
    n, sum_t, sum_y, sum_tt, sum_ty = sums[:, np.minimum(place + half + 1, size)] - sums[:, np.maximum(place - half, 0)]
    return np.asarray((sum_ty - sum_t * sum_y / n) / (sum_tt - sum_t * sum_t / n))


@dataclass(frozen=True, eq=False, slots=True)
class Ticks:
    """Positions averaged over K ticks of 20 ms, in a stretch without gaps.

    `edges` (K + 1,) are sample indices of the ticks' borders, `time` (K,) s and `position` (K, J) rad or m; `interval`
    is the mean distance of ticks, s; `noise` (J,) the standard deviation of a tick's mean, quantisation included, and
    `quantum` (J,) the smallest step of the position, rad or m.
    """

    edges: Counts
    time: Floats
    position: Floats
    interval: float
    noise: Floats
    quantum: Floats

    @classmethod
    def of(cls, time: Floats, position: Floats) -> Ticks:
        """Average (N,) times and (N, J) positions, N at least 2."""
        size = max(1, round_half_up(TICK / usual_step(time)))
        starts = np.arange(0, max(1, len(time) - size // 2), size)
        counts = np.diff(starts, append=len(time))
        # Means about the first sample, which loses no digits to the clock's or the encoder's offset.
        means = position[0] + np.add.reduceat(position - position[0], starts, axis=0) / counts[:, None]
        tick_time = time[0] + np.add.reduceat(time - time[0], starts) / counts
        steps = np.abs(np.diff(position, axis=0))
        quantum = np.where(steps > 1e-9, steps, math.inf).min(axis=0, initial=math.inf)
        quantum[np.isinf(quantum)] = 0.0
        noise = quantum / math.sqrt(12.0)
        if len(means) > 4:
            noise = np.maximum(noise, np.median(np.abs(np.diff(means, 3, axis=0)), axis=0) / THIRD_DIFFERENCE)
        interval = float(tick_time[-1] - tick_time[0]) / max(1, len(means) - 1) or TICK
        return cls(np.append(starts, len(time)), tick_time, means, interval, noise, quantum)

    def slope_error(self, joint: int, half: int) -> float:
        """Standard deviation of the slope of a straight line through ``2 half + 1`` ticks, rad/s or m/s."""
        width = 2 * half + 1
        return float(self.noise[joint - 1]) / (self.interval * math.sqrt(width * (width * width - 1) / 12.0))

    def half_width(self, joint: int, wanted: float, longest: float = LONGEST_FIT) -> int:
        """Fewest ticks on either side for which the slope's error is at most `wanted` (rad/s or m/s)."""
        largest = max(1, round_half_up(longest / self.interval / 2))
        half = 1
        while half < largest and self.slope_error(joint, half) > wanted:
            half += 1
        return half


def sampling_times(time: Floats, position: Floats) -> tuple[Floats, float]:
    """When samples were taken.

    Stamps may be rounded, or written when a message arrives, while the samples are taken evenly: then the positions of
    a moving joint are smooth from sample to sample. Or samples are uneven and the stamps are right: then positions show
    what the stamps show, times the speed. The slope of a straight line through both decides.

    Of (N,) rising times (s) without gaps and (N, J) positions (rad or m), returns (N,) rising times, and the RMS (s) by
    which the stamps differ from them: zero where they are right or nothing shows.
    """
    if len(time) < GROUP * FEWEST:
        return time, 0.0
    numbers, interval = _sample_numbers(time)
    ahead = time - time[0] - numbers * interval
    uneven = ahead - _moving_average(_moving_average(ahead))
    error = math.sqrt(float(np.mean(uneven**2)))
    if error <= EVEN * interval:
        return time, 0.0
    share, uncertainty = _shown(uneven, position, interval=interval, numbers=numbers)
    even = time - uneven
    is_plausible = -4.5 * uncertainty - UNCERTAIN <= share < SHOWN and uncertainty <= UNCERTAIN
    return (even, error) if is_plausible and (np.diff(even) > 0).all() else (time, 0.0)


def _sample_numbers(time: Floats) -> tuple[Floats, float]:
    """(N,) numbers of the samples, lost ones counted, and the interval (s) of all.

    A late stamp is followed by short steps; behind a lost sample all later stamps are ahead.
    """
    steps, beside = np.diff(time), np.arange(BESIDE)
    interval = float(np.median(time[2 * BESIDE :] - time[: -2 * BESIDE])) / (2 * BESIDE)
    ahead = time - time[0] - np.arange(len(time)) * interval
    long, lost = np.flatnonzero(steps > LONG * interval), np.zeros(len(steps))
    before = np.median(ahead[np.maximum(0, long[:, None] - beside)], axis=1)
    behind = np.median(ahead[np.minimum(len(time) - 1, long[:, None] + 1 + beside)], axis=1)
    lost[long] = np.maximum(0.0, np.round(np.minimum(behind - before, steps[long] - interval) / interval))
    numbers = np.concatenate([[0.0], np.cumsum(1.0 + lost)])
    return numbers, float(time[-1] - time[0]) / float(numbers[-1])


def _moving_average(values: Floats) -> Floats:
    """(N,) means over `DRIFT` neighbours on either side; near the ends of a straight line's continuation."""
    half = min(DRIFT, (len(values) - 1) // 2)
    width = 2 * half + 1
    first, last = (np.polyfit(np.arange(width), part, 1) for part in (values[:width], values[-width:]))
    before, behind = np.polyval(first, np.arange(-half, 0)), np.polyval(last, width + np.arange(half))
    total = np.concatenate([[0.0], np.cumsum(np.concatenate([before, values, behind]))])
    return (total[width:] - total[:-width]) / width


def _shown(uneven: Floats, position: Floats, *, interval: float, numbers: Floats) -> tuple[float, float]:
    """Share of the stamps' unevenness (N,) that the positions show, and its standard error; infinite if unknown."""
    span = interval * (numbers[2 * AROUND :] - numbers[: -2 * AROUND])
    cross, square = np.zeros(-(-len(uneven) // GROUP)), np.zeros(-(-len(uneven) // GROUP))
    groups = np.arange(0, len(uneven), GROUP)
    for column in position.T:
        noise = math.sqrt(float(np.mean(np.diff(column, 3) ** 2)) / 20.0)
        speed = np.zeros(len(column))
        speed[AROUND:-AROUND] = (column[2 * AROUND :] - column[: -2 * AROUND]) / span
        if noise == 0.0:
            continue
        speed[np.abs(speed) <= CLEAR * noise / (2 * AROUND * interval)] = 0.0
        observed, expected = (
            (values - savitzky_golay(values, 2 * SLOW + 1, 0)) / noise for values in (column, speed * uneven)
        )
        cross += np.add.reduceat(expected * observed, groups)
        square += np.add.reduceat(expected * expected, groups)
    total = float(square.sum())
    if total <= 0.0 or total**2 < FEWEST * float(square @ square):
        return 1.0, math.inf
    share = float(cross.sum()) / total
    rest = cross - share * square
    return share, math.sqrt(float(rest @ rest)) / total
