"""Tests of a candidate: its score beside a fit, the best by chance, what runs left out say; free functions alike."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from typing import ClassVar

import numpy as np

from pumaid.diagnosis.candidates import PERIODIC, Candidates, Expansion, Key, Spectrum, grid_of, minus_log10_p
from pumaid.diagnosis.records import Repeats, Transfer
from pumaid.effect_spec import EffectTerm
from pumaid.effects import Samples
from pumaid.estimation.fit import ABSORBED, Fit, Projector, elsewhere
from pumaid.joint_bins import JointBins
from pumaid.maths import FLAT, Floats, pseudo_inverse

#: Condition beyond which two columns of one candidate are one: their sizes would be told with errors a hundred times
#: those of their sum. Least share of an information that is left for a residual where few runs feed many parameters.
SINGULAR, LEAST_FREEDOM = 1e4, 0.25


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
            used = float(np.sum((row.jacobian @ inverse) * row.jacobian))
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
        fitted = pseudo_inverse(information[np.ix_(free, free)])[0] @ total[free]
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
    tests = (test for group in tried.groups.values() for test in scores_at(projector, group))
    return ScoreTable(solved, tried, tuple(test for test in tests if test is not None))


#: Evaluations of one search. Relative tolerance of a shape; its own error is a per cent at best. First step of a
#: search, as a share of the value (grids step by a factor of about 1.6).
MOST_STEPS, TOLERANCE, FIRST_STEP = 60, 2e-3, 0.25


def refine_shape(projector: Projector, trial: ScoreTest) -> ScoreTest:
    """The trial, at the best point of its grid, with searched shapes at the largest statistic, all else profiled out.

    The projector is of the fit that the trial was scored on.
    """
    # They take as long to load as some diagnoses, of which those that find nothing with a shape do without them.
    from scipy import optimize

    from pumaid.estimation.nonlinear import search_bounds

    term, solved, tried = trial.added, projector.solved, [trial]
    shapes = [s for s in term.shapes(solved.model.robot).values() if s.is_searched and s.name in term.shape]
    if not shapes:
        return trial
    names = [shape.name for shape in shapes]
    start = np.array([term.shape[name] for name in names])
    if term.effect.periodic is not None and term.joint is not None:
        step = np.array([np.pi / 2.0 / np.ptp(solved.by_bin[term.joint].bins.samples.position[:, term.joint - 1])])
        ends = np.array([(shape.low, shape.high) for shape in shapes])
    else:
        step = FIRST_STEP * np.where(start == 0.0, 1.0, np.abs(start))
        grid = [other.shape for other in grid_of(solved, term.effect, term.joint)]
        ends = np.array([search_bounds(shape, grid) for shape in shapes])

    def cost(point: np.ndarray) -> float:
        values = start + point * step
        if np.any((values < ends[:, 0]) | (values > ends[:, 1])):
            return 0.0
        there = score_at(projector, term.at(dict(zip(names, values.tolist(), strict=True)))) or trial
        tried.append(there)
        return 0.0 if there is trial else -there.statistic

    simplex = np.vstack([np.zeros(len(names)), np.eye(len(names))])
    options = {"maxfev": MOST_STEPS, "xatol": TOLERANCE / FIRST_STEP, "fatol": 1e-2, "initial_simplex": simplex}
    optimize.minimize(cost, simplex[0], method="Nelder-Mead", options=options)
    return max(tried, key=lambda test: test.statistic)


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
        out.append(score_of(term, scores[:, part], information[number], share=share, signs=solved.signs(term)))
    return out


#: Flips of the signs of whole runs (the smallest p-value is one in a thousand), and their seed: a diagnosis is the same
#: each time. Quantile of each candidate's own flips that all are brought to, so that each has the same chance of a
#: false alarm.
FLIPS, SEED, BALANCED = 999, 20_261, 0.98
#: Surprise beyond which no flip is asked. Of what shows in a few runs flips can say nothing (of three runs one flip in
#: four changes nothing but the sign), whatever its size; and no misjudgement of the noise makes eleven deviations.
GROSS = 30.0
#: Where a few runs hold nearly all of a candidate's score (fewer than `FEW` that count alike), and repeated runs show
#: the noise, as much is asked of it: six deviations, which noise misjudged by half its size does not make either.
FEW, LONE = 6.0, 9.0


@dataclass(frozen=True, eq=False, slots=True)
class SignFlips:
    """How surprising the best of a catalogue is where nothing is missing.

    `handicaps` are the surprise (-log10 of a single p-value) that each candidate's best shape reaches in `BALANCED` of
    the flips, `largest` (B,) the surprise beyond its handicap of the best candidate in each flip, sorted, `lone` the
    candidates of which a few runs tell nearly all, so that flips do not judge them.
    """

    handicaps: dict[Key, float]
    largest: Floats
    lone: frozenset[Key] = frozenset()

    def gross(self, key: Key) -> float:
        """Surprise beyond which no flip is asked."""
        return LONE if key in self.lone else GROSS

    def p_value(self, key: Key, surprise: float) -> float:
        """Chance of any candidate at least as far beyond its handicap as `key` is with this `surprise`."""
        if surprise >= self.gross(key):
            return 1.0 / (1 + len(self.largest))
        beyond = surprise - self.handicaps.get(key, 0.0)
        return float(1 + np.count_nonzero(self.largest >= beyond)) / (1 + len(self.largest))

    def threshold(self, key: Key, level: float) -> float:
        """Surprise that `key` needs for a p-value below `level`."""
        last = len(self.largest) - 1
        beyond = float(np.interp((1.0 - level) * last, np.arange(last + 1), self.largest))
        return min(self.handicaps.get(key, 0.0) + beyond, self.gross(key))


def sign_flips(scan: ScoreTable, *, flips: int = FLIPS) -> SignFlips:
    """Flip the signs of whole runs' scores and keep the best shape of each candidate each time.

    Candidates with many shapes (all frequencies of a periodic effect) are handicapped by what these gain in the flips,
    so that they do not drown the others.

    Source
    ------
    The wild cluster score bootstrap of P. Kline and A. Santos, J. Econometric Methods 1 (2012) 23-41, with the maximum
    over hypotheses of J. P. Romano and M. Wolf, Econometrica 73 (2005) 1237-1282, balanced as in their section 4.
    """
    rng = np.random.default_rng(SEED)
    signs = rng.choice([-1.0, 1.0], size=(flips, len(scan.leverage))) * scan.leverage
    scale, surprises = scan.solved.scale, dict[Key, Floats]()
    for key, group in groupby(scan.trials, key=lambda trial: trial.added.key):
        trials = list(group)
        width = trials[0].width
        total = (signs @ np.concatenate([trial.scores for trial in trials], axis=1)).reshape(len(signs), -1, width)
        inverse = np.array([pseudo_inverse(trial.information)[0] for trial in trials])
        if width > 1:
            statistics = np.einsum("btw,twv,btv->bt", total, inverse, total, optimize=True)
        else:  # of the sign that the physics does not allow nothing would be made
            is_allowed = total[:, :, 0] * np.array([trial.signs[0] for trial in trials]) >= 0.0
            statistics = np.where(is_allowed, total[:, :, 0] ** 2 * inverse[:, 0, 0], 0.0)
        surprises[key] = minus_log10_p(statistics.max(axis=1) / scale, width)
    runs = Projector(scan.solved).runs
    for waves in scan.spectra:
        best = waves.highest(signs[:, runs[waves.key[1] or 0]])
        surprises[waves.key] = minus_log10_p(best / scale, PERIODIC)
    if not surprises:
        return SignFlips({}, np.zeros(flips))
    handicaps = {key: float(np.quantile(drawn, BALANCED)) for key, drawn in surprises.items()}
    largest = np.max([drawn - handicaps[key] for key, drawn in surprises.items()], axis=0)
    is_repeated = all(row.noise.from_replicates for row in scan.solved.joints)
    lone = frozenset(key for key, trial in scan.best().items() if is_repeated and alike(trial.scores) < FEW)
    return SignFlips(handicaps, np.sort(largest), lone)


def alike(scores: Floats) -> float:
    """How many runs that tell as much as one another would make scores (R, m) like these: by their fourth moment."""
    squares = np.sum(scores**2, axis=1)
    return float(squares.sum() ** 2 / np.sum(squares**2)) if squares.any() else 0.0


#: Sign flips of pairs. Pairs below which nothing can be said.
PAIR_FLIPS, PAIR_SEED, FEWEST_PAIRS = 4999, 11, 4
#: Bins of the stretches over which repeated runs are compared.
LENGTHS = (1, 2, 4, 8, 16)


def replicate_test(field: JointBins, misfit: Floats, white: Floats) -> Repeats | None:
    """How much of the misfit (N,) A, and whitened, repeats; None with fewer than `FEWEST_PAIRS` pairs.

    Whitened, so that slow noise does not hide what is fast; over stretches of several lengths, so that fast noise does
    not hide what is slow; the most surprising length against the same of each flip.

    Source
    ------
    The lack-of-fit test of G. E. P. Box, W. G. Hunter and J. S. Hunter, Statistics for Experimenters, ch. 10, by signs
    of whole pairs, since samples of one run are not independent.
    """
    pairs = field.pairs
    if len(pairs) < FEWEST_PAIRS:
        return None
    shared, squares, gaps, counts = np.zeros((4, len(pairs)))
    products = np.zeros((len(LENGTHS), len(pairs)))
    for number, pair in enumerate(pairs):
        a, b = field.side_by_side(misfit, pair)
        shared[number], squares[number] = float(a @ b), 0.5 * float(a @ a + b @ b)
        gaps[number], counts[number] = 0.5 * float(np.sum((a - b) ** 2)), len(a)
        a, b = field.side_by_side(white, pair)
        for row, length in enumerate(LENGTHS):
            starts = np.arange(0, len(a), length)
            products[row, number] = float(np.add.reduceat(a, starts) @ np.add.reduceat(b, starts))
    rng = np.random.default_rng(PAIR_SEED)
    signs = rng.choice([-1.0, 1.0], size=(PAIR_FLIPS, len(pairs)))
    spread = np.sqrt(np.sum(products**2, axis=1)) + np.finfo(float).tiny
    flipped = (signs @ products.T / spread).max(axis=1)
    observed = float((products.sum(axis=1) / spread).max())
    chance = float(1 + np.count_nonzero(flipped >= observed * (1.0 - 1e-12))) / (1 + PAIR_FLIPS)
    share = float(shared.sum() / squares.sum()) if squares.sum() > 0 else 0.0
    return Repeats(share, chance, float(np.sqrt(gaps.sum() / counts.sum())))


#: Share of a parameter's information that runs must keep for it to be fitted to them. Most of a joint's runs that
#: leave together: with all runs of one direction gone, the others could not even tell friction from weight.
KEPT, MOST_LEAVING = 0.01, 1.0 / 3.0


@dataclass(frozen=True, eq=False, slots=True)
class FoldLosses:
    """What leaving runs out says of one effect: (F,) `falls` of the held-out whitened square, one a fold.

    `before` and `after` are the RMSE (A) of the runs left out, without and with the effect.
    """

    falls: Floats
    before: float
    after: float

    @property
    def steadiness(self) -> float:
        """Mean fall in its own standard errors."""
        error = float(self.falls.std(ddof=1)) / np.sqrt(len(self.falls)) if len(self.falls) > 1 else 0.0
        return float(self.falls.mean()) / error if error > 0 else 0.0


def replicate_folds(solved: Fit, joints: Sequence[int]) -> list[tuple[int, tuple[int, ...]]]:
    """Joints (from 1) and runs of each (from 0) that leave together: repeated ones, or each alone if too many would."""
    folds = []
    for bins in (solved.by_bin[joint].bins for joint in joints):
        alone = tuple((number,) for number in range(len(bins.runs)))
        is_too_many = max(len(group) for group in bins.groups) > MOST_LEAVING * len(bins.runs)
        folds += [(bins.joint, group) for group in (alone if is_too_many else bins.groups)]
    return folds


def leave_out(solved: Fit, shapes: Sequence[EffectTerm], folds: Sequence[tuple[int, tuple[int, ...]]]) -> FoldLosses:
    """Leave each fold out, choose one of the effect's shapes and fit without it, and see what it then predicts.

    Everything is done on Gram matrices of the whole less those of the fold.

    Source
    ------
    M. Stone, J. R. Stat. Soc. B 36 (1974) 111-147, with clusters left out whole.
    """
    projector = Projector(solved)
    plain = projector.columns(shapes)
    white = projector.whitened(plain)
    whole_cross, whole = projector.crossed(white), solved.information()
    gram = np.sum([columns.T @ columns for columns in white.values()], axis=0)
    slope = np.sum([columns.T @ solved.by_bin[joint].residual for joint, columns in white.items()], axis=0)
    alone = np.diagonal(gram) - np.sum(whole_cross * (solved.inverse @ whole_cross), axis=0)
    unit = np.divide(1.0, np.sqrt(np.maximum(alone, 0.0)), out=np.zeros_like(alone), where=alone > 0.0)
    size = np.sqrt(np.maximum(np.diagonal(whole), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(whole / np.outer(size, size))
    is_determined = values > FLAT * values[-1]
    half = vectors[:, is_determined] / np.sqrt(values[is_determined]) / size[:, None]
    places, falls, squares = np.arange(len(slope)).reshape(len(shapes), -1), [], np.zeros(3)
    units = unit[places][:, :, None] * np.eye(places.shape[1])
    for joint, runs in folds:
        row = solved.by_bin[joint]
        bins = np.isin(row.bins.run, runs)
        J, r, weight = row.jacobian[bins], row.residual[bins], row.bins.count[bins]
        C = white[joint][bins] if joint in white else np.zeros((len(r), len(slope)))
        cross, inverse = whole_cross - J.T @ C, _inverse(whole - J.T @ J, half)
        move = -inverse @ (J.T @ r)
        turned = inverse @ cross
        score = slope - C.T @ r - cross.T @ move
        alone = (gram - C.T @ C - cross.T @ turned)[places[:, :, None], places[:, None, :]]
        fitted = np.einsum("kvw,kw->kv", _inverse(alone, units), score[places])
        best = int(np.argmax(np.sum(score[places] * fitted, axis=1)))
        place, sizes = places[best], fitted[best]
        error, bare = r - J @ move, row.bare[bins]
        after = error - (C - J @ turned)[:, place] @ sizes
        raw = row.misfit[bins] - bare @ move
        drawn = plain[joint][bins][:, place] if joint in plain else 0.0
        raw_after = raw - (drawn - bare @ turned[:, place]) @ sizes
        inside = weight @ row.bins.inside[bins]
        falls.append(float(error @ error - after @ after))
        squares += (weight @ raw**2 + inside, weight @ raw_after**2 + inside, weight.sum())
    return FoldLosses(np.array(falls), *np.sqrt(squares[:2] / squares[2]).tolist())


def _inverse(information: Floats, half: Floats) -> Floats:
    """Inverse (..., P, P) of what training runs tell, in directions of which they keep `KEPT` of the whole information.

    What only the fold could tell stays at the fit of all: friction guessed at a speed never run is wrong by more than
    any effect. `half` is a root of the inverse of the whole.
    """
    values, vectors = np.linalg.eigh(np.swapaxes(half, -1, -2) @ information @ half)
    weight = np.where(values > KEPT, 1.0 / np.sqrt(np.maximum(values, KEPT)), 0.0)
    turned = half @ (vectors * weight[..., None, :])
    return np.asarray(turned @ np.swapaxes(turned, -1, -2))


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
    place = [(effect.key, effect.shape) for effect in last.model.effects].index((added.key, added.shape))
    is_effect = np.isin(np.arange(len(last.inverse)), last.columns_of(place))
    held, sums = np.zeros_like(last.inverse), np.zeros((2, len(is_effect)))
    drawn2, shared = 0.0, 0.0
    for row in (elsewhere(last, bins) for bins in heldout if bins.joint in last.by_bin):
        drawn = row.noise.whiten(row.bins, added.linear(last.model.robot, row.bins.samples) @ last.sizes(place))
        held += row.jacobian.T @ row.jacobian
        sums += np.vstack([drawn, row.residual]) @ row.jacobian
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


#: Variable -> its unit (``{unit}`` is rad or m), and knots of a free function over its span: a bump of an eighth of the
#: span is still seen.
FORM_VARIABLES = {"q": ("{unit}", 16), "v": ("{unit}/s", 8), "load": ("A", 8), "t": ("s", 8), "travel": ("{unit}", 8)}
#: Variable of each form, and what multiplies the function of it: nothing, the direction s or the velocity v.
FORMS = (("q", ""), ("q", "s"), ("q", "v"), ("v", "s"), ("load", "s"), ("t", "s"), ("t", ""), ("travel", "s"))
#: Share of a knot's square below which it is absorbed by the model, and eigenvalues of what is left of the hats, as a
#: share of the largest, below which it absorbs a combination of them.
KNOT_ABSORBED, HATS_FLAT = 1e-4, 1e-3
#: Combinations of hats of which the model absorbs more than all but this share are not drawn: their sizes are told with
#: errors far above anything that is left.
DRAWN = 0.1


class FreeForm(Expansion):
    """A free function of one variable, as hat functions, named like ``s f(q)``.

    Source: C. de Boor, A Practical Guide to Splines, ch. 9 (linear B-splines).
    """

    needs_loads: ClassVar[bool] = True

    def __init__(self, variable: str, factor: str, knots: Floats) -> None:
        super().__init__(f"{factor} f({variable})".strip(), len(knots), self._made)
        self.variable, self.factor, self.knots = variable, factor, knots

    def _made(self, samples: Samples) -> Floats:
        factors = {"": np.ones(len(samples)), "s": samples.direction, "v": samples.velocity[:, samples.joint - 1]}
        x = variable(samples, self.variable)
        hats = np.column_stack([np.interp(x, self.knots, hat) for hat in np.eye(len(self.knots))])
        return np.asarray(hats * factors[self.factor][:, None])


def variable(samples: Samples, name: str) -> Floats:
    """(M,) values of a form's variable."""
    column = samples.joint - 1
    return {
        "q": samples.position[:, column],
        "v": np.abs(samples.velocity[:, column]),
        "load": np.zeros(len(samples)) if samples.loads is None else samples.loads.moving,
        "t": samples.time,
        "travel": samples.travel,
    }[name]


def forms(bins: JointBins) -> Iterator[FreeForm]:
    """Every form that the runs of a joint can show."""
    for name, factor in FORMS:
        x, count = variable(bins.samples, name), FORM_VARIABLES[name][1]
        low, high = float(x.min()), float(x.max())
        if high - low <= 1e-6 * max(abs(high), 1.0):
            continue
        knots: Floats = np.linspace(low, high, count)
        if name == "v":
            speeds = np.array(bins.speeds)
            knots = speeds if len(speeds) <= count else np.quantile(speeds, np.linspace(0.0, 1.0, count))
        if len(knots) > 1:
            yield FreeForm(name, factor, knots)


def free_form_scores(solved: Fit, joint: int) -> list[ScoreTest]:
    """Every free form at one joint, in the directions of its hats that a fit with loads does not absorb."""
    projector, out = Projector(solved), []
    for form in forms(solved.by_bin[joint].bins):
        term = EffectTerm(form, joint)
        scores, information, raw = _hat_scores(projector, term)
        visible = np.flatnonzero(np.diagonal(information) > KNOT_ABSORBED * raw)
        if len(visible) < 2:
            continue
        values, vectors = np.linalg.eigh(information[np.ix_(visible, visible)])
        turn = vectors[:, values > HATS_FLAT * values[-1]]
        information, free = turn.T @ information[np.ix_(visible, visible)] @ turn, np.zeros(turn.shape[1])
        out.append(score_of(term, scores[:, visible] @ turn, information, share=free + 1.0, signs=free))
    return [trial for trial in out if trial is not None]


def _hat_scores(projector: Projector, term: EffectTerm) -> tuple[Floats, Floats, Floats]:
    """(R, K) scores, (K, K) information and (K,) squares of the hats of a form."""
    columns = projector.columns([term])
    scores, information, raw = projector.scores(projector.whitened(columns), columns[term.number].shape[1])
    return scores, information[0], raw


def knot_values(solved: Fit, trial: ScoreTest) -> tuple[Floats, Floats, Floats]:
    """Knots, values there (A, as a current in the direction of motion where the form says so) and standard errors."""
    free = trial.added.effect
    assert isinstance(free, FreeForm)
    scores, information, raw = _hat_scores(Projector(solved), trial.added)
    unit = np.divide(1.0, np.sqrt(raw), out=np.zeros_like(raw), where=raw > 0.0)
    values, vectors = np.linalg.eigh(information * np.outer(unit, unit))
    good = values > DRAWN
    inverse = unit[:, None] * ((vectors[:, good] / values[good]) @ vectors[:, good].T) * unit
    return free.knots, inverse @ scores.sum(axis=0), np.sqrt(np.diagonal(inverse) * solved.scale)
