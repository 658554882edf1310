"""What samples of one run share: a level a run on top of noise, estimated by restricted maximum likelihood."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.maths.least import least

Floats = NDArray[np.float64]

#: Fewest degrees of freedom from which two variances are estimated.
FEWEST_FREEDOMS = 4

#: Logarithms of how many times the variance of others loud runs may have, and to what it is found.
CALMEST, LOUDEST, LOUD_TO = -3.0, 14.0, 0.02


@dataclass(frozen=True, slots=True)
class Levels:
    """Variances of one joint's current: of a sample (low-frequency noise, A2) and of the level that a run shares (A2).

    `freedoms` are the degrees of freedom behind them; in loud runs a sample has `loud` times the variance.
    """

    sample: float
    level: float
    freedoms: int
    loud: float = 1.0

    def whitener(self, ones: Floats) -> tuple[Floats, Floats]:
        """Shares by which the part along each run's constant is shrunk, and 1/sigma.

        Parameters
        ----------
        ones
            (R, k) each run's constant regressor in the run's own rows.
        """
        length2 = np.einsum("rk,rk->r", ones, ones)
        ratio = self.level / self.sample
        shrink = np.where(length2 > 0, 1.0 - 1.0 / np.sqrt(1.0 + ratio * length2), 0.0)
        return shrink, np.full(len(ones), 1.0 / np.sqrt(self.sample))


def whiten(levels: Levels, ones: Floats, rows: Floats) -> Floats:
    """Rows (R, k, q) multiplied by the inverse root of each run's covariance sample I + level 1 1'."""
    shrink, weight = levels.whitener(ones)
    length2 = np.einsum("rk,rk->r", ones, ones)
    along = (
        np.einsum("rk,rkq->rq", ones, rows)
        * np.divide(shrink, length2, out=np.zeros_like(shrink), where=length2 > 0)[:, None]
    )
    return (rows - ones[:, :, None] * along[:, None, :]) * weight[:, None, None]


def estimate(
    ones: Floats,
    design: Floats,
    target: Floats,
    *,
    counts: NDArray[np.int64],
    is_loud: NDArray[np.bool_] | None = None,
) -> Levels | None:
    """Restricted maximum likelihood of the two variances, and of a third where some runs may be noisier than others.

    Parameters
    ----------
    ones
        (R, k) each run's constant in its own rows (padding rows are zero).
    design, target
        (R, k, q) and (R, k).
    counts
        (R,) true rows of each run, padding not counted.
    is_loud
        (R,) runs that may be noisier than the others, or calmer; without effect where they are all or none.

    Returns
    -------
    levels
        None when fewer than `FEWEST_FREEDOMS` degrees of freedom are left.

    Source
    ------
    D. A. Harville, J. Am. Stat. Assoc. 72 (1977) 320-338.
    """
    flat = design.reshape(-1, design.shape[2])
    size = np.linalg.norm(flat, axis=0)
    left, singular, _ = np.linalg.svd(flat / np.where(size > 0, size, 1.0), full_matrices=False)
    kept = singular > 1e-9 * max(float(singular[0]), 1e-300)
    basis = left[:, kept].reshape(*design.shape[:2], -1)
    freedoms = int(counts.sum()) - int(kept.sum())
    if freedoms < FEWEST_FREEDOMS:
        return None
    likelihood = _Likelihood.of(ones, np.concatenate([basis, target[:, :, None]], axis=2), freedoms)
    if is_loud is None or is_loud.all() or not is_loud.any():
        return likelihood.best()[1]
    loud, rows = is_loud.astype(bool), int(counts[is_loud].sum())

    def cost(log: float) -> float:
        return likelihood.quieted(loud, float(np.exp(log))).best()[0] + rows * log

    found, worth = least(cost, (CALMEST, LOUDEST), within=LOUD_TO)
    times = 1.0 if cost(0.0) <= worth + 1e-9 else float(np.exp(found))
    return replace(likelihood.quieted(loud, times).best()[1], loud=times)


@dataclass(frozen=True, eq=False, slots=True)
class _Likelihood:
    """Products, run by run: of basis and target (R, p + 1, p + 1), of these with the constant, of the constant."""

    grams: Floats
    along: Floats
    length2: Floats
    freedoms: int

    @classmethod
    def of(cls, ones: Floats, joined: Floats, freedoms: int) -> _Likelihood:
        grams = np.einsum("rkp,rkq->rpq", joined, joined)
        return cls(grams, np.einsum("rk,rkp->rp", ones, joined), np.einsum("rk,rk->r", ones, ones), freedoms)

    def quieted(self, loud: NDArray[np.bool_], times: float) -> _Likelihood:
        """The same with loud runs divided by how much louder they are."""
        share = np.where(loud, 1.0 / times, 1.0)
        return replace(
            self,
            grams=self.grams * share[:, None, None],
            along=self.along * share[:, None],
            length2=self.length2 * share,
        )

    def best(self) -> tuple[float, Levels]:
        """The least cost (minus twice the logarithm, but for constants), and the variances that have it."""
        length2, gram = self.length2, self.grams.sum(axis=0)

        def cost(log: float) -> float:
            return float(self._profile(np.exp([log]), gram)[0][0])

        centre = -np.log(np.median(length2[length2 > 0])) if (length2 > 0).any() else 0.0
        grid = centre + np.linspace(-10.0, 14.0, 25)
        best = int(np.argmin(self._profile(np.exp(grid), gram)[0]))
        low, high = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
        found, worth = least(cost, (float(low), float(high)))
        ratio = float(np.exp(found))
        if self._profile(np.zeros(1), gram)[0][0] <= worth + 1e-9:
            ratio = 0.0
        (worth,), (sample,) = self._profile(np.array([ratio]), gram)
        return float(worth), Levels(float(sample), ratio * float(sample), self.freedoms)

    def _profile(self, ratios: Floats, gram: Floats) -> tuple[Floats, Floats]:
        """(n,) cost, and variance (A2) of a sample, at each of (n,) ratios of level to sample; all runs' `gram`."""
        stretch = ratios[:, None] * self.length2
        pulled = (self.along * (ratios[:, None] / (1.0 + stretch))[:, :, None]).transpose(0, 2, 1)
        shrunk = gram - pulled @ self.along
        info, cross, square = shrunk[:, :-1, :-1], shrunk[:, :-1, -1], shrunk[:, -1, -1]
        told = np.sum(cross * np.linalg.solve(info, cross[:, :, None])[:, :, 0], axis=1)
        sample = np.maximum(square - told, 1e-30 * gram[-1, -1] + 1e-300) / self.freedoms
        cost = self.freedoms * np.log(sample) + np.sum(np.log1p(stretch), axis=1) + np.linalg.slogdet(info)[1]
        return cost, sample


def freedoms(levels: Levels, *, ones: Floats, jacobian: Floats, inverse: Floats) -> Floats:
    """Satterthwaite degrees of freedom of each parameter's variance when the working model of the noise gives it.

    Parameters
    ----------
    levels
        The variances in use.
    ones
        (R, k) each run's constant, not whitened.
    jacobian
        (R, k, p) whitened.
    inverse
        (p, p) inverse information of all rows.

    Source
    ------
    F. E. Satterthwaite, Biometrics 2 (1946) 110-114, on restricted likelihood as in A. H. M. A. Cornelius and R. Fai,
    J. Stat. Comput. Simul. 54 (1996) 363-378.
    """
    n_runs, k, p = jacobian.shape
    eye = np.broadcast_to(np.eye(k), (n_runs, k, k))
    root = whiten(levels, ones, eye)  # V^-1/2 of each run
    by_sample = root @ root
    along = np.einsum("rij,rj->ri", root, ones)
    by_level = along[:, :, None] * along[:, None, :]
    flat = jacobian.reshape(-1, p)
    size = np.linalg.norm(flat, axis=0)
    left, singular, _ = np.linalg.svd(flat / np.where(size > 0, size, 1.0), full_matrices=False)
    basis = left[:, singular > 1e-9 * max(float(singular[0]), 1e-300)].reshape(n_runs, k, -1)
    parts = [by_sample, by_level]
    info = np.zeros((2, 2))
    for a, first in enumerate(parts):
        for b, second in enumerate(parts):
            info[a, b] = 0.5 * _trace(first, second, basis)
    pulled = np.einsum("rkp,pq->rkq", jacobian, inverse)
    slopes = np.stack([np.einsum("rkq,rkl,rlq->q", pulled, part, pulled) for part in parts])
    if levels.level == 0.0:
        variance_of = slopes[0] ** 2 / info[0, 0]
    else:
        variance_of = np.einsum("aq,ab,bq->q", slopes, np.linalg.pinv(info), slopes)
    variance = slopes[0] * levels.sample + slopes[1] * levels.level
    return np.divide(2.0 * variance**2, variance_of, out=np.full(p, np.inf), where=variance_of > 0)


def _trace(first: Floats, second: Floats, basis: Floats) -> float:
    """trace(P A P B) with P = I - basis basis' and A, B block diagonal by run."""
    plain = float(np.einsum("rij,rji->", first, second))
    seen = float(np.einsum("rip,rij,rjk,rkp->", basis, first, second, basis))
    a = np.einsum("rip,rij,rjq->pq", basis, first, basis)
    b = np.einsum("rip,rij,rjq->pq", basis, second, basis)
    return plain - 2.0 * seen + float(np.sum(a * b.T))
