"""The score test: how much better a fit would be with a candidate in it, run by run, everything else refitted."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

from pumaid.diagnosis.candidates import CandidateColumns, CandidateShape
from pumaid.diagnosis.periodogram import Spectrum
from pumaid.effect_spec import EffectTerm, columns_each
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
class ScoreTest:
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
class ScoreTable:
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
    trials: tuple[ScoreTest, ...]
    absorbed: dict[tuple[str, int | None], float]
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
        bands = [np.sum([_band(block, block, k) for block in columns], axis=0) for k in range(max(widths))]
        information = [np.asarray(band - _band(cross, turned, k)) for k, band in enumerate(bands)]
        starts = np.cumsum([0, *widths[:-1]])
        return scores, [_square(information, int(start), m) for start, m in zip(starts, widths, strict=True)], bands[0]

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
        self, variants: Sequence[CandidateShape], white: dict[int, Floats]
    ) -> tuple[list[ScoreTest], dict[tuple[str, int | None], float]]:
        """Every variant of one kind; those that the model absorbs apart, with the share that is left."""
        out: list[ScoreTest] = []
        lost: dict[tuple[str, int | None], float] = {}
        if not variants:
            return out, lost
        scores, remaining, raw = self.apart(white, [len(variant.columns) for variant in variants])
        for variant, information in zip(variants, remaining, strict=True):
            numbers = np.array(variant.columns)
            before = raw[numbers]
            share = np.divide(np.diagonal(information), before, out=np.zeros(len(numbers)), where=before > 0)
            signs = self.solved.signs(variant.added)
            trial = score_of(variant.added, scores[:, numbers], information, share=share, signs=signs)
            if trial is None:
                key = variant.added.key
                lost[key] = max(lost.get(key, 0.0), float(share.max(initial=0.0)))
            else:
                out.append(trial)
        keys = {trial.added.key for trial in out}
        return out, {key: share for key, share in lost.items() if key not in keys}


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


def score_of(
    added: EffectTerm, scores: Floats, information: Floats, *, share: Floats, signs: Floats
) -> ScoreTest | None:
    """The score statistic of one variant in the directions that the model does not absorb; None where there is none.

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
    """Score every variant of a catalogue.

    Source
    ------
    C. R. Rao, Proc. Camb. Phil. Soc. 44 (1948) 50-57, the score test; whitened, so of generalised least squares.
    """
    projector = Projector(solved)
    trials: list[ScoreTest] = []
    absorbed: dict[tuple[str, int | None], float] = {}
    for row in solved.joints:
        joint = row.bins.joint
        variants = [
            candidate for candidate in catalogue.variants if not candidate.is_wide and candidate.added.joint == joint
        ]
        white = {joint: row.noise.whiten(row.bins, catalogue.local[joint])}
        scored, lost = projector.trials(variants, white)
        trials += scored
        absorbed |= lost
    wide = [candidate for candidate in catalogue.variants if candidate.is_wide]
    white = {row.bins.joint: row.noise.whiten(row.bins, catalogue.wide[row.bins.joint]) for row in solved.joints}
    scored, lost = projector.trials(wide, white)
    leverage = np.concatenate([_leverage(row, solved) for row in solved.joints])
    return ScoreTable(solved, (*trials, *scored), absorbed | lost, {}, leverage)


def _leverage(row: FitRow, solved: Fit) -> Floats:
    """(R,) 1 / sqrt(1 - parameters a run), the bias of scores of runs that were themselves fitted (HC2's)."""
    used = float(np.sum((row.slim @ solved.inverse[np.ix_(row.acting, row.acting)]) * row.slim))
    runs = len(row.bins.runs)
    return np.full(runs, 1.0 / np.sqrt(max(LEAST_FREEDOM, 1.0 - used / runs)))


def minus_log10_p(statistic: Floats | float, freedoms: int) -> Floats:
    """-log10 of the chance of at least `statistic` under chi-square, also far out in the tail."""
    if freedoms == 1:
        return np.asarray(-(special.log_ndtr(-np.sqrt(statistic)) + np.log(2.0)) / np.log(10.0))
    if freedoms == 2:
        return np.asarray(np.asarray(statistic) / (2.0 * np.log(10.0)))
    half, x = freedoms / 2.0, np.maximum(np.asarray(statistic, dtype=float) / 2.0, 1e-12)
    tail = special.gammaincc(half, x)
    far = (half - 1.0) * np.log(x) - x - special.gammaln(half) + np.log1p((half - 1.0) / np.maximum(x, FAR))
    return np.asarray(-np.where(x > FAR, far, np.log(np.maximum(tail, 1e-300))) / np.log(10.0))


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
    scores, remaining, raw = projector.apart(white, [width] * len(shapes))
    out = []
    for number, (term, information) in enumerate(zip(shapes, remaining, strict=True)):
        columns_of = slice(number * width, (number + 1) * width)
        share = np.divide(np.diagonal(information), raw[columns_of], out=np.zeros(width), where=raw[columns_of] > 0)
        signs = solved.signs(term)
        out.append(score_of(term, scores[:, columns_of], information, share=share, signs=signs))
    return out
