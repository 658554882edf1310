"""Whether an effect predicts runs that it was not fitted to: runs left out, those that repeat one another together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.diagnosis.scan import Projector
from pumaid.effect_spec import EffectTerm, columns_each
from pumaid.estimation.fit import Fit
from pumaid.maths.rank import FLAT

Floats = NDArray[np.float64]


#: Share of a parameter's information that runs must keep for it to be fitted to them.
KEPT = 0.01
#: Most of a joint's runs that leave together: with all runs of one direction gone, the others could not even tell
#: friction from weight.
MOST_LEAVING = 1.0 / 3.0


@dataclass(frozen=True, eq=False, slots=True)
class Falls:
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


def groups_of(solved: Fit, joints: Sequence[int]) -> list[tuple[int, tuple[int, ...]]]:
    """(joint, runs) that leave together: repeated runs of each joint; runs one by one where that would be too many."""
    found: list[tuple[int, tuple[int, ...]]] = []
    for row in solved.joints:
        if row.bins.joint in joints:
            most = MOST_LEAVING * len(row.bins.runs)
            alone = tuple((number,) for number in range(len(row.bins.runs)))
            groups = alone if max(len(group) for group in row.bins.groups) > most else row.bins.groups
            found += [(row.bins.joint, group) for group in groups]
    return found


def postures_of(solved: Fit, joints: Sequence[int]) -> list[tuple[int, tuple[int, ...]]]:
    """(joint, runs) of each posture."""
    found = []
    for row in solved.joints:
        if row.bins.joint in joints:
            found += [(row.bins.joint, group) for group in row.bins.postures]
    return found


def falls(solved: Fit, shapes: Sequence[EffectTerm], folds: Sequence[tuple[int, tuple[int, ...]]]) -> Falls:
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
    return Falls(np.array([result[0] for result in results]), float(mean[0]), float(mean[1]))


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
        known = values > FLAT * values[-1]
        self.half = vectors[:, known] / np.sqrt(values[known]) / size[:, None]

    def _kept(self, known: Floats) -> Floats:
        """Inverse of what is known without a fold, in directions of which that keeps `KEPT` of the whole information.

        What only the fold could tell stays at the fit of all: friction guessed at a speed never run is wrong by more
        than any effect.
        """
        values, vectors = np.linalg.eigh(self.half.T @ known @ self.half)
        kept = values > KEPT
        turned = self.half @ vectors[:, kept] / np.sqrt(values[kept])
        return turned @ turned.T

    def one(self, joint: int, runs: tuple[int, ...]) -> tuple[float, float, float, float]:
        """Fall, raw squares before and after weighted by samples, and samples, of one fold."""
        row = self.solved.row(joint)
        bins = np.isin(row.bins.run, runs)
        J, r, own = row.slim[bins], row.residual[bins], row.acting
        columns = self.white.get(joint)
        C = columns[bins] if columns is not None else np.zeros((len(r), self.cross.shape[1]))
        known, cross = self.information.copy(), self.cross.copy()
        known[np.ix_(own, own)] -= J.T @ J
        cross[own] -= J.T @ C
        inverse = self._kept(known)
        move = -inverse[:, own] @ (J.T @ r)
        turned = inverse @ cross
        score = self.slope - C.T @ r - cross.T @ move
        left = self.gram - C.T @ C - cross.T @ turned
        error, beyond = r - J @ move[own], C - J @ turned[own]
        best, chosen, sizes = -np.inf, slice(0, self.width), np.zeros(self.width)
        for number in range(len(self.shapes)):
            place = slice(number * self.width, (number + 1) * self.width)
            fitted = _solved(left[place, place], score[place], self.whole[place])
            gain = float(score[place] @ fitted)
            if gain > best:
                best, chosen, sizes = gain, place, fitted
        after = error - beyond[:, chosen] @ sizes
        plain = row.bare[bins]
        raw = row.misfit[bins] - plain @ move[own]
        raw_after = raw - (self.plain[joint][bins][:, chosen] - plain @ turned[own, chosen]) @ sizes
        weight = row.bins.count[bins]
        inside = float(weight @ row.bins.inside[bins])
        squares = (float(weight @ raw**2) + inside, float(weight @ raw_after**2) + inside)
        return float(error @ error - after @ after), *squares, float(weight.sum())


def _solved(information: Floats, score: Floats, whole: Floats) -> Floats:
    """Parameters of the training runs, in directions of which these keep at least `KEPT` of the whole information."""
    unit = np.divide(1.0, np.sqrt(whole), out=np.zeros_like(whole), where=whole > 0.0)
    values, vectors = np.linalg.eigh(information * unit[:, None] * unit[None, :])
    kept = values > KEPT
    half = vectors[:, kept] / np.sqrt(values[kept])
    return np.asarray(unit * (half @ (half.T @ (unit * score))))
