"""Runs that repeat one another, and the noise floor that they show."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Run
from pumaid.kinematics import Numbers, grouped, marked, near

Floats = NDArray[np.float64]

#: Held positions within this (rad or m) are the same posture to a controller: hundreds of encoder counts, and gravity
#: differs by less than 1 %.
SAME_POSITION = 0.01
#: Speeds within this share are the same speed.
SAME_SPEED = 0.03
#: Share of the shorter run's travel that two replicates must have in common.
OVERLAP = 0.8


def replicates(runs: Sequence[Run]) -> list[list[int]]:
    """Groups of indices into `runs` that repeat one another: same joint, kind, posture, speed, direction and span.

    Each begins with its earliest run, by the log's clock and not by the order of files, to which the others are held.
    """
    sorts: dict[tuple[int, str], list[int]] = {}
    for number in sorted(range(len(runs)), key=lambda n: (runs[n].start, runs[n].duration, runs[n].speed)):
        sorts.setdefault((runs[number].joint, runs[number].kind), []).append(number)
    groups = [
        [numbers[k] for k in group]
        for numbers in sorts.values()
        for group in grouped(len(numbers), _repeating([runs[number] for number in numbers]))
        if len(group) > 1
    ]
    return sorted(groups, key=lambda group: group[0])


def _repeating(runs: Sequence[Run]) -> Callable[[int, Numbers], NDArray[np.bool_]]:
    """Of runs of one joint and kind, by number: which of some (n,) repeat one."""
    speed, span = np.array([run.speed for run in runs]), np.array([run.span for run in runs])
    posture = np.delete([run.posture for run in runs], runs[0].joint - 1, axis=1)
    low, high, middle = span.min(axis=1), span.max(axis=1), span.sum(axis=1)

    def alike(first: int, others: Numbers) -> NDArray[np.bool_]:
        close = others[np.abs(speed[others] - speed[first]) <= SAME_SPEED * abs(speed[first])]
        close = near(posture, first, close, within=SAME_POSITION)
        turns = 2.0 * np.pi * np.round((middle[first] - middle[close]) / (4.0 * np.pi))
        shared = np.minimum(high[first], high[close] + turns) - np.maximum(low[first], low[close] + turns)
        shorter = np.minimum(high[first] - low[first], high[close] - low[close])
        return marked(others, close[shared >= OVERLAP * shorter])

    return alike


@dataclass(frozen=True, eq=False, slots=True)
class Pair:
    """The first of a group of replicates and a later one.

    `more` (A) is what the later one draws beyond the first at the same positions, so that nothing is in it that a model
    of position and speed could explain; `variance` (A2) is that of a sample as both show it.
    """

    first: Run
    later: Run
    more: float
    variance: float
    is_last: bool


def pairs(runs: Sequence[Run]) -> list[Pair]:
    """Of each group of replicates among `runs` the first beside every other one."""
    out = []
    for numbers in replicates(runs):
        first, *repeats = (runs[number] for number in numbers)
        a = _OrderedBins.of(first)
        for later in repeats:
            turns = 2.0 * np.pi * float(np.round((sum(first.span) - sum(later.span)) / (4.0 * np.pi)))
            b = _OrderedBins.of(later, turns=turns, smooth=a.smooth)
            more, square = _difference(a, b)
            variance = 0.5 * (more**2 + square) + _inside(a, b)
            out.append(Pair(first, later, more, variance, later is repeats[-1]))
    return out


def noise_floor(repeated: Sequence[Pair]) -> tuple[float | None, str | None]:
    """The RMSE (A, of samples) that no model of position, posture, speed and direction can go below, or why unknown.

    Half the mean squared difference of replicates at the same positions, plus the variance inside bins that the
    current's course from bin to bin does not explain. Physics that repeats within less than a bin counts as noise.

    Source
    ------
    G. E. P. Box, W. G. Hunter and J. S. Hunter, Statistics for Experimenters, ch. 3: pure error from replicates.
    """
    if not repeated:
        return None, "no run is repeated (same posture, speed, direction), so noise cannot be told from missing physics"
    weights = [pair.first.samples + pair.later.samples for pair in repeated]
    return float(np.sqrt(np.average([pair.variance for pair in repeated], weights=weights))), None


@dataclass(frozen=True, eq=False, slots=True)
class _OrderedBins:
    """A run's bins in order of position (M,), with the first harmonic's regressors (M, 4): cos, sin, one, acceleration.

    `rest` (M,) is the current (A) less the first harmonic `smooth` (4,) of the run with which it is compared.
    """

    q: Floats
    current: Floats
    variance: Floats
    count: NDArray[np.int64]
    basis: Floats
    smooth: Floats

    @classmethod
    def of(cls, run: Run, *, turns: float = 0.0, smooth: Floats | None = None) -> _OrderedBins:
        moving, bins = run.joint - 1, run.bins
        order = np.argsort(bins.position[:, moving], kind="stable")
        q, current = bins.position[order, moving] + turns, bins.current[order]
        basis = np.column_stack([np.cos(q), np.sin(q), np.ones(len(q)), bins.acceleration[order]])
        if smooth is None:
            smooth = np.asarray(np.linalg.lstsq(basis, current, rcond=1e-6)[0], dtype=float)
        return cls(q, current, bins.variance[order], bins.count[order], basis, smooth)

    @property
    def rest(self) -> Floats:
        return np.asarray(self.current - self.basis @ self.smooth)

    def before(self, q: Floats) -> NDArray[np.int64]:
        """The bin before each position, so that it and the next enclose the position."""
        return np.asarray(np.searchsorted(self.q, q).clip(1, len(self.q) - 1) - 1)

    def rises(self) -> Floats:
        """(M - 1,) slopes (A/rad or A/m) of the rest from one bin to the next."""
        return _ratio(np.diff(self.rest), np.diff(self.q))


def _ratio(values: Floats, width: Floats) -> Floats:
    return np.divide(values, width, out=np.zeros(len(width)), where=width > 0)


def _difference(a: _OrderedBins, b: _OrderedBins) -> tuple[float, float]:
    """Mean (A) by which the second's current is larger at the same positions, and mean square (A2) about it."""
    shared = (b.q >= a.q[0]) & (b.q <= a.q[-1])
    if len(a.q) < 2 or np.count_nonzero(shared) < 2:
        return float(np.average(b.current, weights=b.count) - np.average(a.current, weights=a.count)), 0.0
    k, q = a.before(b.q[shared]), b.q[shared]
    share = _ratio(q - a.q[k], a.q[k + 1] - a.q[k])
    difference = b.rest[shared] - (1.0 - share) * a.rest[k] - share * a.rest[k + 1]
    # Interpolation averages the bins' noise, not what a whole run shares.
    averaging = 0.5 * (1.0 + (1.0 - share) ** 2 + share**2)
    level = float(difference.mean())
    return level, float(np.mean((difference - level) ** 2 / averaging))


def _inside(a: _OrderedBins, b: _OrderedBins) -> float:
    """Mean variance (A2) inside the bins of two runs, less what the current's slope makes of a bin's width.

    What the slope adds to the first harmonic's is squared as a product of both runs', whose noise is independent.
    """
    counts = int(a.count.sum()) + int(b.count.sum())
    variance = float(a.variance @ a.count + b.variance @ b.count) / counts
    if len(a.q) < 2 or len(b.q) < 2:
        return variance
    width, smooth = np.gradient(b.q), b.smooth
    bend = _ratio(np.gradient(b.basis[:, 3]), width)
    harmonic = b.basis[:, 0] * smooth[1] - b.basis[:, 1] * smooth[0] + bend * smooth[3]
    first, second = a.rises()[a.before(0.5 * (b.q[1:] + b.q[:-1]))], b.rises()
    along = 0.5 * (harmonic[1:] + harmonic[:-1])
    inner = np.diff(b.q) ** 2 * (along * (first + second) + first * second)
    spread = float(np.mean((harmonic * width) ** 2) + np.mean(inner)) / 12.0
    return max(variance - spread * (1.0 - 1.0 / float(b.count.mean()) ** 2), 0.0)
