"""Where a straight line of position ends: the latest instant that the data still surely put on the line."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: How position may leave the line: as a corner, as at constant acceleration, as at constant jerk.
POWERS = (1, 2, 3)
#: Points to which the samples of the sure line and of the rest are thinned; more would change little and cost time.
LINE_POINTS, EDGE_POINTS = 40, 100
#: Instants tried for an edge, first along the whole window, then around the best.
COARSE, FINE = 32, 20
_COARSE_STEPS, _FINE_STEPS = np.linspace(0.0, 1.0, COARSE), np.linspace(-2.0, 2.0, FINE)
#: Rise of the misfit, in units of its mean share a point, of an instant that is compatible (two standard deviations).
COMPATIBLE = 4.0
#: Fall of the misfit, in the same units, that a departure must bring to be believed (five standard deviations).
BELIEVED = 25.0
#: rad2 or m2; a misfit of data without any noise (1e-9 squared).
TINY = 1e-18
#: Excess of a departure's mean square misfit over the line's, in its standard deviations, up to which a curve fits it.
DESCRIBED = 2.5
#: Mean square swing about the line, in units of the sure part's, above which position does not stay on it.
SWINGING = 5.0
#: Times that less of a departure is looked at, and samples of it always looked at.
MOST_LOOKS, LEAST_DEPARTURE = 6, 6
#: Fewest points from which a noise is told.
FEWEST = 8


def leaving(time: Floats, position: Floats, sure: int) -> float:
    """Latest time up to which position surely follows a straight line that it later leaves.

    Line plus ``max(0, t - t_e)^p`` is fitted for many `t_e` and p = 1, 2, 3; among the instants whose misfit is not
    significantly worse than the best one's, the earliest is returned, so that what is kept is on the line. Where no
    such curve describes the departure (a ramp that ends in view), less of it is looked at.

    Parameters
    ----------
    time, position
        (N,) s and rad or m; the line comes first, the departure last; N at least 6.
    sure
        Samples at the front that are on the line in any case.

    Returns
    -------
    time
        s; the last time given where nothing leaves the line; the end of what is sure where position swings about it.
    """
    points = _thinned(time, position, sure)
    earliest, latest, is_described = _onset(points)
    was_described = is_described
    for _ in range(MOST_LOOKS):
        line = int(np.searchsorted(points.time, latest))
        stop = line + max(LEAST_DEPARTURE, (len(points.time) - line) // 2)
        if was_described or stop >= len(points.time) or line < FEWEST:
            break
        # One look more than the curve needs: a ramp that ended in view may hide below the noise.
        was_described = is_described
        points = Points(points.time[:stop], points.position[:stop], points.weight[:stop])
        again, latest, is_described = _onset(points)
        earliest = min(again, earliest)
    if earliest < points.time[-1]:
        return earliest
    return float(time[-1] if _stays(points, float(time[sure])) else time[sure])


def _stays(points: Points, sure: float) -> bool:
    """Whether position swings no more about the line behind the time `sure` than before it."""
    line = points.time < sure
    if line.sum() < FEWEST or line.all():
        return True
    t, w = points.time - sure, points.weight
    slope, level = np.polyfit(t[line], points.position[line] - points.position[0], 1, w=w[line])
    swing = ((points.position - points.position[0] - level - slope * t) * w) ** 2
    return bool(swing[~line].mean() <= SWINGING * swing[line].mean() + TINY)


@dataclass(frozen=True, eq=False, slots=True)
class Points:
    """Thinned samples: (M,) times, positions, and weights, the roots of their counts."""

    time: Floats
    position: Floats
    weight: Floats


def _onset(points: Points) -> tuple[float, float, bool]:
    """Earliest compatible and best time of departure, and whether the curve fits the departure as the line fits."""
    t, w = points.time - points.time[0], points.weight
    q = (points.position - points.position[0]) * w
    basis = _line_basis(t, w)
    rest = q - (basis @ q) @ basis
    known = np.vstack([basis, rest])
    whole = float(rest @ rest)
    low, high = float(t[0] + 0.1 * (t[-1] - t[0])), float(t[-2])
    tried = low + _COARSE_STEPS * (high - low)
    misfit = _misfits(t, w, known, tried=tried)
    best = int(misfit.argmin()) % COARSE
    step = tried[1] - tried[0]
    around = np.clip(tried[best] + step * _FINE_STEPS, low, high)
    tried = np.concatenate([tried, around])
    misfit = np.concatenate([misfit, _misfits(t, w, known, tried=around)], axis=1)
    power, best = divmod(int(misfit.argmin()), len(tried))
    least = float(misfit[power, best])
    share = least / max(1, len(t) - 4) + TINY
    start = float(points.time[0])
    if whole - least < BELIEVED * share:
        return float(points.time[-1]), float(points.time[-1]), True
    compatible = tried[(misfit <= least + COMPATIBLE * share).any(axis=0)]
    onset = float(tried[best])
    hinge = w * np.maximum(0.0, t - onset) ** POWERS[power]
    is_described = _describes(t, rest, _apart_from(basis, hinge), onset=onset)
    return start + float(compatible.min()), start + onset, is_described


def _line_basis(t: Floats, w: Floats) -> Floats:
    """(2, M) orthonormal rows that span all straight lines, weighted; about the weighted mean they are orthogonal."""
    weight = w * w
    x = w * (t - (weight @ t) / weight.sum())
    return np.stack([w / math.sqrt(w @ w), x / math.sqrt(x @ x)])


def _apart_from(basis: Floats, column: Floats) -> Floats:
    """What of a column is none of the orthonormal rows, of length one; twice, since once leaves rounding."""
    for _ in range(2):
        column = column - (basis @ column) @ basis
    return np.asarray(column / max(math.sqrt(column @ column), 1e-300))


def _describes(t: Floats, rest: Floats, hinge: Floats, *, onset: float) -> bool:
    """Whether line plus hinge leaves no more of the departure than of the line; `rest` is what the line leaves."""
    residual = rest - (hinge @ rest) * hinge
    # As long before the onset as behind it, a wrong curve shows too.
    first = int(np.searchsorted(t, 2.0 * onset - t[-1]))
    near, far = residual[first:], residual[:first]
    if len(far) < FEWEST or not len(near):
        return True
    usual = 1.0 + DESCRIBED * math.sqrt(2.0 / len(near) + 2.0 / len(far))
    return bool(near @ near / len(near) <= usual * (far @ far) / len(far) + TINY)


def _misfits(t: Floats, w: Floats, known: Floats, *, tried: Floats) -> Floats:
    """(3, G) sums of squares left by line plus hinge at each of (G,) instants.

    `known` (3, M) are the line's two orthonormal rows and what the line leaves of the position.
    """
    # Before the first instant every hinge is zero.
    first = int(np.searchsorted(t, tried.min()))
    known, whole = known[:, first:], float(known[2] @ known[2])
    ramp = t[first:, None] - tried
    np.maximum(ramp, 0.0, out=ramp)
    hinges = np.empty((len(ramp), len(POWERS), len(tried)))
    np.multiply(ramp, w[first:, None], out=hinges[:, 0])
    for power in range(1, len(POWERS)):
        np.multiply(hinges[:, power - 1], ramp, out=hinges[:, power])
    columns = hinges.reshape(len(ramp), -1)
    plain = np.einsum("ij,ij->j", columns, columns)
    along = known @ columns
    along *= along
    size = plain - along[0] - along[1]
    is_told = size > 1e-9 * plain
    misfit = np.maximum(whole - along[2] / np.where(is_told, size, 1.0), 0.0)
    return np.where(is_told, misfit, whole).reshape(len(POWERS), -1)


def _thinned(time: Floats, position: Floats, sure: int) -> Points:
    line, edge = -(-max(1, sure) // LINE_POINTS), -(-max(1, len(time) - sure) // EDGE_POINTS)
    starts = np.concatenate([np.arange(0, sure, line), np.arange(sure, len(time), edge)])
    counts = np.diff(np.append(starts, len(time)))
    return Points(
        time[0] + np.add.reduceat(time - time[0], starts) / counts,
        position[0] + np.add.reduceat(position - position[0], starts) / counts,
        np.sqrt(counts.astype(float)),
    )
