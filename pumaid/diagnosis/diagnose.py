"""Diagnose: which effect a model misses, with the evidence, its picture, the rivals, and the run that would decide."""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pumaid.dataset import CONSTANT, STROKE, Dataset, Run, first_motions
from pumaid.diagnosis.candidates import Suspect, Together
from pumaid.diagnosis.compare import budget
from pumaid.diagnosis.cross_validation import forecast
from pumaid.diagnosis.detection_limits import TINY, detection_limits
from pumaid.diagnosis.free_forms import FORM_VARIABLES, FormTest, free_form_tests, knot_values
from pumaid.diagnosis.late_currents import current_late
from pumaid.diagnosis.learned_curves import CurveOffer, curve_size, offer
from pumaid.diagnosis.records import (
    ABSENT,
    ADD,
    ADEQUATE,
    DOUBTFUL,
    MISSING,
    STAND_IN,
    UNEXPLAINED_JOINT,
    Binned,
    Candidate,
    Curve,
    Diagnosis,
    Finding,
    JointDiagnosis,
    Line,
    Size,
    Unexplained,
    causes_in,
)
from pumaid.diagnosis.score_test import (
    DECISIVE,
    LEVEL,
    EvaluatedCandidate,
    covariance_of,
    misfit_with,
    replicate_test,
)
from pumaid.diagnosis.stepwise import Stepwise
from pumaid.effect_spec import EffectTerm, expanded, option_text, reopened, terms_of
from pumaid.effects import Family, Samples, Scope, catalogue
from pumaid.effects.curve import knots_of, spoken_form
from pumaid.errors import LogError, ModelError, Note, Where
from pumaid.estimate import Estimate, JointFit
from pumaid.estimation.fit import Fit
from pumaid.estimation.noise import FEWEST_PAIRS
from pumaid.estimation.nonlinear import effect_bins, fit_effects
from pumaid.joint_bins import JointBins, distinct
from pumaid.maths import Floats, pseudo_inverse
from pumaid.model import Model
from pumaid.preprocessing.hold_out import held_out_otherwise, is_fitted_to
from pumaid.results.documents import check_same_recipe, model_digest
from pumaid.robot import SHAPE_WORDS, EffectChoice, Robot

#: How a command that adds an effect begins; whoever knows the logs puts them in.
IDENTIFY = "pumaid identify LOGS"
#: Cosine of two parameters' information beyond which only their sum, or difference, is told.
TOGETHER = 0.95
#: Candidates listed for a joint. Joints whose picture a finding of several joints carries. Runs at constant speed from
#: which a joint's strokes are not needed.
LISTED, PICTURES, STEADY = 5, 2, 12


def sizes(term: EffectTerm, robot: Robot, values: Floats, *, covariance: Floats) -> tuple[Size, ...]:
    """An effect's parameters with standard errors; of two of which only the sum or difference is known, that."""
    if isinstance(term.effect, Together):
        widths = [len(single.parameters(robot)) for single in term.effect.terms]
        parts = np.split(np.arange(len(values)), np.cumsum(widths)[:-1])
        by_joint = [
            (single.joint, sizes(single, robot, values[part], covariance=covariance[np.ix_(part, part)]))
            for single, part in zip(term.effect.terms, parts, strict=True)
        ]
        return tuple(replace(size, name=f"{size.name}@{joint}") for joint, group in by_joint for size in group)
    errors = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    alone = tuple(
        Size(parameter.name, float(value), float(error) if np.isfinite(error) else None, parameter.unit)
        for parameter, value, error in zip(term.parameters(robot), values, errors, strict=True)
    )
    if len(alone) != 2 or alone[0].unit != alone[1].unit or not np.isfinite(errors).all():
        return alone
    information, (first, second) = pseudo_inverse(covariance)[0], alone
    cosine = information[0, 1] / np.sqrt(max(information[0, 0] * information[1, 1], np.finfo(float).tiny))
    if abs(cosine) < TOGETHER:
        return alone
    sign, word = float(np.sign(cosine)), "+" if cosine > 0.0 else "-"
    error = float(np.sqrt(covariance.trace() + 2.0 * sign * covariance[0, 1]))
    return (Size(f"{first.name} {word} {second.name}", first.value + sign * second.value, error, first.unit),)


def reason(candidate: EvaluatedCandidate, better: str | None = None) -> str:
    """Why a candidate has the verdict that it has; `better` is what was chosen instead of it."""
    gain = 100.0 * candidate.gain
    return {
        "chance": "chance, or motion that is made again and again, makes something as good in these data",
        "heldout": "it does not predict runs that were left out any better",
        "single": "runs of a single joint show it, where the whole arm would feel it",
        "denied": "runs that were held out show too little of it, or are predicted decidedly worse with it",
        "worth": f"it would lower the error by {gain:.1g} % only" if gain > 0.0 else "it lowers no error",
        None: f"it would lower the error by {gain:.2g} %, but {better} explains the same and more"
        if better
        else f"it lowers the error by {gain:.2g} % and predicts runs that were left out",
    }[candidate.fault]


def weakened(bins: JointBins, runs: Sequence[Run]) -> tuple[str, ...]:
    """What makes a joint's diagnosis weaker than it could be."""
    pairs, speeds, directions = len(bins.pairs), len(bins.speeds), bins.directions
    repeated = {0: "no run is", 1: "only one run is"}.get(pairs, f"only {pairs} runs are")
    posture = "one posture only: what depends on the load cannot be told from what depends on the position"
    direction = "one direction only: friction cannot be told from what pushes the same way in both"
    claims = {
        f"{repeated} repeated, so noise is told from missing physics by the residual alone": pairs < FEWEST_PAIRS,
        posture: len(bins.postures) == 1,
        f"{speeds} speed{'s' if speeds > 1 else ''} only: effects of speed are absorbed": speeds < 3,
        "three speeds only: an effect of speed shows its height there, not its course between": speeds == 3,
        direction: len(directions) == 1,
        "strokes from rest to rest: speed, position and start of a run change together": any(
            r.kind == STROKE for r in bins.runs
        ),
        "one joint only: gravity's loads cannot be checked against other joints": len({r.joint for r in runs}) == 1,
    }
    return tuple(text for text, holds in claims.items() if holds)


#: Bins over a span: narrow enough for the shapes of the catalogue, wide enough to hold several runs each.
FINE, COARSE = 32, 16
#: Share of the speed by which bins of a run at constant speed differ from its mean at most.
SAME_SPEED = 0.1
#: Of a family of effects, the variable that shows it; a family that is not named is shown by what the effect itself
#: adds.
VARIABLES = {
    Family.SPEED: "speed",
    Family.LOAD: "load",
    Family.POSITION: "position",
    Family.TORQUE: "position",
    Family.RIPPLE: "position",
    Family.PAYLOAD: "time",
    Family.START: "travel",
    Family.TIME: "time",
    Family.TEMPERATURE: "temperature",
    Family.CURRENT: "current",
}


@dataclass(frozen=True, eq=False, slots=True)
class Axis:
    """What a picture is drawn against: a word or two, the unit, (M,) values at the bins of the runs, the number of
    bins of the picture (None where equal values stand together), the period of a folded variable."""

    variable: str
    unit: str
    values: Floats
    bins: int | None = COARSE
    period: float | None = None

    def labels(self) -> Floats:
        """(M,) number of the picture's bin of each value; bins of travel are narrow where the motion begins."""
        if self.bins is None:
            return np.searchsorted(distinct(self.values.tolist()), self.values, side="right").astype(float)
        low, high = (0.0, self.period) if self.period else (np.nanmin(self.values), np.nanmax(self.values))
        share = (self.values - low) / (high - low if high > low else 1.0)
        if self.variable.startswith("travel"):
            share = np.sqrt(share)
        return np.minimum(np.floor(share * self.bins), self.bins - 1)


def curve(robot: Robot, samples: Samples, *, before: Floats, trials: Sequence[tuple[EffectTerm, Floats]]) -> Curve:
    """Bin what is left before and after an effect is added, with the effect's own line and its rivals'.

    A line is what adding the effect changes in the model at the bins, so that it runs through what is left before.

    Parameters
    ----------
    robot
        The arm.
    samples
        M bins of all runs of one joint; `Samples.run` tells them apart.
    before
        (M,) A left without the effect.
    trials
        The effect found, then its rivals, each with (M,) A that is left with it.

    Returns
    -------
    curve
        A side for each direction of motion that was run.
    """
    (term, after), sides, lines = trials[0], [], []
    axis = _axis(robot, samples, term, change=before - after)
    for way in (1, -1):
        label = np.where((samples.direction == way) & np.isfinite(axis.values), axis.labels(), np.nan)
        if np.isnan(label).all():
            continue
        places, mean = (_means(values, label, samples.run)[0] for values in (axis.values, before))
        sides.append(Binned(way, places, mean, *_means(after, label, samples.run)))
        for shown, misfit in trials:
            lines.append(Line(shown.effect.name, way, places, _means(before - misfit, label, samples.run)[0]))
    names = [drawn.effect.name for drawn, _ in trials]
    lines.sort(key=lambda line: names.index(line.effect))
    return Curve(samples.joint, axis.variable, axis.unit, tuple(sides), tuple(lines), axis.period)


def _axis(robot: Robot, samples: Samples, term: EffectTerm, *, change: Floats) -> Axis:
    column, unit, effect = samples.joint - 1, robot.joint(samples.joint).position_unit, term.effect
    position, effect = samples.position[:, column], catalogue().get(effect.name, effect)
    shown = SHAPE_WORDS["of"][int(term.shape["of"])] if effect.is_free else VARIABLES.get(effect.family, "")
    if isinstance(effect, Suspect) and samples.extra is not None:
        return Axis(effect.column, "", samples.extra[:, effect.place])
    frequency = term.shape.get(effect.periodic or "", 0.0)
    if frequency > 0.0:
        period = 2.0 * math.pi / frequency
        return Axis("position within one period", unit, np.mod(position, period), FINE, period)
    run, speed = np.unique(samples.run, return_inverse=True)[1], np.abs(samples.velocity[:, column])
    mean = (np.bincount(run, speed) / np.bincount(run))[run]
    is_constant = float(np.median(np.abs(speed - mean))) < SAME_SPEED * float(np.median(speed))
    axes = {
        "speed": Axis("speed", f"{unit}/s", *((mean, None) if is_constant else (speed, COARSE))),
        "position": Axis("position", unit, position, FINE),
        "travel": Axis("travel since the motion began", unit, samples.travel, FINE),
        "time": Axis("time since the first motion", "s", samples.time),
    }
    if np.isfinite(samples.temperature).any():
        axes["temperature"] = Axis("temperature", "degC", samples.temperature)
    if samples.loads is not None:
        axes["current"] = Axis("predicted current", "A", samples.loads.drawn)
        across = Axis("moment across the axis", "A", samples.loads.across)
        axes["load"] = across if "side" in effect.name else Axis("gravity load", "A", samples.loads.moving)
    return axes.get(shown, Axis("what it adds", "A", change))


def _means(values: Floats, label: Floats, run: Floats) -> tuple[Floats, Floats, Floats]:
    """Means over runs in each bin, their standard errors (NaN of one run), and how many runs there are."""
    is_valid = np.isfinite(label)
    both, where = np.unique(np.column_stack([label[is_valid], run[is_valid]]), axis=0, return_inverse=True)
    where = np.ravel(where)
    by_run = np.bincount(where, values[is_valid]) / np.bincount(where)
    _, at = np.unique(both[:, 0], return_inverse=True)
    runs = np.bincount(at)
    mean = np.bincount(at, by_run) / runs
    error = np.sqrt(np.bincount(at, (by_run - mean[at]) ** 2) / np.where(runs > 1, runs * (runs - 1.0), np.nan))
    return mean, error, runs.astype(float)


#: Chance, over all joints together, below which what repeats between replicates is not noise. Chance, over all joints
#: together, below which a free form is more than noise.
REPEATS, NAMELESS = 0.005, 0.01
#: Share of the excess over the noise floor that what was added must take away. Excess of the mean square over the
#: floor below which there is none to speak of.
ENOUGH, EXCESS = 0.8, 1.02


def joint_verdict(first: Fit, last: Fit, *, joint: int, acting: bool) -> JointDiagnosis:
    """One joint's verdict, what repeats, and the shape of what has no name, without the rest of its diagnosis.

    It is that of the fits as it was given and with all that was added; `acting`: something of it acts there.
    """
    a, b = first.by_bin[joint], last.by_bin[joint]
    before, after = (replicate_test(item.bins, item.misfit, item.residual) for item in (a, b))
    is_repeated = after is not None and after.p_value * len(last.joints) <= REPEATS and after.share > EXCESS - 1.0
    forms = free_form_tests(last, joint)
    best = next((form for form in forms if form.p_value * len(last.joints) <= NAMELESS), None)
    is_clear = best is not None and best.evidence > DECISIVE
    is_gone, shape = False, None
    verdict = MISSING if acting else ADEQUATE
    if acting and after is not None and after.floor is not None:
        inside = b.bins.inside_left(b.bins.current - b.misfit)
        floor2 = after.floor**2 + float(b.bins.count @ inside / b.bins.count.sum())
        start2, end2 = a.rmse**2, b.rmse**2
        is_gone = start2 > EXCESS * floor2 and start2 - end2 >= ENOUGH * (start2 - min(floor2, end2))
    if is_clear or (is_repeated and not is_gone):
        verdict, top = UNEXPLAINED_JOINT, best or next(iter(forms), None)
        shape = None if top is None else _shape(top, is_clear=is_clear)
    return JointDiagnosis(joint, verdict, "", a.rmse, None, before, unexplained=shape)


def _shape(test: FormTest, *, is_clear: bool) -> Unexplained:
    free, trial, solved, (knots, values, errors) = test.form, test.trial, test.on, knot_values(test)
    unit = FORM_VARIABLES[free.variable][0].format(unit=solved.model.robot.joint(trial.added.number).position_unit)
    peak = float(knots[int(np.argmax(np.abs(values)))])
    row = solved.by_bin[trial.added.number]
    freedom = len(row.bins) * (1.0 - solved.rank / max(solved.size, 1))
    explained = max(trial.statistic - trial.width, 0.0)
    excess = max(float(row.residual @ row.residual) - freedom, explained)
    gain = explained / excess if excess > 0.0 else 0.0
    text = f"what is left looks like {free.name}, largest at {peak:.3g} {unit}"
    return Unexplained(
        *(free.name, free.variable, unit, knots, values, errors, peak, float(gain), text), is_clear=is_clear
    )


#: FreeForm forms that are a family's own, and so no competitors of its effects.
OWN = {
    Family.SPEED: {"s f(v)"},
    Family.LOAD: {"s f(load)"},
    Family.POSITION: {"s f(q)"},
    Family.START: {"s f(travel)"},
    Family.TIME: {"s f(t)", "f(t)"},
    Family.TEMPERATURE: {"s f(t)", "f(t)"},
    Family.TORQUE: {"f(q)"},
}


def free_shape(
    solved: Fit, joint: int, *, families: Iterable[Family] = (), beyond: float = -np.inf
) -> Unexplained | None:
    """The free form, other than some families' own, that explains a joint best, if its evidence is `beyond`."""
    skipped = set[str]().union(*(OWN.get(family, set()) for family in families))
    best = next((test for test in free_form_tests(solved, joint) if test.form.name not in skipped), None)
    if best is None or best.evidence <= beyond:
        return None
    return _shape(best, is_clear=best.evidence > DECISIVE)


class DiagnosisBuilder:
    """Everything that a finished search (after `Stepwise.run`) has to say of a model of `runs` that has effects."""

    def __init__(self, search: Stepwise, choices: Sequence[EffectChoice], runs: Sequence[Run]) -> None:
        self.search, self.robot, self.choices, self.runs = search, search.model.robot, choices, runs
        self.base = self._identified(choices)
        self.fits = [step.scan.solved for step in search.steps]
        self.late = current_late(self.fits[0], search.fits.bins[1])
        last = search.steps[-1]
        self.limits = sorted(
            detection_limits(last.scan, last.family).values(), key=lambda limit: (limit.effect, limit.joint or 0)
        )
        acting = {joint for item in search.accepted for joint in item.after}
        self.verdicts = {
            joint: joint_verdict(self.fits[0], self.fits[-1], joint=joint, acting=joint in acting)
            for joint in self.fits[0].by_bin
        }
        self.offers = list[CurveOffer]()
        self.refuted = {joint for item in search.denied for joint in item.shown_at} - acting
        self.refuted |= {
            joint
            for item in search.accepted
            if item.transfer is not None and item.transfer.is_partial
            for joint in item.shown_at
        }
        for joint in self.verdicts:
            is_open = self.verdicts[joint].verdict == UNEXPLAINED_JOINT or self._shape(joint) is not None
            self.offers += [made] if (made := offer(search, joint, is_unexplained=is_open)) else []
        self.stand_ins = {item for made in self.offers for item in made.stand_ins}

    def findings(self) -> tuple[Finding, ...]:
        """What should be added to the model, by worth, then curves; not what stood in for one.

        The command of each adds those before it, too, and its forecast is what held-out runs show of just that model.
        """
        search, out, head, choices = self.search, list[Finding](), IDENTIFY, self.choices
        noise = {joint: row.rmse for joint, row in self.fits[-1].by_bin.items()}
        chosen = sorted((x for x in search.accepted if x not in self.stand_ins), key=lambda x: -x.worth(noise))
        chosen += [made.candidate for made in self.offers]
        terms = [*search.given, *(item.trial.added for item in chosen)]
        heldout = effect_bins(self.robot, search.unseen, terms, begun=search.begun)
        before = self.base if heldout else None
        waiting = [(item, self.finding(item)) for item in chosen]
        rest = dict[EvaluatedCandidate, Finding]()
        while waiting:
            tried = list[tuple[EvaluatedCandidate, Finding, int]]()
            for candidate, first in waiting:
                unseen = [part for part in heldout if part.joint in candidate.after]
                finding, after = replace(first, command=first.command.replace(IDENTIFY, head, 1)), None
                more = (*choices, *first.choices()) if first.command else choices  # no command adds a suspected column
                if before and unseen and first.command:
                    after = self._identified(more)
                    finding = forecast(finding, before, after, unseen=unseen)
                if finding.verdict == ADD and first.command:
                    head, before, choices = finding.command, after or before, more
                if finding.rmse_heldout_before is not None and finding.rmse_heldout_after is not None:
                    fall = finding.rmse_heldout_before - finding.rmse_heldout_after
                    spread = np.sqrt(np.mean([noise[joint] ** 2 for joint in candidate.after]))
                    finding = replace(finding, worth=fall / max(float(spread), TINY))
                rest[candidate] = finding
                out += [rest.pop(candidate)] if finding.verdict == ADD else []
                tried += [(candidate, first, len(out))] * (finding.verdict != first.verdict)
            # What lowers no error of runs held out may do so beside others there: of several waves, one alone may not.
            waiting = [(item, first) for item, first, n in tried if any(x.joint in item.after for x in out[n:])]
        return (*out, *rest.values())

    def _identified(self, choices: Sequence[EffectChoice]) -> Fit | None:
        """The model with some effects as `identify` fits it; None where it would refuse that."""
        with suppress(ModelError):
            return fit_effects(self.search.model, self.runs, expanded(choices, self.robot), begun=self.search.begun).fit
        return None

    def finding(self, candidate: EvaluatedCandidate) -> Finding:
        """What to add, without what runs held out will show."""
        term, transfer = candidate.trial.added, candidate.transfer
        facts = self._facts(candidate, candidate.rivals)
        rival, next_run = next((rival for rival in candidate.rivals if rival.on is candidate.on), None), None
        if rival is not None and not facts["joints"]:
            from pumaid.diagnosis.discrimination import deciding  # loads the engine of collisions

            next_run = deciding(rival.on, candidate.trial, rival.trial)
        fit, keys = self.fits[-1], [effect.key for effect in self.fits[-1].model.effects]
        if term.effect.scope is not Scope.JOINT and term.key in keys:
            # What several joints feel moves gravity and gain ratios, which a score follows to first order only.
            index = keys.index(term.key)
            columns = [n for n in fit.columns_of(index) if fit.model.columns[n].shape is None]
            facts["sizes"] = sizes(
                fit.model.effects[index],
                self.robot,
                fit.values[columns],
                covariance=fit.inverse[np.ix_(columns, columns)] * fit.scale,
            )
        return Finding(
            **facts,
            verdict=DOUBTFUL if transfer is not None and transfer.is_denied else ADD,
            reason=reason(candidate),
            next_run=next_run,
            curves=tuple(
                self._curve(candidate, joint)
                for joint in sorted(candidate.after, key=lambda j: candidate.after[j] / candidate.before[j])[:PICTURES]
            ),
            transfer=transfer,
        )

    def _curve(self, candidate: EvaluatedCandidate, joint: int) -> Curve:
        row, drawn = candidate.on.by_bin[joint], []
        for item in (candidate, *candidate.rivals):
            residual = misfit_with(item.on, item.trial).get(joint)
            if residual is not None and len(residual) == len(row.misfit):
                drawn.append((item.trial.added, residual))
        return curve(self.robot, row.bins.samples, before=row.misfit, trials=drawn)

    def joint(self, joint: int, fit: JointFit | None) -> JointDiagnosis:
        """What is wrong at one joint (from 1), which the model fits like `fit`, if it is fitted to these logs."""
        judged = self.verdicts.get(joint)
        if judged is None:
            return JointDiagnosis(joint, ADEQUATE, f"joint {joint} never moves alone in these logs", None, None)
        row, shape = (self.base or self.fits[0]).by_bin[joint], self._shape(joint)
        split = budget(row.bins, row.misfit, self.robot.joint(joint), floor=fit.noise_floor if fit else None)
        return replace(
            judged,
            rmse=fit.rmse if fit else row.rmse,
            verdict=UNEXPLAINED_JOINT if shape is not None or joint in self.refuted else judged.verdict,
            noise_floor=None if split.floor is None else float(np.sqrt(split.floor)),
            noise_inside=fit.noise_inside if fit else None,
            budget={part.name: part.mean_square for part in split.parts},
            candidates=self._candidates(joint),
            unexplained=shape or judged.unexplained,
            limits=tuple(limit for limit in self.limits if limit.joint in (joint, None)),
            weakened=weakened(self.fits[0].by_bin[joint].bins, self.search.runs),
        )

    def _shape(self, joint: int) -> Unexplained | None:
        """A shape without a name that explains a joint decisively better than what was named there.

        Where runs held out deny what could be named, or show not all of it, the shape nearest to what is left.
        """
        for made in self.offers:
            term = made.candidate.trial.added
            forms = free_form_tests(made.before, joint) if term.joint == joint else []
            for test in (test for test in forms if test.form.name == spoken_form(term.shape)):
                return _shape(test, is_clear=True)
        if joint in self.refuted:
            return free_shape(self.fits[-1], joint)
        named = [item for item in self.search.accepted if item.key[1] == joint]
        families = [item.trial.added.effect.family for item in named]
        enough = DECISIVE + sum(item.evidence for item in named)
        return free_shape(self.fits[0], joint, families=families, beyond=enough) if named else None

    def _candidates(self, joint: int) -> tuple[Candidate, ...]:
        search = self.search
        judged = [
            *(item for step in reversed(search.steps) for item in reversed(step.evaluated)),
            *reversed(search.denied),
            *reversed(search.accepted),
        ]
        by_key = {item.key: item for item in judged if joint in item.after}
        best = sorted(by_key.values(), key=lambda item: (self._verdict(item) != ADD, -item.evidence))
        return tuple(self._candidate(item) for item in best[:LISTED])

    def _partner(self, candidate: EvaluatedCandidate) -> EvaluatedCandidate | None:
        return next((x for x in self.search.accepted if candidate.key in [rival.key for rival in x.rivals]), None)

    def _verdict(self, candidate: EvaluatedCandidate) -> str:
        if candidate in self.stand_ins:
            return STAND_IN
        if candidate.key in [item.key for item in self.search.accepted] and candidate.fault != "denied":
            return ADD
        return DOUBTFUL if self._partner(candidate) is not None or candidate.p_value <= LEVEL else ABSENT

    def _candidate(self, candidate: EvaluatedCandidate) -> Candidate:
        partner, verdict, like = self._partner(candidate), self._verdict(candidate), candidate.rivals
        if partner is not None:
            like = (partner, *(rival for rival in partner.rivals if rival.key != candidate.key))
        beside = [item for item in self.search.accepted if item.after.keys() & candidate.after.keys()]
        better = max(beside or self.search.accepted, key=lambda item: item.evidence, default=None)
        return Candidate(
            **self._facts(candidate, like),
            verdict=verdict,
            reason="it takes only a part of what a learned curve explains decidedly better"
            if verdict == STAND_IN
            else reason(candidate, None if verdict == ADD or partner or better is None else better.key[0]),
        )

    def _facts(self, candidate: EvaluatedCandidate, rivals: Sequence[EvaluatedCandidate]) -> dict[str, Any]:
        """What findings and other candidates tell; the command is empty for a suspected column, which nothing adds."""
        term, falls = candidate.trial.added, candidate.left_out()
        whole = term.effect if isinstance(term.effect, Together) else None
        options = whole.options(self.robot) if whole else [option_text(term.effect.name, term.joint, term.shape)]
        keys = dict.fromkeys(rival.key for rival in rivals if rival.key != term.key)
        return {
            "effect": term.effect.name,
            "joint": term.joint,
            "shape": dict(term.effect.chosen(term.shape) if term.effect.is_free else term.shape),
            "p_value": candidate.p_value,
            "evidence": candidate.evidence,
            "rmse_after": min(candidate.after.values(), default=None),
            "rmse_heldout_before": falls.before,
            "rmse_heldout_after": falls.after,
            "sizes": curve_size(candidate)
            if term.effect.is_free
            else sizes(term, self.robot, candidate.trial.sizes, covariance=covariance_of(candidate)),
            "knots": knots_of(term.shape) if term.effect.is_free else (),
            "rivals": tuple(name if joint in (term.joint, None) else f"{name}@{joint}" for name, joint in keys),
            "command": " ".join([IDENTIFY, *(f"--add {option}" for option in options)]) if options[0] else "",
            "joints": whole.joints if whole else (),
        }


def diagnose(
    estimate: Estimate,
    dataset: Dataset,
    robot: Robot,
    *,
    suspects: Sequence[str] = (),
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Try every effect of the catalogue at every joint, and say what is missing.

    Each candidate is scored beside the fitted model; its chance is that of the best of the whole catalogue when the
    signs of whole runs are flipped; it must then predict runs that were left out. What passes is added, and all is
    looked at again. Effects of the model are not sought again, runs that are held out only judge. `suspects` are names
    of extra columns that `dataset` carries; `progress` is called with a word on what is done.

    Raises
    ------
    ModelError [model-other-recipe], [unknown-effect]
        The model was identified with another recipe, or holds an effect that the catalogue does not have.
    LogError [no-runs]
        There is no run to look at.
    """
    check_same_recipe(estimate, robot)
    fitted = [run for run in dataset.runs if not run.heldout]
    # In a stroke the model misses more, by all that a change of speed does; a few strokes, left by moves between
    # postures, would pass for missing physics of a joint that has runs at constant speed enough.
    steady = Counter(run.joint for run in fitted if run.kind == CONSTANT)
    runs = [run for run in fitted if run.kind == CONSTANT or steady[run.joint] < STEADY]
    if not runs:
        raise LogError(
            "no-runs",
            "there is no run to diagnose",
            Where(file=dataset.files[0].name if dataset.files else None),
            "see why with: pumaid segment LOGS --rejects",
        )
    search = Stepwise(
        Model.of_runs(robot, fitted),
        runs,
        given=terms_of(estimate.effects),
        begun=first_motions(dataset.runs),
        unseen=[run for run in dataset.runs if run.heldout],
        effects=[*catalogue().values(), *(Suspect.of(dataset, name) for name in suspects)],
        tell=progress or (lambda text: None),
    )
    search.run()
    builder = DiagnosisBuilder(search, reopened(estimate), fitted)
    clocks = len({run.clock for run in runs})
    text = f"the logs have {clocks} clocks, each starting anew: effects of time but payloads are judged within one only"
    several = [Note("several-clocks", text)] * (clocks > 1)
    fits = {fit.joint: fit for fit in estimate.joints if is_fitted_to(estimate, dataset)}
    return Diagnosis(
        robot=robot.name,
        joints=tuple(builder.joint(joint.number, fits.get(joint.number)) for joint in robot.joints),
        findings=builder.findings(),
        model={"sha256": model_digest(estimate)},
        logs={facts.name: facts.digest for facts in dataset.files},
        notes=(*causes_in(estimate.notes), *builder.late, *held_out_otherwise(estimate, dataset), *several),
        recipe={"sha256": robot.digest},
    )
