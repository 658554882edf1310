"""Is a projection of the residual more than noise would give? Signs of whole runs are flipped to find out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

Floats = NDArray[np.float64]
Labels = NDArray[np.int64]

#: Directions of which less than this share is left after what was fitted are not looked at.
LEAST_LEFT = 1e-3
#: A direction that one run fills to this share says nothing of other runs.
ALONE = 0.9
#: Most of a run's own noise that a fit may have taken away before the correction for it stops growing.
MOST_LEVERAGE = 0.8


@dataclass(frozen=True, eq=False, slots=True)
class Basis:
    """Orthonormal directions, k of them, in the space of a design's columns.

    Attributes
    ----------
    mixing
        (P, k) combinations of the design's columns.
    own
        (R, k) share of each direction that each run fills; adds up to 1 over runs.
    lost
        (R, k) share of a run's noise along each direction that the fit took away.
    """

    mixing: Floats
    own: Floats
    lost: Floats

    def scores(self, by_run: Floats) -> Floats:
        """(R, k) each run's part of the projection, what the fit took of its noise given back.

        `by_run` (R, P) are the design's own scores.
        """
        return np.asarray(by_run @ self.mixing / np.sqrt(1.0 - self.lost))

    def noise(self, rest: Floats) -> float:
        """Square that noise brings into the projection; `rest` (R, P) are scores of what is left after it."""
        left = np.maximum(1.0 - self.lost - self.own, 1.0 - MOST_LEVERAGE)
        return float(np.sum((rest @ self.mixing) ** 2 / left))


@dataclass(frozen=True, eq=False, slots=True)
class Design:
    """Weighted columns of a joint's bins: (N, P) `columns`, (N,) `weight`, first bin of each run, products by run."""

    columns: Floats
    weight: Floats
    first: Labels
    products: Floats

    @classmethod
    def of(cls, columns: Floats, weight: Floats, first: Labels) -> Design:
        """Products (R, P, P) once."""
        root = columns * np.sqrt(weight)[:, None]
        pieces = np.split(root, first[1:])
        return cls(columns, weight, first, np.array([piece.T @ piece for piece in pieces]))

    def scores(self, residual: Floats) -> Floats:
        """(R, P) of a residual (N,)."""
        return np.asarray(np.add.reduceat(self.columns * (self.weight * residual)[:, None], self.first, axis=0))

    def basis(self, chosen: Labels, taken: Labels) -> Basis | None:
        """Orthonormal directions of the columns `chosen`, free of the columns `taken`; None where nothing is left."""
        total = self.products.sum(axis=0)
        whole = np.diag(total)[chosen]
        shares = np.diagonal(self.products, axis1=1, axis2=2)[:, chosen].max(axis=0)
        chosen = chosen[(whole > 0) & (shares <= ALONE * whole)]
        if not len(chosen):
            return None
        inverse = _inverse(total[np.ix_(taken, taken)])
        back = inverse @ total[np.ix_(taken, chosen)]
        root = np.sqrt(np.diag(total)[chosen])
        left = (total[np.ix_(chosen, chosen)] - total[np.ix_(chosen, taken)] @ back) / np.outer(root, root)
        values, vectors = np.linalg.eigh(0.5 * (left + left.T))
        keep = values > LEAST_LEFT
        if not keep.any():
            return None
        turned = vectors[:, keep] / np.sqrt(values[keep]) / root[:, None]
        mixing = np.zeros((len(total), turned.shape[1]))
        mixing[chosen], mixing[taken] = turned, -back @ turned
        moved = self.products @ mixing
        own = np.einsum("pk,rpk->rk", mixing, moved)
        crossed = moved[:, taken]
        lost = np.einsum("rak,ab,rbk->rk", crossed, inverse, crossed)
        lost = np.divide(lost, own, out=np.zeros_like(own), where=own > 1e-12)
        return Basis(mixing, own, np.clip(lost, 0.0, MOST_LEVERAGE))


def _inverse(gram: Floats) -> Floats:
    """Pseudo-inverse of a Gram matrix, scaled first."""
    if not len(gram):
        return gram
    root = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    return np.asarray(np.linalg.pinv(gram / np.outer(root, root), rcond=1e-9, hermitian=True) / np.outer(root, root))


def flipped(signs: Floats, scores: Floats) -> Floats:
    """(B,) squares of the projection with the runs' signs flipped: (B, R) signs of (R, k) scores."""
    return np.asarray(np.sum((signs @ scores) ** 2, axis=1))


def chances(observed: float, drawn: Floats) -> tuple[float, Floats]:
    """How rare the observed statistic and each drawn one (B,) are, by the gamma law of the drawn ones' two moments.

    It only makes unlike statistics comparable; what is right on the whole is the smallest of them over all statistics,
    compared with the smallest of each draw.
    """
    mean, variance = float(drawn.mean()), float(drawn.var())
    if variance <= 1e-24 * mean**2 or mean <= 0.0:
        return 1.0, np.ones(len(drawn))
    shape, scale = mean**2 / variance, variance / mean
    return float(special.gammaincc(shape, max(observed, 0.0) / scale)), np.asarray(
        special.gammaincc(shape, np.maximum(drawn, 0.0) / scale)
    )
