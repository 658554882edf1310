"""Into which parts a sum can be split when some of its terms are known only together."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: Largest group that is looked for; what is left beyond is one group, which is what a user can still read.
LARGEST_GROUP = 3


def told_apart(gram: Floats, limit: float) -> list[tuple[int, ...]]:
    """The finest groups of terms whose sums are each known to `limit`.

    Terms that are known by themselves stand alone; then the smallest, best-known groups of the others are taken, and
    what cannot be grouped so is one group.

    Parameters
    ----------
    gram
        (k, k) mean products of what any two terms may be off by: the diagonal holds squares, and the sum over a
        group's rows and columns is the square of what the group's sum may be off by.
    limit
        What a sum may be off by and still count as known, in the root of the gram's unit.

    Returns
    -------
    groups
        Indices, each once; in order of their first member.

    Examples
    --------
    Two terms that may move against each other by 1, and one that is known:

    >>> told_apart(np.array([[1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, 0.0]]), 0.1)
    [(0, 1), (2,)]
    """
    left, groups = list(range(len(gram))), []
    for size in range(1, LARGEST_GROUP + 1):
        ranked = sorted((_off(gram, group), group) for group in combinations(left, size))
        for off, group in ranked:
            if off <= limit and set(group) <= set(left):
                groups.append(group)
                left = [term for term in left if term not in group]
    if left:
        groups.append(tuple(left))
    return sorted(groups)


def _off(gram: Floats, group: Sequence[int]) -> float:
    """What the sum of a group may be off by."""
    return float(np.sqrt(max(gram[np.ix_(group, group)].sum(), 0.0)))
