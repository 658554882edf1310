"""Whether an effect predicts runs that it was not fitted to: runs left out in turn, and held-out runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.diagnosis.records import Transfer
from pumaid.diagnosis.score_test import Projector
from pumaid.effect_spec import EffectTerm, columns_each
from pumaid.estimation.fit import Fit, elsewhere
from pumaid.joint_bins import JointBins
from pumaid.maths.rank import FLAT, pseudo_inverse

Floats = NDArray[np.float64]


#: Share of a parameter's information that runs must keep for it to be fitted to them.
KEPT = 0.01
#: Most of a joint's runs that leave together: with all runs of one direction gone, the others could not even tell
#: friction from weight.
MOST_LEAVING = 1.0 / 3.0


@dataclass(frozen=True, eq=False, slots=True)
class FoldLosses:
    """What leaving runs out says of one effect.

    Attributes
    ----------
    falls
        (F,) fall of the held-out whitened square, one a fold.
    before, after
        RMSE (A) of the runs left out, without and with the effect.
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


def replicate_folds(solved: Fit, joints: Sequence[int]) -> list[tuple[int, tuple[int, ...]]]:
    """(joint, runs) that leave together: repeated runs of each joint; runs one by one where that would be too many."""
    folds: list[tuple[int, tuple[int, ...]]] = []
    for row in solved.joints:
        if row.bins.joint in joints:
            largest = MOST_LEAVING * len(row.bins.runs)
            alone = tuple((number,) for number in range(len(row.bins.runs)))
            groups = alone if max(len(group) for group in row.bins.groups) > largest else row.bins.groups
            folds += [(row.bins.joint, group) for group in groups]
    return folds


def posture_folds(solved: Fit, joints: Sequence[int]) -> list[tuple[int, tuple[int, ...]]]:
    """(joint, runs) of each posture."""
    folds = []
    for row in solved.joints:
        if row.bins.joint in joints:
            folds += [(row.bins.joint, group) for group in row.bins.postures]
    return folds


def leave_out(solved: Fit, shapes: Sequence[EffectTerm], folds: Sequence[tuple[int, tuple[int, ...]]]) -> FoldLosses:
    """Leave each fold out, choose the shape and fit without it, and see what it then predicts.

    Everything is done on Gram matrices of the whole less those of the fold.

    Parameters
    ----------
    solved
        The model without the effect.
    shapes
        The effect with each shape that it may take.
    folds
        As `groups_of` or `postures_of` give them.

    Source
    ------
    M. Stone, J. R. Stat. Soc. B 36 (1974) 111-147, with clusters left out whole.
    """
    test = _Folds(solved, shapes)
    results = [test.one(joint, runs) for joint, runs in folds]
    counts = np.array([result[3] for result in results])
    squares = np.array([result[1:3] for result in results])
    mean = np.sqrt(squares.sum(axis=0) / counts.sum())
    return FoldLosses(np.array([result[0] for result in results]), float(mean[0]), float(mean[1]))


class _Folds:
    def __init__(self, solved: Fit, shapes: Sequence[EffectTerm]) -> None:
        self.solved, self.shapes = solved, shapes
        self.plain = {
            row.bins.joint: columns_each(shapes, solved.model.robot, row.bins.samples) for row in solved.joints
        }
        self.width = next(iter(self.plain.values())).shape[1] // len(shapes)
        acting = {joint: values for joint, values in self.plain.items() if np.any(values)}
        self.white = {joint: solved.row(joint).noise.whiten(solved.row(joint).bins, acting[joint]) for joint in acting}
        self.cross = Projector(solved).crossed(self.white)
        self.gram = sum(columns.T @ columns for columns in self.white.values())
        turned = solved.inverse @ self.cross
        self.whole = np.maximum(np.diagonal(self.gram) - np.sum(self.cross * turned, axis=0), 0.0)
        self.slope = sum(columns.T @ solved.row(joint).residual for joint, columns in self.white.items())
        self.information = solved.information()
        size = np.sqrt(np.maximum(np.diagonal(self.information), np.finfo(float).tiny))
        values, vectors = np.linalg.eigh(self.information / np.outer(size, size))
        is_determined = values > FLAT * values[-1]
        self.half = vectors[:, is_determined] / np.sqrt(values[is_determined]) / size[:, None]

    def _inverse(self, information: Floats) -> Floats:
        """Inverse of what is known without a fold, in directions of which that keeps `KEPT` of the whole information.

        What only the fold could tell stays at the fit of all: friction guessed at a speed never run is wrong by more
        than any effect.
        """
        values, vectors = np.linalg.eigh(self.half.T @ information @ self.half)
        is_kept = values > KEPT
        turned = self.half @ vectors[:, is_kept] / np.sqrt(values[is_kept])
        return turned @ turned.T

    def one(self, joint: int, runs: tuple[int, ...]) -> tuple[float, float, float, float]:
        """Fall, raw squares before and after weighted by samples, and samples, of one fold."""
        row = self.solved.row(joint)
        bins = np.isin(row.bins.run, runs)
        J, r, acting = row.slim[bins], row.residual[bins], row.acting
        columns = self.white.get(joint)
        C = columns[bins] if columns is not None else np.zeros((len(r), self.cross.shape[1]))
        training, cross = self.information.copy(), self.cross.copy()
        training[np.ix_(acting, acting)] -= J.T @ J
        cross[acting] -= J.T @ C
        inverse = self._inverse(training)
        move = -inverse[:, acting] @ (J.T @ r)
        turned = inverse @ cross
        score = self.slope - C.T @ r - cross.T @ move
        remaining = self.gram - C.T @ C - cross.T @ turned
        error, beyond = r - J @ move[acting], C - J @ turned[acting]
        best, chosen, sizes = -np.inf, slice(0, self.width), np.zeros(self.width)
        for number in range(len(self.shapes)):
            place = slice(number * self.width, (number + 1) * self.width)
            fitted = _solved(remaining[place, place], score[place], self.whole[place])
            gain = float(score[place] @ fitted)
            if gain > best:
                best, chosen, sizes = gain, place, fitted
        after = error - beyond[:, chosen] @ sizes
        plain = row.bare[bins]
        raw = row.misfit[bins] - plain @ move[acting]
        raw_after = raw - (self.plain[joint][bins][:, chosen] - plain @ turned[acting, chosen]) @ sizes
        weight = row.bins.count[bins]
        inside = float(weight @ row.bins.inside[bins])
        squares = (float(weight @ raw**2) + inside, float(weight @ raw_after**2) + inside)
        return float(error @ error - after @ after), *squares, float(weight.sum())


def _solved(information: Floats, score: Floats, whole: Floats) -> Floats:
    """Parameters of the training runs, in directions of which these keep at least `KEPT` of the whole information."""
    unit = np.divide(1.0, np.sqrt(whole), out=np.zeros_like(whole), where=whole > 0.0)
    values, vectors = np.linalg.eigh(information * unit[:, None] * unit[None, :])
    is_kept = values > KEPT
    half = vectors[:, is_kept] / np.sqrt(values[is_kept])
    return np.asarray(unit * (half @ (half.T @ (unit * score))))


#: Standard deviations of what the effect adds to runs held out below which these say nothing of it.
LEAST = 2.0


def confirmed_share(last: Fit, added: EffectTerm, heldout: Sequence[JointBins]) -> Transfer | None:
    """The share of an effect's current that runs held out show; None where they could not show it.

    What the whole model leaves of these runs is projected on what the effect adds there, by generalised least squares
    with the covariance of their noise and of all fitted parameters but the effect's own; the error of these is told as
    an error of the share.

    Parameters
    ----------
    last
        The system with all that was added, `added` among it.
    added
        One of `last.model.effects`.
    heldout
        Bins of runs that were not fitted.

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
