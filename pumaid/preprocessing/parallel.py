"""Parallel filtering: what smooths a stroke's motion smooths its current, so that corners are blunt in both alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.preprocessing.differentiate import averaging_kernel, cubic_window
from pumaid.preprocessing.stroke import Smooth

Floats = NDArray[np.float64]

#: By the step, a velocity and what makes plain samples as blunt as it and as a second difference are: all three have
#: the same second moment, a sixth of a squared step.
_RATE = np.array([1.0, -14.0, 0.0, 14.0, -1.0]) / 24.0
_LEVEL = np.array([1.0, 10.0, 1.0]) / 12.0
_CURVE = np.array([1.0, -2.0, 1.0])
#: Samples below which a stroke, or what a cut left of it, is not averaged.
FEWEST = 16
#: Mean steps between currents from which there is a hole between two of them.
MOST_APART = 2.5
#: The same of the currents of a stroke in which some are missing: of fewer, averages leave hardly more rows than there
#: are columns, and have larger errors than the blunt corners of plain samples make.
FEWEST_OF_SOME = 32
#: Largest share of an acceleration's own course, beyond weight and friction, that is taken for noise.
MOST_NOISE = 0.9
#: Samples between which noise is looked for.
_LAGS = (1, 2, 3, 5)


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


def filtered_stroke(course: Smooth, position: Floats, current: Floats) -> Filtered | None:
    """A stroke's motion and current, averaged over the same spans; None where its samples are too few.

    An acceleration from positions that are smoothed is blunt at its corners where the current is not: regressed on
    it, sharp currents make inertia, weight and viscous friction too large. With the average that the acceleration is
    by nature, of all columns and of the current, least squares returns the truth whatever the motion.

    Parameters
    ----------
    course
        The smoothed motion at N samples while the joint slides one way; steps of time may be uneven.
    position, current
        (N,) rad or m, and A, which may be no number.

    Source
    ------
    M. Gautier, Dynamic identification of robots with power model, ICRA 1997: parallel filtering, here by the kernel
    of A. Savitzky and M. J. E. Golay's second derivative.
    """
    time, is_good = course.time, np.isfinite(current)
    at = time[is_good]
    if len(at) < (FEWEST if len(at) == len(time) else FEWEST_OF_SOME):
        return None
    # As many instants as there are currents: what were made up between them would be smoother than they are.
    even = np.linspace(at[0], at[-1], len(at))
    step = float(even[1] - even[0])
    q, known = np.interp(even, time, position), np.interp(even, at, current[is_good])
    kernel = averaging_kernel(min(cubic_window(course.window, step), len(at) // 4 * 2 + 1))
    ends = (len(kernel) + 3) // 2
    series = [_sums(q, _LEVEL), _sums(q, _RATE) / step, _sums(q, _CURVE) / step**2, _sums(known, _LEVEL)]
    blunt = _averaged(np.column_stack(series), kernel)
    inner = slice(ends, len(at) - ends)
    rows = np.ones(len(blunt), dtype=np.bool_)
    if len(at) < len(time):
        # What is suggested from both ends of a hole is no row.
        right = np.clip(np.searchsorted(at, even[inner]), 1, len(at) - 1)
        rows = at[right] - at[right - 1] < MOST_APART * step
    noise, curvature = _variance(q), np.convolve(kernel, _CURVE) / step**2
    plain = known[inner]
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
    size = 1 << (len(values) + len(kernel) - 2).bit_length()
    spectrum = np.fft.rfft(values, size, axis=0) * np.fft.rfft(kernel, size)[:, None]
    return np.asarray(np.fft.irfft(spectrum, size, axis=0)[len(kernel) - 1 : len(values)])


def _variance(position: Floats) -> float:
    """Variance of the noise of (N,) positions, from third differences, in which their course is next to nothing.

    Rounding at a steady speed is a tone, which differences at one lag may enlarge; the least of several lags is taken.
    """
    found = [
        float(np.mean((position[3 * lag :] - position[: -3 * lag] - 3.0 * (b - a)) ** 2)) / 20.0
        for lag in _LAGS
        if len(position) > 3 * lag + 1
        for a, b in [(position[lag : -2 * lag], position[2 * lag : -lag])]
    ]
    return min(found, default=0.0)
