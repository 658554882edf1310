"""The verdict of a joint: nothing is missing, a known effect is, or something without a name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.diagnosis.agreement import Agreement, agreement
from pumaid.diagnosis.contender import DECISIVE, Contender, evidence, rmse
from pumaid.diagnosis.familywise import Familywise, family
from pumaid.diagnosis.freeform import Free, free_trials, knot_values
from pumaid.diagnosis.scan import Scan, Trial, surprise
from pumaid.effects import Family
from pumaid.estimation.fit import Fit
from pumaid.joint_bins import JointBins
from pumaid.records import ADEQUATE, MISSING, UNEXPLAINED_JOINT, Unexplained

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
class Judged:
    """One joint's verdict with what it rests on.

    Attributes
    ----------
    verdict
        ``adequate``, ``missing`` or ``unexplained``.
    before, after
        Agreement of repeated runs without and with what was added; None without replicates.
    rmse, rmse_after
        A, of fitted samples.
    removed
        Share of the excess over the floor that is gone; None where there is none or no floor.
    shape
        What has no name; None where all is explained.
    """

    verdict: str
    before: Agreement | None
    after: Agreement | None
    rmse: float
    rmse_after: float
    removed: float | None
    shape: Unexplained | None


def judged(first: Fit, last: Fit, scan: Scan, *, joint: int, acting: bool) -> Judged:
    """The verdict of one joint.

    Parameters
    ----------
    first, last
        The system as it was given and with all that was added, both with loads.
    scan
        Of `last`; its leverage is used.
    joint
        From 1.
    acting
        Whether anything that was added acts in this joint.
    """
    a, b = first.row(joint), last.row(joint)
    before, after = (agreement(one.bins, one.misfit, one.residual) for one in (a, b))
    start = rmse(a.bins.count, a.bins.inside, a.misfit)
    end = rmse(b.bins.count, b.bins.inside, b.misfit)
    removed = _removed(start, end, b.bins, after)
    still = after is not None and after.p_value * len(last.joints) <= REPEATS
    free, chances = _free(last, scan, joint)
    seen = [one for one in free if chances.p_value(one.added.key, _surprise(last, one)) * len(last.joints) <= NAMELESS]
    best = max(seen, key=lambda one: evidence(last, one), default=None)
    nameless = best is not None and evidence(last, best) > DECISIVE
    verdict = MISSING if acting else ADEQUATE
    if (nameless or still) and not (acting and removed is not None and removed >= ENOUGH and not nameless):
        verdict = UNEXPLAINED_JOINT
    shape = None
    if verdict == UNEXPLAINED_JOINT and free:
        top = best if best is not None else max(free, key=lambda one: evidence(last, one))
        shape = _shape(last, top, is_clear=nameless)
    return Judged(verdict, before, after, start, end, removed, shape)


def _removed(start: float, end: float, bins: JointBins, after: Agreement | None) -> float | None:
    """Share of the excess over the floor that is gone."""
    if after is None:
        return None
    floor2 = after.floor**2 + float(bins.count @ bins.inside / bins.count.sum())
    if start**2 <= EXCESS * floor2:
        return None
    return (start**2 - end**2) / (start**2 - min(floor2, end**2))


def _free(last: Fit, scan: Scan, joint: int) -> tuple[list[Trial], Familywise]:
    """Free forms at a joint, and their chances under flips of runs' signs."""
    found = free_trials(last, joint)
    return found, family(Scan(last, tuple(found), {}, {}, scan.leverage))


def _surprise(solved: Fit, trial: Trial) -> float:
    return float(surprise(trial.statistic / solved.scale, trial.width))


def _shape(solved: Fit, trial: Trial, *, is_clear: bool = True) -> Unexplained:
    """The free form for people."""
    free = trial.added.effect
    assert isinstance(free, Free) and trial.added.joint is not None
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


#: Free forms that are a family's own, and so no competitors of its effects.
OWN = {
    Family.SPEED: {"s f(v)"},
    Family.LOAD: {"s f(load)"},
    Family.POSITION: {"s f(q)"},
    Family.START: {"s f(travel)"},
    Family.TIME: {"s f(t)", "f(t)"},
    Family.TEMPERATURE: {"s f(t)", "f(t)"},
    Family.TORQUE: {"f(q)"},
}


def competes(first: Fit, joint: int, named: Sequence[Contender]) -> Unexplained | None:
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
    own = set[str]().union(*(OWN.get(one.trial.added.effect.family, set()) for one in named))
    others = [one for one in free_trials(first, joint) if one.added.effect.name not in own]
    best = max(others, key=lambda one: evidence(first, one), default=None)
    if best is None or evidence(first, best) <= sum(one.evidence for one in named) + DECISIVE:
        return None
    return _shape(first, best)


def nearest(solved: Fit, joint: int) -> Unexplained | None:
    """The free form that comes nearest to what a system with loads leaves of a joint."""
    best = max(free_trials(solved, joint), key=lambda one: evidence(solved, one), default=None)
    return None if best is None else _shape(solved, best, is_clear=evidence(solved, best) > DECISIVE)
