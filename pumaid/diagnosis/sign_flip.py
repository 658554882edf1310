"""Chances by sign flips: how good the best candidate, or what repeats, looks where nothing is missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from pumaid.diagnosis.candidates import PERIODIC, Key, minus_log10_p
from pumaid.diagnosis.score_test import ScoreTable, ScoreTest
from pumaid.estimation.fit import Projector
from pumaid.joint_bins import JointBins
from pumaid.maths.rank import pseudo_inverse

Floats = NDArray[np.float64]

#: Flips of the signs of whole runs; the smallest p-value is one in a thousand.
FLIPS = 999
#: Of the flips; a diagnosis is the same each time.
SEED = 20_261
#: Quantile of each candidate's own flips that all are brought to, so that each has the same chance of a false alarm.
BALANCED = 0.98
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
    for key, trials in groupby(scan.trials, key=lambda trial: trial.added.key):
        surprises[key] = minus_log10_p(*_best(list(trials), signs, scale=scale))
    runs = Projector(scan.solved).runs
    for waves in scan.spectra:
        best = waves.highest(signs[:, runs[waves.key[1] or 0]])
        surprises[waves.key] = minus_log10_p(best / scale, PERIODIC)
    if not surprises:
        return SignFlips({}, np.zeros(flips))
    handicaps = {key: float(np.quantile(drawn, BALANCED)) for key, drawn in surprises.items()}
    largest = np.max([drawn - handicaps[key] for key, drawn in surprises.items()], axis=0)
    lone = frozenset[Key]()
    if all(row.noise.from_replicates for row in scan.solved.joints):
        lone = frozenset(key for key, trial in scan.best().items() if alike(trial.scores) < FEW)
    return SignFlips(handicaps, np.sort(largest), lone)


def alike(scores: Floats) -> float:
    """How many runs that tell as much as one another would make scores (R, m) like these: by their fourth moment."""
    squares = np.sum(scores**2, axis=1)
    return float(squares.sum() ** 2 / np.sum(squares**2)) if squares.any() else 0.0


def _best(trials: Sequence[ScoreTest], signs: Floats, *, scale: float) -> tuple[Floats, int]:
    """(B,) largest scaled statistic in each flip of one candidate's trials, and their width."""
    width = trials[0].width
    total = (signs @ np.concatenate([trial.scores for trial in trials], axis=1)).reshape(len(signs), -1, width)
    inverse = np.array([pseudo_inverse(trial.information)[0] for trial in trials])
    if width > 1:
        statistics = np.einsum("btw,twv,btv->bt", total, inverse, total, optimize=True)
    else:  # of the sign that the physics does not allow nothing would be made
        is_allowed = total[:, :, 0] * np.array([trial.signs[0] for trial in trials]) >= 0.0
        statistics = np.where(is_allowed, total[:, :, 0] ** 2 * inverse[:, 0, 0], 0.0)
    return statistics.max(axis=1) / scale, width


#: Sign flips of pairs.
PAIR_FLIPS = 4999
PAIR_SEED = 11
#: Pairs below which nothing can be said.
FEWEST_PAIRS = 4
#: Bins of the stretches over which repeated runs are compared.
LENGTHS = (1, 2, 4, 8, 16)


@dataclass(frozen=True, slots=True)
class ReplicateTest:
    """What pairs of repeated runs share: `share` of the mean square, and the chance of that much where nothing repeats.

    `floor` is the RMS (A) of bins that no model of position, posture, speed and direction removes.
    """

    share: float
    p_value: float
    floor: float


def replicate_test(field: JointBins, misfit: Floats, white: Floats) -> ReplicateTest | None:
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
    return ReplicateTest(share, chance, float(np.sqrt(gaps.sum() / counts.sum())))
