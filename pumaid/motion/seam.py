"""Where one file ends and the next begins: may a motion go on across, or is each looked at by itself?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.motion.options import SegmentOptions

Floats = NDArray[np.float64]

#: s between two samples from which no motion is followed across them.
FAR = 1.0
#: s of rest on either side in which nothing is lost if files are looked at one by one.
RESTFUL = 0.2


@dataclass(frozen=True, slots=True)
class Side:
    """One side of a seam: the time there (s), and whether the arm rests there for long enough."""

    time: float
    is_rest: bool


def first_side(time: Floats, position: Floats, options: SegmentOptions) -> Side:
    """The beginning of some samples.

    Parameters
    ----------
    time, position
        (N,) s and (N, J) rad or m; at least one, of `RESTFUL` seconds or more where there are so many.
    options
        What counts as rest.
    """
    stop = int(np.searchsorted(time, time[0] + RESTFUL, side="right"))
    return Side(
        float(time[0]), _rests(time[:stop], position[:stop], options, lasts=bool(time[-1] - time[0] >= RESTFUL))
    )


def last_side(time: Floats, position: Floats, options: SegmentOptions) -> Side:
    """The end of some samples; parameters as of `first_side`."""
    start = int(np.searchsorted(time, time[-1] - RESTFUL, side="left"))
    lasts = bool(time[-1] - time[0] >= RESTFUL)
    return Side(float(time[-1]), _rests(time[start:], position[start:], options, lasts=lasts))


def _rests(time: Floats, position: Floats, options: SegmentOptions, *, lasts: bool) -> bool:
    """Whether no joint goes farther than one that creeps at the speed of rest would."""
    if not lasts or len(time) < 2:
        return False
    way = np.ptp(position, axis=0)
    return bool(np.all(way <= options.rest_speed * RESTFUL))


def are_apart(before: Side, after: Side) -> bool:
    """Whether the two sides can be looked at one by one: far apart in time, or at rest."""
    return after.time - before.time > FAR or (before.is_rest and after.is_rest)
