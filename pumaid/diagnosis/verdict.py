"""The verdict on a joint: nothing is missing, a catalogue effect is, or something without a name."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.design.discrimination import FittedEffect, deciding
from pumaid.diagnosis.candidates import Candidates, Suspect
from pumaid.diagnosis.free_form import FreeForm, free_form_scores, knot_values
from pumaid.diagnosis.records import ADEQUATE, MISSING, UNEXPLAINED_JOINT, Unexplained
from pumaid.diagnosis.score_test import ScoreTable, ScoreTest
from pumaid.diagnosis.sign_flip import ReplicateTest, replicate_test, sign_flips
from pumaid.diagnosis.stepwise import DECISIVE, evidence, rmse
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
    """Of one joint, by the fits as it was given and with all that was added; `acting`: something of it acts there."""
    a, b = first.row(joint), last.row(joint)
    before, after = (replicate_test(item.bins, item.misfit, item.residual) for item in (a, b))
    is_repeated = after is not None and after.p_value * len(last.joints) <= REPEATS
    forms = free_form_scores(last, joint)
    chances = sign_flips(ScoreTable(last, Candidates(), tuple(forms)))
    level = NAMELESS / len(last.joints)
    passing = [form for form in forms if chances.p_value(form.added.key, form.surprise(last.scale)) <= level]
    best = max(passing, key=lambda form: evidence(last, form), default=None)
    is_clear = best is not None and evidence(last, best) > DECISIVE
    is_gone = acting and _removed(rmse(a.bins, a.misfit), rmse(b.bins, b.misfit), b.bins, after) >= ENOUGH
    if not is_clear and (not is_repeated or is_gone):
        return JointVerdict(MISSING if acting else ADEQUATE, before, None)
    top = best or max(forms, key=lambda form: evidence(last, form), default=None)
    return JointVerdict(UNEXPLAINED_JOINT, before, None if top is None else _shape(last, top, is_clear=is_clear))


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
    unit = free.unit.format(unit=solved.model.robot.joint(trial.added.joint).position_unit)
    peak = float(knots[int(np.argmax(np.abs(values)))])
    row = solved.row(trial.added.joint)
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
    forms = [form for form in free_form_scores(solved, joint) if form.added.effect.name not in skipped]
    best = max(forms, key=lambda form: evidence(solved, form), default=None)
    if best is None or evidence(solved, best) <= beyond:
        return None
    return _shape(solved, best, is_clear=evidence(solved, best) > DECISIVE)


def next_run(solved: Fit, chosen: ScoreTest, rival: ScoreTest) -> NextRun:
    """The feasible runs that tell two effects apart, both tested on `solved`; without motions where there are none."""
    for effect in (test.added.effect for test in (chosen, rival)):
        if isinstance(effect, Suspect):
            return NextRun(f"change {effect.column} on purpose while all else is repeated: no plan of motions can")
    first, second = (FittedEffect(test.added, test.sizes, test.statistic) for test in (chosen, rival))
    lead = evidence(solved, chosen) - evidence(solved, rival)
    return deciding(solved, (first, second), lead=lead, decisive=DECISIVE)
