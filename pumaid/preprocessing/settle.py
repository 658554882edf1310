"""Overshoot and ringing at the ends of a constant speed: where they have died down into what the middle shows."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pumaid.maths.short import lengths, mean
from pumaid.preprocessing.speed import slopes_by, whole

Floats = NDArray[np.float64]

#: s; means over it resolve a ringing of up to some 40 Hz.
STEP = 0.005
#: Steps on either side of the straight lines for the speed: short ones for fast ringing, longer ones for weak ringing.
HALVES = (2, 5)
#: s; a ringing that returns within it (half a period at 5 Hz) is still the same ringing.
RETURN = 0.1
#: Standard deviations of the middle's speed above which an end is not settled.
UNSETTLED = 4.5
#: Share of the speed below which a departure is nothing to speak of.
NEGLIGIBLE = 0.005
#: A ringing that sank into the noise after some time is given this share of that time again to die.
AGAIN = 0.3
#: Fewest steps whose middle half tells a spread.
FEWEST = 24


def settled(time: Floats, position: Floats) -> tuple[int, int]:
    """Samples [start, stop) of a stretch of constant speed between which it rings no more than in its middle.

    Parameters
    ----------
    time, position
        (N,) s and rad or m of the stretch.
    """
    size = max(1, whole(STEP * (len(time) - 1) / max(1e-9, float(time[-1] - time[0]))))
    starts = np.arange(0, len(time) - size + 1, size)
    if len(starts) < FEWEST:
        return 0, len(time)
    counts = lengths(starts, len(time))
    t = np.add.reduceat(time - time[0], starts) / counts
    q = np.add.reduceat(position - position[0], starts) / counts
    reach = max(1, whole(RETURN / max(1e-9, float(t[-1] - t[0]) / len(t))))
    front = back = 0
    for half, speed in zip(HALVES, slopes_by(t, q, HALVES), strict=True):
        far = _departures(t, speed, half)
        front = max(front, _ringing(far[: len(t) // 2], reach))
        back = max(back, _ringing(far[::-1][: len(t) // 2], reach))
    return front * size, len(time) - back * size


def _departures(t: Floats, speed: Floats, half: int) -> NDArray[np.bool_]:
    """(M,) where the speed is off the middle's straight line by more than the middle's own spread allows."""
    quarter = len(t) // 4
    middle = slice(quarter, len(t) - quarter)
    x, level = t - mean(t[middle]), mean(speed[middle])
    trend = float(x[middle] @ (speed[middle] - level)) / float(x[middle] @ x[middle])
    departure = np.abs(speed - level - trend * x)
    spread = math.sqrt(mean(departure[middle] ** 2))
    far = departure > max(UNSETTLED * spread, NEGLIGIBLE * abs(level))
    # Straight lines at the ends have fewer neighbours and so more noise.
    far[:half] = far[-half:] = False
    return far


def _ringing(far: NDArray[np.bool_], reach: int) -> int:
    """Steps from the front until the last departure that follows the one before within `reach`, and some again."""
    last = -1
    for step in np.flatnonzero(far).tolist():
        if step - last > reach:
            break
        last = step
    return 0 if last < 0 else min(len(far), round((last + 1) * (1.0 + AGAIN)) + HALVES[0])
