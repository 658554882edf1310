"""Paths of the joints: where they are at each share of the way, for many paths at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

#: Postures (N, J) of paths numbered `which` (N,) from 0 at shares (N,) of their way, 0 at the start, 1 at the end. Each
#: joint goes one way only along a path, however unevenly.
Route = Callable[[Ints, Floats], Floats]


def straight(starts: Floats, ends: Floats) -> Route:
    """Paths (K, J) on which all joints begin and end together, each at its own constant speed; rad or m."""
    begin, way = np.atleast_2d(starts), np.atleast_2d(ends) - np.atleast_2d(starts)
    return lambda which, share: begin[which] + share[:, None] * way[which]


def trapezoids(starts: Floats, ends: Floats, *, speeds: Floats, accelerations: Floats) -> Route:
    """Paths on which all joints begin together and each follows its own trapezoid of speed until it is there.

    The joints bend the path, since short ways are done before long ones. Shares are of the time that the last needs.

    Parameters
    ----------
    starts, ends
        (K, J) rad or m.
    speeds, accelerations
        (J,) or (K, J), positive: rad/s and rad/s2, or m/s and m/s2.
    """
    begin, finish = np.atleast_2d(starts), np.atleast_2d(ends)
    way = np.abs(finish - begin)
    acceleration = np.broadcast_to(accelerations, way.shape)
    peak = np.minimum(np.broadcast_to(speeds, way.shape), np.sqrt(acceleration * way))
    ramp = peak / acceleration
    lasting = ramp + np.divide(way, peak, out=np.zeros_like(way), where=peak > 0)
    whole = lasting.max(axis=1)

    def at(which: Ints, share: Floats) -> Floats:
        time = (share * whole[which])[:, None]
        a, top, up, end = acceleration[which], peak[which], ramp[which], lasting[which]
        rising, falling = np.clip(time, 0.0, up), np.clip(time - (end - up), 0.0, up)
        cruising = np.clip(time - up, 0.0, np.maximum(end - 2.0 * up, 0.0))
        gone = 0.5 * a * rising**2 + top * (cruising + falling) - 0.5 * a * falling**2
        return begin[which] + np.sign(finish - begin)[which] * np.minimum(gone, way[which])

    return at
