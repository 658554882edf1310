"""Add what explains most, refit everything, look again; and swap what was named too early."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Run
from pumaid.diagnosis.contender import DECISIVE, LEVEL, Contender, contender, evidence, rivals
from pumaid.diagnosis.familywise import Familywise, family
from pumaid.diagnosis.periodogram import Spectrum, spectrum
from pumaid.diagnosis.refine import at, refined
from pumaid.diagnosis.scan import Projector, Scan, Trial, scan, surprise
from pumaid.diagnosis.settling import settling
from pumaid.diagnosis.transfer import transfer
from pumaid.diagnosis.variants import Catalogue, build
from pumaid.effect_spec import EffectTerm, marked
from pumaid.effects import Effect, catalogue
from pumaid.estimation.fit import Fit, at_bins, loaded
from pumaid.estimation.gls import fit_bins, refit
from pumaid.estimation.noise import Noise, noise_of
from pumaid.joint_bins import COARSE, FINE, JointBins, joint_bins
from pumaid.model import Model
from pumaid.records import Campaign, Transfer

Floats = NDArray[np.float64]
Pair = tuple[Trial, Trial]
Key = tuple[str, int | None]

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

    scan: Scan
    catalogue: Catalogue
    family: Familywise
    chosen: Contender | None
    rivals: tuple[Contender, ...]
    contenders: tuple[Contender, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Accepted:
    """An addition: as it was judged, and what these data cannot tell from it."""

    contender: Contender
    rivals: tuple[Contender, ...]


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
    denied: list[Contender] = field(default_factory=list)
    added: list[EffectTerm] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)
    accepted: list[Accepted] = field(default_factory=list)
    _coarse: tuple[JointBins, ...] = ()
    _finest: tuple[JointBins, ...] = ()
    _unseen: tuple[tuple[JointBins, JointBins], ...] = ()
    _first: Fit | None = None

    def __post_init__(self) -> None:
        self.effects = [one for one in (self.effects or tuple(catalogue().values())) if not one.base]
        self.added = list(self.given)
        self._coarse, self._finest = self._fields(self.runs)
        self._unseen = tuple(zip(*self._fields(self.unseen), strict=True)) if self.unseen else ()

    def _fields(self, runs: Sequence[Run]) -> tuple[tuple[JointBins, ...], tuple[JointBins, ...]]:
        """At coarse bins and at the finest."""
        robot, campaign = self.model.robot, self.campaign
        coarse, finest = (joint_bins(robot, runs, most=most, campaign=campaign) for most in (COARSE, FINE))
        return coarse, finest

    def heldout(self, added: Sequence[EffectTerm]) -> tuple[JointBins, ...]:
        """Of runs that are not fitted, at the finest bins of joints that have a periodic effect, else coarse."""
        fine = {one.joint for one in added if one.effect.periodic is not None}
        return tuple(b if a.joint in fine else a for a, b in self._unseen)

    @property
    def periodic(self) -> Effect | None:
        """The effect that is looked for by a periodogram."""
        return next((one for one in self.effects if one.periodic is not None), None)

    def solved(self, added: Sequence[EffectTerm], noises: dict[int, Noise] | None = None) -> Fit:
        """The model with `added`, on the finest bins of joints that have a periodic effect, else on coarse ones."""
        if self._first is None:
            self._first = fit_bins(self.model, self._coarse)
        fine = {one.joint for one in added if one.effect.periodic is not None}
        chosen = [b if a.joint in fine else a for a, b in zip(self._coarse, self._finest, strict=True)]
        robot = self.model.robot
        terms = marked([*settling(self._coarse), *(term.searched(robot) for term in added)])
        found = refit(
            self._first, self.model.with_effects([replace(t, fitted=()) for t in terms]), bins=chosen, noise=noises
        )
        if noises is None:
            noises = {row.bins.joint: noise_of(row.bins, row.misfit) for row in found.joints}
        elif not added:
            return found
        sized = [replace(term, sizes=tuple(found.sizes(place).tolist())) for place, term in enumerate(terms)]
        return refit(found, self.model.with_effects(sized), noise=noises)

    def run(self) -> Fit:
        """Add until nothing passes, again without what runs held out deny; the final system."""
        while True:
            last = self._climb()
            held = self.heldout(self.added)
            self.transfers = tuple(transfer(last, one.contender.trial.added, held) for one in self.accepted)
            refused = [
                replace(one.contender, transfer=found)
                for one, found in zip(self.accepted, self.transfers, strict=True)
                if found is not None and found.is_denied
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
        """Scan with the noise that is left once the leading candidate is out, then judge the leaders."""
        solved = loaded(self.solved(added))
        tried = build(solved, self.effects)
        seen = scan(solved, tried)
        lead = max(seen.best().values(), key=lambda one: evidence(solved, one), default=None)
        if lead is not None and evidence(solved, lead) > DECISIVE:  # else it takes no noise with it
            solved = loaded(self.solved(added, self.solved([*added, lead.added]).noises))
            seen = scan(solved, tried)
        seen = replace(seen, spectra=self._spectra(solved))
        chances = family(seen, periodic=self.periodic.name if self.periodic else None)
        pairs = self._close(seen, chances)
        found = [self._judged(seen, tried, pair, chances) for pair in pairs]
        found.sort(key=lambda one: -one.evidence)
        chosen = next((one for one in found if one.fault is None), None)
        like: tuple[Contender, ...] = ()
        if chosen is not None:
            like = rivals(chosen, found, loaded(self.solved([*added, chosen.trial.added])))
        return Step(seen, tried, chances, chosen, like, tuple(found))

    def _spectra(self, solved: Fit) -> dict[int, Spectrum]:
        """Of what the solved system leaves, at the finest bins."""
        out: dict[int, Spectrum] = {}
        for fine in self._finest if self.periodic is not None else ():
            if self.periodic is None or self.periodic.applies(self.model.robot, fine.joint) is not None:
                continue
            on = at_bins(solved, fine)
            known = [
                one.shape[one.effect.periodic]
                for one in [*solved.model.effects, *(each.trial.added for each in self.denied)]
                if one.effect.periodic and one.joint == fine.joint
            ]
            found = spectrum(on.row(fine.joint), scale=on.scale / solved.scale, known=known)
            if found is not None:
                out[fine.joint] = found
        return out

    def _close(self, seen: Scan, chances: Familywise) -> list[Pair]:
        """Candidates worth a close look, on the grid and with refined shapes, periodic ones at their peaks."""
        scale = seen.solved.scale

        def chance(trial: Trial) -> float:
            return chances.p_value(trial.added.key, float(surprise(trial.statistic / scale, trial.width)))

        grid = sorted(seen.best().values(), key=lambda one: -evidence(seen.solved, one))
        near = [trial for trial in grid if chance(trial) <= FAR] or grid[:1]
        projector = Projector(seen.solved)
        pairs = [(trial, refined(projector, trial)) for trial in near[:LEADERS]]
        pairs += [pair for joint in seen.spectra for pair in self._peak(seen, joint, chances)]
        return pairs

    def _peak(self, seen: Scan, joint: int, chances: Familywise) -> list[Pair]:
        """The highest peak of a joint's spectrum, at the finest bins."""
        effect, found = self.periodic, seen.spectra[joint]
        if effect is None or effect.periodic is None:
            return []
        statistic = found.statistic()
        highest = float(statistic.max())
        if chances.p_value((effect.name, joint), float(surprise(highest / seen.solved.scale, 2))) > FAR:
            return []
        frequency = float(found.frequency[int(np.argmax(statistic))])
        projector = Projector(self._at_finest(seen.solved, joint))
        trial = at(projector, EffectTerm(effect, joint, {effect.periodic: frequency}))
        return [] if trial is None else [(trial, refined(projector, trial))]

    def _at_finest(self, solved: Fit, joint: int) -> Fit:
        return at_bins(solved, next(one for one in self._finest if one.joint == joint))

    def _judged(self, seen: Scan, tried: Catalogue, pair: Pair, chances: Familywise) -> Contender:
        added = pair[1].added
        on, shapes = seen.solved, [one.added for one in tried.variants if one.added.key == added.key]
        if added.effect.periodic is not None and added.joint is not None:
            on, shapes = self._at_finest(on, added.joint), [pair[0].added]
        found = contender(on, *pair, shapes=shapes, family=chances)
        return replace(found, transfer=self._denial(found.trial.added))

    def _denial(self, added: EffectTerm) -> Transfer | None:
        """What runs held out said of an effect if they denied it; of this very shape where a joint may have several."""
        for one in (one for one in self.denied if one.key == added.key):
            shape = one.trial.added.shape
            if not added.effect.is_repeatable or all(np.isclose(added.shape[k], shape[k], rtol=ALIKE) for k in shape):
                return one.transfer
        return None

    def _swap(self) -> None:
        """Look at every earlier addition again, now that the later ones are in: drop it, or put a better one there."""
        first = len(self.given)
        place = first
        while place < len(self.added) - 1:
            rest = [one for number, one in enumerate(self.added) if number != place]
            solved = loaded(self.solved(rest, self.solved(self.added).noises))
            tried = build(solved, self.effects)
            seen, chances = scan(solved, tried), self.steps[-1].family
            own = self._again(seen, self.added[place])
            if own is None or chances.p_value(own.added.key, _surprise(seen, own)) > LEVEL:
                del self.added[place], self.accepted[place - first]
                continue
            others = [one for one in seen.best().values() if self._denial(one.added) is None]
            top = max(others, key=lambda one: evidence(solved, one), default=own)
            if evidence(solved, top) > evidence(solved, own) + DECISIVE:
                pair = (top, refined(Projector(solved), top))
                self.added[place] = pair[1].added
                self.accepted[place - first] = Accepted(self._judged(seen, tried, pair, chances), ())
            place += 1

    def _again(self, seen: Scan, added: EffectTerm) -> Trial | None:
        """An addition tried on the model without it."""
        solved = seen.solved
        if added.effect.periodic is not None and added.joint is not None:
            solved = self._at_finest(solved, added.joint)
        return at(Projector(solved), added)


def _surprise(seen: Scan, trial: Trial) -> float:
    return float(surprise(trial.statistic / seen.solved.scale, trial.width))
