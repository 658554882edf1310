"""The noise of one joint's bins: correlated within a run, with a level that the run shares; and how to whiten it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pumaid.diagnosis.field import Field

Floats = NDArray[np.float64]

#: Fewest pairs of repeated runs from which noise is taken; with fewer it comes from the residuals.
FEWEST_PAIRS = 6
#: Runs whose bins last equally long within this factor share correlation and spread.
ALIKE = 1.2
#: Bins below which a group of runs takes the whole joint's correlation and spread.
FEWEST_CELLS = 60
#: Correlation beyond which a residual is a trend.
MOST_CORRELATED = 0.98
#: Share of the variance that a run's own mean may have taken away; more is known of hardly correlated bins only.
MOST_LOST = 0.8
#: Noise below this share of the RMS current is rounding.
EXACT = 1e-9


@dataclass(frozen=True, eq=False, slots=True)
class Noise:
    """Noise of one joint.

    Attributes
    ----------
    correlation, spread
        (R,) of neighbouring bins, and standard deviation of a bin (A), of each run.
    level
        Standard deviation (A) of the level that a run shares.
    from_replicates
        Whether it comes from differences of repeated runs; else from residuals, which hold missing physics too.
    """

    correlation: Floats
    spread: Floats
    level: float
    from_replicates: bool

    def whiten(self, field: Field, values: Floats) -> Floats:
        """(N, ...) values times the inverse root of the noise's covariance, run by run."""
        out = self.decorrelated(field, values)
        if self.level == 0.0:
            return out
        ones, shrunk = _level(self, field)
        wide = (slice(None),) + (None,) * (values.ndim - 1)
        shared = field.sums(out * ones[wide])[field.run]
        shared *= shrunk[wide]
        out -= shared
        return out

    def unwhiten(self, field: Field, white: Floats) -> Floats:
        """(N,) the transpose of `whiten` on whitened values: with it a column's score is its plain product."""
        run = field.run
        values = white
        if self.level > 0.0:
            ones, shrunk = _level(self, field)
            values = white - shrunk * field.sums(white * ones)[run]
        scaled = values / (self.spread * np.sqrt(1.0 - self.correlation**2))[run]
        rho = self.correlation[run]
        out = scaled.copy()
        out[field.first] *= np.sqrt(1.0 - self.correlation**2)
        later = np.ones(len(field), dtype=bool)
        later[field.first] = False
        out[:-1] -= np.where(later[1:], rho[1:] * scaled[1:], 0.0)
        return np.asarray(out)

    def at(self, field: Field, speeds: Floats, steps: Floats) -> Noise:
        """Of other runs of the joint of `field`: correlation decays with time, slow noise keeps its density.

        Parameters
        ----------
        field
            That this noise is of.
        speeds, steps
            (R,) of the other runs, rad/s or m/s, and s that their bins last.
        """
        seen = np.array([abs(run.speed) for run in field.runs])
        near = np.argmin(np.abs(np.log(seen[None, :] / speeds[:, None])), axis=1)
        rho, spread = self.correlation[near], self.spread[near]
        ratio = steps / np.maximum(field.step[near], 1e-12)
        fresh = np.where(rho > 0.0, rho, 0.0) ** ratio
        density = spread**2 * (1.0 + rho) / (1.0 - rho) / ratio
        return Noise(fresh, np.sqrt(density * (1.0 - fresh) / (1.0 + fresh)), self.level, self.from_replicates)

    def decorrelated(self, field: Field, values: Floats) -> Floats:
        """(N, ...) values times the inverse root of the covariance without the level that a run shares."""
        run = field.run
        wide = (slice(None),) + (None,) * (values.ndim - 1)
        rho = self.correlation[run][wide]
        out = np.empty_like(values)
        np.multiply(rho[1:], values[:-1], out=out[1:])
        np.subtract(values[1:], out[1:], out=out[1:])
        fresh = np.sqrt(1.0 - self.correlation**2)
        out[field.first] = fresh[wide] * values[field.first]
        out /= (self.spread * fresh)[run][wide]
        return out


@lru_cache(maxsize=16)  # the same for all columns that are tried
def _level(noise: Noise, field: Field) -> tuple[Floats, Floats]:
    """(N,) a level that a run shares, with the noise of its bins taken out, and what of it whitening takes away."""
    ones = noise.decorrelated(field, np.ones(len(field)))
    length2 = field.sums(ones * ones)
    shrink = (1.0 - 1.0 / np.sqrt(1.0 + noise.level**2 * length2)) / length2
    return ones, ones * shrink[field.run]


def noise(field: Field, residual: Floats) -> Noise:
    """Estimate the noise from differences of repeated runs, else from the residual (N,) itself.

    Differences are taken at the nearest bins, so that interpolation does not smooth the noise.

    Source
    ------
    Yule-Walker for the correlation, with the first-order correction of its bias (M. G. Kendall, Biometrika 41, 1954).
    """
    pairs = field.pairs
    paired = len(pairs) >= FEWEST_PAIRS
    pieces = [_difference(field, residual, pair) for pair in pairs] if paired else _alone(field, residual)
    owners = [a for a, _ in pairs] if paired else list(range(len(field.runs)))
    floor = EXACT * float(np.sqrt(np.mean(field.current**2)) + 1e-12)
    whole = _moments([pieces[k] for k in range(len(pieces))])
    correlation, spread = np.full(len(field.runs), whole[0]), np.full(len(field.runs), whole[1])
    for group in _alike(field.step):
        own = [pieces[k] for k, owner in enumerate(owners) if owner in group]
        if sum(len(piece) for piece in own) >= FEWEST_CELLS:
            correlation[group], spread[group] = _moments(own)
    means = np.array([piece.mean() for piece in pieces])
    lengths = np.array([len(piece) for piece in pieces], dtype=float)
    rho, sd = correlation[owners], spread[owners]
    by_bins = sd**2 * _shared(rho, lengths)
    level = float(np.sqrt(max(float(np.mean(means**2 - by_bins)), 0.0)))
    return Noise(correlation, np.maximum(spread, floor), level, paired)


def _difference(field: Field, residual: Floats, pair: tuple[int, int]) -> Floats:
    """Half the root-two difference of two runs."""
    a, b = field.side_by_side(residual, pair)
    return np.asarray((a - b) / np.sqrt(2.0))


def _alone(field: Field, residual: Floats) -> list[Floats]:
    return np.split(residual, field.first[1:])


def _moments(pieces: list[Floats]) -> tuple[float, float]:
    """Correlation of neighbours and standard deviation of bins about their run's mean, bias taken out."""
    n = np.array([len(piece) for piece in pieces], dtype=float)
    centred = [piece - piece.mean() for piece in pieces]
    square = sum(float(c @ c) for c in centred)
    if square <= 0.0 or n.sum() <= len(n):
        return 0.0, 0.0
    lagged = sum(float(c[1:] @ c[:-1]) for c in centred)
    rho = lagged / square
    mean_n = float(n.mean())
    rho = float(np.clip(rho + (1.0 + 4.0 * rho) / mean_n, 0.0, MOST_CORRELATED))
    lost = np.minimum(_shared(rho, n), MOST_LOST)  # the share that a run's own mean took away
    return rho, float(np.sqrt(square / np.sum(n * (1.0 - lost))))


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
