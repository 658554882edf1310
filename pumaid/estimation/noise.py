"""The noise of one joint's bins: correlated within a run, with a level that each run shares; the only noise model."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pumaid.joint_bins import JointBins

Floats = NDArray[np.float64]

#: Fewest pairs of repeated runs from which noise is taken; with fewer it comes from the residuals.
FEWEST_PAIRS = 6
#: Runs whose bins last equally long within this factor share correlation and spread.
ALIKE = 1.2
#: Bins below which a group of runs takes the whole joint's correlation and spread.
FEWEST_BINS = 60
#: Correlation beyond which a residual is a trend.
MOST_CORRELATED = 0.98
#: Share of the variance that a run's own mean may have taken away; more is known of hardly correlated bins only.
MOST_LOST = 0.8
#: Noise below this share of the RMS current is rounding: data without noise, whose weights would be infinite. Large
#: enough that rounding, thus weighted, says nothing about a parameter's plausible size.
EXACT = 1e-10
#: Fewest degrees of freedom from which two variances are estimated.
FEWEST_FREEDOMS = 4
#: Logarithms of how many times the variance of others loud runs may have, and to what it is found.
CALMEST, LOUDEST, LOUD_TO = -3.0, 14.0, 0.02


@dataclass(frozen=True, eq=False, slots=True)
class NoiseModel:
    """Noise of one joint.

    Attributes
    ----------
    correlation, spread
        (R,) of neighbouring bins, and standard deviation of a bin (A), of each run.
    level
        (R,) standard deviation (A) of the level that each run shares.
    from_replicates
        Whether it comes from differences of repeated runs; else from residuals, which hold missing physics too.
    """

    correlation: Floats
    spread: Floats
    level: Floats
    from_replicates: bool = False

    def whiten(self, bins: JointBins, values: Floats) -> Floats:
        """(N, ...) values times the inverse root of the noise's covariance, run by run."""
        out = self.decorrelated(bins, values)
        if not self.level.any():
            return out
        ones, shrunk = _levelled(self, bins)
        wide = (slice(None),) + (None,) * (values.ndim - 1)
        shared = bins.sums(out * ones[wide])[bins.run]
        shared *= shrunk[wide]
        out -= shared
        return out

    def unwhiten(self, bins: JointBins, white: Floats) -> Floats:
        """(N,) the transpose of `whiten` on whitened values: with it a column's score is its plain product."""
        run = bins.run
        values = white
        if self.level.any():
            ones, shrunk = _levelled(self, bins)
            values = white - shrunk * bins.sums(white * ones)[run]
        scaled = values / (self.spread * np.sqrt(1.0 - self.correlation**2))[run]
        rho = self.correlation[run]
        out = scaled.copy()
        out[bins.first] *= np.sqrt(1.0 - self.correlation**2)
        later = np.ones(len(bins), dtype=bool)
        later[bins.first] = False
        out[:-1] -= np.where(later[1:], rho[1:] * scaled[1:], 0.0)
        return np.asarray(out)

    def at(self, bins: JointBins, speeds: Floats, steps: Floats) -> NoiseModel:
        """Of other runs of the joint of `bins`: correlation decays with time, slow noise keeps its density.

        Parameters
        ----------
        bins
            That this noise is of.
        speeds, steps
            (R,) of the other runs, rad/s or m/s, and s that their bins last.
        """
        measured = np.array([abs(run.speed) for run in bins.runs])
        near = np.argmin(np.abs(np.log(measured[None, :] / speeds[:, None])), axis=1)
        rho, spread = self.correlation[near], self.spread[near]
        ratio = steps / np.maximum(bins.step[near], 1e-12)
        fresh = np.where(rho > 0.0, rho, 0.0) ** ratio
        density = spread**2 * (1.0 + rho) / (1.0 - rho) / ratio
        return NoiseModel(
            fresh, np.sqrt(density * (1.0 - fresh) / (1.0 + fresh)), self.level[near], self.from_replicates
        )

    def decorrelated(self, bins: JointBins, values: Floats) -> Floats:
        """(N, ...) values times the inverse root of the covariance without the level that a run shares."""
        run = bins.run
        wide = (slice(None),) + (None,) * (values.ndim - 1)
        rho = self.correlation[run][wide]
        out = np.empty_like(values)
        np.multiply(rho[1:], values[:-1], out=out[1:])
        np.subtract(values[1:], out[1:], out=out[1:])
        fresh = np.sqrt(1.0 - self.correlation**2)
        out[bins.first] = fresh[wide] * values[bins.first]
        out /= (self.spread * fresh)[run][wide]
        return out

    def plain(self, bins: JointBins) -> tuple[NoiseModel, float]:
        """White noise of a sample alike in all runs of a joint, and how many times its density slow noise has.

        To estimate parameters nothing is whitened within runs: that would lift the band in which what a model lacks,
        and the noise of smoothed accelerations, live.
        """
        count = bins.sums(bins.count) / bins.lengths
        sample = float(np.average(self.spread**2 * count, weights=bins.lengths))
        slow = self.spread**2 * count * (1.0 + self.correlation) / (1.0 - self.correlation)
        white = NoiseModel(np.zeros(len(count)), np.sqrt(sample / count), np.zeros(len(count)))
        return white, float(np.average(slow / sample, weights=bins.lengths))

    def scaled(self, levels: Levels, is_stroke: NDArray[np.bool_]) -> NoiseModel:
        """The same as the variances say that a whole fit leaves of runs that were whitened by it."""
        loud = np.where(is_stroke, levels.loud, 1.0)
        return replace(self, spread=self.spread * np.sqrt(levels.sample * loud), level=np.sqrt(levels.level * loud))


@lru_cache(maxsize=16)  # the same for all columns that are tried
def _levelled(noise: NoiseModel, bins: JointBins) -> tuple[Floats, Floats]:
    """(N,) a level that a run shares, with the noise of its bins taken out, and what of it whitening takes away."""
    ones = noise.decorrelated(bins, np.ones(len(bins)))
    length2 = bins.sums(ones * ones)
    shrink = (1.0 - 1.0 / np.sqrt(1.0 + noise.level**2 * length2)) / length2
    return ones, ones * shrink[bins.run]


def inside_runs(bins: JointBins, residual: Floats, *, lost: Floats, enough: NDArray[np.bool_]) -> NoiseModel:
    """Correlation and spread of bins from (N,) what each run leaves beside a fit of its own; no level.

    Parameters
    ----------
    bins
        R runs, N bins.
    residual
        (N,) A.
    lost
        (R,) parameters of each run's own fit.
    enough
        (R,) runs that are long enough to tell; where none is, the scatter inside bins does, as white noise.
    """
    pieces = np.split(residual, bins.first[1:])
    floor = max(EXACT * float(np.sqrt(bins.mean_square)), 1e-70)
    within = float(np.sqrt(bins.count @ (bins.inside / bins.count) / bins.count.sum()))
    correlation, spread = np.zeros(len(pieces)), np.full(len(pieces), within)
    for is_stroke in (False, True):
        members = np.flatnonzero(bins.is_stroke == is_stroke)
        long_enough = members[enough[members]]
        if len(long_enough):
            correlation[members], spread[members] = _moments([pieces[k] for k in long_enough], lost[long_enough])
        for group in _alike(bins.step[members]):
            alike = members[group]
            long_enough = alike[enough[alike]]
            if sum(len(pieces[k]) for k in long_enough) >= FEWEST_BINS:
                correlation[alike], spread[alike] = _moments([pieces[k] for k in long_enough], lost[long_enough])
    return NoiseModel(correlation, np.maximum(spread, floor), np.zeros(len(pieces)))


def noise_of(bins: JointBins, residual: Floats) -> NoiseModel:
    """Estimate the noise from differences of repeated runs, else from the residual (N,) of a fit itself.

    Differences are taken at the nearest bins, so that interpolation does not smooth the noise.

    Source
    ------
    Yule-Walker for the correlation, with the first-order correction of its bias (M. G. Kendall, Biometrika 41, 1954).
    """
    pairs = bins.pairs
    paired = len(pairs) >= FEWEST_PAIRS
    pieces = [_difference(bins, residual, pair) for pair in pairs] if paired else np.split(residual, bins.first[1:])
    owners = [a for a, _ in pairs] if paired else list(range(len(bins.runs)))
    floor = 10.0 * EXACT * float(np.sqrt(np.mean(bins.current**2)) + 1e-12)
    whole = _moments(pieces, np.ones(len(pieces)))
    correlation, spread = np.full(len(bins.runs), whole[0]), np.full(len(bins.runs), whole[1])
    for group in _alike(bins.step):
        chosen = [pieces[k] for k, owner in enumerate(owners) if owner in group]
        if sum(len(piece) for piece in chosen) >= FEWEST_BINS:
            correlation[group], spread[group] = _moments(chosen, np.ones(len(chosen)))
    means = np.array([piece.mean() for piece in pieces])
    lengths = np.array([len(piece) for piece in pieces], dtype=float)
    rho, sd = correlation[owners], spread[owners]
    by_bins = sd**2 * _shared(rho, lengths)
    level = float(np.sqrt(max(float(np.mean(means**2 - by_bins)), 0.0)))
    return NoiseModel(correlation, np.maximum(spread, floor), np.full(len(bins.runs), level), paired)


def _difference(bins: JointBins, residual: Floats, pair: tuple[int, int]) -> Floats:
    """Half the root-two difference of two runs."""
    a, b = bins.side_by_side(residual, pair)
    return np.asarray((a - b) / np.sqrt(2.0))


def _moments(pieces: list[Floats], lost: Floats) -> tuple[float, float]:
    """Correlation of neighbours and standard deviation of bins beside fits of (n,) `lost` parameters, bias taken out.

    A piece's mean, which is one of them, is taken out here.
    """
    n = np.array([len(piece) for piece in pieces], dtype=float)
    centred = [piece - piece.mean() for piece in pieces]
    square = sum(float(c @ c) for c in centred)
    if square <= 0.0 or n.sum() <= lost.sum():
        return 0.0, float(np.sqrt(square / max(n.sum(), 1.0)))
    lagged = sum(float(c[1:] @ c[:-1]) for c in centred)
    rho = lagged / square
    mean_n, k = float(n.mean()), float(lost.mean())
    rho = float(np.clip(rho + (k * (1.0 + rho) + 3.0 * rho) / mean_n, 0.0, MOST_CORRELATED))
    gone = np.minimum(lost * _shared(rho, n), MOST_LOST)  # the share that each run's own fit took away
    return rho, float(np.sqrt(square / np.sum(n * (1.0 - gone))))


def _shared(rho: Floats | float, n: Floats) -> Floats:
    """Variance of the mean of n bins of correlation rho, over that of a bin."""
    return np.asarray(((1.0 + rho) / (1.0 - rho) - 2.0 * rho * (1.0 - rho**n) / (n * (1.0 - rho) ** 2)) / n)


def _alike(step: Floats) -> list[list[int]]:
    """Runs by the duration of their bins."""
    order = np.argsort(step, kind="stable")
    groups: list[list[int]] = []
    for number in order:
        if groups and step[number] <= ALIKE * step[groups[-1][0]]:
            groups[-1].append(int(number))
        else:
            groups.append([int(number)])
    return groups


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
    vectors, singular, _ = np.linalg.svd(flat / np.where(size > 0, size, 1.0), full_matrices=False)
    is_spanned = singular > 1e-9 * max(float(singular[0]), 1e-300)
    basis = vectors[:, is_spanned].reshape(*design.shape[:2], -1)
    freedoms = int(counts.sum()) - int(is_spanned.sum())
    if freedoms < FEWEST_FREEDOMS:
        return None
    likelihood = _Likelihood.of(ones, np.concatenate([basis, target[:, :, None]], axis=2), freedoms)
    if is_loud is None or is_loud.all() or not is_loud.any():
        return likelihood.best()[1]
    loud, rows = is_loud.astype(bool), int(counts[is_loud].sum())

    def cost(log: float) -> float:
        return likelihood.quieted(loud, float(np.exp(log))).best()[0] + rows * log

    log_times, worth = least(cost, (CALMEST, LOUDEST), within=LOUD_TO)
    times = 1.0 if cost(0.0) <= worth + 1e-9 else float(np.exp(log_times))
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
        log_ratio, worth = least(cost, (float(low), float(high)))
        ratio = float(np.exp(log_ratio))
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
        explained = np.sum(cross * np.linalg.solve(info, cross[:, :, None])[:, :, 0], axis=1)
        sample = np.maximum(square - explained, 1e-30 * gram[-1, -1] + 1e-300) / self.freedoms
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
    vectors, singular, _ = np.linalg.svd(flat / np.where(size > 0, size, 1.0), full_matrices=False)
    basis = vectors[:, singular > 1e-9 * max(float(singular[0]), 1e-300)].reshape(n_runs, k, -1)
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
    crossed = float(np.einsum("rip,rij,rjk,rkp->", basis, first, second, basis))
    a = np.einsum("rip,rij,rjq->pq", basis, first, basis)
    b = np.einsum("rip,rij,rjq->pq", basis, second, basis)
    return plain - 2.0 * crossed + float(np.sum(a * b.T))


#: Share of an interval at which a golden section stands.
_GOLDEN = 0.5 * (3.0 - math.sqrt(5.0))
#: Relative distance below which two numbers cost the same to rounding.
_ROUNDING = math.sqrt(2.2e-16)
_MOST_TRIES = 500


def least(cost: Callable[[float], float], bounds: tuple[float, float], *, within: float = 1e-5) -> tuple[float, float]:
    """Where a function with one minimum is least, and its value there.

    Golden sections, and parabolas through the three best points where these lead inwards: as scipy's bounded scalar
    minimisation, whose steps it takes, without what else scipy's optimisers load (longer than an identification takes).

    Parameters
    ----------
    cost
        The function; it is looked at inside the bounds only.
    bounds
        Lowest and highest value.
    within
        How near (beside rounding) the result must come.

    Source
    ------
    R. P. Brent, Algorithms for Minimization without Derivatives (1973), ch. 5; G. E. Forsythe, M. A. Malcolm and
    C. B. Moler, Computer Methods for Mathematical Computations (1977), FMIN.
    """
    low, high = bounds
    best = low + _GOLDEN * (high - low)
    points = [(best, float(cost(best)))] * 3  # best, second, third
    step = before = 0.0
    for _ in range(_MOST_TRIES - 1):
        best, middle = points[0][0], 0.5 * (low + high)
        near = _ROUNDING * abs(best) + within / 3.0
        if abs(best - middle) <= 2.0 * near - 0.5 * (high - low):
            break
        parabolic = _parabola(points, (low, high), before=before) if abs(before) > near else None
        if parabolic is None:
            before = (low if best >= middle else high) - best
            step = _GOLDEN * before
        else:
            before, step = step, parabolic
            if best + step - low < 2.0 * near or high - (best + step) < 2.0 * near:
                step = math.copysign(near, middle - best)
        tried = best + math.copysign(max(abs(step), near), step)
        low, high = _absorb(points, (tried, float(cost(tried))), (low, high))
    return points[0]


def _parabola(points: list[tuple[float, float]], bounds: tuple[float, float], *, before: float) -> float | None:
    """Step to the lowest point of the parabola, if that is inside and the step less than half the last but one."""
    (best, f_best), (second, f_second), (third, f_third) = points
    r, q = (best - second) * (f_best - f_third), (best - third) * (f_best - f_second)
    p, q = (best - third) * q - (best - second) * r, 2.0 * (q - r)
    p, q = (-p if q > 0.0 else p), abs(q)
    inside = q * (bounds[0] - best) < p < q * (bounds[1] - best)
    return p / q if inside and abs(p) < abs(0.5 * q * before) else None


def _absorb(
    points: list[tuple[float, float]], found: tuple[float, float], bounds: tuple[float, float]
) -> tuple[float, float]:
    """Rank a point among the three best, and draw the bounds in behind the worse of it and the best."""
    (low, high), (best, second, third) = bounds, points
    if found[1] <= best[1]:
        points[:] = [found, best, second]
        return (best[0], high) if found[0] >= best[0] else (low, best[0])
    if found[1] <= second[1] or second[0] == best[0]:
        points[:] = [best, found, second]
    elif found[1] <= third[1] or third[0] in (best[0], second[0]):
        points[:] = [best, second, found]
    return (found[0], high) if found[0] < best[0] else (low, found[0])
