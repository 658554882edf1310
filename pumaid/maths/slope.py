"""Velocity and acceleration from positions that were recorded at equal, or nearly equal, steps of time."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: Samples through which a polynomial goes, and its order. What is seen best through one of them is taken.
WINDOWS, ORDER = (9, 17, 33, 65), 3
#: Mean square of an acceleration, over that of the noise in it, from which it is seen.
SEEN = 10.0
#: Noise below this share of the largest position is rounding.
ROUNDING = 1e-12


def acceleration(time: Floats, position: Floats) -> Floats:
    """(M,) second derivative of positions by time; zeros where it is lost in the sensor's noise.

    Noise in a regressor would pass for a small inertia, well known. The straight line through the positions is taken
    out first: steps of time that differ by a sample would else pass for acceleration.

    Parameters
    ----------
    time, position
        (M,) s, nearly equal steps, and rad or m.

    Source
    ------
    A. Savitzky and M. J. E. Golay, Anal. Chem. 36 (1964) 1627-1639.
    """
    best, clearest = np.zeros(len(time)), SEEN
    if len(time) < WINDOWS[0]:
        return best
    since = time - time.mean()
    bent = position - position.mean() - since * (since @ position) / (since @ since)
    step, floor = float(time[-1] - time[0]) / (len(time) - 1), ROUNDING * float(np.abs(position).max())
    for window in WINDOWS:
        if len(time) < window:
            break
        smooth, curved = (filtered(bent, window, order) for order in (0, 2))
        rough = bent - smooth
        noise = float(rough @ rough) / len(rough) * window / (window - ORDER - 1)
        carried = max(noise, floor**2) * _gain(window, len(time))
        seen = float(curved @ curved) / len(curved)
        if seen > clearest * carried:
            best, clearest = curved / step**2, seen / carried
    return best


def filtered(values: Floats, window: int, derivative: int) -> Floats:
    """Local cubics through equally spaced values; near the ends the outermost ones.

    Parameters
    ----------
    values
        (M,) at least `window` of them.
    window
        Values through which each cubic goes; odd.
    derivative
        0: the smoothed values (M,); 1 or 2: their derivative by the step.

    Source
    ------
    A. Savitzky and M. J. E. Golay, Anal. Chem. 36 (1964) 1627-1639.
    """
    read, fit = _cubics(window, derivative)
    half = window // 2
    inner = np.convolve(values, (read[half] @ fit)[::-1], mode="valid")
    first, last = read[:half] @ (fit @ values[:window]), read[half + 1 :] @ (fit @ values[-window:])
    return np.concatenate([first, inner, last])


@lru_cache(64)
def curvature_kernel(window: int) -> Floats:
    """(window - 2,) weights, of sum 1, with which local cubics' second derivative averages second differences."""
    read, fit = _cubics(window, 2)
    return np.cumsum(np.cumsum(read[window // 2] @ fit))[:-2]


@lru_cache(64)
def _cubics(window: int, derivative: int) -> tuple[Floats, Floats]:
    """(window, 4) from a cubic's coefficients to a derivative by the step at each place, and (4, window) to them."""
    half = window // 2
    x = np.arange(-half, half + 1) / half
    values = [np.polynomial.legendre.Legendre.basis(k) for k in range(ORDER + 1)]
    fit = np.linalg.pinv(np.column_stack([one(x) for one in values]))
    read = np.column_stack([(one.deriv(derivative) if derivative else one)(x) for one in values])
    return read / half**derivative, fit


@lru_cache(1024)
def _gain(window: int, length: int) -> float:
    """Mean over `length` samples of the variance of their second derivative, the samples' noise having variance one."""
    read, fit = _cubics(window, 2)
    squares, half = np.sum((read @ fit) ** 2, axis=1), window // 2
    return float((squares.sum() - squares[half] + (length - window + 1) * squares[half]) / length)
