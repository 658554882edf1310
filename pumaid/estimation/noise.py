"""The noise of one joint's bins: correlated within a run, with a level that each run shares; the only noise model."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pumaid.joint_bins import JointBins
from pumaid.maths import FLAT, Counts, Flags, Floats

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
#: Runs that are reduced at once.
AT_ONCE = 500
#: Bins of a run, beside twice the parameters of its own fit, from which correlation is read.
FEWEST_OF_RUN = 12
#: Fewest degrees of freedom from which two variances are estimated.
FEWEST_FREEDOMS = 4
#: Logarithms between which the ratio of level to sample, times a run's weight, is looked for: on grids of so many
#: points, in so many rounds, each about the best of the last.
LOWEST, HIGHEST, POINTS, ROUNDS = -10.0, 14.0, 17, 6
#: Most times that a run's variance is taken to be that of others, and what is one of these (its logarithm).
MOST_EXCESS, SAME_EXCESS = 1e6, 0.01
#: Costs that differ by less are one; singular values below this share of the largest are rounding.
SAME_COST, RANK = 1e-6, 1e-9


@dataclass(frozen=True, eq=False, slots=True)
class NoiseModel:
    """Noise of one joint: of each run (R,) the correlation of neighbouring bins, and the standard deviations (A) of a
    bin (`spread`) and of the level that the run shares; `from_replicates`, else from residuals, which hold missing
    physics too. `sample` is the variance over that of the noise by which rows were reduced, `freedoms` are behind both.
    """

    correlation: Floats
    spread: Floats
    level: Floats
    from_replicates: bool = False
    sample: float = 1.0
    freedoms: int = 0

    def whiten(self, bins: JointBins, values: Floats) -> Floats:
        """(N, ...) values times the inverse root of the noise's covariance, run by run."""
        out = self.decorrelated(bins, values)
        if self.level.any():
            ones, shrunk = _levelled(self, bins)
            for column in np.atleast_2d(out.T):
                column -= shrunk * np.repeat(bins.sums(column * ones), bins.lengths)
        return out

    def unwhiten(self, bins: JointBins, white: Floats) -> Floats:
        """(N,) the transpose of `whiten` on whitened values: with it a column's score is its plain product."""
        if self.level.any():
            ones, shrunk = _levelled(self, bins)
            white = white - shrunk * bins.sums(white * ones)[bins.run]
        fresh = np.sqrt(1.0 - self.correlation**2)
        out = white / (self.spread * fresh)[bins.run]
        lagged = self.correlation[bins.run] * out
        lagged[bins.first] = 0.0
        out[bins.first] *= fresh
        out[:-1] -= lagged[1:]
        return np.asarray(out)

    def decorrelated(self, bins: JointBins, values: Floats) -> Floats:
        """(N, ...) values times the inverse root of the covariance without the level that a run shares."""
        (lead, back), columns = _filter(self, bins), np.ascontiguousarray(values.T)
        out = columns * lead
        for new, old in zip(np.atleast_2d(out), np.atleast_2d(columns), strict=True):  # else large arrays in between
            new[1:] -= old[:-1] * back[1:]
        return np.asarray(out.T)

    def at(self, bins: JointBins, others: JointBins) -> "NoiseModel":
        """Of other runs of the joint than those in `bins`, by the nearest in speed: slow noise keeps its density."""
        measured, speeds = (np.array([abs(run.speed) for run in part.runs]) for part in (bins, others))
        near = np.argmin(np.abs(np.log(measured[None, :] / speeds[:, None])), axis=1)
        rho, ratio = self.correlation[near], others.step / np.maximum(bins.step[near], 1e-12)
        fresh = np.maximum(rho, 0.0) ** ratio
        density = self.spread[near] ** 2 * (1.0 + rho) / (1.0 - rho) / ratio
        spread = np.sqrt(density * (1.0 - fresh) / (1.0 + fresh))
        return NoiseModel(fresh, spread, self.level[near], self.from_replicates)

    def whiten_reduced(self, ones: Floats, rows: Floats) -> Floats:
        """Reduced rows (R, k, q) times the inverse root of each run's covariance sample I + level^2 1 1'.

        (R, k) `ones` is each run's constant in its own rows.
        """
        length2 = np.sum(ones * ones, axis=1)
        safe = np.where(length2 > 0.0, length2, 1.0)
        shrink = (1.0 - 1.0 / np.sqrt(1.0 + self.level**2 / self.sample * length2)) / safe
        along = (shrink[:, None, None] * ones[:, None, :]) @ rows
        return np.asarray((rows - ones[:, :, None] * along) / np.sqrt(self.sample))


@lru_cache(maxsize=16)  # the same for all columns that are tried
def _filter(noise: NoiseModel, bins: JointBins) -> tuple[Floats, Floats]:
    """(N,) factors of each value, and of the one before it, in the difference of neighbours that is white."""
    lead = (1.0 / (noise.spread * np.sqrt(1.0 - noise.correlation**2)))[bins.run]
    back = noise.correlation[bins.run] * lead
    lead[bins.first], back[bins.first] = 1.0 / noise.spread, 0.0
    return lead, back


@lru_cache(maxsize=16)
def _levelled(noise: NoiseModel, bins: JointBins) -> tuple[Floats, Floats]:
    """(N,) a level that a run shares, with the noise of its bins taken out, and what of it whitening takes away."""
    ones = noise.decorrelated(bins, np.ones(len(bins)))
    length2 = bins.sums(ones * ones)
    return ones, ones * ((1.0 - 1.0 / np.sqrt(1.0 + noise.level**2 * length2)) / length2)[bins.run]


def reduced(bins: JointBins, design: Floats, others: Floats) -> tuple[Floats, Counts, Floats]:
    """Columns of each of R runs (N bins) along the directions that its design (N, p) spans.

    `others` (N, q) is what else is wanted there; its last is what the run's own fit explains. Returns (R, k, p + q),
    zero where a run spans fewer than k; (R,) directions of each run; and (R, p) minimum-norm parameters of each run's
    own fit.
    """
    size = np.linalg.norm(design, axis=0)
    live, lengths, (n_runs, p) = np.flatnonzero(size), bins.lengths, (len(bins.runs), design.shape[1])
    m, table = len(live), np.column_stack([design[:, live] / size[live], others])
    small = np.zeros((n_runs, max(min(m, int(lengths.max())), 1), p + others.shape[1]))
    counts, parameters = np.zeros(n_runs, dtype=np.int64), np.zeros((n_runs, p))
    for start in range(0, n_runs, AT_ONCE):
        runs = slice(start, min(start + AT_ONCE, n_runs))
        first, last = bins.first[start], bins.first[runs][-1] + lengths[runs][-1]
        run = bins.run[first:last]
        padded = np.zeros((runs.stop - start, int(lengths[runs].max()), table.shape[1]))
        padded[run - start, np.arange(first, last) - bins.first[run]] = table[first:last]
        upper: Floats = np.asarray(np.linalg.qr(padded, mode="r"))
        basis, singular, right = _svd(upper[:, :, :m])
        is_spanned = singular > FLAT * np.maximum(singular[:, :1], 1e-300)
        turned = np.where(is_spanned[:, :, None], basis.transpose(0, 2, 1) @ upper[:, :, m:], 0.0)
        singular, k = np.where(is_spanned, singular, 0.0), singular.shape[1]
        small[runs, :k, live] = singular[:, :, None] * right * size[live]
        small[runs, :k, p:] = turned
        shares = np.divide(turned[:, :, -1], singular, out=np.zeros_like(singular), where=is_spanned)
        parameters[runs, live] = np.einsum("rkm,rk->rm", right, shares) / size[live]
        counts[runs] = is_spanned.sum(axis=1)
    return small[:, : max(int(counts.max()), 1)], counts, parameters


def _svd(matrices: Floats) -> tuple[Floats, Floats, Floats]:
    """Thin singular value decompositions of (R, n, m): by QR iterations where divide and conquer does not converge."""
    try:
        basis, singular, right = np.linalg.svd(matrices, full_matrices=False)
    except np.linalg.LinAlgError:
        from scipy.linalg import svd  # loads a tenth of a second

        parts = [svd(matrix, full_matrices=False, lapack_driver="gesvd") for matrix in matrices]
        basis, singular, right = map(np.stack, zip(*parts, strict=True))
    return basis, singular, right


def fit_each_run(bins: JointBins, design: Floats) -> tuple[Floats, Counts]:
    """(N,) A that each run's own fit of (N, p) `design` predicts, and (R,) its terms."""
    _, counts, parameters = reduced(bins, design, bins.current[:, None])
    return np.einsum("np,np->n", design, parameters[bins.run]), counts


def inside_runs(bins: JointBins, design: Floats) -> tuple[NoiseModel, float]:
    """White noise of a sample alike in all runs, and how many times its density slow noise has inside runs.

    It is what each run leaves beside its own fit of (N, p) `design` and its first harmonic, where runs are long enough
    to tell; else the scatter inside bins or, where these hold one sample each, what all runs leave. To estimate
    parameters nothing is whitened within runs: that would lift the band in which what a model lacks, and the noise of
    smoothed accelerations, live.
    """
    drawn, lost = fit_each_run(bins, np.column_stack([design, bins.harmonic]))
    residual = bins.current - drawn
    runs = np.flatnonzero(bins.lengths >= np.maximum(FEWEST_OF_RUN, 2 * lost))
    pieces, free = np.split(residual, bins.first[1:]), len(residual) - int(lost.sum())
    unknown = float(residual @ residual) / free if free > 0 else bins.mean_square
    floor = max(EXACT * float(np.sqrt(bins.mean_square)), 1e-70)
    correlation = np.zeros(len(pieces))
    spread = np.full(len(pieces), float(np.sqrt(bins.inside.sum() / bins.count.sum() or unknown)))
    if len(runs):
        correlation, spread = _moments_by_step(bins.step, [pieces[k] for k in runs], runs, lost[runs].astype(float))
    spread = np.maximum(spread, floor)
    count = bins.sums(bins.count) / bins.lengths
    sample = float(np.average(spread**2 * count, weights=bins.lengths))
    slow = spread**2 * count * (1.0 + correlation) / (1.0 - correlation)
    white = NoiseModel(np.zeros(len(count)), np.sqrt(sample / count), np.zeros(len(count)))
    return white, float(np.average(slow / sample, weights=bins.lengths))


def noise_of(bins: JointBins, residual: Floats, pairs: Sequence[tuple[int, int]] | None = None) -> NoiseModel:
    """Estimate the noise from differences of repeated runs, else from the residual (N,) of a fit itself.

    `pairs` are the runs that repeat one another; those of `bins` where not given.

    Source: Yule-Walker for the correlation, its bias corrected to first order (M. G. Kendall, Biometrika 41, 1954).
    """
    pairs = bins.pairs if pairs is None else pairs
    paired = len(pairs) >= FEWEST_PAIRS
    if paired:
        sides = [bins.side_by_side(residual, pair) for pair in pairs]
        pieces, runs = [(a - b) / np.sqrt(2.0) for a, b in sides], np.array([a for a, _ in pairs])
    else:
        pieces, runs = np.split(residual, bins.first[1:]), np.arange(len(bins.runs))
    floor = 10.0 * EXACT * float(np.sqrt(np.mean(bins.current**2)) + 1e-12)
    correlation, spread = _moments_by_step(bins.step, pieces, runs, np.ones(len(pieces)))
    means = np.array([piece.mean() for piece in pieces])
    lengths = np.array([len(piece) for piece in pieces], dtype=float)
    by_bins = spread[runs] ** 2 * _variance_of_mean(correlation[runs], lengths)
    level = float(np.sqrt(max(float(np.mean(means**2 - by_bins)), 0.0)))
    return NoiseModel(correlation, np.maximum(spread, floor), np.full(len(bins.runs), level), paired)


def _moments_by_step(step: Floats, pieces: Sequence[Floats], runs: Counts, lost: Floats) -> tuple[Floats, Floats]:
    """(R,) correlation and spread of runs whose bins last (R,) `step` s; each piece of residual is of one of `runs`.

    Runs whose bins last alike share them, where they have `FEWEST_BINS`; else they take those of all.
    """
    whole = _moments(pieces, lost)
    correlation, spread = np.full(len(step), whole[0]), np.full(len(step), whole[1])
    order = np.argsort(step, kind="stable")
    while len(order):
        is_alike = step[order] <= ALIKE * step[order[0]]
        group, order = order[is_alike], order[~is_alike]
        members = np.flatnonzero(np.isin(runs, group)).tolist()
        if sum(len(pieces[k]) for k in members) >= FEWEST_BINS:
            correlation[group], spread[group] = _moments([pieces[k] for k in members], lost[members])
    return correlation, spread


def _moments(pieces: Sequence[Floats], lost: Floats) -> tuple[float, float]:
    """Correlation of neighbours and standard deviation of bins beside fits of (n,) `lost` parameters, bias taken out.

    A piece's mean, which is one of them, is taken out here.
    """
    n = np.array([len(piece) for piece in pieces], dtype=float)
    centred = [piece - piece.mean() for piece in pieces]
    square = sum(float(c @ c) for c in centred)
    if square <= 0.0 or n.sum() <= lost.sum():
        return 0.0, float(np.sqrt(square / max(n.sum(), 1.0)))
    rho = sum(float(c[1:] @ c[:-1]) for c in centred) / square
    mean_n, k = float(n.mean()), float(lost.mean())
    rho = float(np.clip(rho + (k * (1.0 + rho) + 3.0 * rho) / mean_n, 0.0, MOST_CORRELATED))
    share = np.minimum(lost * _variance_of_mean(rho, n), MOST_LOST)  # that each run's own fit took away
    return rho, float(np.sqrt(square / np.sum(n * (1.0 - share))))


def _variance_of_mean(rho: Floats | float, n: Floats) -> Floats:
    return np.asarray(((1.0 + rho) / (1.0 - rho) - 2.0 * rho * (1.0 - rho**n) / (n * (1.0 - rho) ** 2)) / n)


def estimate(ones: Floats, design: Floats, target: Floats, *, counts: Counts) -> tuple[float, float, int] | None:
    """Restricted maximum likelihood of the variances of a sample and of the level of a run, and their freedoms.

    `ones` (R, k) is each run's constant in its own rows, `design` (R, k, q), `target` (R, k); of the k rows `counts`
    (R,) are true, the others zero. None where fewer than `FEWEST_FREEDOMS` degrees of freedom are left.

    Source: D. A. Harville, J. Am. Stat. Assoc. 72 (1977) 320-338.
    """
    basis = _orthonormal(design)
    freedoms = int(counts.sum()) - basis.shape[2]
    if freedoms < FEWEST_FREEDOMS:
        return None
    joined = np.concatenate([basis, target[:, :, None]], axis=2)
    along, length2 = np.einsum("rk,rkq->rq", ones, joined), np.sum(ones * ones, axis=1)
    outer = (along[:, :, None] * along[:, None, :]).reshape(len(ones), -1)
    gram = np.einsum("rkp,rkq->pq", joined, joined)

    def profile(ratios: Floats) -> tuple[Floats, Floats]:
        """(n,) cost (minus twice the logarithm, but for constants), and variance of a sample, A2, by level over it."""
        stretch = ratios[:, None] * length2
        shrunk = gram - ((ratios[:, None] / (1.0 + stretch)) @ outer).reshape(-1, *gram.shape)
        info, cross, square = shrunk[:, :-1, :-1], shrunk[:, :-1, -1], shrunk[:, -1, -1]
        explained = np.sum(cross * np.linalg.solve(info, cross[:, :, None])[:, :, 0], axis=1)
        sample = np.maximum(square - explained, 1e-30 * gram[-1, -1] + 1e-300) / freedoms
        return freedoms * np.log(sample) + np.sum(np.log1p(stretch), axis=1) + np.linalg.slogdet(info)[1], sample

    centre = -np.log(np.median(length2[length2 > 0])) if (length2 > 0).any() else 0.0
    low, high = lowest, highest = centre + LOWEST, centre + HIGHEST
    for _ in range(ROUNDS):
        grid = np.linspace(low, high, POINTS)
        middle, step = float(grid[np.argmin(profile(np.exp(grid))[0])]), (high - low) / (POINTS - 1)
        low, high = max(middle - step, lowest), min(middle + step, highest)
    ratios = np.array([np.exp(middle), 0.0])
    costs, samples = profile(ratios)
    simplest = int(costs[1] <= costs.min() + SAME_COST)
    return float(samples[simplest]), float(ratios[simplest] * samples[simplest]), freedoms


def excess(design: Floats, target: Floats, *, counts: Counts, is_other: Flags) -> float:
    """How many times the variance of the rest some of R runs have beside a fit of all; 1 where that cannot be told.

    `design` (R, k, q), `target` (R, k); of the k rows of a run `counts` (R,) are true, the others zero.

    Source: W. Foerstner, Z. Vermessungswesen 104 (1979) 149-156: variance components by redundancy.
    """
    times, groups = 1.0, (is_other, ~is_other)
    for _ in range(ROUNDS):
        weight = np.where(is_other, times**-0.5, 1.0)[:, None]
        basis, values = _orthonormal(design * weight[:, :, None]), target * weight
        residual = values - basis @ np.einsum("rkb,rk->b", basis, values)
        redundancy = [float(counts[group].sum() - np.sum(basis[group] ** 2)) for group in groups]
        squares = [float(np.sum(residual[group] ** 2)) for group in groups]
        if min(redundancy) < FEWEST_FREEDOMS or squares[1] <= EXACT**2 * float(np.sum(values**2)):
            return 1.0
        ratio = squares[0] / redundancy[0] * redundancy[1] / squares[1]
        times, before = min(max(times * ratio, 1.0), MOST_EXCESS), times
        if abs(np.log(times / before)) < SAME_EXCESS:
            break
    return times


def freedoms(noise: NoiseModel, *, ones: Floats, jacobian: Floats, inverse: Floats) -> Floats:
    """(p,) Satterthwaite degrees of freedom of each parameter's variance where the noise's working model gives it.

    `ones` (R, k) is each run's constant, not whitened, `jacobian` (R, k, p) whitened, `inverse` (p, p) the inverse
    information of all rows.

    Source: F. E. Satterthwaite, Biometrics 2 (1946) 110-114, on restricted likelihood as in A. H. M. A. Cornelius and
    R. Fai, J. Stat. Comput. Simul. 54 (1996) 363-378.
    """
    n_runs, k, p = jacobian.shape
    root = noise.whiten_reduced(ones, np.broadcast_to(np.eye(k), (n_runs, k, k)))  # V^-1/2 of each run
    along = root @ ones[:, :, None]
    parts = np.stack([root @ root, along @ along.transpose(0, 2, 1)])
    basis = _orthonormal(jacobian)
    turned = parts @ basis
    inner = np.einsum("rkb,arkc->abc", basis, turned)
    # trace(P A P B) with P = I - basis basis' and A, B block diagonal by run.
    products = [np.tensordot(part, part, (range(1, part.ndim), range(1, part.ndim))) for part in (parts, turned, inner)]
    info = 0.5 * (products[0] - 2.0 * products[1] + products[2])
    pulled = jacobian @ inverse
    slopes = np.einsum("rkq,arkl,rlq->aq", pulled, parts, pulled, optimize=True)
    if not noise.level.any():
        variance_of = slopes[0] ** 2 / info[0, 0]
    else:
        variance_of = np.einsum("aq,ab,bq->q", slopes, np.linalg.pinv(info), slopes)
    variance = slopes[0] * noise.sample + slopes[1] * noise.level[0] ** 2
    return np.divide(2.0 * variance**2, variance_of, out=np.full(p, np.inf), where=variance_of > 0)


def _orthonormal(design: Floats) -> Floats:
    """(R, k, b) orthonormal basis of the span of (R, k, q) columns over all rows."""
    flat = design.reshape(-1, design.shape[2])
    size = np.linalg.norm(flat, axis=0)
    vectors, singular, _ = np.linalg.svd(flat / np.where(size > 0, size, 1.0), full_matrices=False)
    return vectors[:, singular > RANK * max(float(singular[0]), 1e-300)].reshape(*design.shape[:2], -1)
