"""Diagnose: which physical effect a model misses, with the evidence, the rivals, and the run that would decide."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from pumaid import __version__
from pumaid.dataset import Campaign, Dataset, Run
from pumaid.diagnosis.candidates import Suspect
from pumaid.diagnosis.cross_validation import leave_out, posture_folds
from pumaid.diagnosis.curves import Trial as Drawn
from pumaid.diagnosis.curves import curve
from pumaid.diagnosis.detection_limit import detection_limits
from pumaid.diagnosis.records import (
    ABSENT,
    ADD,
    ADEQUATE,
    DOUBTFUL,
    UNEXPLAINED_JOINT,
    Candidate,
    Curve,
    Diagnosis,
    Finding,
    JointDiagnosis,
    Limit,
    Size,
    Unexplained,
)
from pumaid.diagnosis.residual_budget import budget
from pumaid.diagnosis.stepwise import LEVEL, Accepted, EvaluatedCandidate, Step, Stepwise, misfit_with, silent
from pumaid.diagnosis.verdict import JointVerdict, competing_form, joint_verdict, nearest_form, next_run
from pumaid.effect_spec import EffectTerm, check_known, terms_of
from pumaid.effects import Effect, catalogue
from pumaid.errors import LogError, Note, Where
from pumaid.estimate import Estimate
from pumaid.estimation.fit import Fit, misfit_at
from pumaid.estimation.noise import FEWEST_PAIRS
from pumaid.joint_bins import JointBins, distinct
from pumaid.maths.rank import pseudo_inverse
from pumaid.model import Model
from pumaid.preprocessing.hold_out import held_out_otherwise
from pumaid.preprocessing.options import CONSTANT
from pumaid.results.model_file import check_same_recipe, model_digest
from pumaid.robot import Robot
from pumaid.trajectory import NextRun
from pumaid.units import number

Floats = NDArray[np.float64]

#: Cosine of two parameters' information beyond which only their sum, or difference, is told.
TOGETHER = 0.95


def rmse_at(solved: Fit, held: list[JointBins]) -> float:
    """RMSE (A) of samples of runs that were not fitted."""
    square, count = 0.0, 0.0
    for bins in held:
        square += float(bins.count @ (misfit_at(solved, bins) ** 2 + bins.inside))
        count += float(bins.count.sum())
    return float(np.sqrt(square / count))


def sizes(found: EvaluatedCandidate) -> tuple[Size, ...]:
    """Parameters of a candidate with standard errors; of two that only their sum or difference is known of, that."""
    robot, added = found.on.model.robot, found.trial.added
    parameters = added.effect.parameters(robot, added.joint or 0)
    covariance = pseudo_inverse(found.trial.information)[0] * found.on.scale
    errors = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    unit = robot.joint(added.joint or 1).position_unit
    alone = tuple(
        Size(parameter.name, float(value), float(error), parameter.unit.format(unit=unit))
        for parameter, value, error in zip(parameters, found.trial.sizes, errors, strict=True)
    )
    if len(alone) != 2 or alone[0].unit != alone[1].unit:
        return alone
    information, (first, second) = found.trial.information, alone
    alike = information[0, 1] / np.sqrt(max(information[0, 0] * information[1, 1], np.finfo(float).tiny))
    if abs(alike) < TOGETHER:
        return alone
    sign = float(np.sign(alike))
    error = float(np.sqrt(covariance.trace() + 2.0 * sign * covariance[0, 1]))
    word = "+" if sign > 0.0 else "-"
    return (Size(f"{first.name} {word} {second.name}", first.value + sign * second.value, error, first.unit),)


def command(added: EffectTerm) -> str:
    """What adds it."""
    where = "" if added.joint is None else f"@{added.joint}"
    if isinstance(added.effect, Suspect):
        return ""
    shape = ",".join(f"{name}={value:.6g}" for name, value in added.shape.items())
    return f"pumaid identify LOGS --add {added.effect.name}{where}" + (f":{shape}" if shape else "")


def rival_name(key: tuple[str, int | None], joint: int | None) -> str:
    """A rival of an effect at `joint`: its name, with its joint where that is another."""
    name, place = key
    return name if place == joint or place is None else f"{name}@{place}"


def reason(found: EvaluatedCandidate, better: str | None = None) -> str:
    """Why a candidate has the verdict that it has; `better` is what was chosen instead of it."""
    if found.fault == "chance":
        return "chance alone makes something as good in these data"
    if found.fault == "heldout":
        return "it does not predict runs that were left out any better"
    if found.fault == "denied" and found.transfer is not None:
        if not found.transfer.is_little:
            return "with it runs that were held out are predicted decidedly worse"
        share, error = (number(100.0 * part, 2) for part in (found.transfer.share, found.transfer.std_error))
        return f"of what it adds to runs that were held out these show only {share} ± {error} %"
    if found.fault == "worth":
        little = f"it would lower the error by {100.0 * found.gain:.1g} % only"
        return little if found.gain > 0.0 else "it lowers no error"
    gain = 100.0 * found.gain
    if better is not None:
        return f"it would lower the error by {gain:.2g} %, but {better} explains the same and more"
    return f"it lowers the error by {gain:.2g} % and predicts runs that were left out"


def weakened(field: JointBins, runs: Sequence[Run]) -> tuple[str, ...]:
    """What makes a joint's diagnosis weaker than it could be."""
    out = []
    if len(field.pairs) < FEWEST_PAIRS:
        few = {0: "no run is", 1: "only one run is"}
        what = few.get(len(field.pairs), f"only {len(field.pairs)} runs are")
        out.append(f"{what} repeated, so noise is told from missing physics by the residual alone")
    if len(field.postures) == 1:
        out.append("one posture only: what depends on the load cannot be told from what depends on the position")
    speeds = distinct([abs(run.speed) for run in field.runs])
    if len(speeds) < 3:
        out.append(f"{len(speeds)} speed{'s' if len(speeds) > 1 else ''} only: effects of speed are absorbed")
    elif len(speeds) == 3:
        out.append("three speeds only: an effect of speed shows its height there, not its course between")
    if len({run.direction for run in field.runs}) == 1:
        out.append("one direction only: friction cannot be told from what pushes the same way in both")
    if any(run.kind == "stroke" for run in field.runs):
        out.append("strokes from rest to rest: speed, position and start of a run change together")
    if len({run.joint for run in runs}) == 1:
        out.append("one joint only: gravity's loads cannot be checked against other joints")
    return tuple(out)


Key = tuple[str, int | None]

#: Candidates told a joint.
TOLD = 5
#: Postures from which leaving one out says whether a finding travels.
POSTURES = 4
#: Joints whose picture a finding of several joints carries.
PICTURES = 2


class Account:
    """Everything that a finished search has to say.

    Parameters
    ----------
    search
        After `Stepwise.run`.
    dataset
        All runs, held-out ones too.
    """

    def __init__(self, search: Stepwise, dataset: Dataset) -> None:
        self.search, self.dataset = search, dataset
        self.states = [step.scan.solved for step in search.steps]
        last = search.steps[-1]
        self.limits = detection_limits(last.scan, last.catalogue, last.family, periodic=search.periodic)
        self.verdicts = {row.bins.joint: self._judged(row.bins.joint) for row in self.states[0].joints}
        acting = {joint for item in search.accepted for joint in item.contender.after}
        pairs = zip(search.accepted, search.transfers, strict=True)
        partly = {joint for item, share in pairs if share and share.is_partial for joint in item.contender.after}
        self.refuted = ({joint for item in search.denied for joint in item.after} - acting) | partly
        self.shapeless = {joint: self._competes(joint) for joint in self.verdicts}

    def _judged(self, joint: int) -> JointVerdict:
        acting = any(joint in item.contender.after for item in self.search.accepted)
        return joint_verdict(self.states[0], self.states[-1], self.search.steps[-1].scan, joint=joint, acting=acting)

    def findings(self) -> tuple[Finding, ...]:
        """What to add, in the order in which it was found."""
        out = []
        for place, item in enumerate(self.search.accepted):
            candidate, added = item.contender, item.contender.trial.added
            names = dict.fromkeys(rival_name(rival.key, added.joint) for rival in item.rivals if rival.key != added.key)
            before, after = self._errors(place, candidate)
            out.append(
                Finding(
                    effect=added.effect.name,
                    joint=added.joint,
                    shape=dict(added.shape),
                    verdict=DOUBTFUL if self._is_denied(place) else ADD,
                    rivals=tuple(names),
                    p_value=candidate.p_value,
                    text=reason(candidate),
                    command=command(added),
                    rmse_heldout_before=before,
                    rmse_heldout_after=after,
                    sizes=sizes(candidate),
                    next_run=self._next(item),
                    curves=self._curves(item),
                    transfer=self.search.transfers[place],
                )
            )
        return tuple(out)

    def _is_denied(self, number: int) -> bool:
        """Whether runs held out deny addition `number`, which the search kept since it had been denied enough."""
        share = self.search.transfers[number]
        return share is not None and share.is_denied

    def _errors(self, number: int, found: EvaluatedCandidate) -> tuple[float | None, float | None]:
        """RMSE (A) of runs that no fit saw, before and after addition `number`, in the joints where it acts."""
        held = [bins for bins in self.search.heldout(self.search.added) if bins.joint in found.after]
        if held:
            fitted = [bins for bins in held if any(row.bins.joint == bins.joint for row in self.states[0].joints)]
            pair = [rmse_at(self.states[min(k, len(self.states) - 1)], fitted) for k in (number, number + 1)]
            return pair[0], pair[1]
        return (found.falls.before, found.falls.after) if found.falls is not None else (None, None)

    def _next(self, one: Accepted) -> NextRun | None:
        """The run that would tell it from its first rival."""
        rival = next((item for item in one.rivals if item.on is one.contender.on), None)
        return None if rival is None else next_run(rival.on, one.contender.trial, rival.trial)

    def _curves(self, one: Accepted) -> tuple[Curve, ...]:
        """What is left before and after in the joints that it changes most."""
        candidate = one.contender
        order = sorted(candidate.after, key=lambda joint: candidate.after[joint] / candidate.before[joint])
        return tuple(self._curve(one, joint) for joint in order[:PICTURES])

    def _curve(self, one: Accepted, joint: int) -> Curve:
        row, drawn = one.contender.on.row(joint), []
        for candidate in (one.contender, *one.rivals):
            residual = misfit_with(candidate.on, candidate.trial).get(joint)
            if residual is not None and len(residual) == len(row.misfit):
                added = candidate.trial.added
                drawn.append(Drawn(added.effect, added.joint, dict(added.shape), candidate.trial.sizes, residual))
        return curve(self.search.model.robot, row.bins.samples, before=row.misfit, trials=drawn)

    def joints(self) -> tuple[JointDiagnosis, ...]:
        """Every joint of the arm."""
        return tuple(self._joint(joint.number) for joint in self.search.model.robot.joints)

    def _joint(self, joint: int) -> JointDiagnosis:
        judged = self.verdicts.get(joint)
        if judged is None:
            return JointDiagnosis(joint, ADEQUATE, f"joint {joint} never moves alone in these logs", None, None)
        row, competitor = self.states[0].row(joint), self.shapeless[joint]
        verdict = UNEXPLAINED_JOINT if competitor is not None or joint in self.refuted else judged.verdict
        split = budget(
            row.bins,
            row.misfit,
            self.search.model.robot.joint(joint),
            load=None if row.bins.samples.loads is None else row.bins.samples.loads.own,
        )
        return JointDiagnosis(
            joint=joint,
            verdict=verdict,
            text="",
            rmse=judged.rmse,
            noise_floor=None if split.floor is None else float(np.sqrt(split.floor)),
            repeats=None if judged.before is None else (judged.before.share, judged.before.p_value),
            budget=split.by_name(),
            candidates=self._candidates(joint),
            unexplained=competitor or judged.shape,
            limits=tuple(limit for key, limit in sorted(self.limits.items(), key=_by_name) if _concerns(key, joint)),
            weakened=weakened(row.bins, self.search.runs),
        )

    def _competes(self, joint: int) -> Unexplained | None:
        """A shape without a name that explains a joint decisively better than what was named there.

        Where runs held out deny what could be named, or show not all of it, the shape nearest to what is left.
        """
        if joint in self.refuted:
            return nearest_form(self.states[-1], joint)
        named = [item.contender for item in self.search.accepted if item.contender.key[1] == joint]
        if not named:
            return None
        return competing_form(self.states[0], joint, named)

    def _candidates(self, joint: int) -> tuple[Candidate, ...]:
        """What was found, and what came near, at one joint."""
        records: dict[Key, Candidate] = {}
        added = {item.contender.key: item.contender for item in self.search.accepted}
        steps = [(step, step.chosen) for step in self.search.steps]
        adding = {
            candidate.key: step for step, candidate in steps if candidate is not None and candidate in added.values()
        }
        for step in self.search.steps:
            for candidate in step.contenders:
                if joint in candidate.after and candidate.key not in records:  # what was added, as it was when it was
                    records[candidate.key] = self._candidate(
                        added.get(candidate.key, candidate), adding.get(candidate.key, step)
                    )
        denied = [
            self._candidate(candidate, self.search.steps[0])
            for candidate in self.search.denied
            if joint in candidate.after
        ]
        rest = [
            candidate
            for candidate in records.values()
            if all((candidate.effect, candidate.shape) != (d.effect, d.shape) for d in denied)
        ]
        order = sorted([*rest, *denied], key=lambda candidate: (candidate.verdict != ADD, -candidate.evidence))
        return tuple(order[:TOLD])

    def _candidate(self, one: EvaluatedCandidate, step: Step) -> Candidate:
        added, accepted = one.trial.added, {item.contender.key for item in self.search.accepted}
        is_rival = any(one.key == rival.key for rival in step.rivals)
        is_denied = one.fault == "denied"
        verdict = (
            ADD if one.key in accepted and not is_denied else DOUBTFUL if is_rival or one.p_value <= LEVEL else ABSENT
        )
        like = step.rivals if step.chosen is one else ()
        if is_rival and step.chosen is not None:
            like = (step.chosen, *(other for other in step.rivals if other is not one))
        rivals = [rival_name(other.key, added.joint) for other in like if other.key != one.key]
        return Candidate(
            effect=added.effect.name,
            joint=added.joint,
            shape=dict(added.shape),
            verdict=verdict,
            reason=reason(one, None if verdict == ADD or is_rival or step.chosen is None else step.chosen.key[0]),
            p_value=one.p_value,
            evidence=one.evidence,
            rmse_after=min(one.after.values(), default=None),
            rmse_heldout_before=one.falls.before if one.falls else None,
            rmse_heldout_after=one.falls.after if one.falls else None,
            posture_gain=self._travels(one),
            sizes=sizes(one),
            rivals=tuple(dict.fromkeys(rivals)),
            command=command(added),
        )

    def _travels(self, one: EvaluatedCandidate) -> float | None:
        """Share of the error in postures left out that it takes away."""
        folds = posture_folds(one.on, sorted(one.after))
        if len(folds) < POSTURES * len(one.after) or one.falls is None:
            return None
        losses = leave_out(one.on, [one.trial.added], folds)
        return 1.0 - losses.after / losses.before if losses.before > 0 else None

    def notes(self) -> tuple[Note, ...]:
        """What the whole diagnosis rests on."""
        clocks = {run.clock for run in self.search.runs}
        if len(clocks) == 1:
            return ()
        text = f"the logs have {len(clocks)} clocks, each starting anew: effects of time are judged within a clock only"
        return (Note("several-clocks", text),)


def _by_name(item: tuple[Key, Limit]) -> tuple[str, int]:
    return item[0][0], item[0][1] or 0


def _concerns(key: Key, joint: int) -> bool:
    return key[1] in (joint, None)


#: Runs at constant speed from which a joint's strokes are not needed.
STEADY = 12


def diagnose(
    estimate: Estimate,
    dataset: Dataset,
    robot: Robot,
    *,
    suspects: Sequence[str] = (),
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Try every effect of the catalogue at every joint, and say what is missing.

    Bins of all runs are whitened by the noise that repeated runs show; each candidate is scored beside the fitted
    model, all else refitted; its chance is that of the best of the whole catalogue when the signs of whole runs are
    flipped; it must then predict runs that were left out. What passes is added, and all is looked at again.

    Parameters
    ----------
    estimate
        The model; what it already has is not sought again.
    dataset
        Runs of the same arm; those held out are only used to judge.
    robot
        By the recipe that the model was made with.
    suspects
        Names of extra columns that `dataset` carries.
    progress
        Called with a word on what is done.

    Returns
    -------
    diagnosis
        Same input, same diagnosis.

    Raises
    ------
    ModelError [model-other-recipe]
        The model was identified with another recipe.
    ModelError [unknown-effect]
        It holds an effect that the catalogue does not have.
    LogError [no-runs]
        There is no run to look at.
    """
    check_same_recipe(estimate, robot)
    check_known(estimate.effects)
    runs = _looked_at([run for run in dataset.runs if not run.heldout])
    if not runs:
        where = Where(file=dataset.files[0].name if dataset.files else None)
        raise LogError("no-runs", "there is no run to diagnose", where, "see why with: pumaid segment LOGS --rejects")
    search = Stepwise(
        Model.of_runs(robot, [run for run in dataset.runs if not run.heldout]),
        runs,
        given=terms_of(estimate.effects),
        campaign=Campaign.of(dataset.runs),
        unseen=tuple(run for run in dataset.runs if run.heldout),
        effects=[*catalogue().values(), *_suspects(dataset, suspects)],
        tell=progress or silent,
    )
    search.run()
    account = Account(search, dataset)
    return Diagnosis(
        robot=robot.name,
        joints=account.joints(),
        findings=account.findings(),
        model=model_digest(estimate),
        logs={facts.name: facts.digest for facts in dataset.files},
        notes=(*held_out_otherwise(estimate, dataset), *account.notes()),
        recipe_digest=robot.digest,
        version=__version__,
    )


def _looked_at(runs: Sequence[Run]) -> tuple[Run, ...]:
    """Runs without the strokes of joints that have runs at constant speed enough.

    In a stroke the model misses more, by all that a change of speed does; a few of them, left by moves between
    postures, would pass for missing physics.
    """
    steady = Counter(run.joint for run in runs if run.kind == CONSTANT)
    return tuple(run for run in runs if run.kind == CONSTANT or steady[run.joint] < STEADY)


def _suspects(dataset: Dataset, names: Sequence[str]) -> list[Effect]:
    """An effect for each suspected column, scaled by what it does in these runs."""
    out: list[Effect] = []
    for name in names:
        place = dataset.extra.index(name)
        columns = [run.bins.extra[:, place] for run in dataset.runs if run.bins.extra is not None]
        values = np.concatenate(columns) if columns else np.zeros(1)
        values = values[np.isfinite(values)]
        middle, spread = (float(values.mean()), float(values.std())) if len(values) else (0.0, 0.0)
        out.append(Suspect(name, place, middle=middle, spread=spread))
    return out
