"""Things by what they are like."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from pumaid.kinematics import apart

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]


def grouped(count: int, alike: Callable[[int, Numbers], NDArray[np.bool_]]) -> Iterator[list[int]]:
    """Groups of numbers 0..count-1, each of a first one and those after it that are like it and like no earlier first.

    Parameters
    ----------
    count
        How many there are.
    alike
        Of a number and (n,) numbers, whether each of these is like it.

    Examples
    --------
    >>> values = np.array([1.0, 5.0, 1.1, 5.1, 1.2])
    >>> list(grouped(5, lambda first, others: np.abs(values[others] - values[first]) < 0.15))
    [[0, 2], [1, 3], [4]]
    """
    left = np.arange(count, dtype=np.int64)
    while len(left):
        own = alike(int(left[0]), left)
        own[0] = True
        yield left[own].tolist()
        left = left[~own]


def near(postures: Floats, first: int, others: Numbers, *, within: float) -> Numbers:
    """Those of some postures that are one's neighbours, whole turns taken out.

    Parameters
    ----------
    postures
        (N, J) rad or m; where one is NaN it is near any.
    first, others
        The one's number, and (n,) numbers.
    within
        How far apart (rad or m) they may be at each joint.
    """
    # Joint after joint: of thousands of postures few are left for the second.
    for column in postures.T:
        if not len(others):
            break
        others = others[~(apart(column[first], column[others]) > within)]
    return others


def marked(others: Numbers, chosen: Numbers) -> NDArray[np.bool_]:
    """(n,) which of some rising numbers are chosen."""
    out = np.zeros(len(others), dtype=np.bool_)
    out[np.searchsorted(others, chosen)] = True
    return out
