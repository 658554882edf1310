"""The score test: how much better a fit would be with a candidate in it, run by run, everything else refitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pumaid.diagnosis.candidates import Candidates, Key, Spectrum, grid_of, minus_log10_p
from pumaid.effect_spec import EffectTerm
from pumaid.estimation.fit import ABSORBED, Fit, Projector
from pumaid.maths.rank import pseudo_inverse

Floats = NDArray[np.float64]

#: Condition beyond which two columns of one candidate are one: their sizes would be told with errors a hundred times
#: those of their sum.
SINGULAR = 1e4
#: Least share of an information that is left for a residual where few runs feed many parameters.
LEAST_FREEDOM = 0.25


@dataclass(frozen=True, eq=False, slots=True)
class ScoreTest:
    """One candidate's score statistic, with one shape.

    Attributes
    ----------
    statistic
        Twice the gain in log likelihood if it were added (chi-square with as many degrees of freedom as columns).
    information, sizes, scores
        (m, m) of its parameters, all else refitted, (m,) these at the maximum, (R, m) score of each run of all joints.
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

    def surprise(self, scale: float) -> float:
        """-log10 of the chance of this statistic alone; `scale` is the variance of a whitened residual."""
        return float(minus_log10_p(self.statistic / scale, self.width))


@dataclass(frozen=True, eq=False)
class ScoreTable:
    """All candidates scored beside one fit: a test of each shape that the model does not absorb.

    `spectra` are the scores of all frequencies of periodic effects.
    """

    solved: Fit
    candidates: Candidates
    trials: tuple[ScoreTest, ...]
    spectra: tuple[Spectrum, ...] = ()

    def best(self) -> dict[Key, ScoreTest]:
        """The best shape of each effect at each joint."""
        return {test.added.key: test for test in sorted(self.trials, key=lambda test: test.statistic)}

    @cached_property
    def leverage(self) -> Floats:
        """(R,) 1 / sqrt(1 - parameters a run), the bias of scores of runs that were themselves fitted (HC2's)."""
        parts, inverse = [], self.solved.inverse
        for row in self.solved.joints:
            runs = len(row.bins.runs)
            used = float(np.sum((row.slim @ inverse[np.ix_(row.acting, row.acting)]) * row.slim))
            parts.append(np.full(runs, 1.0 / np.sqrt(max(LEAST_FREEDOM, 1.0 - used / runs))))
        return np.concatenate(parts)


def score_of(
    added: EffectTerm, scores: Floats, information: Floats, *, share: Floats, signs: Floats
) -> ScoreTest | None:
    """The score statistic of one candidate in the directions that the model does not absorb; None where there is none.

    A parameter whose sign is not that of the physics is held at zero, the others fitted anew.
    """
    size = np.sqrt(np.maximum(np.diagonal(information), 0.0))
    visible = np.flatnonzero((share >= ABSORBED) & (size > 0))
    if len(visible) == 0:
        return None
    if (
        len(visible) > 1
        and np.linalg.cond(information[np.ix_(visible, visible)] / np.outer(size[visible], size[visible])) > SINGULAR
    ):
        visible = visible[:1]
    total, sizes, statistic = scores.sum(axis=0), np.zeros(len(size)), 0.0
    free = visible
    while len(free):
        inverse = pseudo_inverse(information[np.ix_(free, free)])[0]
        fitted = inverse @ total[free]
        wrong = fitted * signs[free] < 0.0
        if not wrong.any():
            sizes[free], statistic = fitted, float(total[free] @ fitted)
            break
        free = free[~wrong]
    return ScoreTest(added, statistic, information, sizes, scores, float(share[visible].max()), signs)


def score_candidates(solved: Fit, tried: Candidates) -> ScoreTable:
    """Score every candidate in every shape.

    Source
    ------
    C. R. Rao, Proc. Camb. Phil. Soc. 44 (1948) 50-57, the score test; whitened, so of generalised least squares.
    """
    projector = Projector(solved)
    tests = [test for group in tried.groups for test in scores_at(projector, group)]
    return ScoreTable(solved, tried, tuple(test for test in tests if test is not None))


#: Evaluations of one search.
MOST_STEPS = 60
#: Relative tolerance of a shape; its own error is a per cent at best.
TOLERANCE = 2e-3
#: First step of a search, as a share of the value (grids step by a factor of about 1.6).
FIRST_STEP = 0.25


def refine_shape(projector: Projector, trial: ScoreTest) -> ScoreTest:
    """The trial, at the best point of its grid, with searched shapes at the largest statistic, all else profiled out.

    The projector is of the fit that the trial was scored on.
    """
    # They take as long to load as some diagnoses, of which those that find nothing with a shape do without them.
    from scipy import optimize

    from pumaid.estimation.nonlinear import search_bounds

    term, solved, best = trial.added, projector.solved, trial
    shapes = [s for s in term.shapes(solved.model.robot).values() if s.is_searched and s.name in term.shape]
    if not shapes:
        return trial
    names = [shape.name for shape in shapes]
    start = np.array([term.shape[name] for name in names])
    if term.effect.periodic is not None and term.joint is not None:
        step = np.array([np.pi / 2.0 / np.ptp(solved.row(term.joint).bins.samples.position[:, term.joint - 1])])
        ends = np.array([(shape.low, shape.high) for shape in shapes])
    else:
        step = FIRST_STEP * np.where(start == 0.0, 1.0, np.abs(start))
        grid = [other.shape for other in grid_of(solved, term.effect, term.joint)]
        ends = np.array([search_bounds(shape, grid) for shape in shapes])

    def cost(point: np.ndarray) -> float:
        nonlocal best
        values = start + point * step
        if np.any((values < ends[:, 0]) | (values > ends[:, 1])):
            return 0.0
        there = score_at(projector, term.at(dict(zip(names, values.tolist(), strict=True))))
        if there is None:
            return 0.0
        if there.statistic > best.statistic:
            best = there
        return -there.statistic

    simplex = np.vstack([np.zeros(len(names)), np.eye(len(names))])
    options = {"maxfev": MOST_STEPS, "xatol": TOLERANCE / FIRST_STEP, "fatol": 1e-2, "initial_simplex": simplex}
    optimize.minimize(cost, simplex[0], method="Nelder-Mead", options=options)
    return best


def score_at(projector: Projector, added: EffectTerm) -> ScoreTest | None:
    """The trial of one effect with one shape; None where the model absorbs it."""
    return scores_at(projector, [added])[0]


def scores_at(projector: Projector, terms: Sequence[EffectTerm]) -> list[ScoreTest | None]:
    """The same for several shapes of one effect at once."""
    solved, white = projector.solved, projector.whitened(projector.columns(terms))
    if not white:
        return [None] * len(terms)
    width = next(iter(white.values())).shape[1] // len(terms)
    scores, information, raw = projector.scores(white, width)
    out = []
    for number, term in enumerate(terms):
        part = slice(number * width, (number + 1) * width)
        share = np.divide(np.diagonal(information[number]), raw[part], out=np.zeros(width), where=raw[part] > 0)
        test = score_of(term, scores[:, part], information[number], share=share, signs=solved.signs(term))
        out.append(test)
    return out
