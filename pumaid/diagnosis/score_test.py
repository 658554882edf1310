"""Tests of a candidate: its score beside a fit, the best of the catalogue by sign flips, what repeats, all gates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby

import numpy as np
from scipy import special

from pumaid.diagnosis.candidates import PERIODIC, Candidates, Key, Spectrum, grid_of, minus_log10_p
from pumaid.diagnosis.cross_validation import FoldLosses
from pumaid.diagnosis.records import Repeats, Transfer
from pumaid.effect_spec import EffectTerm
from pumaid.effects import USUAL, Scope
from pumaid.estimation.fit import ABSORBED, Fit, Projector
from pumaid.joint_bins import JointBins
from pumaid.maths import Counts, Floats, by_key, inverse_root, pseudo_inverse

#: Condition beyond which two columns of one candidate are one: their sizes would be told with errors a hundred times
#: those of their sum. Least share of an information that is left for a residual where few runs feed many parameters.
#: Directions, all round, in which a body is looked for where it would lie too far.
SINGULAR, LEAST_FREEDOM, DIRECTIONS = 1e4, 0.25, 2000
#: Share of the whitened square that no effect takes away but by rounding.
EXACT = 1e-9


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

    def shared(self) -> dict[str, list[ScoreTest]]:
        """The best shape at each joint of effects that surveys find at every joint, which all may share."""
        groups = by_key(self.best().values(), lambda test: test.added.effect)
        return {
            effect.name: group
            for effect, group in groups.items()
            if len(group) >= FEWEST_JOINTS
            and effect.prior_odds == USUAL
            and effect.scope is Scope.JOINT
            and effect.periodic is None
        }

    @property
    def tests(self) -> int:
        """How many shapes and frequencies of all effects were scored."""
        return len(self.trials) + sum(len(waves.frequency) for waves in self.spectra)

    @cached_property
    def leverage(self) -> Floats:
        """(R,) 1 / sqrt(1 - parameters a run), the bias of scores of runs that were themselves fitted (HC2's)."""
        parts = []
        for row in self.solved.joints:
            runs, used = len(row.bins.runs), float(np.sum((row.jacobian.T @ row.jacobian) * self.solved.inverse))
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
        part = information if len(free) == len(size) else information[np.ix_(free, free)]
        fitted = pseudo_inverse(part)[0] @ total[free]
        wrong = fitted * signs[free] < 0.0
        if not wrong.any():
            sizes[free], statistic = fitted, float(total[free] @ fitted)
            break
        free = free[~wrong]
    return ScoreTest(added, statistic, information, sizes, scores, float(share[visible].max()), signs)


def as_body(sizes: Floats, information: Floats, farthest: float) -> tuple[Floats, float]:
    """(4,) the likeliest mass and first moments of a body within `farthest` (m), and their statistic."""
    if np.linalg.norm(sizes[1:]) <= farthest * abs(sizes[0]):
        return sizes, float(sizes @ information @ sizes)
    rng = np.random.default_rng(SEED)
    bodies = rng.normal(size=(DIRECTIONS, len(sizes))) * (sizes != 0.0)
    bodies[:, 0] = np.linalg.norm(bodies[:, 1:], axis=1) / farthest
    along = bodies @ information
    shares = along @ sizes / np.einsum("kp,kp->k", along, bodies)
    best = int(np.argmax(shares * (along @ sizes)))
    return bodies[best] * shares[best], float(shares[best] * (along @ sizes)[best])


#: Joints from which on an effect is tried at all of them as one.
FEWEST_JOINTS = 3
#: Columns that are scored together: what a processor's cache holds.
AT_ONCE = 32


def score_candidates(solved: Fit, tried: Candidates) -> ScoreTable:
    """Score every candidate in every shape.

    Source
    ------
    C. R. Rao, Proc. Camb. Phil. Soc. 44 (1948) 50-57, the score test; whitened, so of generalised least squares.
    """
    projector, tests = Projector(solved), list[ScoreTest | None]()
    for group in tried.groups.values():
        few = max(AT_ONCE // len(group[0].effect.parameters(solved.model.robot, group[0].number)), 1)
        for start in range(0, len(group), few):
            tests += scores_at(projector, group[start : start + few])
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
    scale, surprises, highest = scan.solved.scale, dict[Key, Floats](), dict[Key, Floats]()
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
        highest[key] = statistics.max(axis=1) / scale
        surprises[key] = minus_log10_p(highest[key], width)
    for name, tests in scan.shared().items():
        widths = [test.width for test in tests]
        surprises[name, None] = surprise_together([highest[test.added.key] for test in tests], widths)
    runs = Projector(scan.solved).runs
    for waves in scan.spectra:
        best = waves.highest(signs[:, runs[waves.key[1] or 0]])
        surprises[waves.key] = np.maximum(minus_log10_p(best / scale, PERIODIC), surprises.get(waves.key, 0.0))
    if not surprises:
        return SignFlips({}, np.zeros(flips))
    handicaps = {key: float(np.quantile(drawn, BALANCED)) for key, drawn in surprises.items()}
    largest = np.max([drawn - handicaps[key] for key, drawn in surprises.items()], axis=0)
    is_repeated = all(row.noise.from_replicates for row in scan.solved.joints)
    lone = frozenset(key for key, trial in scan.best().items() if is_repeated and alike(trial.scores) < FEW)
    return SignFlips(handicaps, np.sort(largest), lone)


def surprise_together(statistics: Sequence[Floats], widths: Sequence[int]) -> Floats:
    """-log10 of the chance of what joints show together, each with so many parameters.

    What the joint that shows most tells is left out, so that no joint stands for all.
    """
    return minus_log10_p(np.sum(statistics, axis=0) - np.max(statistics, axis=0), sum(widths) - max(widths))


def alike(scores: Floats) -> float:
    """How many runs that tell as much as one another would make scores (R, m) like these: by their fourth moment."""
    squares = np.sum((scores / (np.abs(scores).max(initial=0.0) or 1.0)) ** 2, axis=1)  # of 1e-99 no square is left
    return float(squares.sum() ** 2 / np.sum(squares**2)) if squares.any() else 0.0


#: Runs of a joint below which flips of whole runs tell little of effects of any size; then pieces of runs are flipped,
#: too, so many in all, of so many bins at least. Least share of a score that is left where a piece tells most of it.
FEW_RUNS, PIECES, A_PIECE, LEAST = 24, 64, 8, 0.25


def is_few(on: Fit, joint: int | None) -> bool:
    """Whether a joint, or any where it is none of those that move, has few runs."""
    rows = [on.by_bin[joint]] if joint in on.by_bin else on.joints
    return any(len(row.bins.runs) < FEW_RUNS for row in rows)


def evidence(on: Fit, trial: ScoreTest) -> float:
    """Twice the gain in log likelihood less (parameters) x log(runs): effects between runs have only runs to go by.

    The variance is that which is left with the effect, so that large effects are told apart as well as small ones.

    Source
    ------
    G. Schwarz, Ann. Stat. 6 (1978) 461-464; the count of clusters for that of observations.
    """
    remaining = max(on.square - trial.statistic, EXACT * on.square, np.finfo(float).tiny)
    gain = max(on.size - on.rank, 1) * float(np.log(on.square / remaining)) if trial.statistic > 0.0 else 0.0
    return gain - price(on, trial)


def price(on: Fit, trial: ScoreTest) -> float:
    """(Parameters) x log(runs), without parameters that the model absorbs."""
    runs = [len(row.bins.runs) for row in on.joints]
    count = (np.count_nonzero(trial.sizes) or trial.width) + len(trial.added.shape)
    return count * float(np.log(max(sum(runs) / len(runs), 2.0)))


def projected(on: Fit, trial: ScoreTest) -> tuple[dict[int, Floats], Floats]:
    """(N, V) columns of an effect by joint, and (P, V) what of each parameter the fit has in their place."""
    projector = Projector(on)
    plain = projector.columns([trial.added])
    if not plain:
        return {}, np.zeros((len(on.inverse), trial.width))
    return plain, on.inverse @ projector.crossed(projector.whitened(plain))


def chance_of_pieces(on: Fit, trial: ScoreTest, tests: int, *, of_motion: bool = False) -> float:
    """Chance that any of so many `tests` shows as much inside runs, pieces of which have noise of their own.

    The level of a run, which its pieces share, is taken out: what only differs from run to run shows nothing here.
    `of_motion`: pieces are what blocks make again and again, all repeats as one, since what is left of these is alike;
    the chance is zero where they make nothing again.

    Source
    ------
    J. E. Pustejovsky and E. Tipton, J. Bus. Econ. Stat. 36 (2018) 672-683: Hotelling's test of clustered errors.
    """
    (plain, turned), acting = projected(on, trial), np.flatnonzero(trial.sizes)
    if of_motion and all(np.array_equal(on.by_bin[joint].bins.motions, on.by_bin[joint].bins.run) for joint in plain):
        return 0.0
    scores, grams = list[Floats](), list[Floats]()
    for row, columns in ((on.by_bin[joint], columns) for joint, columns in plain.items()):
        bins, noise = row.bins, replace(row.noise, level=np.full(len(row.bins.runs), np.inf))
        white, residual = noise.whiten(bins, (columns - row.bare @ turned)[:, acting]), noise.whiten(bins, row.misfit)
        starts = _pieces(bins)
        if of_motion:
            order = np.argsort(bins.motions, kind="stable")
            white, residual = white[order], residual[order]
            starts = np.flatnonzero(np.diff(bins.motions[order], prepend=-1))
        scores.append(np.add.reduceat(white * residual[:, None], starts))
        grams.append(np.add.reduceat(white[:, :, None] * white[:, None, :], starts))
    if not scores or not len(acting):
        return 1.0
    score, gram = np.vstack(scores), np.vstack(grams)
    total, half = score.sum(axis=0), inverse_root(gram.sum(axis=0))
    width = half.shape[1]
    if not width:
        return 1.0
    share = np.einsum("pk,npq,qk->n", half, gram, half) / width
    remaining = (score - gram @ (half @ (half.T @ total))) / np.sqrt(np.maximum(1.0 - share, LEAST))[:, None]
    freedoms = 1.0 / float(share @ share) - width
    square = float(total @ pseudo_inverse(remaining.T @ remaining)[0] @ total)
    ratio = square * freedoms / (width * (freedoms + width - 1.0))
    return min(1.0, tests * float(special.fdtrc(width, freedoms, ratio))) if freedoms > 1.0 else 1.0


def _pieces(bins: JointBins) -> Counts:
    parts = np.clip(np.round(PIECES * bins.lengths / len(bins)), 1, np.maximum(bins.lengths // A_PIECE, 1))
    runs = zip(bins.first, bins.lengths, parts.astype(int), strict=True)
    return np.concatenate([first + length * np.arange(count) // count for first, length, count in runs])


#: Sign flips of pairs. Pairs below which nothing can be said.
PAIR_FLIPS, PAIR_SEED, FEWEST_PAIRS = 4999, 11, 4
#: Bins of the stretches over which repeated runs are compared. Pairs below which flips of whole pairs cannot show what
#: joints together ask for: then pieces of so many bins are flipped, without the level that those of a run share.
LENGTHS, MANY_PAIRS, A_PAIR_PIECE = (1, 2, 4, 8, 16), 12, 32


def replicate_test(field: JointBins, misfit: Floats, white: Floats) -> Repeats | None:
    """How much of the misfit (N,) A, and whitened, repeats; None with fewer than `FEWEST_PAIRS` pairs.

    Whitened, so that slow noise does not hide what is fast; over stretches of several lengths, so that fast noise does
    not hide what is slow; the most surprising length against the same of each flip.

    Source
    ------
    The lack-of-fit test of G. E. P. Box, W. G. Hunter and J. S. Hunter, Statistics for Experimenters, ch. 10, by signs
    of whole pairs, since samples of one run are not independent, and of long pieces of them where pairs are few.
    """
    pairs = field.pairs
    if len(pairs) < FEWEST_PAIRS:
        return None
    shared, squares, gaps, counts = np.zeros((4, len(pairs)))
    products = list[Floats]()
    for number, pair in enumerate(pairs):
        a, b = field.side_by_side(misfit, pair)
        shared[number], squares[number] = float(a @ b), 0.5 * float(a @ a + b @ b)
        gaps[number], counts[number] = 0.5 * float(np.sum((a - b) ** 2)), len(a)
        a, b = field.side_by_side(white, pair)
        piece = len(a)
        if len(pairs) < MANY_PAIRS:
            a, b, piece = a - a.mean(), b - b.mean(), A_PAIR_PIECE
        starts, bins = np.arange(0, len(a), piece), np.arange(len(a))
        agree = [np.add.reduceat(a, bins[::length]) * np.add.reduceat(b, bins[::length]) for length in LENGTHS]
        products.append(np.array([np.add.reduceat(x, -(-starts // n)) for x, n in zip(agree, LENGTHS, strict=True)]))
    rng = np.random.default_rng(PAIR_SEED)
    by_piece = np.hstack(products)
    signs = rng.choice([-1.0, 1.0], size=(PAIR_FLIPS, by_piece.shape[1]))
    spread = np.sqrt(np.sum(by_piece**2, axis=1)) + np.finfo(float).tiny
    flipped = (signs @ by_piece.T / spread).max(axis=1)
    observed = float((by_piece.sum(axis=1) / spread).max())
    chance = float(1 + np.count_nonzero(flipped >= observed * (1.0 - 1e-12))) / (1 + PAIR_FLIPS)
    share = float(shared.sum() / squares.sum()) if squares.sum() > 0 else 0.0
    return Repeats(share, chance, float(np.sqrt(gaps.sum() / counts.sum())))


#: Family-wise chance of a finding where nothing is missing: with the chance of a shape without a name, at most one
#: experiment in twenty is told that something is missing when nothing is.
LEVEL = 0.03
#: Standard errors beyond which a sign is no chance.
DOUBT = 3.0
#: Share by which an effect must lower the RMSE of some joint to be worth a parameter: far below what a user would mind,
#: since fast waves well beyond chance may hide deep in slow noise.
WORTH = 0.0005
#: Difference of evidence beyond which one effect is decidedly better (odds of 150).
DECISIVE = 10.0
#: Share of a parameter's information below which its shapes have all of it.
SHOWN = 1e-6


@dataclass(frozen=True, eq=False, slots=True)
class EvaluatedCandidate:
    """A candidate at its best shape, and the fit that it was tried on.

    `p_value` is family-wise, `evidence` twice the gain in log likelihood less what its parameters would gain by chance.
    `left_out` works out, when first asked, what leaving runs out says, `beyond` the same of an arm's effect without the
    joint that shows it most; `before` and `after` (A) are the RMSE of the fitted samples by joint that it touches,
    `transfer` says how much of it runs held out showed once it had been added, `rivals` are those which these data
    cannot tell from it, once it was added.
    """

    trial: ScoreTest
    on: Fit
    p_value: float
    evidence: float
    left_out: Callable[[], FoldLosses]
    before: dict[int, float]
    after: dict[int, float]
    beyond: Callable[[], FoldLosses] | None = None
    transfer: Transfer | None = None
    rivals: tuple[EvaluatedCandidate, ...] = ()

    @property
    def key(self) -> Key:
        """Effect and joint."""
        return self.trial.added.key

    @property
    def log_odds(self) -> float:
        """Twice the logarithm of its odds, but for what all candidates share: evidence and how usual the effect is."""
        return self.evidence + 2.0 * float(np.log(self.trial.added.effect.prior_odds))

    @property
    def gain(self) -> float:
        """Largest share by which a joint's RMSE falls."""
        return max((1.0 - after / self.before[joint] for joint, after in self.after.items()), default=0.0)

    @property
    def shown_at(self) -> set[int]:
        """Joints whose RMSE falls by half of `gain` at least: what all feel says nothing of one at its noise."""
        return {joint for joint, after in self.after.items() if 1.0 - after / self.before[joint] >= 0.5 * self.gain > 0}

    def worth(self, noise: Mapping[int, float]) -> float:
        """Largest fall of a joint's mean squared error over that of its noise (A), which is the same in any order."""
        falls = {joint: self.before[joint] ** 2 - after**2 for joint, after in self.after.items()}
        return max((fall / max(noise[joint] ** 2, 1e-300) for joint, fall in falls.items()), default=0.0)

    @property
    def predicts(self) -> bool:
        """Whether it lowers the error of runs that were left out, steadily."""
        return self.left_out().predicts

    @property
    def fault(self) -> str | None:
        """Which gate it misses; None where it passes all."""
        if self.p_value > LEVEL:
            return "chance"
        if not self.predicts:
            return "heldout"
        if self.beyond is not None and not self.beyond().predicts:
            return "single"
        if self.transfer is not None and self.transfer.is_denied:
            return "denied"
        return "worth" if self.gain < WORTH else None


def misfit_with(on: Fit, trial: ScoreTest) -> dict[int, Floats]:
    """Joint in which an effect acts -> (N,) A that is left with it, all else refitted."""
    (plain, turned), out = projected(on, trial), dict[int, Floats]()
    for joint, columns in plain.items():
        row = on.by_bin[joint]
        out[joint] = row.misfit - (columns - row.bare @ turned) @ trial.sizes
    return out


def drives(on: Fit, trial: ScoreTest) -> bool:
    """Whether friction with this effect, all else refitted, has Coulomb friction that drives the motion beyond doubt.

    Such a friction is none: a fall from a height beyond all friction, say, is only another curve of speed.
    """
    name, size = f"coulomb.j{trial.added.joint}.", len(on.values) * trial.added.effect.opposes_motion
    way = np.array([(x == f"{name}plus") - 1.0 * (x == f"{name}minus") for x in on.model.names[:size]])
    turned = way @ projected(on, trial)[1][:size]
    before, after = float(way @ on.values[:size]), float(way @ on.values[:size] - turned @ trial.sizes)
    spread = way @ on.inverse[:size, :size] @ way + turned @ pseudo_inverse(trial.information)[0] @ turned
    return bool(before * after < 0.0 and after**2 > DOUBT**2 * on.scale * spread)


def covariance_of(candidate: EvaluatedCandidate) -> Floats:
    """(m, m) of its linear parameters, its shapes refitted too; infinite where it is not told apart from its shapes."""
    solved, trial, count = candidate.on, candidate.trial, len(candidate.trial.sizes)
    term, information = trial.added.searched(solved.model.robot), trial.information
    if term.fitted and not term.effect.periodic:  # a frequency is given to the fit, not fitted
        projector = Projector(solved)
        white = projector.whitened(projector.columns([term.at({}, trial.sizes.tolist())]))
        if white:
            information = projector.scores(white, next(iter(white.values())).shape[1])[1][0]
    among, with_shapes, shapes = information[:count, :count], information[:count, count:], information[count:, count:]
    if len(shapes):
        among = among - with_shapes @ pseudo_inverse(shapes)[0] @ with_shapes.T
    is_shown = np.diagonal(among) > SHOWN * np.diagonal(information)[:count]
    return np.where(np.outer(is_shown, is_shown), pseudo_inverse(among)[0] * solved.scale, np.inf)
