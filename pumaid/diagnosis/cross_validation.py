"""Whether an effect predicts runs that it was not fitted to: runs left out in turn, and held-out runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pumaid.diagnosis.records import Transfer
from pumaid.effect_spec import EffectTerm
from pumaid.estimation.fit import Fit, Projector, elsewhere
from pumaid.joint_bins import Floats, JointBins
from pumaid.maths.rank import FLAT, pseudo_inverse

#: A joint (from 1), and runs of it (from 0) that leave together.
Fold = tuple[int, tuple[int, ...]]

#: Share of a parameter's information that runs must keep for it to be fitted to them.
KEPT = 0.01
#: Most of a joint's runs that leave together: with all runs of one direction gone, the others could not even tell
#: friction from weight.
MOST_LEAVING = 1.0 / 3.0


@dataclass(frozen=True, eq=False, slots=True)
class FoldLosses:
    """What leaving runs out says of one effect: (F,) `falls` of the held-out whitened square, one a fold.

    `before` and `after` are the RMSE (A) of the runs left out, without and with the effect.
    """

    falls: Floats
    before: float
    after: float

    @property
    def total(self) -> float:
        """Of all folds."""
        return float(self.falls.sum())

    @property
    def steadiness(self) -> float:
        """Mean fall in its own standard errors."""
        if len(self.falls) < 2:
            return 0.0
        error = float(self.falls.std(ddof=1)) / np.sqrt(len(self.falls))
        return float(self.falls.mean()) / error if error > 0 else 0.0


def replicate_folds(solved: Fit, joints: Sequence[int]) -> list[Fold]:
    """Repeated runs of each joint leave together; runs one by one where that would be too many."""
    folds: list[Fold] = []
    for bins in (solved.row(joint).bins for joint in joints):
        alone = tuple((number,) for number in range(len(bins.runs)))
        is_too_many = max(len(group) for group in bins.groups) > MOST_LEAVING * len(bins.runs)
        folds += [(bins.joint, group) for group in (alone if is_too_many else bins.groups)]
    return folds


def leave_out(solved: Fit, shapes: Sequence[EffectTerm], folds: Sequence[Fold]) -> FoldLosses:
    """Leave each fold out, choose one of the effect's shapes and fit without it, and see what it then predicts.

    Everything is done on Gram matrices of the whole less those of the fold.

    Source
    ------
    M. Stone, J. R. Stat. Soc. B 36 (1974) 111-147, with clusters left out whole.
    """
    test = _Folds(solved, shapes)
    results = np.array([test.losses(joint, runs) for joint, runs in folds])
    mean = np.sqrt(results[:, 1:3].sum(axis=0) / results[:, 3].sum())
    return FoldLosses(results[:, 0], float(mean[0]), float(mean[1]))


class _Folds:
    """Products of a fit's derivatives, a candidate's columns with each shape, and the residual, over all runs."""

    def __init__(self, solved: Fit, shapes: Sequence[EffectTerm]) -> None:
        projector = Projector(solved)
        self.solved, self.count, self.plain = solved, len(shapes), projector.columns(shapes)
        self.white = projector.whitened(self.plain)
        self.cross = projector.crossed(self.white)
        self.gram = np.sum([columns.T @ columns for columns in self.white.values()], axis=0)
        slopes = [columns.T @ solved.row(joint).residual for joint, columns in self.white.items()]
        self.slope = np.sum(slopes, axis=0)
        whole = np.diagonal(self.gram) - np.sum(self.cross * (solved.inverse @ self.cross), axis=0)
        self.unit = np.divide(1.0, np.sqrt(np.maximum(whole, 0.0)), out=np.zeros_like(whole), where=whole > 0.0)
        self.information = solved.information()
        size = np.sqrt(np.maximum(np.diagonal(self.information), np.finfo(float).tiny))
        values, vectors = np.linalg.eigh(self.information / np.outer(size, size))
        is_determined = values > FLAT * values[-1]
        self.half = vectors[:, is_determined] / np.sqrt(values[is_determined]) / size[:, None]

    def losses(self, joint: int, runs: tuple[int, ...]) -> tuple[float, float, float, float]:
        """Fall, raw squares before and after weighted by samples, and samples, of one fold."""
        row = self.solved.row(joint)
        bins = np.isin(row.bins.run, runs)
        J, r, acting = row.slim[bins], row.residual[bins], row.acting
        C = self.white[joint][bins] if joint in self.white else np.zeros((len(r), self.cross.shape[1]))
        training, cross = self.information.copy(), self.cross.copy()
        training[np.ix_(acting, acting)] -= J.T @ J
        cross[acting] -= J.T @ C
        inverse = _inverse(training, self.half)
        move = -inverse[:, acting] @ (J.T @ r)
        turned = inverse @ cross
        score = self.slope - C.T @ r - cross.T @ move
        remaining = self.gram - C.T @ C - cross.T @ turned
        best, place, sizes, width = -np.inf, slice(0), np.zeros(0), len(self.slope) // self.count
        for part in (slice(start, start + width) for start in range(0, len(self.slope), width)):
            fitted = _inverse(remaining[part, part], np.diag(self.unit[part])) @ score[part]
            gain = float(score[part] @ fitted)
            if gain > best:
                best, place, sizes = gain, part, fitted
        error, bare, weight = r - J @ move[acting], row.bare[bins], row.bins.count[bins]
        after = error - (C - J @ turned[acting])[:, place] @ sizes
        raw = row.misfit[bins] - bare @ move[acting]
        drawn = self.plain[joint][bins, place] if joint in self.plain else 0.0
        raw_after = raw - (drawn - bare @ turned[acting, place]) @ sizes
        inside = float(weight @ row.bins.inside[bins])
        squares = (float(weight @ raw**2) + inside, float(weight @ raw_after**2) + inside)
        return float(error @ error - after @ after), *squares, float(weight.sum())


def _inverse(information: Floats, half: Floats) -> Floats:
    """Inverse of what training runs tell, in directions of which they keep at least `KEPT` of the whole information.

    What only the fold could tell stays at the fit of all: friction guessed at a speed never run is wrong by more than
    any effect. `half` is a root of the inverse of the whole.
    """
    values, vectors = np.linalg.eigh(half.T @ information @ half)
    is_kept = values > KEPT
    turned = half @ vectors[:, is_kept] / np.sqrt(values[is_kept])
    return np.asarray(turned @ turned.T)


#: Standard deviations of what the effect adds to runs held out below which these say nothing of it.
LEAST = 2.0


def confirmed_share(last: Fit, added: EffectTerm, heldout: Sequence[JointBins]) -> Transfer | None:
    """The share of an effect's current that runs held out show; None where they could not show it.

    What the whole model leaves of these runs is projected on what the effect adds there, by generalised least squares
    with the covariance of their noise and of all fitted parameters but the effect's own; the error of these is told as
    an error of the share. `added` is one of the effects of `last`, `heldout` are runs that were not fitted.

    Source
    ------
    A. C. Atkinson, Biometrika 56 (1969) 33-41: a variable of the model's own prediction as a test of it.
    """
    place = last.place_of(added)
    is_effect = np.isin(np.arange(len(last.inverse)), last.columns_of(place))
    held, sums = np.zeros_like(last.inverse), np.zeros((2, len(is_effect)))
    drawn2, shared = 0.0, 0.0
    for bins in heldout:
        if bins.joint not in last.noises:
            continue
        row = elsewhere(last, bins)
        drawn = row.noise.whiten(row.bins, added.linear(last.model.robot, row.bins.samples) @ last.sizes(place))
        held[np.ix_(row.acting, row.acting)] += row.slim.T @ row.slim
        sums[:, row.acting] += np.vstack([drawn, row.residual]) @ row.slim
        drawn2, shared = drawn2 + float(drawn @ drawn), shared + float(drawn @ row.residual)
    training = (last.information() + held)[np.ix_(~is_effect, ~is_effect)]
    turned = np.zeros_like(sums)
    turned[:, ~is_effect] = sums[:, ~is_effect] @ pseudo_inverse(training)[0]
    square = drawn2 - float(sums[0] @ turned[0])
    if square <= LEAST**2 * last.scale:
        return None
    weighed = (drawn2 - 2.0 * float(turned[0] @ sums[0]) + float(turned[0] @ held @ turned[0])) / square**2
    along = (sums[0] - held @ turned[0]) / square
    error = float(np.sqrt(last.scale * (weighed + along @ last.inverse @ along)))
    return Transfer(1.0 + (shared - float(sums[0] @ turned[1])) / square, error, -(drawn2 + 2.0 * shared) / last.scale)
