"""Movements from rest to rest: smoothed motion, where friction slides, and the same filter for the current."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.preprocessing.differentiate import averaging_kernel, cubic_window, derivatives
from pumaid.preprocessing.options import SegmentOptions

Floats = NDArray[np.float64]

#: s; shortest and longest span of the local cubics; longer ones are calmer, and blunter at the acceleration's corners.
SHORTEST_FIT, LONGEST_FIT = 0.04, 0.4
#: Share of the movement's mean acceleration below which the noise of the smoothed one should stay.
CALM = 0.1
#: Share of a movement that a local cubic may span.
LARGEST_SHARE = 0.15
#: By the step, a velocity and what makes plain samples as blunt as it and as a second difference are: all three have
#: the same second moment, a sixth of a squared step.
_RATE = np.array([1.0, -14.0, 0.0, 14.0, -1.0]) / 24.0
_LEVEL = np.array([1.0, 10.0, 1.0]) / 12.0
_CURVE = np.array([1.0, -2.0, 1.0])
#: Samples below which a stroke is not filtered; with some currents missing, averages of fewer leave too few rows.
FEWEST, FEWEST_OF_SOME = 16, 32
#: Mean steps between currents from which there is a hole between two of them.
MOST_APART = 2.5
#: Largest share of an acceleration's own course, beyond weight and friction, that is taken for noise.
MOST_NOISE = 0.9
#: Samples between which noise is looked for.
_LAGS = (1, 2, 3, 5)


@dataclass(frozen=True, eq=False, slots=True)
class SmoothedMotion:
    """Samples [start, stop) of a movement: `time` (s), `velocity` and `acceleration`, (stop - start,) each.

    Times are those at which samples were taken, which stamps need not be; `window` (s) is what each cubic spanned.
    """

    start: int
    stop: int
    time: Floats
    velocity: Floats
    acceleration: Floats
    window: float

    def within(self, start: int, stop: int) -> SmoothedMotion:
        """The same for fewer samples."""
        part = slice(start - self.start, stop - self.start)
        return SmoothedMotion(start, stop, self.time[part], self.velocity[part], self.acceleration[part], self.window)


def smooth(time: Floats, position: Floats, *, bounds: tuple[int, int], noise: float) -> SmoothedMotion:
    """Velocity and acceleration of a movement.

    Parameters
    ----------
    time, position
        (N,) s and rad or m of a stretch without gaps.
    bounds
        First sample of the movement and the one behind its last.
    noise
        Standard deviation of one sample's position (rad or m).
    """
    start, stop = bounds
    duration = max(1e-9, float(time[stop - 1] - time[start]))
    interval = duration / max(1, stop - start)
    # From rest to rest over `way`: a triangle of speed has acceleration 4 way / duration^2.
    wanted = max(1e-12, CALM * 4.0 * abs(float(position[stop - 1] - position[start])) / duration**2)
    # A local cubic's acceleration has the noise sqrt(720 interval) / span^2.5, per noise of a sample.
    span = (noise * math.sqrt(720.0 * interval) / wanted) ** 0.4
    window = min(max(span, SHORTEST_FIT, 7.0 * interval), max(LONGEST_FIT, 7.0 * interval), LARGEST_SHARE * duration)
    margin = math.ceil(window / interval) + 3
    low, high = max(0, start - margin), min(len(time), stop + margin)
    velocity, acceleration = derivatives(time[low:high], position[low:high], window)
    return SmoothedMotion(low, high, time[low:high], velocity, acceleration, window).within(start, stop)


def sliding(smoothed: SmoothedMotion, direction: int, options: SegmentOptions) -> tuple[int, int]:
    """Samples [start, stop) between which the speed stays above the share of its peak that `options` ask for."""
    speed = direction * smoothed.velocity
    fast = np.flatnonzero(speed > max(options.rest_speed, options.low_speed_share * float(speed.max(initial=0.0))))
    if not len(fast):
        return smoothed.start, smoothed.start
    return smoothed.start + int(fast[0]), smoothed.start + int(fast[-1]) + 1


@dataclass(frozen=True, eq=False, slots=True)
class Filtered:
    """A stroke through one filter: (N,) times (s), position, velocity, acceleration and current (A), and plain current.

    A ripple that is faster than the filter stays in the current.

    `noise` is the variance of a position's noise (rad2 or m2), and `curvature` the weights by positions with which an
    acceleration is made.
    """

    time: Floats
    position: Floats
    velocity: Floats
    acceleration: Floats
    current: Floats
    plain: Floats
    noise: float
    curvature: Floats

    def calibrated(self, position: Floats, velocity: Floats, acceleration: Floats) -> Floats:
        """(B,) means of accelerations, at (B,) means of the motion, less the share of them that is noise.

        Noise in a regressor makes its parameter too small by its share of what the regressor has beyond the others.

        Source
        ------
        R. J. Carroll et al., Measurement Error in Nonlinear Models, 2nd ed. (2006), ch. 4: regression calibration.
        """
        count = round(len(self.time) / len(position))
        weights = np.convolve(self.curvature, np.full(count, 1.0 / count))
        columns = np.column_stack([np.ones(len(position)), np.cos(position), np.sin(position), velocity])
        beyond = acceleration - columns @ np.linalg.lstsq(columns, acceleration, rcond=None)[0]
        noise, square = self.noise * float(weights @ weights) * len(beyond), float(beyond @ beyond)
        return acceleration - min(noise / square, MOST_NOISE) * beyond if square > 0.0 else acceleration


def filtered_stroke(smoothed: SmoothedMotion, position: Floats, current: Floats) -> Filtered | None:
    """A stroke's motion and current, averaged over the same spans; None where its samples are too few.

    An acceleration from positions that are smoothed is blunt at its corners where the current is not: regressed on
    it, sharp currents make inertia, weight and viscous friction too large. With the average that the acceleration is
    by nature, of all columns and of the current, least squares returns the truth whatever the motion.

    Parameters
    ----------
    smoothed
        The motion at N samples while the joint slides one way; steps of time may be uneven.
    position, current
        (N,) rad or m, and A, which may be no number.

    Source
    ------
    M. Gautier, Dynamic identification of robots with power model, ICRA 1997: parallel filtering, here by the kernel
    of A. Savitzky and M. J. E. Golay's second derivative.
    """
    time, is_good = smoothed.time, np.isfinite(current)
    at = time[is_good]
    if len(at) < (FEWEST if len(at) == len(time) else FEWEST_OF_SOME):
        return None
    # As many instants as there are currents: what were made up between them would be smoother than they are.
    even = np.linspace(at[0], at[-1], len(at))
    step = float(even[1] - even[0])
    q, sampled = np.interp(even, time, position), np.interp(even, at, current[is_good])
    kernel = averaging_kernel(min(cubic_window(smoothed.window, step), len(at) // 4 * 2 + 1))
    ends = (len(kernel) + 3) // 2
    series = [_sums(q, _LEVEL), _sums(q, _RATE) / step, _sums(q, _CURVE) / step**2, _sums(sampled, _LEVEL)]
    blunt = _averaged(np.column_stack(series), kernel)
    inner = slice(ends, len(at) - ends)
    rows = np.ones(len(blunt), dtype=np.bool_)
    if len(at) < len(time):
        # What is suggested from both ends of a hole is no row.
        right = np.clip(np.searchsorted(at, even[inner]), 1, len(at) - 1)
        rows = at[right] - at[right - 1] < MOST_APART * step
    noise, curvature = _variance(q), np.convolve(kernel, _CURVE) / step**2
    plain = sampled[inner]
    current = blunt[:, 3] + _without_motion(plain - blunt[:, 3], blunt[:, :3], kernel)
    q, velocity, acceleration, _ = blunt[rows].T
    return Filtered(even[inner][rows], q, velocity, acceleration, current[rows], plain[rows], noise, curvature)


def _without_motion(fast: Floats, motion: Floats, kernel: Floats) -> Floats:
    """(N,) of a current what the filter took out, less what follows the (N, 3) motion and its corners.

    Regressed on weight, friction and inertia it gives nothing: least squares returns what it does of filtered currents.
    """
    position, velocity, acceleration = motion.T
    blunter = np.convolve(np.pad(acceleration, len(kernel) // 2, mode="edge"), kernel, mode="valid")
    weight = [np.cos(position), np.sin(position)]
    columns = np.column_stack([np.ones(len(fast)), *weight, velocity, acceleration, blunter])
    return np.asarray(fast - columns @ np.linalg.lstsq(columns, fast, rcond=None)[0])


def _sums(values: Floats, stencil: Floats) -> Floats:
    """(N - 4,) of (N,) values by a stencil of three or five."""
    cut = (5 - len(stencil)) // 2
    return np.convolve(values[cut : len(values) - cut], stencil[::-1], mode="valid")


def _averaged(values: Floats, kernel: Floats) -> Floats:
    """(N - w + 1, c) means of (N, c) values by a symmetric kernel (w,)."""
    return np.column_stack([np.convolve(column, kernel, mode="valid") for column in values.T])


def _variance(position: Floats) -> float:
    """Variance of the noise of (N,) positions, from third differences, in which their course is next to nothing.

    Rounding at a steady speed is a tone, which differences at one lag may enlarge; the least of several lags is taken.
    """
    variances = []
    for lag in _LAGS:
        if len(position) > 3 * lag + 1:
            inner = position[2 * lag : -lag] - position[lag : -2 * lag]
            variances.append(float(np.mean((position[3 * lag :] - position[: -3 * lag] - 3.0 * inner) ** 2)) / 20.0)
    return min(variances, default=0.0)
