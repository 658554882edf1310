"""The score test: how much better a fit would be with a candidate in it, run by run, everything else refitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import special

from pumaid.diagnosis.candidates import CandidateColumns
from pumaid.diagnosis.periodogram import Spectrum
from pumaid.effect_spec import EffectTerm, columns_each
from pumaid.estimation.fit import ABSORBED, Fit, FitRow
from pumaid.maths.rank import pseudo_inverse

Floats = NDArray[np.float64]

#: Condition beyond which two columns of one candidate are one: their sizes would be told with errors a hundred times
#: those of their sum.
SINGULAR = 1e4
#: Half of a chi-square beyond which its tail is told by the expansion, for no program can hold it.
FAR = 500.0
#: Least share of an information that is left for a residual where few runs feed many parameters.
LEAST_FREEDOM = 0.25


@dataclass(frozen=True, eq=False, slots=True)
class ScoreTest:
    """One candidate's score statistic, with one shape.

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
        """Parameters, and shapes over which the best was taken."""
        return self.width + len(self.added.shape)

    def surprise(self, scale: float) -> float:
        """-log10 of the chance of this statistic alone; `scale` is the variance of a whitened residual."""
        return float(minus_log10_p(self.statistic / scale, self.width))


@dataclass(frozen=True, eq=False, slots=True)
class ScoreTable:
    """All candidates scored beside one fit.

    Attributes
    ----------
    solved
        The model so far.
    trials
        Every candidate and shape that the model does not absorb.
    absorbed
        Effect and joint of those that it absorbs in every shape.
    spectra
        By joint: scores of all frequencies of a periodic effect.
    leverage
        (R,) factor by which a run's scores are too small, since the run itself was fitted.
    """

    solved: Fit
    trials: tuple[ScoreTest, ...]
    absorbed: frozenset[tuple[str, int | None]]
    spectra: dict[int, Spectrum]
    leverage: Floats

    def best(self) -> dict[tuple[str, int | None], ScoreTest]:
        """The best shape of each effect at each joint."""
        out: dict[tuple[str, int | None], ScoreTest] = {}
        for trial in self.trials:
            key = trial.added.key
            if key not in out or trial.statistic > out[key].statistic:
                out[key] = trial
        return out


class Projector:
    """What is left of candidates' columns beyond a fit."""

    def __init__(self, solved: Fit) -> None:
        self.solved = solved
        self.runs: dict[int, slice] = {}
        self.total = 0
        for row in solved.joints:
            self.runs[row.bins.joint] = slice(self.total, self.total + len(row.bins.runs))
            self.total += len(row.bins.runs)

    @cached_property
    def base_scores(self) -> Floats:
        """(R, P) score of each run for the fit's parameters."""
        out = np.zeros((self.total, len(self.solved.inverse)))
        for row in self.solved.joints:
            out[self.runs[row.bins.joint], row.acting] = row.bins.sums(row.slim * row.residual[:, None])
        return out

    def crossed(self, white: dict[int, Floats]) -> Floats:
        """(P, V) products of the fit's derivatives with whitened columns (N, V) by joint."""
        out = np.zeros((len(self.solved.inverse), next(iter(white.values())).shape[1]))
        for joint, columns in white.items():
            row = self.solved.row(joint)
            out[row.acting] += row.slim.T @ columns
        return out

    def scores(self, white: dict[int, Floats], widths: Sequence[int]) -> tuple[Floats, list[Floats], Floats]:
        """Scores and information of candidates' columns, side by side, beyond the fit.

        Parameters
        ----------
        white
            Joint -> (N, V) whitened columns; joints that are absent have zero.
        widths
            Columns (m) of each candidate, V in all.

        Returns
        -------
        scores
            (R, V) of all joints' runs.
        information
            (m, m) of each candidate.
        raw
            (V,) squares of the columns before the projection.
        """
        cross = self.crossed(white)
        turned = self.solved.inverse @ cross
        scores = np.zeros((self.total, cross.shape[1]))
        for joint, columns in white.items():
            row = self.solved.row(joint)
            scores[self.runs[joint]] += row.bins.sums(columns * row.residual[:, None])
        information, raw = [], np.zeros(cross.shape[1])
        for stop, width in zip(np.cumsum(widths), widths, strict=True):
            part = slice(int(stop) - width, int(stop))
            gram = np.sum([columns[:, part].T @ columns[:, part] for columns in white.values()], axis=0)
            raw[part] = np.diagonal(gram)
            information.append(gram - cross[:, part].T @ turned[:, part])
        return scores - self.base_scores @ turned, information, raw

    def tests(
        self, terms: Sequence[EffectTerm], white: dict[int, Floats], width: Sequence[int]
    ) -> list[ScoreTest | None]:
        """The score test of each candidate, whose columns (`width` of each) lie side by side; None where absorbed."""
        scores, informations, raw = self.scores(white, width)
        out = []
        for term, information, stop in zip(terms, informations, np.cumsum(width), strict=True):
            part = slice(int(stop) - len(information), int(stop))
            share = np.divide(np.diagonal(information), raw[part], out=np.zeros(len(information)), where=raw[part] > 0)
            out.append(score_of(term, scores[:, part], information, share=share, signs=self.solved.signs(term)))
        return out


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


def score_candidates(solved: Fit, catalogue: CandidateColumns) -> ScoreTable:
    """Score every candidate of a catalogue in every shape.

    Source
    ------
    C. R. Rao, Proc. Camb. Phil. Soc. 44 (1948) 50-57, the score test; whitened, so of generalised least squares.
    """
    projector = Projector(solved)
    trials: list[ScoreTest | None] = []
    for joint in (*(row.bins.joint for row in solved.joints), None):
        columns = catalogue.wide if joint is None else {joint: catalogue.local[joint]}
        chosen = [
            item for item in catalogue.variants if item.is_wide == (joint is None) and joint in (None, item.added.joint)
        ]
        white = {k: solved.row(k).noise.whiten(solved.row(k).bins, values) for k, values in columns.items()}
        if chosen:
            trials += projector.tests([item.added for item in chosen], white, [len(item.columns) for item in chosen])
    scored = tuple(trial for trial in trials if trial is not None)
    absorbed = {item.added.key for item in catalogue.variants} - {trial.added.key for trial in scored}
    leverage = np.concatenate([_leverage(row, solved) for row in solved.joints])
    return ScoreTable(solved, scored, frozenset(absorbed), {}, leverage)


def _leverage(row: FitRow, solved: Fit) -> Floats:
    """(R,) 1 / sqrt(1 - parameters a run), the bias of scores of runs that were themselves fitted (HC2's)."""
    used = float(np.sum((row.slim @ solved.inverse[np.ix_(row.acting, row.acting)]) * row.slim))
    runs = len(row.bins.runs)
    return np.full(runs, 1.0 / np.sqrt(max(LEAST_FREEDOM, 1.0 - used / runs)))


def minus_log10_p(statistic: Floats | float, freedoms: int) -> Floats:
    """-log10 of the chance of at least `statistic` under chi-square, also far out in the tail."""
    half, x = freedoms / 2.0, np.asarray(statistic, dtype=float) / 2.0
    tail, beyond = np.maximum(special.gammaincc(half, x), 1e-300), np.maximum(x, FAR)
    far = (half - 1.0) * np.log(beyond) - beyond - special.gammaln(half) + np.log1p((half - 1.0) / beyond)
    return np.asarray(-np.where(x > FAR, far, np.log(tail)) / np.log(10.0))


#: Evaluations of one search.
MOST_STEPS = 60
#: Relative tolerance of a shape; its own error is a per cent at best.
TOLERANCE = 2e-3
#: First step of a search, as a share of the value (grids step by a factor of about 1.6).
FIRST_STEP = 0.25


def refine_shape(projector: Projector, trial: ScoreTest) -> ScoreTest:
    """The trial with its searched shapes at the largest statistic, everything else profiled out.

    Parameters
    ----------
    projector
        Of the system that the trial was scored on.
    trial
        At the best point of its grid.
    """
    model = projector.solved.model
    bounds = {
        shape.name: shape
        for shape in trial.added.effect.shapes(model.robot, trial.added.joint or 0)
        if shape.is_searched and shape.name in trial.added.shape
    }
    if not bounds:
        return trial
    names = list(bounds)
    start = np.array([trial.added.shape[name] for name in names])
    step = np.array([step_of(trial.added, name, projector.solved) for name in names])
    best = trial

    def cost(point: np.ndarray) -> float:
        nonlocal best
        shape = {name: float(value) for name, value in zip(names, start + point * step, strict=True)}
        if any(not bounds[name].low <= value <= bounds[name].high for name, value in shape.items()):
            return 0.0
        trial_there = score_at(projector, replace(trial.added, shape={**trial.added.shape, **shape}))
        if trial_there is None:
            return 0.0
        if trial_there.statistic > best.statistic:
            best = trial_there
        return -trial_there.statistic

    # It takes as long to load as some diagnoses, of which those that find nothing with a shape do without it.
    from scipy import optimize

    n = len(names)
    simplex = np.vstack([np.zeros(n), np.eye(n)])
    options = {"maxfev": MOST_STEPS, "xatol": TOLERANCE / FIRST_STEP, "fatol": 1e-2, "initial_simplex": simplex}
    optimize.minimize(cost, np.zeros(n), method="Nelder-Mead", options=options)
    return best


def step_of(added: EffectTerm, name: str, solved: Fit) -> float:
    """First step of a shape's search."""
    if name == added.effect.periodic and added.joint is not None:
        q = solved.row(added.joint).bins.samples.position[:, added.joint - 1]
        return float(np.pi / 2.0 / np.ptp(q))
    value = added.shape[name]
    return FIRST_STEP * (abs(value) or 1.0)


def score_at(projector: Projector, added: EffectTerm) -> ScoreTest | None:
    """The trial of one effect with one shape; None where the model absorbs it."""
    return scores_at(projector, [added])[0]


def scores_at(projector: Projector, shapes: Sequence[EffectTerm]) -> list[ScoreTest | None]:
    """The same for several shapes of one effect at once."""
    solved = projector.solved
    white = {}
    for row in solved.joints:
        columns = columns_each(shapes, solved.model.robot, row.bins.samples)
        if np.any(columns):
            white[row.bins.joint] = row.noise.whiten(row.bins, columns)
    if not white:
        return [None] * len(shapes)
    width = next(iter(white.values())).shape[1] // len(shapes)
    return projector.tests(shapes, white, [width] * len(shapes))
