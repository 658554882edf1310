"""Diagnose: which physical effect a model misses, with the evidence, the rivals, and the run that would decide."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from pumaid.dataset import Campaign, Dataset, Run
from pumaid.diagnosis.candidates import Key, Suspect
from pumaid.diagnosis.curves import Trial as Drawn
from pumaid.diagnosis.curves import curve
from pumaid.diagnosis.discrimination import deciding
from pumaid.diagnosis.records import (
    ABSENT,
    ADD,
    ADEQUATE,
    DOUBTFUL,
    UNEXPLAINED_JOINT,
    Candidate,
    Curve,
    Diagnosis,
    Digest,
    Finding,
    JointDiagnosis,
    Repeats,
    Size,
    Unexplained,
)
from pumaid.diagnosis.residual_budget import budget
from pumaid.diagnosis.stepwise import DECISIVE, LEVEL, EvaluatedCandidate, Step, Stepwise, misfit_with, rmse
from pumaid.diagnosis.verdict import detection_limits, free_shape, joint_verdict
from pumaid.effect_spec import EffectTerm, check_known, option_text, terms_of
from pumaid.effects import catalogue
from pumaid.errors import LogError, Note, Where
from pumaid.estimate import Estimate
from pumaid.estimation.fit import misfit_at
from pumaid.estimation.noise import FEWEST_PAIRS
from pumaid.joint_bins import Floats, JointBins
from pumaid.maths.rank import pseudo_inverse
from pumaid.model import Model
from pumaid.preprocessing.hold_out import held_out_otherwise
from pumaid.preprocessing.options import CONSTANT
from pumaid.results.model_file import check_same_recipe, model_digest
from pumaid.robot import Robot
from pumaid.units import number

#: How a command that adds an effect begins; whoever knows the logs puts them in.
IDENTIFY = "pumaid identify LOGS"
#: Cosine of two parameters' information beyond which only their sum, or difference, is told.
TOGETHER = 0.95
#: Candidates listed for a joint.
LISTED = 5
#: Joints whose picture a finding of several joints carries.
PICTURES = 2
#: Runs at constant speed from which a joint's strokes are not needed.
STEADY = 12


def sizes(candidate: EvaluatedCandidate) -> tuple[Size, ...]:
    """Parameters of a candidate, by its score beside the model that it was tried on."""
    covariance = pseudo_inverse(candidate.trial.information)[0] * candidate.on.scale
    return _sizes(candidate.trial.added, candidate.on.model.robot, candidate.trial.sizes, covariance=covariance)


def _sizes(term: EffectTerm, robot: Robot, values: Floats, *, covariance: Floats) -> tuple[Size, ...]:
    """With standard errors; of two parameters of which only the sum or difference is known, that."""
    errors = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    unit = robot.joint(term.joint or 1).position_unit
    alone = tuple(
        Size(parameter.name, float(value), float(error), parameter.unit.format(unit=unit))
        for parameter, value, error in zip(term.effect.parameters(robot, term.number), values, errors, strict=True)
    )
    if len(alone) != 2 or alone[0].unit != alone[1].unit:
        return alone
    information, (first, second) = pseudo_inverse(covariance)[0], alone
    cosine = information[0, 1] / np.sqrt(max(information[0, 0] * information[1, 1], np.finfo(float).tiny))
    if abs(cosine) < TOGETHER:
        return alone
    sign, word = float(np.sign(cosine)), "+" if cosine > 0.0 else "-"
    error = float(np.sqrt(covariance.trace() + 2.0 * sign * covariance[0, 1]))
    return (Size(f"{first.name} {word} {second.name}", first.value + sign * second.value, error, first.unit),)


def rival_name(key: Key, joint: int | None) -> str:
    """A rival of an effect at `joint`: its name, with its joint where that is another."""
    name, place = key
    return name if place == joint or place is None else f"{name}@{place}"


def reason(candidate: EvaluatedCandidate, better: str | None = None) -> str:
    """Why a candidate has the verdict that it has; `better` is what was chosen instead of it."""
    gain, transfer = 100.0 * candidate.gain, candidate.transfer
    if candidate.fault == "denied" and transfer is not None and transfer.is_little:
        share, error = (number(100.0 * part, 2) for part in (transfer.share, transfer.std_error))
        return f"of what it adds to runs that were held out these show only {share} ± {error} %"
    faults = {
        "chance": "chance alone makes something as good in these data",
        "heldout": "it does not predict runs that were left out any better",
        "denied": "with it runs that were held out are predicted decidedly worse",
        "worth": f"it would lower the error by {gain:.1g} % only" if gain > 0.0 else "it lowers no error",
    }
    if candidate.fault is not None:
        return faults[candidate.fault]
    if better is not None:
        return f"it would lower the error by {gain:.2g} %, but {better} explains the same and more"
    return f"it lowers the error by {gain:.2g} % and predicts runs that were left out"


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
        "strokes from rest to rest: speed, position and start of a run change together": bins.has_strokes,
        "one joint only: gravity's loads cannot be checked against other joints": len({r.joint for r in runs}) == 1,
    }
    return tuple(text for text, holds in claims.items() if holds)


class DiagnosisBuilder:
    """Everything that a finished search (after `Stepwise.run`) has to say."""

    def __init__(self, search: Stepwise) -> None:
        self.search, self.robot = search, search.model.robot
        self.fits = [step.scan.solved for step in search.steps]
        last = search.steps[-1]
        self.limits = detection_limits(last.scan, last.family)
        acting = {joint for item in search.accepted for joint in item.after}
        joints = [row.bins.joint for row in self.fits[0].joints]
        self.verdicts = {
            joint: joint_verdict(self.fits[0], self.fits[-1], joint=joint, acting=joint in acting) for joint in joints
        }
        self.refuted = {joint for item in search.denied for joint in item.after} - acting
        for item in search.accepted:
            if item.transfer and item.transfer.is_partial:
                self.refuted |= set(item.after)

    def findings(self) -> tuple[Finding, ...]:
        """What to add, in the order in which it was found."""
        return tuple(self._finding(place, item) for place, item in enumerate(self.search.accepted))

    def _finding(self, place: int, candidate: EvaluatedCandidate) -> Finding:
        term, transfer = candidate.trial.added, candidate.transfer
        facts = self._facts(candidate, candidate.rivals)
        facts["rmse_heldout_before"], facts["rmse_heldout_after"] = self._errors(place, candidate)
        rival = next((rival for rival in candidate.rivals if rival.on is candidate.on), None)
        by_gain = sorted(candidate.after, key=lambda joint: candidate.after[joint] / candidate.before[joint])
        if term.joint is None and term.key in [effect.key for effect in self.fits[-1].model.effects]:
            # An effect of the whole arm moves gain ratios, which a score follows to first order only.
            facts["sizes"] = self._fitted_sizes(term)
        return Finding(
            **facts,
            verdict=DOUBTFUL if transfer is not None and transfer.is_denied else ADD,
            reason=reason(candidate),
            next_run=None if rival is None else deciding(rival.on, candidate.trial, rival.trial),
            curves=tuple(self._curve(candidate, joint) for joint in by_gain[:PICTURES]),
            transfer=transfer,
        )

    def _fitted_sizes(self, term: EffectTerm) -> tuple[Size, ...]:
        """Parameters of an effect as the fit with all that was found gives them."""
        fit = self.fits[-1]
        place = [effect.key for effect in fit.model.effects].index(term.key)
        columns = [n for n in fit.columns_of(place) if fit.model.columns[n].shape is None]
        covariance = fit.inverse[np.ix_(columns, columns)] * fit.scale
        return _sizes(fit.model.effects[place], self.robot, fit.values[columns], covariance=covariance)

    def _errors(self, place: int, candidate: EvaluatedCandidate) -> tuple[float | None, float | None]:
        """RMSE (A) of runs that no fit saw, before and after addition `place`, in the joints where it acts."""
        unseen = [bins for bins in self.search.heldout() if bins.joint in candidate.after]
        if not unseen:
            return (candidate.falls.before, candidate.falls.after) if candidate.falls is not None else (None, None)
        samples, errors = sum(float(bins.count.sum()) for bins in unseen), []
        for fit in (self.fits[min(k, len(self.fits) - 1)] for k in (place, place + 1)):
            squares = [bins.count @ (misfit_at(fit, bins) ** 2 + bins.inside) for bins in unseen]
            errors.append(float(np.sqrt(sum(squares) / samples)))
        return errors[0], errors[1]

    def _curve(self, candidate: EvaluatedCandidate, joint: int) -> Curve:
        row, drawn = candidate.on.row(joint), []
        for item in (candidate, *candidate.rivals):
            residual = misfit_with(item.on, item.trial).get(joint)
            if residual is not None and len(residual) == len(row.misfit):
                drawn.append(Drawn(item.trial.added, item.trial.sizes, residual))
        return curve(self.robot, row.bins.samples, before=row.misfit, trials=drawn)

    def joint(self, joint: int, floor: float | None) -> JointDiagnosis:
        """What is wrong at one joint (from 1); `floor` is the noise floor of the model (A), None where unknown."""
        judged = self.verdicts.get(joint)
        if judged is None:
            return JointDiagnosis(joint, ADEQUATE, f"joint {joint} never moves alone in these logs", None, None)
        row, shape = self.fits[0].row(joint), self._shape(joint)
        split = budget(row.bins, row.misfit, self.robot.joint(joint), floor=floor)
        limits = sorted(self.limits.items(), key=lambda item: (item[0][0], item[0][1] or 0))
        return JointDiagnosis(
            joint=joint,
            verdict=UNEXPLAINED_JOINT if shape is not None or joint in self.refuted else judged.verdict,
            text="",
            rmse=rmse(row.bins, row.misfit),
            noise_floor=None if split.floor is None else float(np.sqrt(split.floor)),
            repeats=None if judged.replicates is None else Repeats(judged.replicates.share, judged.replicates.p_value),
            budget=split.by_name(),
            candidates=self._candidates(joint),
            unexplained=shape or judged.shape,
            limits=tuple(limit for (_, place), limit in limits if place in (joint, None)),
            weakened=weakened(row.bins, self.search.runs),
        )

    def _shape(self, joint: int) -> Unexplained | None:
        """A shape without a name that explains a joint decisively better than what was named there.

        Where runs held out deny what could be named, or show not all of it, the shape nearest to what is left.
        """
        if joint in self.refuted:
            return free_shape(self.fits[-1], joint)
        named = [item for item in self.search.accepted if item.key[1] == joint]
        families = [item.trial.added.effect.family for item in named]
        enough = DECISIVE + sum(item.evidence for item in named)
        return free_shape(self.fits[0], joint, families=families, beyond=enough) if named else None

    def _candidates(self, joint: int) -> tuple[Candidate, ...]:
        """What was found, what runs held out denied, and what came near, at one joint."""
        search, steps = self.search, self.search.steps
        adding = {step.chosen.key: step for step in steps if step.chosen is not None}
        judged = [(item, step) for step in reversed(steps) for item in reversed(step.evaluated)]
        judged += [(item, steps[0]) for item in reversed(search.denied)]
        judged += [(item, adding.get(item.key, steps[0])) for item in reversed(search.accepted)]
        by_key = {item.key: (item, step) for item, step in judged if joint in item.after}
        order = {key: n for n, key in enumerate(reversed([item.key for item, _ in judged if joint in item.after]))}
        best = sorted(
            by_key, key=lambda key: (self._verdict(by_key[key][0]) != ADD, -by_key[key][0].evidence, order[key])
        )
        return tuple(self._candidate(*by_key[key]) for key in best[:LISTED])

    def _partner(self, candidate: EvaluatedCandidate) -> EvaluatedCandidate | None:
        """What was added of which it is a rival."""
        accepted = self.search.accepted
        return next((item for item in accepted if candidate.key in [rival.key for rival in item.rivals]), None)

    def _verdict(self, candidate: EvaluatedCandidate) -> str:
        if candidate.key in [item.key for item in self.search.accepted] and candidate.fault != "denied":
            return ADD
        return DOUBTFUL if self._partner(candidate) is not None or candidate.p_value <= LEVEL else ABSENT

    def _candidate(self, candidate: EvaluatedCandidate, step: Step) -> Candidate:
        partner, verdict, like = self._partner(candidate), self._verdict(candidate), candidate.rivals
        if partner is not None:
            like = (partner, *(rival for rival in partner.rivals if rival.key != candidate.key))
        beside = [item for item in self.search.accepted if item.after.keys() & candidate.after.keys()]
        better = max(beside, key=lambda item: item.evidence, default=step.chosen)
        why = reason(candidate, None if verdict == ADD or partner or better is None else better.key[0])
        return Candidate(**self._facts(candidate, like), verdict=verdict, reason=why)

    def _facts(self, candidate: EvaluatedCandidate, rivals: Sequence[EvaluatedCandidate]) -> dict[str, Any]:
        """What findings and other candidates tell; the command is empty for a suspected column, which nothing adds."""
        term, falls = candidate.trial.added, candidate.falls
        option = option_text(term.effect.name, term.joint, term.shape)
        names = dict.fromkeys(rival_name(rival.key, term.joint) for rival in rivals if rival.key != term.key)
        return {
            "effect": term.effect.name,
            "joint": term.joint,
            "shape": dict(term.shape),
            "p_value": candidate.p_value,
            "evidence": candidate.evidence,
            "rmse_after": min(candidate.after.values(), default=None),
            "rmse_heldout_before": falls.before if falls else None,
            "rmse_heldout_after": falls.after if falls else None,
            "sizes": sizes(candidate),
            "rivals": tuple(names),
            "command": option and f"{IDENTIFY} --add {option}",
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
    check_known(estimate.effects)
    fitted = [run for run in dataset.runs if not run.heldout]
    runs = _without_odd_strokes(fitted)
    if not runs:
        where = Where(file=dataset.files[0].name if dataset.files else None)
        raise LogError("no-runs", "there is no run to diagnose", where, "see why with: pumaid segment LOGS --rejects")
    search = Stepwise(
        Model.of_runs(robot, fitted),
        runs,
        given=terms_of(estimate.effects),
        campaign=Campaign.of(dataset.runs),
        unseen=[run for run in dataset.runs if run.heldout],
        effects=[*catalogue().values(), *(Suspect.of(dataset, name) for name in suspects)],
        tell=progress or (lambda text: None),
    )
    search.run()
    builder = DiagnosisBuilder(search)
    floors = {fit.joint: fit.noise_floor for fit in estimate.joints}
    return Diagnosis(
        robot=robot.name,
        joints=tuple(builder.joint(joint.number, floors.get(joint.number)) for joint in robot.joints),
        findings=builder.findings(),
        model=Digest(model_digest(estimate)),
        logs={facts.name: facts.digest for facts in dataset.files},
        notes=(*held_out_otherwise(estimate, dataset), *_notes_on_clocks(runs)),
        recipe=Digest(robot.digest),
    )


def _notes_on_clocks(runs: Sequence[Run]) -> tuple[Note, ...]:
    clocks = len({run.clock for run in runs})
    text = f"the logs have {clocks} clocks, each starting anew: effects of time are judged within a clock only"
    return (Note("several-clocks", text),) if clocks > 1 else ()


def _without_odd_strokes(runs: Sequence[Run]) -> tuple[Run, ...]:
    """Runs without the strokes of joints that have runs at constant speed enough.

    In a stroke the model misses more, by all that a change of speed does; a few of them, left by moves between
    postures, would pass for missing physics.
    """
    steady = Counter(run.joint for run in runs if run.kind == CONSTANT)
    return tuple(run for run in runs if run.kind == CONSTANT or steady[run.joint] < STEADY)
