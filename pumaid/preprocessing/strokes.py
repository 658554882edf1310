"""Movements from rest to rest: where friction slides, and bins of motion and current through one filter."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Bins, Log, finite_means, spans
from pumaid.preprocessing.differentiate import averaging_kernel, cubic_window, velocity
from pumaid.preprocessing.options import SegmentOptions

Floats = NDArray[np.float64]

#: s; shortest and longest span of the local cubics; longer ones are calmer, and blunter at the acceleration's corners.
SHORTEST_FIT, LONGEST_FIT = 0.04, 0.4
#: Share of the movement's mean acceleration below which the noise of the smoothed one should stay.
CALM = 0.1
#: Share of a movement that a local cubic may span.
LARGEST_SHARE = 0.15
#: Bins of a stroke at most.
MOST_BINS = 512
#: Position, velocity and acceleration by the step, convolved from five positions; equally blunt: all have the same
#: second moment, a sixth of a squared step.
LEVEL = np.array([0.0, 1.0, 10.0, 1.0, 0.0]) / 12.0
RATE = np.array([-1.0, 14.0, 0.0, -14.0, 1.0]) / 24.0
CURVE = np.array([0.0, 1.0, -2.0, 1.0, 0.0])
#: Samples below which a stroke is not filtered; with some currents missing, averages of fewer leave too few rows.
FEWEST, FEWEST_OF_SOME = 16, 32
#: Mean steps between currents from which there is a hole between two of them.
MOST_APART = 2.5
#: Largest share of an acceleration's own course, beyond weight and friction, that is taken for noise.
MOST_NOISE = 0.9
#: Samples between which noise is looked for.
LAGS = (1, 2, 3, 5)


def sliding(
    time: Floats, position: Floats, bounds: tuple[int, int], *, noise: float, options: SegmentOptions
) -> tuple[int, int, float, float]:
    """Where a movement's speed is above the share of its peak that `options` ask for.

    The movement, samples [start, stop) of `bounds`, goes upwards; `noise` (rad or m) is the standard deviation of one
    of the (N,) positions. Returned are samples [start, stop), the span (s) of the local cubics by which speed is taken,
    and its peak.
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
    speed = velocity(time[low:high], position[low:high], window)[start - low : stop - low]
    peak = float(speed.max(initial=0.0))
    fast = np.flatnonzero(speed > max(options.rest_speed, options.low_speed_share * peak))
    return (start + int(fast[0]), start + int(fast[-1]) + 1, window, peak) if len(fast) else (start, start, window, 0.0)


def stroke_bins(log: Log, joint: int, *, time: Floats, window: float) -> Bins | None:
    """Bins of a stroke, its motion and current averaged over the same spans; None where currents are too few.

    `log` holds its N samples, currents that are missing NaN; `time` (N,) s is when they were taken.

    An acceleration from positions that are smoothed is blunt at its corners where the current is not: regressed on
    it, sharp currents make inertia, weight and viscous friction too large. With the average that the acceleration is
    by nature, of all columns and of the current, least squares returns the truth whatever the motion.
    A ripple that is faster than the filter stays in the current; what remains of it counts as scatter inside bins.

    Source
    ------
    M. Gautier, Dynamic identification of robots with power model, ICRA 1997: parallel filtering, here by the kernel
    of A. Savitzky and M. J. E. Golay's second derivative.
    """
    position, current = log.position[:, joint - 1], log.current[:, joint - 1]
    measured = np.isfinite(current)
    at = time[measured]
    if len(at) < (FEWEST if measured.all() else FEWEST_OF_SOME):
        return None
    # As many instants as there are currents: interpolated ones would be smoother than they are.
    even = np.linspace(at[0], at[-1], len(at))
    step = float(even[1] - even[0])
    kernel = averaging_kernel(min(cubic_window(window, step), len(at) // 4 * 2 + 1))
    q, sampled = np.interp(even, time, position), np.interp(even, at, current[measured])
    level, rate, curve = (
        np.convolve(kernel, LEVEL),
        np.convolve(kernel, RATE) / step,
        np.convolve(kernel, CURVE) / step**2,
    )
    motion = np.column_stack([np.convolve(q, weights, mode="valid") for weights in (level, rate, curve)])
    smoothed = np.convolve(sampled, level, mode="valid")
    inner = slice(len(level) // 2, len(at) - len(level) // 2)
    # What is interpolated across a hole is no row.
    right = np.clip(np.searchsorted(at, even[inner]), 1, len(at) - 1)
    rows = at[right] - at[right - 1] < MOST_APART * step if not measured.all() else np.ones(len(right), np.bool_)
    plain, instants = sampled[inner][rows], even[inner][rows]
    filtered = (smoothed + _without_motion(sampled[inner] - smoothed, motion, kernel))[rows]
    starts, count = spans(instants, MOST_BINS)
    means = finite_means(np.column_stack([instants - instants[0], motion[rows], filtered]), starts)
    bin_time, (moving, speed, acceleration, binned) = instants[0] + means[:, 0], means[:, 1:].T
    posture = np.column_stack([np.interp(bin_time, log.time, column) for column in log.position.T])
    posture[:, joint - 1] = moving
    weights = np.convolve(curve, np.full(round(len(rows) / len(starts)), 1.0 / round(len(rows) / len(starts))))
    noise = _variance(q) * float(weights @ weights)
    before = np.clip(np.searchsorted(log.time, bin_time, side="right") - 1, 0, len(log) - 1)
    return Bins(
        count=count,
        time=bin_time,
        position=posture,
        velocity=speed,
        acceleration=_calibrated(moving, speed, acceleration, noise=noise),
        current=binned,
        variance=finite_means((plain - np.repeat(binned, count)) ** 2, starts),
        temperature=np.full(len(starts), np.nan) if log.temperature is None else log.temperature[before, joint - 1],
        extra=None if log.extra is None else log.extra[before],
    )


def _calibrated(position: Floats, speed: Floats, acceleration: Floats, *, noise: float) -> Floats:
    """(B,) accelerations less the share of them that is noise of variance `noise`.

    Noise in a regressor makes its parameter too small by its share of what the regressor has beyond the others.

    Source
    ------
    R. J. Carroll et al., Measurement Error in Nonlinear Models, 2nd ed. (2006), ch. 4: regression calibration.
    """
    beyond = _residual(acceleration, [np.cos(position), np.sin(position), speed])
    square = float(beyond @ beyond)
    return acceleration - min(noise * len(beyond) / square, MOST_NOISE) * beyond if square > 0.0 else acceleration


def _without_motion(fast: Floats, motion: Floats, kernel: Floats) -> Floats:
    """(N,) of a current what the filter took out, less what follows the (N, 3) motion and its corners.

    Regressed on weight, friction and inertia it gives nothing: least squares returns what it does of filtered currents.
    """
    position, speed, acceleration = motion.T
    blunter = np.convolve(np.pad(acceleration, len(kernel) // 2, mode="edge"), kernel, mode="valid")
    return _residual(fast, [np.cos(position), np.sin(position), speed, acceleration, blunter])


def _residual(values: Floats, regressors: list[Floats]) -> Floats:
    """(N,) values less their least-squares fit by a constant and the regressors."""
    columns = np.column_stack([np.ones(len(values)), *regressors])
    return np.asarray(values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0])


def _variance(position: Floats) -> float:
    """Variance of the noise of (N,) positions, from third differences, in which their course is next to nothing.

    Rounding at a steady speed is a tone, which differences at one lag may enlarge; the least of several lags is taken.
    """
    variances = []
    for lag in LAGS:
        if len(position) > 3 * lag + 1:
            inner = position[2 * lag : -lag] - position[lag : -2 * lag]
            variances.append(float(np.mean((position[3 * lag :] - position[: -3 * lag] - 3.0 * inner) ** 2)) / 20.0)
    return min(variances, default=0.0)
