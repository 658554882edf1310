"""Runs that repeat one another, and the noise floor that they show."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pumaid.dataset import BLOCK, Run
from pumaid.maths import Counts, Floats
from pumaid.robot import grouped, near

#: Held positions within this (rad or m) are the same posture to a controller: hundreds of encoder counts, and gravity
#: differs by less than 1 %.
SAME_POSITION = 0.01
#: Speeds within this share are the same speed.
SAME_SPEED = 0.03
#: Share of the shorter run's travel that two replicates must have in common.
OVERLAP = 0.8
#: Motion over so many s, asked each other s at so many instants, is an earlier one again if all joints are where they
#: were then, within this share of how far they move meanwhile. Places at most that are asked.
LASTS, SPACING, PLACES, ALIKE, MOST_ASKED = 2.0, 0.1, 5, 0.1, 1000


def replicates(runs: Sequence[Run]) -> list[list[int]]:
    """Groups of indices into `runs` that repeat one another: same joint, kind, load, posture, speed, direction, span.

    Each begins with its earliest run, by the log's clock and not by the order of files, to which the others are held.
    """
    order = np.array(sorted(range(len(runs)), key=lambda n: (runs[n].start, runs[n].duration, runs[n].speed)), np.int64)
    state = np.array([f"{runs[n].joint} {runs[n].kind} {runs[n].payload}" for n in order])
    speed, is_block = np.array([runs[n].speed for n in order]), np.array([runs[n].kind == BLOCK for n in order])
    posture, span = np.array([runs[n].posture for n in order]), np.array([runs[n].span for n in order]).reshape(-1, 2)
    low, high = span.min(axis=1), span.max(axis=1)

    def repeating(first: int, rest: Counts) -> Counts:
        close = rest[(state[rest] == state[first]) & ~is_block[rest]]
        close = close[np.abs(speed[close] - speed[first]) <= SAME_SPEED * abs(speed[first])]
        close = near(posture, first, close, within=SAME_POSITION)
        turns = _turns(span[first], span[close])
        shared = np.minimum(high[first], high[close] + turns) - np.maximum(low[first], low[close] + turns)
        shorter = np.minimum(high[first] - low[first], high[close] - low[close])
        return np.asarray(close[shared >= OVERLAP * shorter])

    groups = [order[group].tolist() for group in grouped(len(runs), repeating) if len(group) > 1]
    return sorted(groups, key=lambda group: group[0])


def first_made(time: Floats, position: Floats) -> Floats:
    """(N,) times (s) at which the arm first moved as it does at each of (N,) rising ones, with positions (N, J)."""
    out, size, whole = time.copy(), np.ptp(position, axis=0), round(LASTS / SPACING)
    scaled = (position / np.maximum(size, SAME_POSITION))[:, size > SAME_POSITION]
    if time[-1] - time[0] <= LASTS or not scaled.size:
        return out
    at = np.arange(time[0], time[-1] - LASTS, SPACING)
    paths = np.stack([np.interp(at[:, None] + np.linspace(0.0, LASTS, PLACES), time, q) for q in scaled.T], axis=-1)
    spread, paths = paths.var(axis=1).sum(axis=1) * PLACES, paths.reshape(len(at), -1)
    squares = np.sum(paths**2, axis=1)
    for place in range(whole, len(at), max(PLACES, len(at) // MOST_ASKED)):
        away = squares[: place - whole + 1] + squares[place] - 2.0 * paths[: place - whole + 1] @ paths[place]
        first = int(np.argmax(away < ALIKE**2 * spread[place]))
        if away[first] < ALIKE**2 * spread[place]:
            first += int(np.argmin(away[first : first + whole]))
            again = slice(*np.searchsorted(time, [at[place], at[place] + LASTS]))
            out[again] = time[again] - (at[place] - at[first])
    return out


def _turns(span: ArrayLike, other: ArrayLike) -> Floats:
    """(...) rad, whole turns by which the middle of one span (2,) is beyond those of others (..., 2)."""
    return 2.0 * np.pi * np.round((np.sum(span) - np.sum(other, axis=-1)) / (4.0 * np.pi))


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
        a = _OrderedBins(first)
        for later in repeats:
            b = _OrderedBins(later, turns=float(_turns(first.span, later.span)), smooth=a.smooth)
            more, square = _difference(a, b)
            out.append(Pair(first, later, more, 0.5 * (more**2 + square) + _inside(a, b), later is repeats[-1]))
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


class _OrderedBins:
    """A run's bins in order of position (M,), with the first harmonic's regressors (M, 4): cos, sin, one, acceleration.

    `rest` (M,) is the current (A) less the first harmonic `smooth` (4,) of the run with which it is compared, and
    `rises` (M - 1,) its slopes (A/rad or A/m) from one bin to the next.
    """

    def __init__(self, run: Run, *, turns: float = 0.0, smooth: Floats | None = None) -> None:
        bins, position = run.bins, run.bins.position[:, run.joint - 1]
        order = np.argsort(position, kind="stable")
        self.q, self.current = position[order] + turns, bins.current[order]
        self.variance, self.count = bins.variance[order], bins.count[order]
        self.basis = np.column_stack([np.cos(self.q), np.sin(self.q), np.ones(len(self.q)), bins.acceleration[order]])
        self.smooth = np.linalg.lstsq(self.basis, self.current, rcond=1e-6)[0] if smooth is None else smooth
        self.rest = self.current - self.basis @ self.smooth
        self.rises = _ratio(np.diff(self.rest), np.diff(self.q))

    def before(self, q: Floats) -> Counts:
        """The bin before each position, so that it and the next enclose the position."""
        return np.asarray(np.searchsorted(self.q, q).clip(1, len(self.q) - 1) - 1)


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
    variance = float(a.variance @ a.count + b.variance @ b.count) / float(a.count.sum() + b.count.sum())
    if len(a.q) < 2 or len(b.q) < 2:
        return variance
    width, smooth = np.gradient(b.q), b.smooth
    bend = _ratio(np.gradient(b.basis[:, 3]), width)
    harmonic = b.basis[:, 0] * smooth[1] - b.basis[:, 1] * smooth[0] + bend * smooth[3]
    first, second, along = a.rises[a.before(0.5 * (b.q[1:] + b.q[:-1]))], b.rises, 0.5 * (harmonic[1:] + harmonic[:-1])
    inner = np.diff(b.q) ** 2 * (along * (first + second) + first * second)
    spread = float(np.mean((harmonic * width) ** 2) + np.mean(inner)) / 12.0
    return max(variance - spread * (1.0 - 1.0 / float(b.count.mean()) ** 2), 0.0)
