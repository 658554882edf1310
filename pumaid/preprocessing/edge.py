"""Where straight lines of position end: the latest instants that the data still surely put on the lines."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.maths.short import lengths

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


def _binomials(powers: tuple[int, ...]) -> tuple[Floats, NDArray[np.int64]]:
    """Coefficients (P, K, 1) of ``x^k`` in ``(x - e)^p`` without its powers of -e, and these powers (P, K)."""
    size = max(powers) + 1
    coefficients = np.array([[float(math.comb(p, k)) for k in range(size)] for p in powers])
    return coefficients[:, :, None], np.array([[max(p - k, 0) for k in range(size)] for p in powers])


_SINGLE, _SINGLE_LEFT = _binomials(POWERS)
_SQUARED, _SQUARED_LEFT = _binomials(tuple(2 * power for power in POWERS))


@dataclass(frozen=True, eq=False, slots=True)
class Window:
    """What is looked at of the end of a line.

    Attributes
    ----------
    time, position
        (N,) s and rad or m; the line comes first, the departure last; N at least 6.
    sure
        Samples at the front that are on the line in any case.
    """

    time: Floats
    position: Floats
    sure: int


def leaving(windows: Sequence[Window]) -> list[float]:
    """Latest times up to which position surely follows straight lines that it later leaves.

    Line plus ``max(0, t - t_e)^p`` is fitted for many `t_e` and p = 1, 2, 3; among the instants whose misfit is not
    significantly worse than the best one's, the earliest is returned, so that what is kept is on the line. Where no
    such curve describes the departure (a ramp that ends in view), less of it is looked at.

    Parameters
    ----------
    windows
        E ends of lines, all looked at together: one by one each step would take longer to call than to compute.

    Returns
    -------
    times
        (E,) s; the last time given where nothing leaves the line; the end of what is sure where position swings
        about it.
    """
    if not windows:
        return []
    points = Points.of(windows)
    earliest, latest, is_described = _onsets(points)
    was_described, going = is_described.copy(), np.ones(len(windows), dtype=np.bool_)
    for _ in range(MOST_LOOKS):
        line = (points.inside & (points.time < latest[:, None])).sum(axis=1)
        stop = line + np.maximum(LEAST_DEPARTURE, (points.size - line) // 2)
        going &= ~(was_described | (stop >= points.size) | (line < FEWEST))
        some = np.flatnonzero(going)
        if not len(some):
            break
        # One look more than the curve needs: a ramp that ended in view may hide below the noise.
        was_described[some] = is_described[some]
        points.size[some] = stop[some]
        again, latest[some], is_described[some] = _onsets(points.some(some))
        earliest[some] = np.minimum(again, earliest[some])
    return [
        float(early) if early < points.end(k) else _unless_swinging(points, k, window)
        for k, (early, window) in enumerate(zip(earliest, windows, strict=True))
    ]


def _unless_swinging(points: Points, number: int, window: Window) -> float:
    """The last time of a window in which nothing leaves the line, unless position swings about it there."""
    size, sure = points.size[number], float(window.time[window.sure])
    time, position, w = (values[number, :size] for values in (points.time, points.position, points.weight))
    line = time < sure
    if line.sum() < FEWEST or line.all():
        return float(window.time[-1])
    t = time - sure
    slope, level = np.polyfit(t[line], position[line] - position[0], 1, w=w[line])
    swing = ((position - position[0] - level - slope * t) * w) ** 2
    stays = swing[~line].mean() <= SWINGING * swing[line].mean() + TINY
    return float(window.time[-1] if stays else sure)


@dataclass(frozen=True, eq=False, slots=True)
class Points:
    """Thinned samples of E windows: (E, M) times, positions, and weights, the roots of their counts.

    `size` (E,) says how many of a window's points count; behind them are none, or some that are looked at no more.
    """

    time: Floats
    position: Floats
    weight: Floats
    size: NDArray[np.int64]

    @classmethod
    def of(cls, windows: Sequence[Window]) -> Points:
        """At most `LINE_POINTS` of what is sure and `EDGE_POINTS` of the rest."""
        thinned = [_thinned(window) for window in windows]
        size = np.array([len(time) for time, _, _ in thinned])
        out = np.zeros((3, len(windows), size.max()))
        for k, values in enumerate(thinned):
            out[:, k, : size[k]] = values
        time, position, weight = out
        return cls(time, position, weight, size)

    @property
    def inside(self) -> NDArray[np.bool_]:
        """(E, M) which points count."""
        return np.asarray(np.arange(self.time.shape[1]) < self.size[:, None])

    def end(self, number: int) -> float:
        """Time of a window's last point."""
        return float(self.time[number, self.size[number] - 1])

    def some(self, numbers: NDArray[np.int64]) -> Points:
        """Some of the windows, no wider than need be."""
        wide = int(self.size[numbers].max())
        time, position, weight = (values[numbers, :wide] for values in (self.time, self.position, self.weight))
        return Points(time, position, weight, self.size[numbers])


def _thinned(window: Window) -> tuple[Floats, Floats, Floats]:
    time, position, sure = window.time, window.position, window.sure
    line, edge = -(-max(1, sure) // LINE_POINTS), -(-max(1, len(time) - sure) // EDGE_POINTS)
    starts = np.concatenate([np.arange(0, sure, line), np.arange(sure, len(time), edge)])
    counts = lengths(starts, len(time))
    return (
        time[0] + np.add.reduceat(time - time[0], starts) / counts,
        position[0] + np.add.reduceat(position - position[0], starts) / counts,
        np.sqrt(counts.astype(float)),
    )


def _onsets(points: Points) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """(E,) earliest compatible and best times of departure, and whether the curve fits as the line does."""
    inside, each = points.inside, np.arange(len(points.size))
    t = points.time - points.time[:, :1]
    w = np.where(inside, points.weight, 0.0)
    end = t[each, points.size - 1]
    line = _line_basis(t, w)
    rest = _apart(line, (points.position - points.position[:, :1]) * w)
    whole = (rest * rest).sum(axis=1)
    sums = _Sums.of(np.where(inside, t / end[:, None] - 1.0, 0.0), w, [*line, rest])
    low, high = 0.1 * end, t[each, points.size - 2]
    tried = low[:, None] + _COARSE_STEPS * (high - low)[:, None]
    misfit = sums.misfits(tried / end[:, None] - 1.0, whole)
    best = misfit.reshape(len(each), -1).argmin(axis=1) % COARSE
    around = tried[each, best][:, None] + (tried[:, 1] - tried[:, 0])[:, None] * _FINE_STEPS
    around = np.clip(around, low[:, None], high[:, None])
    misfit = np.concatenate([misfit, sums.misfits(around / end[:, None] - 1.0, whole)], axis=2)
    tried = np.concatenate([tried, around], axis=1)
    power, best = np.divmod(misfit.reshape(len(each), -1).argmin(axis=1), tried.shape[1])
    least, onset = misfit[each, power, best], tried[each, best]
    share = least / np.maximum(1, points.size - 4) + TINY
    compatible = (misfit <= (least + COMPATIBLE * share)[:, None, None]).any(axis=1)
    earliest = np.where(compatible, tried, np.inf).min(axis=1)
    ramp = np.maximum(0.0, t - onset[:, None])
    hinge = w * np.where(power == 0, 1.0, np.where(power == 1, ramp.T, ramp.T * ramp.T)).T * ramp
    is_described = _describe(
        rest, _unit(_apart(line, _apart(line, hinge))), (t < 2.0 * onset[:, None] - end[:, None], inside)
    )
    stays = whole - least < BELIEVED * share
    start = points.time[:, 0]
    return start + np.where(stays, end, earliest), start + np.where(stays, end, onset), stays | is_described


def _line_basis(t: Floats, w: Floats) -> tuple[Floats, Floats]:
    """Two (E, M) orthonormal rows that span all straight lines, weighted; about the mean they are orthogonal."""
    weight = w * w
    mean = (weight * t).sum(axis=1) / weight.sum(axis=1)
    return _unit(w), _unit(w * (t - mean[:, None]))


def _unit(rows: Floats) -> Floats:
    return np.asarray(rows / np.maximum(np.sqrt((rows * rows).sum(axis=1)), 1e-300)[:, None])


def _apart(basis: Sequence[Floats], rows: Floats) -> Floats:
    """What of (E, M) rows is none of the orthonormal ones."""
    along = [(one * rows).sum(axis=1)[:, None] for one in basis]
    return np.asarray(rows - along[0] * basis[0] - along[1] * basis[1])


def _describe(rest: Floats, hinge: Floats, where: tuple[NDArray[np.bool_], NDArray[np.bool_]]) -> NDArray[np.bool_]:
    """(E,) whether line plus hinge leaves no more of the departure than of the line; `rest` is what the line leaves.

    As long before the onset as behind it, a wrong curve shows too: what is `where[0]` lies farther before.
    """
    square = (rest - (hinge * rest).sum(axis=1)[:, None] * hinge) ** 2
    far, inside = where[0] & where[1], where[1]
    n_far, n_near = far.sum(axis=1), (inside & ~far).sum(axis=1)
    of_far = np.where(far, square, 0.0).sum(axis=1) / np.maximum(n_far, 1)
    of_near = np.where(far, 0.0, square).sum(axis=1) / np.maximum(n_near, 1)
    usual = 1.0 + DESCRIBED * np.sqrt(2.0 / np.maximum(n_near, 1) + 2.0 / np.maximum(n_far, 1))
    return np.asarray((n_far < FEWEST) | (n_near == 0) | (of_near <= usual * of_far + TINY))


@dataclass(frozen=True, eq=False, slots=True)
class _Sums:
    """Sums over the points behind any instant, from which the misfits of all hinges there follow.

    A hinge is a polynomial behind its instant, so sums of ``x^k`` say all of it. `x` counts from the last point back,
    in units of the whole: then no sum is a small difference of large ones, however near to the end the instant is.

    Attributes
    ----------
    x
        (E, M) from -1 to 0.
    sums
        (E, 7 + 3 * 4, M) sums over a point and all behind it: of ``w^2 x^k``, k = 0 to 6, then of ``w x^k``, k = 0 to
        3, times each of the line's two orthonormal rows and the rest.
    """

    x: Floats
    sums: Floats

    @classmethod
    def of(cls, x: Floats, w: Floats, known: Sequence[Floats]) -> _Sums:
        """Of weights, and the line's two rows and what the line leaves."""
        powers, size = _powers(x), len(x)
        rows = np.empty((size, 19, x.shape[1]))
        np.multiply(powers, (w * w)[:, None], out=rows[:, :7])
        for k, row in enumerate(known):
            np.multiply(powers[:, :4], (w * row)[:, None], out=rows[:, 7 + 4 * k : 11 + 4 * k])
        return cls(x, rows[..., ::-1].cumsum(axis=2)[..., ::-1])

    def misfits(self, tried: Floats, whole: Floats) -> Floats:
        """(E, 3, G) sums of squares left by line plus hinge of each power at (E, G) instants, as `x`.

        `whole` (E,) are those that the line leaves.
        """
        first = (self.x[:, None, :] <= tried[:, :, None]).sum(axis=2)
        sums = np.take_along_axis(self.sums, first[:, None, :], axis=2)
        away = _powers(-tried)
        plain = (_SQUARED * away[:, _SQUARED_LEFT] * sums[:, None, :7]).sum(axis=2)
        hinges = _SINGLE * away[:, _SINGLE_LEFT]
        along = [(hinges * sums[:, None, 7 + 4 * k : 11 + 4 * k]).sum(axis=2) ** 2 for k in range(3)]
        size = plain - along[0] - along[1]
        is_told = size > 1e-9 * plain
        whole = whole[:, None, None]
        return np.where(is_told, np.maximum(whole - along[2] / np.where(is_told, size, 1.0), 0.0), whole)


def _powers(x: Floats) -> Floats:
    """(E, 7, M) powers 0 to 6 of (E, M) numbers."""
    out = np.empty((len(x), 7, x.shape[1]))
    out[:, 0] = 1.0
    for power in range(6):
        np.multiply(out[:, power], x, out=out[:, power + 1])
    return out
