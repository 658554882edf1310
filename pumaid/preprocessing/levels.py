"""What the currents of moving joints are like: how far they reach, and whether each sample is measured anew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]
Bools = NDArray[np.bool_]

#: Multiple of the spread of a window's currents by which all of them must be away from zero, where one of them is zero.
FAR_FROM_ZERO = 2.0
#: Samples of a window from which it can be flat.
FEWEST = 3
#: What simply adds up from log to log.
_SUMS = ("moving", "same", "flat", "dropped", "zeros")


@dataclass(eq=False, slots=True)
class Levels:
    """Sums over windows of samples, fed batch by batch; J joints.

    Attributes
    ----------
    lowest, highest
        (J,) A, over the samples in which each joint moves.
    moving
        (J,) samples in which each joint moves.
    top, top_count
        (J, 2, 2): the two largest currents while moving (A), of the positive and, without sign, of the negative ones,
        and how often they occur.
    frozen
        (J,) the most samples one after the other, while moving, in which the current stays the same to the digit.
    same
        (J, 2) pairs of neighbouring samples of one window, while moving, and those whose current is the same to the
        digit.
    flat
        (J, 2) windows in which each joint moves, and those in which all currents are the same.
    dropped
        (J,) samples, while moving, in which the current is exactly zero amid others that are all far from it.
    zeros
        (J,) samples, while moving, in which the current is exactly zero, in windows that have others, too.
    least, least_count
        (J,) the smallest current (A, without sign) that is not zero, and how often it occurs, in windows with zero.
    """

    n_joints: int
    lowest: Floats = field(init=False)
    highest: Floats = field(init=False)
    moving: Counts = field(init=False)
    top: Floats = field(init=False)
    top_count: Counts = field(init=False)
    frozen: Counts = field(init=False)
    same: Counts = field(init=False)
    flat: Counts = field(init=False)
    dropped: Counts = field(init=False)
    zeros: Counts = field(init=False)
    least: Floats = field(init=False)
    least_count: Counts = field(init=False)
    _still: Floats = field(init=False)

    def __post_init__(self) -> None:
        n = self.n_joints
        self.lowest, self.highest = np.full(n, np.inf), np.full(n, -np.inf)
        self.top, self.top_count = np.full((n, 2, 2), -1.0), np.zeros((n, 2, 2), dtype=np.int64)
        self.moving, self.frozen, self.dropped = (np.zeros(n, dtype=np.int64) for _ in range(3))
        self.zeros, self.least_count = (np.zeros(n, dtype=np.int64) for _ in range(2))
        self.least = np.full(n, np.inf)
        self.same, self.flat = np.zeros((n, 2), dtype=np.int64), np.zeros((n, 2), dtype=np.int64)
        self._still = np.full((n, 2), np.nan)

    def take(self, current: Floats, edges: Counts, *, usable: Bools, moves: Bools) -> None:
        """Add a batch; single samples are looked at where a window's are extreme.

        Parameters
        ----------
        current
            (N, J) A.
        edges
            (W + 1,) where windows begin, and N.
        usable
            (W,) windows that count, U of them.
        moves
            (U, J) whether each joint moves in them.
        """
        windows = np.flatnonzero(usable)
        for j in np.flatnonzero(moves.any(axis=0)).tolist():
            own, values = windows[moves[:, j]], current[:, j]
            if np.isnan(np.minimum.reduceat(values, edges[:-1])[own]).any():
                self._take_joint(j, *_known(values, edges, own))
            else:
                self._take_joint(j, values, edges, own)

    def _take_joint(self, j: int, values: Floats, edges: Counts, own: NDArray[np.intp]) -> None:
        """Add (N,) currents of one joint, numbers all in the windows `own` in which it moves; these may be none."""
        if not len(own):
            return
        counts = np.diff(edges)
        low = np.minimum.reduceat(values, edges[:-1])[own]
        high = np.maximum.reduceat(values, edges[:-1])[own]
        self.moving[j] += int(counts[own].sum())
        self.lowest[j] = min(self.lowest[j], low.min())
        self.highest[j] = max(self.highest[j], high.max())
        self._stand_still(j, low, high, counts=counts[own])
        self._repeat(j, values, edges, own)
        self.flat[j] += len(own), int(np.count_nonzero((low == high) & (counts[own] >= FEWEST)))
        for window in own[(low == 0.0) != (high == 0.0)].tolist():
            self.dropped[j] += _dropouts(values[edges[window] : edges[window + 1]])
        crossing = own[(low <= 0.0) & (high >= 0.0) & (low < high)].tolist()
        if crossing:
            self._near_zero(j, [values[edges[window] : edges[window + 1]] for window in crossing])
        for side, size in enumerate((high, -low)):
            second = size[size < size.max()].max(initial=-1.0)
            for window in own[size >= max(second, self.top[j, side, 1])].tolist():
                part = values[edges[window] : edges[window + 1]]
                self._tops(j, side, _two_largest(part if side == 0 else -part))

    def absorb(self, other: Levels) -> None:
        """Add what other logs of the same robot were like.

        Parameters
        ----------
        other
            Of samples that this has not seen; it must not be fed any more.
        """
        self.lowest, self.highest = np.fmin(self.lowest, other.lowest), np.fmax(self.highest, other.highest)
        self.frozen = np.maximum(self.frozen, other.frozen)
        for name in _SUMS:
            setattr(self, name, getattr(self, name) + getattr(other, name))
        for j in range(self.n_joints):
            self._least(j, float(other.least[j]), int(other.least_count[j]))
        for j, side in np.ndindex(self.n_joints, 2):
            found = zip(other.top[j, side].tolist(), other.top_count[j, side].tolist(), strict=True)
            self._tops(j, side, [(level, count) for level, count in found if count])

    def _stand_still(self, j: int, low: Floats, high: Floats, *, counts: Counts) -> None:
        """The longest stretch of one value, in samples of whole windows; the last one waits for the next batch."""
        level = np.where(low == high, low, np.nan)
        edges = np.concatenate([[0], np.flatnonzero(~(level[1:] == level[:-1])) + 1, [len(level)]])
        lengths = np.add.reduceat(counts, edges[:-1])
        value, count = self._still[j]
        if value == level[0]:
            lengths[0] += int(count)
        flat = ~np.isnan(level[edges[:-1]])
        self.frozen[j] = max(self.frozen[j], lengths[flat].max(initial=0))
        self._still[j] = level[-1], lengths[-1]

    def _repeat(self, j: int, values: Floats, edges: Counts, own: NDArray[np.intp]) -> None:
        """Neighbours that are the same; those of two windows are left out, wherever batches are cut."""
        same = np.append(values[1:] == values[:-1], False)
        same[edges[1:] - 1] = False
        pairs = int((np.diff(edges)[own] - 1).sum())
        self.same[j] += pairs, int(np.add.reduceat(same, edges[:-1], dtype=np.int64)[own].sum())

    def _near_zero(self, j: int, parts: Sequence[Floats]) -> None:
        size = np.abs(np.concatenate(parts))
        others = size[size > 0.0]
        self.zeros[j] += len(size) - len(others)
        if len(others):
            least = float(others.min())
            self._least(j, least, int(np.count_nonzero(others == least)))

    def _least(self, j: int, least: float, count: int) -> None:
        """Keep the smallest level, with how often it occurs."""
        if least < self.least[j]:
            self.least[j], self.least_count[j] = least, 0
        self.least_count[j] += count if least == self.least[j] else 0

    def _tops(self, j: int, side: int, found: Sequence[tuple[float, int]]) -> None:
        """Keep the two largest levels of one side."""
        levels: dict[float, int] = {}
        known = zip(self.top[j, side].tolist(), self.top_count[j, side].tolist(), strict=True)
        for level, count in [*known, *found]:
            levels[level] = levels.get(level, 0) + count
        best = [*sorted(levels.items(), reverse=True)[:2], (-1.0, 0)][:2]
        self.top[j, side], self.top_count[j, side] = [b[0] for b in best], [b[1] for b in best]


def _known(values: Floats, edges: Counts, own: NDArray[np.intp]) -> tuple[Floats, Counts, NDArray[np.intp]]:
    """Values without those that are no numbers, where the windows that still have some begin, and which are `own`."""
    is_known = np.isfinite(values[: edges[-1]])
    places = np.concatenate([[0], np.cumsum(is_known)])[edges]
    is_left = np.diff(places) > 0
    starts = np.append(places[:-1][is_left], places[-1])
    return values[: edges[-1]][is_known], starts, (np.cumsum(is_left) - 1)[own[is_left[own]]]


def _two_largest(size: Floats) -> list[tuple[float, int]]:
    """The two largest levels above zero among (N,) values, with their counts."""
    first = size.max()
    second = size[size < first].max(initial=-np.inf)
    found = [(float(level), int(np.count_nonzero(size == level))) for level in (first, second)]
    return [(level, count) for level, count in found if level > 0.0]


def _dropouts(values: Floats) -> int:
    """How many of some currents (N,), of which none is on the other side of zero, are zeros amid others far from it.

    Where the first or the last is zero it may be that of an arm at rest.
    """
    size = np.abs(values)
    others = size[size > 0.0]
    if not (size[0] and size[-1]):
        return 0
    return len(size) - len(others) if 0.0 < FAR_FROM_ZERO * float(np.ptp(others)) < others.min() else 0
