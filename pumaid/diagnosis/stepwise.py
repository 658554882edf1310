"""Stepwise selection: evaluate the leading candidates, add the best, refit all, and exchange."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence, Set
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np

from pumaid.dataset import FirstMotions, Run
from pumaid.diagnosis.candidates import Key, Spectrum, Together, candidates, spectrum
from pumaid.diagnosis.cross_validation import (
    FoldLosses,
    confirmed_share,
    leave_out,
    refit_losses,
    replicate_folds,
    without_strongest,
)
from pumaid.diagnosis.effect_fits import EffectFits
from pumaid.diagnosis.records import Transfer
from pumaid.diagnosis.score_test import (
    DECISIVE,
    DOUBT,
    FEWEST_JOINTS,
    LEVEL,
    EvaluatedCandidate,
    ScoreTable,
    ScoreTest,
    SignFlips,
    as_body,
    chance_of_pieces,
    drives,
    evidence,
    is_few,
    misfit_with,
    price,
    refine_shape,
    score_at,
    score_candidates,
    sign_flips,
    surprise_together,
)
from pumaid.effect_spec import EffectTerm
from pumaid.effects import Effect, Family, Scope, catalogue
from pumaid.errors import ModelError
from pumaid.estimation.fit import Fit, Projector
from pumaid.estimation.noise import noise_of
from pumaid.maths import Floats, pseudo_inverse
from pumaid.model import Model

#: Chance beyond which a candidate is not looked at closely.
FAR = 0.3
#: Share of a rival's statistic that may be left once the chosen effect is in: above, it explains something else.
#: Shapes within this share are one where a joint may have an effect several times. Share of a statistic that a law
#: which is not exact may lack. Share of the chosen effect's statistic from which a less likely effect is refitted.
SAME, ALIKE, ALMOST, LARGE = 0.5, 0.01, 0.9, 0.5
#: Square of whitened residuals that a step may move at a joint so that nothing is chosen there anew: by Cauchy-Schwarz
#: no score moves by more than a third of its standard error.
MOVED = 0.1
#: Looks at most. Candidates looked at closely at a time.
#: Effects that runs held out may deny before what is left is called unexplained. Times that one instant is looked for.
MOST_LOOKS, LEADERS, MOST_DENIED, MOST_TIMINGS = 40, 10, 12, 4
#: Resolutions of a run within which waves take more than some hundredths of each other.
NEAR = 10.0
#: Share of a score that effects of other joints may make, so that all are added at one look.
APART = 0.05


@dataclass(frozen=True, eq=False, slots=True)
class Step:
    """One look: the scores, their chances, what was chosen (None: nothing passed), and all that were looked at.

    `beside` are chosen, too: each leads at another joint and hardly changes once those before it are in.
    """

    scan: ScoreTable
    family: SignFlips
    chosen: EvaluatedCandidate | None
    evaluated: tuple[EvaluatedCandidate, ...]
    beside: tuple[EvaluatedCandidate, ...] = ()


class Stepwise:
    """A search on fitted `runs` for what `model`, with the effects `given`, lacks.

    Any of `effects` may be added (every effect that is no part of each model where not given). `begun` is that of
    all runs of the logs, `unseen` are runs that are not fitted; `tell` is called with a word on what is done. `added`
    is what is in the model now (`given` first), `steps` are the looks, `accepted` the additions as they were judged,
    `denied` those of which runs held out showed too little, so that they are looked for no more, `unsteady` those of
    which runs left out did.
    """

    def __init__(
        self,
        model: Model,
        runs: Sequence[Run],
        *,
        given: Sequence[EffectTerm] = (),
        begun: FirstMotions | None = None,
        effects: Sequence[Effect] = (),
        unseen: Sequence[Run] = (),
        tell: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.model, self.runs, self.unseen, self.begun, self.tell = model, runs, unseen, begun, tell
        self.effects = [
            effect for effect in (effects or tuple(catalogue().values())) if not (effect.base or effect.is_free)
        ]
        self.periodic = next((x for x in self.effects if x.periodic is not None and not x.needs_loads), None)
        self.loaded_waves = [x for x in self.effects if x.periodic is not None and x.needs_loads]
        self.fits = EffectFits(model, runs, unseen, begun=begun)
        self._examined: list[tuple[EffectTerm, Sequence[Floats]]] = []
        self.given, self.added = list(given), list(given)
        self.steps, self.accepted, self.denied = list[Step](), list[EvaluatedCandidate](), list[EvaluatedCandidate]()
        self.unsteady = list[EffectTerm]()

    def run(self) -> Fit:
        """Add until nothing passes, again without what runs held out deny; the final system."""
        while True:
            last = self._climb()
            bins = self.fits.unseen_with(self.added)
            self.accepted = [
                replace(item, transfer=confirmed_share(last, item.trial.added, bins)) for item in self.accepted
            ]
            refused = [item for item in self.accepted if item.transfer is not None and item.transfer.is_denied]
            if not refused or len(self.denied) >= MOST_DENIED:
                return last
            self.denied += refused
            self.accepted = [item for item in self.accepted if item not in refused]
            self.added = [*self.given, *(item.trial.added for item in self.accepted)]
            with suppress(ModelError):  # without them the fit goes astray
                self._exchange()

    def _climb(self) -> Fit:
        """Add until nothing passes; then on trial what only runs that were left out speak against, until all is in."""
        models = list[list[EffectTerm]]()
        while True:
            self.tell(f"looking for what is missing ({len(self.accepted)} added)")
            step = self.look(self.added)
            self.steps.append(step)
            passed = [x for x in (step.chosen, *step.beside) if x and not _is_among(x.trial.added, self.unsteady)]
            chosen, models = passed or self._on_trial(step), [*models, self.added]
            is_again = any(  # what one adds the next may drop
                len(self.added) == len(model) and all(_is_among(term, model) for term in self.added)
                for model in models[:-1]
            )
            if not chosen or is_again or len(self.steps) > MOST_LOOKS:
                if not self._drop_unsteady():
                    return step.scan.solved
                continue
            before = list(self.added), list(self.accepted)
            for new in (chosen, chosen[:1]):
                self.added = [*before[0], *(item.trial.added for item in new)]
                self.accepted = [*before[1], *new]
                with suppress(ModelError):  # with it the fit goes astray
                    self._tune({joint for item in new for joint in item.after})
                    self._exchange(len(new))
                    break
            else:
                self.added, self.accepted = before
                models.pop()
                self.unsteady.append(chosen[0].trial.added)

    def _tune(self, joints: Set[int]) -> None:
        """Refine the frequency of each wave of some joints beside waves near it, which were missing when it was found;
        and the instant of a payload beside the ratios of gains that it shows.

        Source: B. Mamandipoor, D. Ramasamy and U. Madhow, IEEE Trans. Signal Processing 64 (2016) 5066-5081.
        """
        for place in [n for n, x in enumerate(self.added) if x.is_carried and n >= len(self.given)]:
            self._time(place)
        waves = {n: x.shape[x.effect.periodic] for n, x in enumerate(self.added) if x.effect.periodic}
        for place in (n for n in waves if self.added[n].joint in joints):
            at, step, whole = place - len(self.given), self.steps[-1], self.fits.solved(self.added)
            near = NEAR * 2.0 * np.pi / whole.by_bin[self.added[place].number].bins.samples.travel.max()
            at_joint = [n for n in waves if self.added[n].joint == self.added[place].joint and n != place]
            if not any(abs(waves[n] - waves[place]) < near for n in at_joint):
                continue
            shown = self.fits.solved([*self.added[:place], *self.added[place + 1 :]], whole.noises, beside=self.added)
            trial = score_at(Projector(shown), self.added[place])
            judged = trial and at >= 0 and self._judged(step.scan, trial, shown, chances=step.family)
            if trial and judged and judged.trial.statistic > trial.statistic + shown.scale:
                self.added[place] = judged.trial.added
                self.accepted[at] = replace(judged, p_value=self.accepted[at].p_value, rivals=self.accepted[at].rivals)

    def _time(self, place: int) -> None:
        """Look for the instant of a payload anew, as long as it moves and that meets the data better.

        Raises ModelError (effects-astray) where what then is found is no body's: it stands for something else.
        """
        from pumaid.estimation.nonlinear import search_shape  # few diagnoses need it

        for _ in range(MOST_TIMINGS):
            term, whole, at = self.added[place], self.fits.solved(self.added), place - len(self.given)
            among = [(x.key, x.shape) for x in whole.model.effects].index((term.key, term.shape))
            new = search_shape(Projector(whole.without(among)), EffectTerm(term.effect, term.joint), ["time"])[0]
            instead = [*self.added[:place], new, *self.added[place + 1 :]]
            if new.shape == term.shape or self.fits.solved(instead, whole.noises).square >= whole.square:
                break
            self.added, item = instead, self.accepted[at]
            self.accepted[at] = replace(item, trial=replace(item.trial, added=new))
        numbers, sizes = whole.columns_of(among), whole.sizes(among)
        information = pseudo_inverse(whole.inverse[np.ix_(numbers, numbers)])[0]
        if sizes @ information @ sizes - as_body(sizes, information, self.model.robot.length)[1] > DOUBT**2:
            raise ModelError("effects-astray", f"{term.effect.name} is no body's")

    def _on_trial(self, step: Step) -> list[EvaluatedCandidate]:
        """Of each joint the likeliest effect that only runs left out speak against, where these may be wrong: of
        several waves in short runs one alone predicts no other run, all together do; loads are off until refitted."""
        out, taken = list[EvaluatedCandidate](), set[int]()
        for item in step.evaluated:
            effect = item.trial.added.effect
            may_err = effect.scope is Scope.JOINT and (effect.periodic is not None or effect.needs_loads)
            is_new = item.fault == "heldout" and not _is_among(item.trial.added, self.unsteady)
            if may_err and is_new and item.evidence > DECISIVE and taken.isdisjoint(item.after):
                out.append(item)
                taken |= item.after.keys()
        return self._named(out, step.evaluated, self.added)

    def _drop_unsteady(self) -> bool:
        """Drop effects on trial until those of a joint together predict runs left out beside all else, each making
        that better; whether any went."""
        before = len(self.accepted)
        for joint in {item.trial.added.number for item in self.accepted if item.fault == "heldout"}:
            while trials := [x for x in self.accepted if x.trial.added.joint == joint and x.fault == "heldout"]:
                together, *alone = (self._losses(joint, gone) for gone in (trials, *([item] for item in trials)))
                gains = [float(losses.falls.sum()) for losses in alone]
                if together.predicts and min(gains) > 0.0:
                    judged = {
                        id(item): replace(
                            item,
                            left_out=partial(lambda losses: losses, together),
                            before={joint: losses.before},
                            after={joint: losses.after},
                        )
                        for item, losses in zip(trials, alone, strict=True)
                    }
                    self.accepted = [judged.get(id(item), item) for item in self.accepted]
                else:
                    worst = self.accepted.index(trials[int(np.argmin(gains))])
                    self.unsteady.append(self.added.pop(worst + len(self.given)))
                    del self.accepted[worst]
        if len(self.accepted) == before:
            return False
        with suppress(ModelError):  # without them the fit goes astray
            self._exchange()
        return True

    def _losses(self, joint: int, gone: Sequence[EvaluatedCandidate]) -> FoldLosses:
        """What runs of a joint that are left out say of some that are in the model, all refitted without them."""
        whole, rest = self.fits.solved(self.added), [*self.added]
        for item in gone:
            rest.remove(item.trial.added)
        without = self.fits.solved(rest, whole.noises, beside=self.added)
        return refit_losses(without, whole, replicate_folds(whole, [joint]))

    def look(self, added: Sequence[EffectTerm]) -> Step:
        """Score all candidates with the noise that is left once each joint's leading one is out, and judge.

        Were only the arm's leading one out, what another joint lacks would be noise of that joint where repeats differ
        by it.
        """
        solved = self.fits.solved(added)
        tried = candidates(solved, self.effects)
        table = score_candidates(solved, tried)
        trials = sorted(table.best().values(), key=lambda trial: evidence(solved, trial))
        leads = {trial.added.joint: trial.added for trial in trials if evidence(solved, trial) > 0.0}
        if None in leads:  # of the whole arm: it is all that leads, or explains what joints' own do
            leads = {None: leads[None]} if trials[-1].added is leads[None] else {j: leads[j] for j in leads if j}
        if leads:
            terms = list(leads.values())
            solved = self.fits.solved(added, self.fits.noises_with([*added, *terms]), beside=terms)
            table = score_candidates(solved, tried)
        table = replace(table, spectra=self._spectra(solved))
        chances = sign_flips(table)
        # A wave that grows with the load is tried where its spectrum, that of plain waves, has its peak.
        pairs = [((kind.name, waves.key[1]), waves.key) for kind in self.loaded_waves for waves in table.spectra]
        chances.handicaps.update(
            {key: chances.handicaps[plain] for key, plain in pairs if key not in chances.handicaps}
        )
        judged = (self._judged(table, grid, on, chances=chances) for grid, on in self._leaders(table, chances))
        evaluated = sorted((item for item in judged if item is not None), key=lambda item: -item.log_odds)
        chosen, shared = next((item for item in evaluated if item.fault is None), None), list[EvaluatedCandidate]()
        if chosen is None:
            shared = sorted(self._together(table, chances), key=lambda item: -item.log_odds)
            chosen = next((item for item in shared if item.fault is None), None)
        leading = [] if chosen is None else [chosen] if shared else _apart(evaluated)
        named = self._named(leading, shared or evaluated, added)
        return Step(table, chances, named[0] if named else None, (*evaluated, *shared), tuple(named[1:]))

    def _together(self, table: ScoreTable, chances: SignFlips) -> Iterator[EvaluatedCandidate]:
        """Effects that surveys find at every joint, at all joints as one, where these show them together.

        Joints at which they would have the wrong sign are left out.
        """
        solved, projector = table.solved, Projector(table.solved)
        for name, tests in table.shared().items():
            statistics = [np.array(test.statistic / solved.scale) for test in tests]
            chance = chances.p_value((name, None), float(surprise_together(statistics, [test.width for test in tests])))
            members = [refine_shape(projector, test) for test in tests if chance <= LEVEL]
            members = [test for test in members if test.sizes.any() and not drives(solved, test)]
            if len(members) < FEWEST_JOINTS:
                continue
            terms = sorted((test.added for test in members), key=lambda term: term.number)
            shape = {f"{key}@{term.joint}": value for term in terms for key, value in term.shape.items()}
            signs = np.concatenate([solved.signs(term) for term in terms])
            trial = score_at(projector, EffectTerm(Together(terms, signs), None, shape))
            judged = None if trial is None else self._judged(table, trial, solved, chances=chances)
            if judged is not None:
                yield replace(judged, p_value=chance)

    def _named(
        self,
        leading: Sequence[EvaluatedCandidate],
        evaluated: Sequence[EvaluatedCandidate],
        added: Sequence[EffectTerm],
    ) -> list[EvaluatedCandidate]:
        """The likeliest of each of those `leading` and its rivals, with its own; none where the fit goes astray.

        That something is missing, the family-wise test of a leading one shows; what it is, the odds say.
        """
        out = list[EvaluatedCandidate]()
        if not leading:
            return out
        terms = [*added, *(item.trial.added for item in leading)]
        try:
            for place, item in enumerate(leading, start=len(added)):
                rivals = self._rivals(item, evaluated, terms, place=place)
                likeliest = max((item, *rivals), key=lambda candidate: candidate.log_odds)
                if likeliest is not item:
                    instead = [*terms[:place], likeliest.trial.added, *terms[place + 1 :]]
                    rivals = self._rivals(likeliest, evaluated, instead, place=place)
                if likeliest.key not in [candidate.key for candidate in out]:
                    out.append(replace(likeliest, p_value=item.p_value, rivals=rivals))
        except ModelError:
            parts = (leading[:1], leading[1:]) if len(leading) > 1 else ()
            return next((named for part in parts if (named := self._named(part, evaluated, added))), [])
        return out

    def _spectra(self, solved: Fit) -> tuple[Spectrum, ...]:
        out, effect = [], self.periodic
        if effect is None or effect.periodic is None:
            return ()
        for bins in (bins for bins in self.fits.bins[1] if effect.applies(self.model.robot, bins.joint) is None):
            coarse, misfit, key = solved.by_bin[bins.joint].residual, solved.misfit(bins), (effect.name, bins.joint)
            noise = noise_of(bins, misfit)
            white = noise.whiten(bins, misfit)
            square = solved.square - float(coarse @ coarse) + float(white @ white)
            scale = square / max(solved.size - len(coarse) + len(bins) - solved.rank, 1) / solved.scale
            terms = [*solved.model.effects, *(item.trial.added for item in self.denied)]
            waves = [x.shape[str(x.effect.periodic)] for x in terms if x.joint == bins.joint and x.effect.periodic]
            out.append(spectrum(key, bins, noise, white=white, scale=scale, without=waves))
        return tuple(item for item in out if item is not None)

    def _leaders(self, table: ScoreTable, chances: SignFlips) -> list[tuple[ScoreTest, Fit]]:
        """Candidates worth a close look, at their best on the grid, and the fit that shows them.

        Periodic ones are at their peaks.
        """
        solved, effect = table.solved, self.periodic
        grid = sorted(table.best().values(), key=lambda trial: -evidence(solved, trial))
        near = [trial for trial in grid if _is_near(table, trial.added.key, trial.surprise(solved.scale), chances)]
        lowest = {trial.added.joint: evidence(solved, trial) - DECISIVE for trial in reversed(near)}
        likely = [trial for trial in grid if evidence(solved, trial) >= lowest.get(trial.added.joint, np.inf)]
        leaders = [(trial, solved) for trial in dict.fromkeys([*near, *likely][:LEADERS] or grid[:1])]
        for waves in table.spectra:
            slow = table.best().get(waves.key)
            if slow is not None and slow.statistic > waves.statistic().max():
                continue
            leaders = [leader for leader in leaders if leader[0] is not slow]
            if effect is None or not _is_near(table, waves.key, waves.surprise(solved.scale), chances):
                continue
            frequency = float(waves.frequency[int(np.argmax(waves.statistic()))])
            for kind in (effect, *self.loaded_waves):
                term = EffectTerm(kind, waves.key[1], {kind.periodic or "": frequency})
                on = self.fits.where_it_shows(solved, term)
                trial = score_at(Projector(on), term)
                where = self.model.robot, term.number
                if trial is not None and kind.applies(*where, in_motion=self.model.is_dynamic) is None:
                    leaders.append((trial, on))
        return leaders

    def _rivals(
        self,
        chosen: EvaluatedCandidate,
        evaluated: Sequence[EvaluatedCandidate],
        terms: Sequence[EffectTerm],
        *,
        place: int,
    ) -> tuple[EvaluatedCandidate, ...]:
        """Those which these data cannot tell from `chosen`, which is `terms[place]`; all were judged on one fit.

        A rival predicts runs that were left out, has nothing left to explain once `chosen` is in, and is not decisively
        less likely. In one posture load and position change together, and the load of a rotor and link that turn as one
        is not exact: how exact either law is decides there, and of laws of the other family the likeliest.
        """
        out, after = list[tuple[EvaluatedCandidate, bool]](), self.fits.solved(terms)
        row, rotor = chosen.on.by_bin.get(chosen.key[1] or 0), f"rotor.j{chosen.key[1]}"
        # Of an inner joint's inertia no motion shows which is its rotor's, that no gear bears.
        is_load_inexact = row is not None and bool(
            len(row.bins.postures) == 1 or (row.bins.is_block.any() and rotor not in chosen.on.model.names)
        )
        for other in evaluated:
            is_denied = other.transfer is not None and other.transfer.is_denied
            is_mixed = (
                {x.trial.added.effect.family for x in (chosen, other)} == {Family.LOAD, Family.POSITION}
                and other.key[1] == chosen.key[1]
                and is_load_inexact
                and other.trial.statistic > ALMOST * chosen.trial.statistic
            )
            is_far = not is_mixed and chosen.log_odds - other.log_odds > DECISIVE
            is_elsewhere = chosen.after.keys().isdisjoint(other.after)
            is_large = other.trial.statistic > LARGE * chosen.trial.statistic or any(
                error < chosen.after.get(joint, 0.0) for joint, error in other.after.items()
            )
            if other.key == chosen.key or is_elsewhere or is_denied or (is_far and not is_large):
                continue
            remaining = score_at(Projector(self.fits.where_it_shows(after, other.trial.added)), other.trial.added)
            if remaining is not None and remaining.statistic > SAME * other.trial.statistic:
                continue
            rival = self._refitted(other, chosen, terms, place=place) if is_far else other
            is_worse = not is_mixed and chosen.log_odds - rival.log_odds > DECISIVE
            if not is_worse and (rival.predicts or not chosen.predicts):
                out.append((rival, is_mixed))
        best = max((other.log_odds for other, is_mixed in out if is_mixed), default=0.0)
        return tuple(other for other, is_mixed in out if not is_mixed or best - other.log_odds <= DECISIVE)

    def _refitted(
        self, item: EvaluatedCandidate, chosen: EvaluatedCandidate, terms: Sequence[EffectTerm], *, place: int
    ) -> EvaluatedCandidate:
        """An effect as a refit with it in place of the `chosen` one, `terms[place]`, and runs left out of it judge it.

        Scores follow gain ratios to the first order only: what bends these much shows less than it is. By its score
        where either is felt by several joints, whose refits take long.
        """
        if any(x.trial.added.effect.scope is not Scope.JOINT for x in (item, chosen)):
            return item
        whole, rest = self.fits.solved(terms), [*terms[:place], *terms[place + 1 :]]
        instead = self.fits.solved([*rest, item.trial.added], whole.noises, beside=terms)
        if instead.size != whole.size:
            return item

        def losses() -> FoldLosses:
            without = self.fits.solved(rest, whole.noises, beside=terms)
            return refit_losses(without, instead, replicate_folds(instead, sorted(item.after)))

        gain = max(whole.size - whole.rank, 1) * float(np.log(whole.square / instead.square))
        evidence = chosen.evidence + gain + price(chosen.on, chosen.trial) - price(item.on, item.trial)
        return replace(item, evidence=evidence, left_out=cache(losses))

    def _judged(self, table: ScoreTable, grid: ScoreTest, on: Fit, *, chances: SignFlips) -> EvaluatedCandidate | None:
        """Judge a candidate at its best on the grid (what the flips were compared with), and refined.

        None where it is no friction with any shape.
        """
        trial = refine_shape(Projector(on), grid)
        if drives(on, trial):
            tests = [test for test in table.trials if test.added.key == trial.added.key and not drives(on, test)]
            if not tests:
                return None
            trial = max(tests, key=lambda test: test.statistic)
        chance = self._chance(table, grid, on, trial=trial, chances=chances)
        residuals = misfit_with(on, trial)
        before = {joint: on.by_bin[joint].rmse for joint in residuals}
        after = {joint: replace(on.by_bin[joint], misfit=residual).rmse for joint, residual in residuals.items()}
        shapes = table.candidates.groups.get(grid.added.key, (grid.added,))
        folds = replicate_folds(on, sorted(after))
        falls = cache(partial(leave_out, on, (*shapes, trial.added), folds))
        is_wide = trial.added.effect.scope is Scope.ARM and len(after) > 1
        beyond = cache(lambda: without_strongest(falls(), folds)) if is_wide else None
        return EvaluatedCandidate(
            *(trial, on, chance, evidence(on, trial), falls, before, after),
            beyond=beyond,
            transfer=self._denial(trial.added),
        )

    def _chance(self, table: ScoreTable, grid: ScoreTest, on: Fit, *, trial: ScoreTest, chances: SignFlips) -> float:
        chance, effect = chances.p_value(grid.added.key, grid.surprise(on.scale)), trial.added.effect
        if effect.scope is not Scope.JOINT:
            return chance  # what several joints feel is as free in pieces of all their runs as gravity is
        by_pieces = partial(chance_of_pieces, on, trial, table.tests)
        if effect.periodic is not None and effect.needs_loads and on.by_bin[trial.added.number].bins.is_block.any():
            chance = by_pieces()  # flips are of plain waves, which do not weigh where jerks load the joint
        elif is_few(on, trial.added.joint):
            chance = min(1.0, 2.0 * min(chance, by_pieces()))
        # Of thousands of waves some fit what repeats with the motion; laws with few shapes its parts left out deny.
        of_motion = 0.0 if effect.periodic is None else by_pieces(of_motion=True)
        return max(1.0 / (1 + len(chances.largest)), chance, of_motion)

    def _denial(self, term: EffectTerm) -> Transfer | None:
        """What runs held out said of an effect if they denied it; of this very shape where a joint may have several."""
        return next((item.transfer for item in self.denied if _is_among(term, [item.trial.added])), None)

    def _exchange(self, new: int = 0) -> None:
        """Look at additions again, now that so many `new` ones are in: drop it, or put a better one there.

        Not at a single new one, which was chosen beside all others, nor at one in whose joints what is left has hardly
        moved since it was looked at.
        """
        chances, latest = self.steps[-1].family, self.added[len(self.added) - new :]
        for current in self.added[len(self.given) :]:
            place, whole = self.added.index(current), self.fits.solved(self.added)
            rows = [row for row in whole.joints if current.touches(row.bins.joint)]
            before = next((misfits for term, misfits in self._examined if term is current), ())
            if before and all(
                len(row.misfit) == len(old) and np.sum(row.noise.whiten(row.bins, row.misfit - old) ** 2) < MOVED
                for row, old in zip(rows, before, strict=True)
            ):
                continue
            self._examined.insert(0, (current, [row.misfit for row in rows]))
            if current in latest and new == 1:
                continue
            solved = self.fits.solved([*self.added[:place], *self.added[place + 1 :]], whole.noises)
            shown = self.fits.where_it_shows(solved, current)
            again = score_at(Projector(shown), current)
            if again is None or self._chance(self.steps[-1].scan, again, shown, trial=again, chances=chances) > LEVEL:
                del self.added[place], self.accepted[place - len(self.given)]
                continue
            tried, joint = candidates(solved, self.effects), current.joint
            instead = {key: terms for key, terms in tried.groups.items() if joint is None or terms[0].touches(joint)}
            table = score_candidates(solved, replace(tried, groups=instead))
            allowed = [trial for trial in table.best().values() if self._denial(trial.added) is None]
            top = max(allowed, key=lambda trial: evidence(solved, trial), default=again)
            if evidence(solved, top) > evidence(solved, again) + DECISIVE:
                better = self._judged(table, top, solved, chances=chances)
                at = replace(self.accepted[place - len(self.given)], evidence=evidence(solved, again))
                if better is None or better.fault is not None:
                    continue
                if self._refitted(better, at, self.added, place=place).evidence > at.evidence + DECISIVE:
                    self.added[place], self.accepted[place - len(self.given)] = better.trial.added, better


def _is_among(term: EffectTerm, others: Sequence[EffectTerm]) -> bool:
    same = [other for other in others if other.key == term.key]
    return any(
        all(np.isclose(term.shape[k], shape, rtol=ALIKE) for k, shape in term.effect.chosen(other.shape).items())
        for other in same
    )


def _is_near(table: ScoreTable, key: Key, surprise: float, chances: SignFlips) -> bool:
    is_loud = is_few(table.solved, key[1]) and 10.0**-surprise * table.tests <= FAR
    return is_loud or chances.p_value(key, surprise) <= FAR


def _apart(evaluated: Sequence[EvaluatedCandidate]) -> list[EvaluatedCandidate]:
    """The leading candidate that passes, and those of other joints that hardly change once those before it are in."""
    out, shifts, taken = list[EvaluatedCandidate](), list[Floats](), set[int]()
    for item in evaluated:
        if taken.isdisjoint(item.after) and item.fault is None:
            projector = Projector(item.on)
            cross = projector.crossed(projector.whitened(projector.columns([item.trial.added])))
            moved = cross.T @ item.on.inverse @ sum(shifts, np.zeros(len(cross)))
            if moved @ pseudo_inverse(item.trial.information)[0] @ moved < APART**2 * item.trial.statistic:
                out.append(item)
                shifts.append(cross @ item.trial.sizes)
            taken |= item.after.keys()
    return out
