"""Parallel filtering: what smooths a stroke's motion smooths its current, so that corners are blunt in both alike."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import STROKE_COLUMNS, run_columns
from pumaid.maths.triangle import Triangle
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
#: Share of the variance of white noise, left by averages along a combination of columns, below which there is none.
LEAST_SHARE = 0.05
#: Singular values of a triangle below this share of its largest are rounding.
_FLAT = 1e-10
#: Samples between which noise is looked for.
_LAGS = (1, 2, 3, 5)


def of_stroke(course: Smooth, position: Floats, current: Floats, *, turns: bool) -> Triangle:
    """A stroke's triangle, in which current and regressors are averaged over the same spans.

    An acceleration from positions that are smoothed is blunt at its corners where the current is not: regressed on
    it, sharp currents make inertia, weight and viscous friction too large. With the average that the acceleration is
    by nature, of all columns and of the current, least squares returns the truth whatever the motion. What the
    triangle leaves is of the currents as they were logged.

    Parameters
    ----------
    course
        The smoothed motion at N samples while the joint slides one way, taken as it is where they are too few to be
        averaged; steps of time may be uneven.
    position, current
        (N,) rad or m, and A, which may be no number.
    turns
        Whether the joint is revolute.

    Source
    ------
    M. Gautier, Dynamic identification of robots with power model, ICRA 1997: parallel filtering, here by the kernel
    of A. Savitzky and M. J. E. Golay's second derivative.
    """
    time, is_good = course.time, np.isfinite(current)
    plain = run_columns(position, turns=turns, motion=(course.velocity, course.acceleration))[is_good]
    at = time[is_good]
    if len(at) < (FEWEST if len(at) == len(time) else FEWEST_OF_SOME):
        return Triangle.of(STROKE_COLUMNS, plain, current[is_good])
    # As many instants as there are currents: what were made up between them would be smoother than they are.
    even = np.linspace(at[0], at[-1], len(at))
    step = float(even[1] - even[0])
    q, known = np.interp(even, time, position), np.interp(even, at, current[is_good])
    kernel = averaging_kernel(min(cubic_window(course.window, step), len(at) // 4 * 2 + 1))
    ends = (len(kernel) + 3) // 2
    courses = [_sums(np.cos(q), _LEVEL), _sums(np.sin(q), _LEVEL)] if turns else 2 * [np.zeros(len(q) - 4)]
    courses += [_sums(q, _RATE) / step, _sums(q, _CURVE) / step**2, _sums(known, _LEVEL)]
    blunt = _averaged(np.column_stack(courses), kernel)
    columns = np.column_stack([blunt[:, :2], np.ones(len(blunt)), blunt[:, 2:4]])
    rows = np.ones(len(columns), dtype=np.bool_)
    if len(at) < len(time):
        # What is suggested from both ends of a hole is no row.
        right = np.clip(np.searchsorted(at, even[ends : len(at) - ends]), 1, len(at) - 1)
        rows = at[right] - at[right - 1] < MOST_APART * step
    noise = _variance(q) * float(np.sum(np.convolve(kernel, _CURVE) ** 2)) / step**4
    seen = Triangle.of(STROKE_COLUMNS, columns[rows], blunt[rows, 4])
    triangle = _whitened(seen.without_noise(noise * np.count_nonzero(rows)), _louder(seen, columns[rows], kernel))
    upper, target = triangle.rows()
    left = current[is_good] - plain @ np.linalg.lstsq(upper, target, rcond=None)[0]
    return triangle.leaving(float(np.linalg.norm(left)), len(left))


def _sums(values: Floats, stencil: Floats) -> Floats:
    """(N - 4,) of (N,) values by a stencil of three or five."""
    cut = (5 - len(stencil)) // 2
    return np.convolve(values[cut : len(values) - cut], stencil[::-1], mode="valid")


def _averaged(values: Floats, kernel: Floats) -> Floats:
    """(N - w + 1, c) means of (N, c) values by a symmetric kernel (w,)."""
    size = 1 << (len(values) + len(kernel) - 2).bit_length()
    spectrum = np.fft.rfft(values, size, axis=0) * np.fft.rfft(kernel, size)[:, None]
    return np.asarray(np.fft.irfft(spectrum, size, axis=0)[len(kernel) - 1 : len(values)])


def _louder(triangle: Triangle, columns: Floats, kernel: Floats) -> Floats:
    """(c, c) what gives the rows of averaged currents, whose noise is no longer white, the noise of a sample again.

    (N, c) `columns` are those of the triangle.
    """
    upper, _ = triangle.rows()
    wide = np.pad(columns @ np.linalg.pinv(upper[:-1], rcond=_FLAT), ((len(kernel), len(kernel)), (0, 0)))
    spread = _averaged(wide, kernel)
    share, ways = np.linalg.eigh(spread.T @ spread)
    return np.asarray((ways / np.sqrt(np.where(share > LEAST_SHARE, share, 1.0))) @ ways.T)


def _whitened(triangle: Triangle, louder: Floats) -> Triangle:
    upper, target = triangle.rows()
    return Triangle.of(triangle.columns, louder @ upper[:-1], louder @ target[:-1])


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
