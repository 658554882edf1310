"""Speed and acceleration from positions: straight lines through short means, and Savitzky-Golay filters."""

import math
from functools import lru_cache

import numpy as np

from pumaid.maths import Floats

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
        carried = max(noise, floor**2) * (gains.sum() + (len(time) - window) * gains[window // 2]) / len(time)
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


class Ticks:
    """Positions averaged over K ticks of 20 ms, in a stretch without gaps of (N,) times and (N, J) positions, N >= 2.

    `edges` (K + 1,) are sample indices of the ticks' borders, `time` (K,) s and `position` (K, J) rad or m; `interval`
    is the mean distance of ticks, s; `noise` (J,) the standard deviation of a tick's mean, quantisation included, and
    `quantum` (J,) the smallest step of the position, rad or m.
    """

    def __init__(self, time: Floats, position: Floats) -> None:
        size = max(1, round_half_up(TICK / usual_step(time)))
        starts = np.arange(0, max(1, len(time) - size // 2), size)
        counts = np.diff(starts, append=len(time))
        self.edges = np.append(starts, len(time))
        # Means about the first sample, which loses no digits to the clock's or the encoder's offset.
        self.position = position[0] + np.add.reduceat(position - position[0], starts, axis=0) / counts[:, None]
        self.time = time[0] + np.add.reduceat(time - time[0], starts) / counts
        steps = np.abs(np.diff(position, axis=0))
        self.quantum = np.where(steps > 1e-9, steps, math.inf).min(axis=0, initial=math.inf)
        self.quantum[np.isinf(self.quantum)] = 0.0
        self.noise = self.quantum / math.sqrt(12.0)
        if len(starts) > 4:
            third = np.median(np.abs(np.diff(self.position, 3, axis=0)), axis=0)
            self.noise = np.maximum(self.noise, third / THIRD_DIFFERENCE)
        self.interval = float(self.time[-1] - self.time[0]) / max(1, len(starts) - 1) or TICK

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
