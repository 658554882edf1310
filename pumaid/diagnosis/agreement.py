"""What repeats between runs that repeat one another: the judge that needs no name."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.diagnosis.field import Field

Floats = NDArray[np.float64]

#: Sign flips of pairs.
FLIPS = 4999
SEED = 11
#: Pairs below which nothing can be said.
FEWEST = 4


@dataclass(frozen=True, slots=True)
class Agreement:
    """What pairs of repeated runs share.

    Attributes
    ----------
    share
        Of the misfit's mean square, that repeats.
    p_value
        Chance of that much or more where nothing repeats.
    floor
        RMS (A) of cells that no model of position, posture, speed and direction removes: half the mean squared
        difference.
    """

    share: float
    p_value: float
    floor: float


def agreement(field: Field, misfit: Floats) -> Agreement | None:
    """How much of the misfit (N,) A repeats; None with fewer than `FEWEST` pairs.

    Source
    ------
    The lack-of-fit test of G. E. P. Box, W. G. Hunter and J. S. Hunter, Statistics for Experimenters, ch. 10, by signs
    of whole pairs, since samples of one run are not independent.
    """
    pairs = field.pairs
    if len(pairs) < FEWEST:
        return None
    products, squares, gaps, counts = np.zeros((4, len(pairs)))
    for number, pair in enumerate(pairs):
        a, b = field.side_by_side(misfit, pair)
        products[number], squares[number] = float(a @ b), 0.5 * float(a @ a + b @ b)
        gaps[number], counts[number] = 0.5 * float(np.sum((a - b) ** 2)), len(a)
    rng = np.random.default_rng(SEED)
    signs = rng.choice([-1.0, 1.0], size=(FLIPS, len(pairs)))
    chance = float(1 + np.count_nonzero(signs @ products >= products.sum())) / (1 + FLIPS)
    share = float(products.sum() / squares.sum()) if squares.sum() > 0 else 0.0
    return Agreement(share, chance, float(np.sqrt(gaps.sum() / counts.sum())))
