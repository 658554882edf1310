"""Where the arm rests near a seam of the logs, so that what lies before and behind can be looked at one by one."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pumaid.maths.short import lengths
from pumaid.preprocessing.options import SegmentOptions
from pumaid.preprocessing.speed import THIRD_DIFFERENCE, TICK

Floats = NDArray[np.float64]

#: s of rest on either side of an instant at which nothing is lost if the two sides are looked at one by one.
RESTFUL = 0.2
#: Where stretches begin, as a share of one: no sampling rate puts samples there, so rounding of times decides nothing.
_APART = 1.0 / math.pi
#: Standard deviations of noise between the largest and the smallest of some ten means, at most.
SPREAD = 5.0
#: Samples from which a noise is told.
FEWEST = 6
#: Samples looked at together; arms rest every few seconds.
_TOGETHER = 8192


class FirstRest:
    """Looks along a stream, batch by batch, for the first instant with rest on either side.

    Time is told in stretches of `RESTFUL` from the first sample on; the arm rests in one if no joint's mean over a
    tick goes farther than one that creeps at the speed of rest would, noise apart. The instant is where two such
    stretches meet.

    Parameters
    ----------
    options
        What counts as rest.

    Attributes
    ----------
    decided
        Samples that come before the instant in any case.
    """

    def __init__(self, options: SegmentOptions) -> None:
        self.decided = 0
        self._way = options.rest_speed * RESTFUL
        self._begin: float | None = None
        self._time: list[Floats] = []
        self._position: list[Floats] = []
        self._rested = -2  # the number of the last whole stretch if the arm rested in it

    def take(self, time: Floats, position: Floats) -> int | None:
        """Look at (N,) times (s) and (N, J) positions; how many samples of all lie before the instant, once found."""
        for low in range(0, len(time), _TOGETHER):
            some = slice(low, low + _TOGETHER)
            if (found := self._look(time[some], position[some])) is not None:
                return found
        return None

    def _look(self, time: Floats, position: Floats) -> int | None:
        self._begin = float(time[0]) if self._begin is None else self._begin
        self._time.append(time)
        self._position.append(position)
        time, position = np.concatenate(self._time), np.concatenate(self._position)
        number = np.floor((time - self._begin) / RESTFUL + _APART)
        edges = np.concatenate([[0], np.flatnonzero(np.diff(number)) + 1])
        # The last stretch may go on in the next batch.
        for start, stop in pairwise(edges.tolist()):
            rests = self._rests(time[start:stop] - self._begin, position[start:stop])
            if rests and self._rested == number[start] - 1:
                return self.decided + start
            self._rested = int(number[start]) if rests else -2
        last = int(edges[-1])
        self._time, self._position = [time[last:]], [position[last:]]
        self.decided += last
        return None

    def _rests(self, time: Floats, position: Floats) -> bool:
        ticks = np.flatnonzero(np.diff(np.floor(time / TICK + _APART), prepend=-np.inf))
        if len(ticks) < 2:
            return False
        counts = lengths(ticks, len(time))
        # Garbage may be no number, or too large for a difference; there it is no rest.
        with np.errstate(invalid="ignore", over="ignore"):
            way = np.ptp(np.add.reduceat(position - position[0], ticks, axis=0) / counts[:, None], axis=0)
            far = ~(way <= self._way)
            if not far.any():
                return True
            noise = _noise(position[:, far])
            return bool(np.all(way[far] <= self._way + SPREAD * noise / math.sqrt(counts.min())))


def _noise(position: Floats) -> Floats:
    """(J,) standard deviation of a sample's noise; 0 where too few samples tell none."""
    if len(position) < FEWEST:
        return np.zeros(position.shape[1])
    return np.asarray(np.median(np.abs(np.diff(position, 3, axis=0)), axis=0) / THIRD_DIFFERENCE)


def last_rest(time: Floats, position: Floats, options: SegmentOptions) -> int | None:
    """How many of some samples lie before the last instant with rest on either side; None without one.

    Parameters
    ----------
    time, position
        (N,) s and (N, J) rad or m.
    options
        What counts as rest.
    """
    search, stop = FirstRest(options), len(time)
    while stop:
        start = max(0, stop - _TOGETHER)
        found = search.take(-time[start:stop][::-1], position[start:stop][::-1])
        if found is not None:
            return len(time) - found
        stop = start
    return None
