"""A search told as records: findings, and for each joint its verdict, candidates and limits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Dataset
from pumaid.diagnosis.budget import budget
from pumaid.diagnosis.contender import LEVEL, Contender, misfit_with
from pumaid.diagnosis.curves import Trial as Drawn
from pumaid.diagnosis.curves import curve
from pumaid.diagnosis.deciding import deciding
from pumaid.diagnosis.folds import falls, postures_of
from pumaid.diagnosis.limits import limits
from pumaid.diagnosis.stepwise import Accepted, Step, Stepwise
from pumaid.diagnosis.telling import command, reason, rival_name, rmse_at, sizes, weakened
from pumaid.diagnosis.verdict import Judged, competes, judged, nearest
from pumaid.errors import Note
from pumaid.records import (
    ABSENT,
    ADD,
    ADEQUATE,
    DOUBTFUL,
    UNEXPLAINED_JOINT,
    Candidate,
    Curve,
    Finding,
    JointDiagnosis,
    Limit,
    NextRun,
    Unexplained,
)

Floats = NDArray[np.float64]
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
        self.limits = limits(last.scan, last.catalogue, last.family, periodic=search.periodic)
        self.verdicts = {row.bins.joint: self._judged(row.bins.joint) for row in self.states[0].joints}
        acting = {joint for one in search.accepted for joint in one.contender.after}
        pairs = zip(search.accepted, search.transfers, strict=True)
        partly = {joint for one, found in pairs if found and found.is_partial for joint in one.contender.after}
        self.refuted = ({joint for one in search.denied for joint in one.after} - acting) | partly
        self.shapeless = {joint: self._competes(joint) for joint in self.verdicts}

    def _judged(self, joint: int) -> Judged:
        acting = any(joint in one.contender.after for one in self.search.accepted)
        return judged(self.states[0], self.states[-1], self.search.steps[-1].scan, joint=joint, acting=acting)

    def findings(self) -> tuple[Finding, ...]:
        """What to add, in the order in which it was found."""
        out = []
        for number, one in enumerate(self.search.accepted):
            found, added = one.contender, one.contender.trial.added
            names = dict.fromkeys(rival_name(rival.key, added.joint) for rival in one.rivals if rival.key != added.key)
            before, after = self._errors(number, found)
            out.append(
                Finding(
                    effect=added.effect.name,
                    joint=added.joint,
                    shape=dict(added.shape),
                    verdict=DOUBTFUL if self._is_denied(number) else ADD,
                    rivals=tuple(names),
                    p_value=found.p_value,
                    text=reason(found),
                    command=command(added),
                    rmse_heldout_before=before,
                    rmse_heldout_after=after,
                    sizes=sizes(found),
                    next_run=self._next(one),
                    curves=self._curves(one),
                    transfer=self.search.transfers[number],
                )
            )
        return tuple(out)

    def _is_denied(self, number: int) -> bool:
        """Whether runs held out deny addition `number`, which the search kept since it had been denied enough."""
        found = self.search.transfers[number]
        return found is not None and found.is_denied

    def _errors(self, number: int, found: Contender) -> tuple[float | None, float | None]:
        """RMSE (A) of runs that no fit saw, before and after addition `number`, in the joints where it acts."""
        held = [one for one in self.search.heldout(self.search.added) if one.joint in found.after]
        if held:
            known = [one for one in held if any(row.bins.joint == one.joint for row in self.states[0].joints)]
            pair = [rmse_at(self.states[min(k, len(self.states) - 1)], known) for k in (number, number + 1)]
            return pair[0], pair[1]
        return (found.falls.before, found.falls.after) if found.falls is not None else (None, None)

    def _next(self, one: Accepted) -> NextRun | None:
        """The run that would tell it from its first rival."""
        rival = next((each for each in one.rivals if each.on is one.contender.on), None)
        return None if rival is None else deciding(rival.on, one.contender.trial, rival.trial)

    def _curves(self, one: Accepted) -> tuple[Curve, ...]:
        """What is left before and after in the joints that it changes most."""
        found = one.contender
        order = sorted(found.after, key=lambda joint: found.after[joint] / found.before[joint])
        return tuple(self._curve(one, joint) for joint in order[:PICTURES])

    def _curve(self, one: Accepted, joint: int) -> Curve:
        row, drawn = one.contender.on.row(joint), []
        for each in (one.contender, *one.rivals):
            left = misfit_with(each.on, each.trial).get(joint)
            if left is not None and len(left) == len(row.misfit):
                added = each.trial.added
                drawn.append(Drawn(added.effect, added.joint, dict(added.shape), each.trial.sizes, left))
        return curve(self.search.model.robot, row.bins.samples, before=row.misfit, trials=drawn)

    def joints(self) -> tuple[JointDiagnosis, ...]:
        """Every joint of the arm."""
        return tuple(self._joint(joint.number) for joint in self.search.model.robot.joints)

    def _joint(self, joint: int) -> JointDiagnosis:
        told = self.verdicts.get(joint)
        if told is None:
            return JointDiagnosis(joint, ADEQUATE, f"joint {joint} never moves alone in these logs", None, None)
        row, competitor = self.states[0].row(joint), self.shapeless[joint]
        verdict = UNEXPLAINED_JOINT if competitor is not None or joint in self.refuted else told.verdict
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
            rmse=told.rmse,
            noise_floor=None if split.floor is None else float(np.sqrt(split.floor)),
            repeats=None if told.before is None else (told.before.share, told.before.p_value),
            budget=split.by_name(),
            candidates=self._candidates(joint),
            unexplained=competitor or told.shape,
            limits=tuple(limit for key, limit in sorted(self.limits.items(), key=_by_name) if _concerns(key, joint)),
            weakened=weakened(row.bins, self.search.runs),
        )

    def _competes(self, joint: int) -> Unexplained | None:
        """A shape without a name that explains a joint decisively better than what was named there.

        Where runs held out deny what could be named, or show not all of it, the shape nearest to what is left.
        """
        if joint in self.refuted:
            return nearest(self.states[-1], joint)
        named = [one.contender for one in self.search.accepted if one.contender.key[1] == joint]
        if not named:
            return None
        return competes(self.states[0], joint, named)

    def _candidates(self, joint: int) -> tuple[Candidate, ...]:
        """What was found, and what came near, at one joint."""
        seen: dict[Key, Candidate] = {}
        added = {each.contender.key: each.contender for each in self.search.accepted}
        steps = [(step, step.chosen) for step in self.search.steps]
        adding = {one.key: step for step, one in steps if one is not None and one in added.values()}
        for step in self.search.steps:
            for one in step.contenders:
                if joint in one.after and one.key not in seen:  # what was added, as it was when it was
                    seen[one.key] = self._candidate(added.get(one.key, one), adding.get(one.key, step))
        denied = [self._candidate(one, self.search.steps[0]) for one in self.search.denied if joint in one.after]
        rest = [one for one in seen.values() if all((one.effect, one.shape) != (d.effect, d.shape) for d in denied)]
        order = sorted([*rest, *denied], key=lambda one: (one.verdict != ADD, -one.evidence))
        return tuple(order[:TOLD])

    def _candidate(self, one: Contender, step: Step) -> Candidate:
        added, kept = one.trial.added, {each.contender.key for each in self.search.accepted}
        is_rival = any(one.key == rival.key for rival in step.rivals)
        is_denied = one.fault == "denied"
        verdict = ADD if one.key in kept and not is_denied else DOUBTFUL if is_rival or one.p_value <= LEVEL else ABSENT
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

    def _travels(self, one: Contender) -> float | None:
        """Share of the error in postures left out that it takes away."""
        folds = postures_of(one.on, sorted(one.after))
        if len(folds) < POSTURES * len(one.after) or one.falls is None:
            return None
        left = falls(one.on, [one.trial.added], folds)
        return 1.0 - left.after / left.before if left.before > 0 else None

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
