"""What repeats between runs that repeat one another: the judge that needs no name."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.joint_bins import JointBins

Floats = NDArray[np.float64]

#: Sign flips of pairs.
FLIPS = 4999
SEED = 11
#: Pairs below which nothing can be said.
FEWEST = 4
#: Bins of the stretches over which repeated runs are compared.
LENGTHS = (1, 2, 4, 8, 16)


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
        RMS (A) of bins that no model of position, posture, speed and direction removes: half the mean squared
        difference.
    """

    share: float
    p_value: float
    floor: float


def agreement(field: JointBins, misfit: Floats, white: Floats) -> Agreement | None:
    """How much of the misfit repeats; None with fewer than `FEWEST` pairs.

    Whitened, so that slow noise does not hide what is fast; over stretches of several lengths, so that fast noise does
    not hide what is slow; the most surprising length against the same of each flip.

    Parameters
    ----------
    field
        N bins.
    misfit, white
        (N,) A, and whitened.

    Source
    ------
    The lack-of-fit test of G. E. P. Box, W. G. Hunter and J. S. Hunter, Statistics for Experimenters, ch. 10, by signs
    of whole pairs, since samples of one run are not independent.
    """
    pairs = field.pairs
    if len(pairs) < FEWEST:
        return None
    shared, squares, gaps, counts = np.zeros((4, len(pairs)))
    products = np.zeros((len(LENGTHS), len(pairs)))
    for number, pair in enumerate(pairs):
        a, b = field.side_by_side(misfit, pair)
        shared[number], squares[number] = float(a @ b), 0.5 * float(a @ a + b @ b)
        gaps[number], counts[number] = 0.5 * float(np.sum((a - b) ** 2)), len(a)
        a, b = field.side_by_side(white, pair)
        for row, length in enumerate(LENGTHS):
            starts = np.arange(0, len(a), length)
            products[row, number] = float(np.add.reduceat(a, starts) @ np.add.reduceat(b, starts))
    rng = np.random.default_rng(SEED)
    signs = rng.choice([-1.0, 1.0], size=(FLIPS, len(pairs)))
    spread = np.sqrt(np.sum(products**2, axis=1)) + np.finfo(float).tiny
    flipped = (signs @ products.T / spread).max(axis=1)
    seen = float((products.sum(axis=1) / spread).max())
    chance = float(1 + np.count_nonzero(flipped >= seen * (1.0 - 1e-12))) / (1 + FLIPS)
    share = float(shared.sum() / squares.sum()) if squares.sum() > 0 else 0.0
    return Agreement(share, chance, float(np.sqrt(gaps.sum() / counts.sum())))
