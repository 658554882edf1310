"""Things by what they are like."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.int64]


def grouped(count: int, alike: Callable[[int, Numbers], NDArray[np.bool_]]) -> list[list[int]]:
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
    >>> grouped(5, lambda first, others: np.abs(values[others] - values[first]) < 0.15)
    [[0, 2], [1, 3], [4]]
    """
    left, out = np.arange(count), []
    while len(left):
        own = alike(int(left[0]), left)
        own[0] = True
        out.append([int(number) for number in left[own]])
        left = left[~own]
    return out
