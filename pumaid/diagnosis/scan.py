"""Every candidate tried on top of a solved system: how much better it would fit, run by run."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from pumaid.diagnosis.periodogram import Spectrum
from pumaid.diagnosis.variants import Catalogue, Variant
from pumaid.effect_spec import EffectTerm
from pumaid.estimation.fit import Fit, FitRow
from pumaid.maths.rank import pseudo_inverse

Floats = NDArray[np.float64]

#: Share of a column's square below which the model absorbs it: what is left is rounding and creep of held positions.
ABSORBED = 1e-5
#: Condition beyond which two columns of one candidate are one: their sizes would be told with errors a hundred times
#: those of their sum.
SINGULAR = 1e4
#: Half of a chi-square beyond which its tail is told by the expansion, for no program can hold it.
FAR = 500.0
#: Least share of an information that is left for a residual where few runs feed many parameters.
LEAST_FREEDOM = 0.25


@dataclass(frozen=True, eq=False, slots=True)
class Trial:
    """One variant's score statistic.

    Attributes
    ----------
    added
        What was tried.
    statistic
        Twice the gain in log likelihood if it were added (chi-square with as many degrees of freedom as columns).
    information
        (m, m) of its parameters, all else refitted.
    sizes
        (m,) parameters at the maximum.
    scores
        (R, m) score of each run of all joints together.
    visible
        Share of its columns' square that the model does not absorb.
    signs
        (m,) that the parameters must have; 0 where either is possible.
    """

    added: EffectTerm
    statistic: float
    information: Floats
    sizes: Floats
    scores: Floats
    visible: float
    signs: Floats

    @property
    def width(self) -> int:
        """Linear parameters."""
        return len(self.sizes)

    @property
    def freedoms(self) -> int:
        """Parameters and searched shapes."""
        return self.width + self.searched

    @property
    def searched(self) -> int:
        """Shapes over which the best was taken."""
        return len(self.added.shape)


@dataclass(frozen=True, eq=False, slots=True)
class Scan:
    """A catalogue tried on a solved system.

    Attributes
    ----------
    solved
        The model so far.
    trials
        Every variant that the model does not absorb.
    absorbed
        Share that is left of those which it does, by (effect, joint), the largest over shapes.
    spectra
        By joint: scores of all frequencies of a periodic effect.
    leverage
        (R,) factor by which a run's scores are too small, since the run itself was fitted.
    """

    solved: Fit
    trials: tuple[Trial, ...]
    absorbed: dict[tuple[str, int | None], float]
    spectra: dict[int, Spectrum]
    leverage: Floats

    def best(self) -> dict[tuple[str, int | None], Trial]:
        """The best shape of each effect at each joint."""
        out: dict[tuple[str, int | None], Trial] = {}
        for trial in self.trials:
            key = trial.added.key
            if key not in out or trial.statistic > out[key].statistic:
                out[key] = trial
        return out


class Projector:
    """What is left of candidates' columns beyond a solved system."""

    def __init__(self, solved: Fit) -> None:
        self.solved = solved
        ends = np.cumsum([0, *[len(row.bins.runs) for row in solved.joints]])
        self.runs = {
            row.bins.joint: slice(int(a), int(b)) for row, a, b in zip(solved.joints, ends[:-1], ends[1:], strict=True)
        }
        self.total = int(ends[-1])
        self.own_scores = np.zeros((self.total, len(solved.inverse)))
        for row in solved.joints:
            self.own_scores[self.runs[row.bins.joint], row.acting] = row.bins.sums(row.slim * row.residual[:, None])

    def scores(self, white: dict[int, Floats]) -> tuple[Floats, Floats, Floats]:
        """Scores by run, information and what was there before the projection.

        Parameters
        ----------
        white
            Joint -> (N, V) whitened columns; joints that are absent have zero.

        Returns
        -------
        scores
            (R, V) of all joints' runs.
        gram
            (V, V) among themselves.
        raw
            (V,) squares of the columns.
        """
        scores, cross, turned = self._beyond(white)
        gram = np.sum([columns.T @ columns for columns in white.values()], axis=0)
        return scores, gram - cross.T @ turned, np.diagonal(gram).copy()

    def apart(self, white: dict[int, Floats], widths: Sequence[int]) -> tuple[Floats, list[Floats], Floats]:
        """The same of columns that lie side by side in parts: information within each part, none between parts.

        Parameters
        ----------
        white
            Joint -> (N, V) whitened columns.
        widths
            Columns of each part, V in all.

        Returns
        -------
        scores
            (R, V).
        grams
            (m, m) of each part.
        raw
            (V,).
        """
        scores, cross, turned = self._beyond(white)
        columns = list(white.values())
        bands = [np.sum([_band(each, each, k) for each in columns], axis=0) for k in range(max(widths))]
        left = [np.asarray(band - _band(cross, turned, k)) for k, band in enumerate(bands)]
        starts = np.cumsum([0, *widths[:-1]])
        return scores, [_square(left, int(start), m) for start, m in zip(starts, widths, strict=True)], bands[0]

    def crossed(self, white: dict[int, Floats]) -> Floats:
        """(P, V) products of the system's derivatives with whitened columns (N, V) by joint."""
        width = next(iter(white.values())).shape[1]
        out = np.zeros((self.own_scores.shape[1], width))
        for row in self.solved.joints:
            if row.bins.joint in white:
                out[row.acting] += row.slim.T @ white[row.bins.joint]
        return out

    def _beyond(self, white: dict[int, Floats]) -> tuple[Floats, Floats, Floats]:
        """(R, V) scores, (P, V) products with the system's derivatives, and (P, V) the parameters that these make."""
        cross = self.crossed(white)
        scores, turned = np.zeros((self.total, cross.shape[1])), self.solved.inverse @ cross
        for row in self.solved.joints:
            if row.bins.joint in white:
                scores[self.runs[row.bins.joint]] += row.bins.sums(white[row.bins.joint] * row.residual[:, None])
        return scores - self.own_scores @ turned, cross, turned

    def trials(
        self, variants: Sequence[Variant], white: dict[int, Floats]
    ) -> tuple[list[Trial], dict[tuple[str, int | None], float]]:
        """Every variant of one kind; those that the model absorbs apart, with the share that is left."""
        out: list[Trial] = []
        lost: dict[tuple[str, int | None], float] = {}
        if not variants:
            return out, lost
        scores, left, raw = self.apart(white, [len(variant.columns) for variant in variants])
        for variant, information in zip(variants, left, strict=True):
            own = np.array(variant.columns)
            before = raw[own]
            share = np.divide(np.diagonal(information), before, out=np.zeros(len(own)), where=before > 0)
            signs = self.solved.signs(variant.added)
            trial = trial_of(variant.added, scores[:, own], information, share=share, signs=signs)
            if trial is None:
                key = variant.added.key
                lost[key] = max(lost.get(key, 0.0), float(share.max(initial=0.0)))
            else:
                out.append(trial)
        seen = {trial.added.key for trial in out}
        return out, {key: share for key, share in lost.items() if key not in seen}


def _band(first: Floats, second: Floats, apart: int) -> Floats:
    """(V - apart,) products of each column of (N, V) with the one that stands `apart` columns further in another."""
    width = first.shape[1] - apart
    return np.einsum("nv,nv->v", first[:, :width], second[:, apart:])


def _square(bands: Sequence[Floats], start: int, width: int) -> Floats:
    """(width, width) symmetric matrix whose diagonal, and lines beside it, stand in `bands` from `start` on."""
    out = np.empty((width, width))
    for i, j in itertools.combinations_with_replacement(range(width), 2):
        out[i, j] = out[j, i] = bands[j - i][start + i]
    return out


def trial_of(added: EffectTerm, scores: Floats, information: Floats, *, share: Floats, signs: Floats) -> Trial | None:
    """The score statistic of one variant in the directions that the model does not absorb; None where there is none.

    A parameter whose sign is not that of the physics is held at zero, the others fitted anew.
    """
    size = np.sqrt(np.maximum(np.diagonal(information), 0.0))
    own = np.flatnonzero((share >= ABSORBED) & (size > 0))
    if len(own) == 0:
        return None
    if len(own) > 1 and np.linalg.cond(information[np.ix_(own, own)] / np.outer(size[own], size[own])) > SINGULAR:
        own = own[:1]
    total, sizes, statistic = scores.sum(axis=0), np.zeros(len(size)), 0.0
    kept = own
    while len(kept):
        inverse = pseudo_inverse(information[np.ix_(kept, kept)])[0]
        fitted = inverse @ total[kept]
        wrong = fitted * signs[kept] < 0.0
        if not wrong.any():
            sizes[kept], statistic = fitted, float(total[kept] @ fitted)
            break
        kept = kept[~wrong]
    return Trial(added, statistic, information, sizes, scores, float(share[own].max()), signs)


def scan(solved: Fit, catalogue: Catalogue) -> Scan:
    """Score every variant of a catalogue.

    Source
    ------
    C. R. Rao, Proc. Camb. Phil. Soc. 44 (1948) 50-57, the score test; whitened, so of generalised least squares.
    """
    projector = Projector(solved)
    trials: list[Trial] = []
    absorbed: dict[tuple[str, int | None], float] = {}
    for row in solved.joints:
        joint = row.bins.joint
        variants = [one for one in catalogue.variants if not one.is_wide and one.added.joint == joint]
        white = {joint: row.noise.whiten(row.bins, catalogue.local[joint])}
        found, lost = projector.trials(variants, white)
        trials += found
        absorbed |= lost
    wide = [one for one in catalogue.variants if one.is_wide]
    white = {row.bins.joint: row.noise.whiten(row.bins, catalogue.wide[row.bins.joint]) for row in solved.joints}
    found, lost = projector.trials(wide, white)
    leverage = np.concatenate([_leverage(row, solved) for row in solved.joints])
    return Scan(solved, (*trials, *found), absorbed | lost, {}, leverage)


def _leverage(row: FitRow, solved: Fit) -> Floats:
    """(R,) 1 / sqrt(1 - parameters a run), the bias of scores of runs that were themselves fitted (HC2's)."""
    used = float(np.sum((row.slim @ solved.inverse[np.ix_(row.acting, row.acting)]) * row.slim))
    runs = len(row.bins.runs)
    return np.full(runs, 1.0 / np.sqrt(max(LEAST_FREEDOM, 1.0 - used / runs)))


def surprise(statistic: Floats | float, freedoms: int) -> Floats:
    """-log10 of the chance of at least `statistic` under chi-square, also far out in the tail."""
    if freedoms == 1:
        return np.asarray(-(special.log_ndtr(-np.sqrt(statistic)) + np.log(2.0)) / np.log(10.0))
    if freedoms == 2:
        return np.asarray(np.asarray(statistic) / (2.0 * np.log(10.0)))
    half, x = freedoms / 2.0, np.maximum(np.asarray(statistic, dtype=float) / 2.0, 1e-12)
    tail = special.gammaincc(half, x)
    far = (half - 1.0) * np.log(x) - x - special.gammaln(half) + np.log1p((half - 1.0) / np.maximum(x, FAR))
    return np.asarray(-np.where(x > FAR, far, np.log(np.maximum(tail, 1e-300))) / np.log(10.0))
