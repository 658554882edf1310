"""Where a straight line of position ends: the latest instant that the data still surely put on the line."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: How position may leave the line: as a corner, as at constant acceleration, as at constant jerk.
POWERS = (1, 2, 3)
#: Points looked at around one edge; more change nothing that the noise would let through.
MOST_POINTS = 160
#: Instants tried for an edge, first along the whole window, then around the best.
COARSE, FINE = 48, 32
#: Rise of the misfit, in units of its mean share a point, of an instant that is compatible (two standard deviations).
COMPATIBLE = 4.0
#: Fall of the misfit, in the same units, that a departure must bring to be believed (five standard deviations).
BELIEVED = 25.0
#: rad2 or m2; a misfit of data without any noise (1e-9 squared).
TINY = 1e-18


def leaving(time: Floats, position: Floats) -> float:
    """Latest time up to which position surely follows a straight line that it later leaves.

    Line plus ``max(0, t - t_e)^p`` is fitted for many `t_e` and p = 1, 2, 3; among the instants whose misfit is not
    significantly worse than the best one's, the earliest is returned, so that what is kept is on the line.

    Parameters
    ----------
    time, position
        (N,) s and rad or m; the line comes first, the departure last; N at least 6.

    Returns
    -------
    time
        s; the last time given where nothing leaves the line.
    """
    t, q = _thinned(time, position)
    t, q = t - time[0], q - q.mean()
    basis, _ = np.linalg.qr(np.column_stack([np.ones_like(t), t - t.mean()]))
    rest = q - basis @ (basis.T @ q)
    low, high = t[0] + 0.1 * (t[-1] - t[0]), t[-2]
    tried = np.linspace(low, high, COARSE)
    misfit = _misfits(t, rest, basis, tried)
    power, best = np.unravel_index(np.argmin(misfit), misfit.shape)
    step = tried[1] - tried[0]
    around = np.clip(np.linspace(tried[best] - 2 * step, tried[best] + 2 * step, FINE), low, high)
    tried = np.concatenate([tried, around])
    misfit = np.concatenate([misfit[power], _misfits(t, rest, basis, around)[power]])
    least = float(misfit.min())
    share = least / max(1, len(t) - 4) + TINY
    if rest @ rest - least < BELIEVED * share:
        return float(time[-1])
    bound = least + COMPATIBLE * share
    return float(time[0] + tried[misfit <= bound].min())


def _misfits(t: Floats, rest: Floats, basis: Floats, tried: Floats) -> Floats:
    """(3, G) sums of squares left by line plus hinge at each of (G,) instants."""
    ramp = np.maximum(0.0, t[:, None] - tried[None, :])
    out = np.empty((len(POWERS), len(tried)))
    for row, power in enumerate(POWERS):
        hinge = ramp**power
        hinge = hinge - basis @ (basis.T @ hinge)
        size = np.sum(hinge * hinge, axis=0)
        gain = np.where(size > 0, (rest @ hinge) ** 2 / np.where(size > 0, size, 1.0), 0.0)
        out[row] = np.maximum(rest @ rest - gain, 0.0)
    return out


def _thinned(time: Floats, position: Floats) -> tuple[Floats, Floats]:
    size = -(-len(time) // MOST_POINTS)
    if size == 1:
        return time, position
    starts = np.arange(0, len(time), size)
    counts = np.diff(np.append(starts, len(time)))
    return (
        time[0] + np.add.reduceat(time - time[0], starts) / counts,
        position[0] + np.add.reduceat(position - position[0], starts) / counts,
    )
