"""Stepwise selection: evaluate the leading candidates, add the best, refit all, and exchange earlier additions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Campaign, Run
from pumaid.diagnosis.candidates import CandidateColumns, candidate_columns, settling
from pumaid.diagnosis.cross_validation import FoldLosses, confirmed_share, leave_out, replicate_folds
from pumaid.diagnosis.periodogram import Spectrum, spectrum
from pumaid.diagnosis.records import Transfer
from pumaid.diagnosis.score_test import (
    Projector,
    ScoreTable,
    ScoreTest,
    minus_log10_p,
    refine_shape,
    score_at,
    score_candidates,
)
from pumaid.diagnosis.sign_flip import SignFlips, sign_flips
from pumaid.effect_spec import EffectTerm, marked
from pumaid.effects import Effect, catalogue
from pumaid.estimation.fit import Fit, at_bins, loaded
from pumaid.estimation.gls import fit_bins, refit
from pumaid.estimation.noise import NoiseModel, noise_of
from pumaid.joint_bins import COARSE, FINE, JointBins, joint_bins
from pumaid.model import Model

Floats = NDArray[np.float64]
Key = tuple[str, int | None]

#: Family-wise chance of a finding where nothing is missing: with the chance of a shape without a name, at most one
#: experiment in twenty is told that something is missing when nothing is.
LEVEL = 0.03
#: Chance beyond which a candidate is not worth leaving runs out for.
NEAR = 0.2
#: Standard errors by which held-out error must fall.
STEADY = 1.0
#: Share by which an effect must lower the RMSE of some joint to be worth a parameter: far below what a user would mind,
#: since fast waves well beyond chance may hide deep in slow noise.
WORTH = 0.0005
#: Difference of evidence beyond which one effect is decidedly better (odds of 150).
DECISIVE = 10.0
#: Share of the whitened square that no effect takes away but by rounding.
EXACT = 1e-9
#: Share of a rival's statistic that may be left once the chosen effect is in: above, it explains something else.
SAME = 0.5


@dataclass(frozen=True, eq=False, slots=True)
class EvaluatedCandidate:
    """A candidate looked at closely.

    Attributes
    ----------
    trial
        At its best shape.
    shapes
        All that were tried.
    on
        The system that it was tried on.
    p_value
        Family-wise.
    evidence
        Twice the gain in log likelihood, less what its parameters would gain by chance.
    falls
        What leaving runs out says; None where chance alone could have made it.
    before, after
        (A) RMSE of the fitted samples by joint that it touches.
    transfer
        How much of it runs held out showed when it had been added; None before.
    """

    trial: ScoreTest
    shapes: tuple[EffectTerm, ...]
    on: Fit
    p_value: float
    evidence: float
    falls: FoldLosses | None
    before: dict[int, float]
    after: dict[int, float]
    transfer: Transfer | None = None

    @property
    def key(self) -> Key:
        """Effect and joint."""
        return self.trial.added.key

    @property
    def gain(self) -> float:
        """Largest share by which a joint's RMSE falls."""
        return max((1.0 - after / self.before[joint] for joint, after in self.after.items()), default=0.0)

    @property
    def fault(self) -> str | None:
        """Which gate it misses; None where it passes all."""
        if self.p_value > LEVEL or self.falls is None:
            return "chance"
        if self.falls.total <= 0.0 or self.falls.steadiness <= STEADY:
            return "heldout"
        if self.transfer is not None and self.transfer.is_denied:
            return "denied"
        return "worth" if self.gain < WORTH else None


def evaluate(
    on: Fit, grid: ScoreTest, trial: ScoreTest, *, shapes: Sequence[EffectTerm], family: SignFlips
) -> EvaluatedCandidate:
    """Judge one candidate.

    Parameters
    ----------
    on
        The system that it is tried on.
    grid, trial
        Its best on the grid (what the flips were compared with), and refined.
    shapes
        Its grid.
    family
        Chances under the flips.
    """
    tried = (*shapes, trial.added)
    chance = family.p_value(trial.added.key, grid.surprise(on.scale))
    before, after = _errors(on, trial)
    joints = sorted(after)
    return EvaluatedCandidate(
        trial=trial,
        shapes=tried,
        on=on,
        p_value=chance,
        evidence=evidence(on, trial),
        falls=leave_out(on, tried, replicate_folds(on, joints)) if chance <= NEAR else None,
        before=before,
        after=after,
    )


def evidence(on: Fit, trial: ScoreTest) -> float:
    """Twice the gain in log likelihood less (parameters) x log(runs): effects between runs have only runs to go by.

    The variance is that which is left with the effect, so that large effects are told apart as well as small ones.

    Source
    ------
    G. Schwarz, Ann. Stat. 6 (1978) 461-464; the count of clusters for that of observations.
    """
    runs = [len(row.bins.runs) for row in on.joints]
    remaining = max(on.square - trial.statistic, EXACT * on.square, np.finfo(float).tiny)
    gain = max(on.size - on.rank, 1) * float(np.log(on.square / remaining)) if trial.statistic > 0.0 else 0.0
    return gain - trial.freedoms * float(np.log(max(sum(runs) / len(runs), 2.0)))


def _errors(on: Fit, trial: ScoreTest) -> tuple[dict[int, float], dict[int, float]]:
    """RMSE (A) of samples by joint in which the effect acts, without and with it, all else refitted."""
    before, after = {}, {}
    for joint, residual in misfit_with(on, trial).items():
        row = on.row(joint)
        before[joint] = rmse(row.bins.count, row.bins.inside, row.misfit)
        after[joint] = rmse(row.bins.count, row.bins.inside, residual)
    return before, after


def misfit_with(on: Fit, trial: ScoreTest) -> dict[int, Floats]:
    """Joint in which an effect acts -> (N,) A that is left with it, all else refitted."""
    plain = {row.bins.joint: trial.added.linear(on.model.robot, row.bins.samples) for row in on.joints}
    acting = {joint: C for joint, C in plain.items() if np.any(C)}
    cross = np.zeros((len(on.inverse), trial.width))
    for k, C in acting.items():
        cross[on.row(k).acting] += on.row(k).slim.T @ on.row(k).noise.whiten(on.row(k).bins, C)
    turned = on.inverse @ cross
    lost = {k: on.row(k).bare @ turned[on.row(k).acting] for k in acting}
    return {k: on.row(k).misfit - (C - lost[k]) @ trial.sizes for k, C in acting.items()}


def rmse(count: Floats, inside: Floats, misfit: Floats) -> float:
    """RMSE (A) of samples from bins."""
    return float(np.sqrt(count @ (misfit**2 + inside) / count.sum()))


def rivals(
    chosen: EvaluatedCandidate, others: Sequence[EvaluatedCandidate], after: Fit
) -> tuple[EvaluatedCandidate, ...]:
    """Those which these data cannot tell from `chosen`.

    A rival passes the family-wise test itself, has nothing left to explain once `chosen` is in, and is not decisively
    less likely.

    Parameters
    ----------
    chosen, others
        All judged on one system.
    after
        The system with `chosen` in it.
    """
    out = []
    for other in others:
        if other.key == chosen.key or other.p_value > LEVEL or other.falls is None or other.fault == "denied":
            continue
        added, bins = other.trial.added, after
        if added.effect.periodic is not None and added.joint is not None:  # coarse bins do not show it
            bins = at_bins(after, other.on.row(added.joint).bins)
        remaining = score_at(Projector(bins), added)
        if remaining is not None and remaining.statistic > SAME * other.trial.statistic:
            continue
        if chosen.evidence - other.evidence <= DECISIVE:
            out.append(other)
    return tuple(out)


Pair = tuple[ScoreTest, ScoreTest]

#: Effects that runs held out may deny before what is left is called unexplained.
MOST_DENIED = 4
#: Looks for each addition allowed: what one look adds the next may drop, and so on without end.
LOOKS = 2
#: Shapes within this share are one where a joint may have an effect several times.
ALIKE = 0.01
#: Effects added at most, and candidates looked at closely at a time.
MOST_ADDED, LEADERS = 4, 10
#: Chance beyond which a candidate is not looked at closely, unless nothing is nearer.
FAR = 0.3


@dataclass(frozen=True, eq=False, slots=True)
class Step:
    """One look: the scan, what was chosen (None: nothing passed), its rivals, and all that were looked at closely."""

    scan: ScoreTable
    catalogue: CandidateColumns
    family: SignFlips
    chosen: EvaluatedCandidate | None
    rivals: tuple[EvaluatedCandidate, ...]
    contenders: tuple[EvaluatedCandidate, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Accepted:
    """An addition: as it was judged, and what these data cannot tell from it."""

    contender: EvaluatedCandidate
    rivals: tuple[EvaluatedCandidate, ...]


def silent(text: str) -> None:
    """Tell nobody."""


@dataclass(eq=False, slots=True)
class Stepwise:
    """A search on fitted runs: what is in the model, and how it came there.

    Attributes
    ----------
    model, runs
        The base model and the fitted runs.
    given
        Effects that the model has already.
    campaign
        That of all runs of the logs, also those that are not fitted.
    effects
        What may be added; every effect that is no part of each model where not given.
    most
        Additions at most.
    tell
        Called with a word on what is done.
    unseen
        Runs that are not fitted.
    added, steps, accepted
        What is in the model now (`given` first), each look, and why each addition was made.
    transfers
        How much of each addition runs held out show; None where they cannot.
    denied
        What was added and of which they showed too little, so that it was looked for no more.
    """

    model: Model
    runs: Sequence[Run]
    given: Sequence[EffectTerm] = ()
    campaign: Campaign | None = None
    effects: Sequence[Effect] = ()
    most: int = MOST_ADDED
    tell: Callable[[str], None] = silent
    unseen: Sequence[Run] = ()
    transfers: tuple[Transfer | None, ...] = ()
    denied: list[EvaluatedCandidate] = field(default_factory=list)
    added: list[EffectTerm] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)
    accepted: list[Accepted] = field(default_factory=list)
    _coarse: tuple[JointBins, ...] = ()
    _finest: tuple[JointBins, ...] = ()
    _unseen: tuple[tuple[JointBins, JointBins], ...] = ()
    _first: Fit | None = None

    def __post_init__(self) -> None:
        self.effects = [effect for effect in (self.effects or tuple(catalogue().values())) if not effect.base]
        self.added = list(self.given)
        self._coarse, self._finest = self._fields(self.runs)
        self._unseen = tuple(zip(*self._fields(self.unseen), strict=True)) if self.unseen else ()

    def _fields(self, runs: Sequence[Run]) -> tuple[tuple[JointBins, ...], tuple[JointBins, ...]]:
        """At coarse bins and at the finest."""
        robot, campaign = self.model.robot, self.campaign
        coarse, finest = (joint_bins(robot, runs, most=limit, campaign=campaign) for limit in (COARSE, FINE))
        return coarse, finest

    def heldout(self, added: Sequence[EffectTerm]) -> tuple[JointBins, ...]:
        """Of runs that are not fitted, at the finest bins of joints that have a periodic effect, else coarse."""
        fine = {term.joint for term in added if term.effect.periodic is not None}
        return tuple(b if a.joint in fine else a for a, b in self._unseen)

    @property
    def periodic(self) -> Effect | None:
        """The effect that is looked for by a periodogram."""
        return next((effect for effect in self.effects if effect.periodic is not None), None)

    def solved(self, added: Sequence[EffectTerm], noises: dict[int, NoiseModel] | None = None) -> Fit:
        """The model with `added`, on the finest bins of joints that have a periodic effect, else on coarse ones."""
        if self._first is None:
            self._first = fit_bins(self.model, self._coarse)
        fine = {addition.joint for addition in added if addition.effect.periodic is not None}
        chosen = [b if a.joint in fine else a for a, b in zip(self._coarse, self._finest, strict=True)]
        robot = self.model.robot
        terms = marked([*settling(self._coarse), *(term.searched(robot) for term in added)])
        fitted = refit(
            self._first, self.model.with_effects([replace(t, fitted=()) for t in terms]), bins=chosen, noise=noises
        )
        if noises is None:
            noises = {row.bins.joint: noise_of(row.bins, row.misfit) for row in fitted.joints}
        elif not added:
            return fitted
        sized = [replace(term, sizes=tuple(fitted.sizes(place).tolist())) for place, term in enumerate(terms)]
        return refit(fitted, self.model.with_effects(sized), noise=noises)

    def run(self) -> Fit:
        """Add until nothing passes, again without what runs held out deny; the final system."""
        while True:
            last = self._climb()
            held = self.heldout(self.added)
            self.transfers = tuple(confirmed_share(last, item.contender.trial.added, held) for item in self.accepted)
            refused = [
                replace(item.contender, transfer=share)
                for item, share in zip(self.accepted, self.transfers, strict=True)
                if share is not None and share.is_denied
            ]
            if not refused or len(self.denied) >= MOST_DENIED:
                return last
            self.denied += refused
            self.added, self.steps, self.accepted = list(self.given), [], []

    def _climb(self) -> Fit:
        """Add until nothing passes."""
        while True:
            self.tell(f"looking for what is missing ({len(self.added) - len(self.given)} added)")
            step = self.look(self.added)
            self.steps.append(step)
            is_full = len(self.added) - len(self.given) >= self.most
            if step.chosen is None or is_full or len(self.steps) > LOOKS * self.most:
                return step.scan.solved
            self.added.append(step.chosen.trial.added)
            self.accepted.append(Accepted(step.chosen, step.rivals))
            self._swap()

    def look(self, added: Sequence[EffectTerm]) -> Step:
        """ScoreTable with the noise that is left once the leading candidate is out, then judge the leaders."""
        solved = loaded(self.solved(added))
        tried = candidate_columns(solved, self.effects)
        table = score_candidates(solved, tried)
        lead = max(table.best().values(), key=lambda item: evidence(solved, item), default=None)
        if lead is not None and evidence(solved, lead) > DECISIVE:  # else it takes no noise with it
            solved = loaded(self.solved(added, self.solved([*added, lead.added]).noises))
            table = score_candidates(solved, tried)
        table = replace(table, spectra=self._spectra(solved))
        chances = sign_flips(table, periodic=self.periodic.name if self.periodic else None)
        pairs = self._close(table, chances)
        evaluated = [self._judged(table, tried, pair, chances) for pair in pairs]
        evaluated.sort(key=lambda item: -item.evidence)
        chosen = next((item for item in evaluated if item.fault is None), None)
        like: tuple[EvaluatedCandidate, ...] = ()
        if chosen is not None:
            like = rivals(chosen, evaluated, loaded(self.solved([*added, chosen.trial.added])))
        return Step(table, tried, chances, chosen, like, tuple(evaluated))

    def _spectra(self, solved: Fit) -> dict[int, Spectrum]:
        """Of what the solved system leaves, at the finest bins."""
        out: dict[int, Spectrum] = {}
        for fine in self._finest if self.periodic is not None else ():
            if self.periodic is None or self.periodic.applies(self.model.robot, fine.joint) is not None:
                continue
            on = at_bins(solved, fine)
            frequencies = [
                term.shape[term.effect.periodic]
                for term in [*solved.model.effects, *(item.trial.added for item in self.denied)]
                if term.effect.periodic and term.joint == fine.joint
            ]
            row = on.row(fine.joint)
            waves = spectrum(row.bins, row.noise, row.residual, scale=on.scale / solved.scale, known=frequencies)
            if waves is not None:
                out[fine.joint] = waves
        return out

    def _close(self, seen: ScoreTable, chances: SignFlips) -> list[Pair]:
        """Candidates worth a close look, on the grid and with refined shapes, periodic ones at their peaks."""
        grid = sorted(seen.best().values(), key=lambda one: -evidence(seen.solved, one))
        near = [
            trial for trial in grid if chances.p_value(trial.added.key, trial.surprise(seen.solved.scale)) <= FAR
        ] or grid[:1]
        projector = Projector(seen.solved)
        pairs = [(trial, refine_shape(projector, trial)) for trial in near[:LEADERS]]
        pairs += [pair for joint in seen.spectra for pair in self._peak(seen, joint, chances)]
        return pairs

    def _peak(self, seen: ScoreTable, joint: int, chances: SignFlips) -> list[Pair]:
        """The highest peak of a joint's spectrum, at the finest bins."""
        effect, waves = self.periodic, seen.spectra[joint]
        if effect is None or effect.periodic is None:
            return []
        statistic = waves.statistic()
        highest = float(statistic.max())
        if chances.p_value((effect.name, joint), float(minus_log10_p(highest / seen.solved.scale, 2))) > FAR:
            return []
        frequency = float(waves.frequency[int(np.argmax(statistic))])
        projector = Projector(self._at_finest(seen.solved, joint))
        trial = score_at(projector, EffectTerm(effect, joint, {effect.periodic: frequency}))
        return [] if trial is None else [(trial, refine_shape(projector, trial))]

    def _at_finest(self, solved: Fit, joint: int) -> Fit:
        return at_bins(solved, next(bins for bins in self._finest if bins.joint == joint))

    def _judged(self, seen: ScoreTable, tried: CandidateColumns, pair: Pair, chances: SignFlips) -> EvaluatedCandidate:
        added = pair[1].added
        on, shapes = seen.solved, [variant.added for variant in tried.variants if variant.added.key == added.key]
        if added.effect.periodic is not None and added.joint is not None:
            on, shapes = self._at_finest(on, added.joint), [pair[0].added]
        candidate = evaluate(on, *pair, shapes=shapes, family=chances)
        return replace(candidate, transfer=self._denial(candidate.trial.added))

    def _denial(self, added: EffectTerm) -> Transfer | None:
        """What runs held out said of an effect if they denied it; of this very shape where a joint may have several."""
        for candidate in (candidate for candidate in self.denied if candidate.key == added.key):
            shape = candidate.trial.added.shape
            if not added.effect.is_repeatable or all(np.isclose(added.shape[k], shape[k], rtol=ALIKE) for k in shape):
                return candidate.transfer
        return None

    def _swap(self) -> None:
        """Look at every earlier addition again, now that the later ones are in: drop it, or put a better one there."""
        first = len(self.given)
        place = first
        while place < len(self.added) - 1:
            rest = [term for number, term in enumerate(self.added) if number != place]
            solved = loaded(self.solved(rest, self.solved(self.added).noises))
            tried = candidate_columns(solved, self.effects)
            table, chances = score_candidates(solved, tried), self.steps[-1].family
            current = self._again(table, self.added[place])
            if current is None or chances.p_value(current.added.key, current.surprise(solved.scale)) > LEVEL:
                del self.added[place], self.accepted[place - first]
                continue
            allowed = [term for term in table.best().values() if self._denial(term.added) is None]
            top = max(allowed, key=lambda term: evidence(solved, term), default=current)
            if evidence(solved, top) > evidence(solved, current) + DECISIVE:
                pair = (top, refine_shape(Projector(solved), top))
                self.added[place] = pair[1].added
                self.accepted[place - first] = Accepted(self._judged(table, tried, pair, chances), ())
            place += 1

    def _again(self, seen: ScoreTable, added: EffectTerm) -> ScoreTest | None:
        """An addition tried on the model without it."""
        solved = seen.solved
        if added.effect.periodic is not None and added.joint is not None:
            solved = self._at_finest(solved, added.joint)
        return score_at(Projector(solved), added)
