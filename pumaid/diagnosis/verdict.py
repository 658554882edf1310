"""The verdict on a joint: nothing is missing, a catalogue effect is, or something without a name."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.design.discrimination import FittedEffect, deciding
from pumaid.diagnosis.candidates import Candidates, Suspect
from pumaid.diagnosis.free_form import FreeForm, free_form_scores, knot_values
from pumaid.diagnosis.records import ADEQUATE, MISSING, UNEXPLAINED_JOINT, Unexplained
from pumaid.diagnosis.score_test import ScoreTable, ScoreTest
from pumaid.diagnosis.sign_flip import ReplicateTest, replicate_test, sign_flips
from pumaid.diagnosis.stepwise import DECISIVE, EvaluatedCandidate, evidence, rmse
from pumaid.effects import Family
from pumaid.estimation.fit import Fit
from pumaid.joint_bins import JointBins
from pumaid.trajectory import NextRun

Floats = NDArray[np.float64]

#: Chance, over all joints together, below which what repeats between replicates is not noise.
REPEATS = 0.005
#: Chance, over all joints together, below which a free form is more than noise.
NAMELESS = 0.01
#: Share of the excess over the noise floor that what was added must take away.
ENOUGH = 0.8
#: Excess of the mean square over the floor below which there is none to speak of.
EXCESS = 1.02


@dataclass(frozen=True, eq=False, slots=True)
class JointVerdict:
    """One joint's verdict (adequate, missing or unexplained), what repeated before anything was added, and the shape.

    `replicates` is None without repeated runs; `shape` is of what has no name, None where all is explained.
    """

    verdict: str
    replicates: ReplicateTest | None
    shape: Unexplained | None


def joint_verdict(first: Fit, last: Fit, *, joint: int, acting: bool) -> JointVerdict:
    """The verdict of one joint.

    Parameters
    ----------
    first, last
        The system as it was given and with all that was added, both with loads.
    joint
        From 1.
    acting
        Whether anything that was added acts in this joint.
    """
    a, b = first.row(joint), last.row(joint)
    before, after = (replicate_test(item.bins, item.misfit, item.residual) for item in (a, b))
    is_repeated = after is not None and after.p_value * len(last.joints) <= REPEATS
    forms = free_form_scores(last, joint)
    chances = sign_flips(ScoreTable(last, Candidates(), tuple(forms)))
    level = NAMELESS / len(last.joints)
    passing = [form for form in forms if chances.p_value(form.added.key, form.surprise(last.scale)) <= level]
    best = _most_evident(last, passing)
    is_clear = best is not None and evidence(last, best) > DECISIVE
    is_gone = acting and _removed(rmse(a.bins, a.misfit), rmse(b.bins, b.misfit), b.bins, after) >= ENOUGH
    if not is_clear and (not is_repeated or is_gone):
        return JointVerdict(MISSING if acting else ADEQUATE, before, None)
    top = best or _most_evident(last, forms)
    return JointVerdict(UNEXPLAINED_JOINT, before, None if top is None else _shape(last, top, is_clear=is_clear))


def _most_evident(solved: Fit, tests: Iterable[ScoreTest]) -> ScoreTest | None:
    return max(tests, key=lambda test: evidence(solved, test), default=None)


def _removed(start: float, end: float, bins: JointBins, after: ReplicateTest | None) -> float:
    """Share of the excess over the floor that is gone; NaN where there is none or no floor."""
    if after is None:
        return np.nan
    floor2 = after.floor**2 + float(bins.count @ bins.inside / bins.count.sum())
    if start**2 <= EXCESS * floor2:
        return np.nan
    return (start**2 - end**2) / (start**2 - min(floor2, end**2))


def _shape(solved: Fit, trial: ScoreTest, *, is_clear: bool) -> Unexplained:
    """The free form for people."""
    free = trial.added.effect
    assert isinstance(free, FreeForm) and trial.added.joint is not None
    knots, values, errors = knot_values(solved, trial)
    unit = solved.model.robot.joint(trial.added.joint).position_unit
    peak = float(knots[int(np.argmax(np.abs(values)))])
    row = solved.row(trial.added.joint)
    freedom = len(row.bins) * (1.0 - solved.rank / max(solved.size, 1))
    explained = max(trial.statistic - trial.width, 0.0)
    excess = max(float(row.residual @ row.residual) - freedom, explained)
    gain = explained / excess if excess > 0.0 else 0.0
    text = f"what is left looks like {free.form.name}, largest at {peak:.3g} {free.form.unit.format(unit=unit)}"
    where = free.form.unit.format(unit=unit)
    return Unexplained(
        *(free.form.name, free.form.variable, where, knots, values, errors, peak, float(gain), text), is_clear=is_clear
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


def competing_form(first: Fit, joint: int, named: Sequence[EvaluatedCandidate]) -> Unexplained | None:
    """A free form in another variable that explains a joint decisively better than what was named there.

    Parameters
    ----------
    first
        The system without what was named, with loads.
    joint
        From 1.
    named
        What was named there.
    """
    families = set[str]().union(*(OWN.get(item.trial.added.effect.family, set()) for item in named))
    forms = [item for item in free_form_scores(first, joint) if item.added.effect.name not in families]
    best = _most_evident(first, forms)
    if best is None or evidence(first, best) <= sum(item.evidence for item in named) + DECISIVE:
        return None
    return _shape(first, best, is_clear=True)


def nearest_form(solved: Fit, joint: int) -> Unexplained | None:
    """The free form that comes nearest to what a system with loads leaves of a joint."""
    best = _most_evident(solved, free_form_scores(solved, joint))
    return None if best is None else _shape(solved, best, is_clear=evidence(solved, best) > DECISIVE)


def next_run(solved: Fit, chosen: ScoreTest, rival: ScoreTest) -> NextRun:
    """The feasible runs that tell two effects apart, both tested on `solved`; without motions where there are none."""
    for effect in (test.added.effect for test in (chosen, rival)):
        if isinstance(effect, Suspect):
            return NextRun(f"change {effect.column} on purpose while all else is repeated: no plan of motions can")
    first, second = (FittedEffect(test.added, test.sizes, test.statistic) for test in (chosen, rival))
    lead = evidence(solved, chosen) - evidence(solved, rival)
    return deciding(solved, (first, second), lead=lead, decisive=DECISIVE)
