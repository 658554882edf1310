"""Acceleration from positions that were recorded at nearly equal steps of time."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_coeffs

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
        smooth, curved = (_filtered(bent, window, order) for order in (0, 2))
        rough = bent - smooth
        noise = float(rough @ rough) / len(rough) * window / (window - ORDER - 1)
        carried = max(noise, floor**2) * _gain(window, len(time))
        seen = float(curved @ curved) / len(curved)
        if seen > clearest * carried:
            best, clearest = curved / step**2, seen / carried
    return best


def _filtered(values: Floats, window: int, derivative: int) -> Floats:
    """(M,) smoothed values or their derivative by the sample; near the ends by the outermost polynomials."""
    rows, half = _rows(window, derivative), window // 2
    inner = np.convolve(values, rows[half][::-1], mode="valid")
    return np.concatenate([rows[:half] @ values[:window], inner, rows[half + 1 :] @ values[-window:]])


@cache
def _rows(window: int, derivative: int) -> Floats:
    """(window, window) what the polynomial through a window makes of its samples at each of them."""
    return np.array([savgol_coeffs(window, ORDER, derivative, pos=place, use="dot") for place in range(window)])


def _gain(window: int, length: int) -> float:
    """Mean over `length` samples of the variance of their second derivative, the samples' noise having variance one."""
    squares, half = np.sum(_rows(window, 2) ** 2, axis=1), window // 2
    return float((squares.sum() - squares[half] + (length - window + 1) * squares[half]) / length)
