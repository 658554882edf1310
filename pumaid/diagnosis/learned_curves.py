"""Learned curves for joints that no effect of the catalogue explains, and which effects only stood in for one."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np

from pumaid.diagnosis.cross_validation import confirmed_share, leave_out, replicate_folds, rmse_of
from pumaid.diagnosis.free_forms import free_form_tests
from pumaid.diagnosis.records import Size
from pumaid.diagnosis.score_test import DECISIVE, EvaluatedCandidate, ScoreTest, evidence, misfit_with, score_at
from pumaid.diagnosis.stepwise import Stepwise
from pumaid.effect_spec import EffectTerm
from pumaid.effects import catalogue
from pumaid.estimation.curves import informed, learned
from pumaid.estimation.fit import Fit, Projector
from pumaid.joint_bins import JointBins


@dataclass(frozen=True, eq=False, slots=True)
class CurveOffer:
    """A curve that explains a joint, the fit of what the model would have without it, and the effects that had been
    added for what it explains."""

    candidate: EvaluatedCandidate
    before: Fit
    stand_ins: tuple[EvaluatedCandidate, ...]


def offer(search: Stepwise, joint: int, *, is_unexplained: bool) -> CurveOffer | None:
    """The curve, after a finished search, for a joint (from 1) that stays unexplained; None where there is none.

    Where it does not, a curve is asked for that alone is decidedly better than several effects. The effects that were
    added there go, and come back where something is left for them beside the curve; together they must be decidedly
    better than these effects alone, and runs left out and runs held out must be predicted better. What is left with all
    effects says which curve is tried, and what is left without them.
    """
    last, added = search.fits.solved(search.added), list(search.added)
    there = [  # at the joint whose error they lower most
        item
        for item in search.accepted
        if min(item.after, key=lambda number: item.after[number] / item.before[number], default=None) == joint
    ]
    if not is_unexplained and len(there) < 2:
        return None
    rest = [term for term in added if not any(term is item.trial.added for item in there)]
    forms = free_form_tests(last, joint)
    last = forms[0].on if forms else last  # what has no name passes for noise where no run is repeated
    noises = last.noises | {joint: last.by_bin[joint].noise}
    bare, best = search.fits.solved(rest, noises, beside=added), None
    usual = _gain(bare, search.fits.solved(added, noises, beside=added), _terms(there))
    if not is_unexplained and _best(bare, joint)[1] <= usual + DECISIVE:
        return None
    for on in (last, bare) if there and is_unexplained else (bare,):
        form = _best(on, joint)[0]
        form = EffectTerm(form.effect, joint, form.effect.chosen(form.shape))
        curve, staying = learned(Projector(bare), form)[0], list[EvaluatedCandidate]()
        for item in sorted(there, key=lambda item: -item.evidence):
            fitted = search.fits.solved([*rest, *_terms(staying), curve], noises, beside=added)
            again = score_at(Projector(fitted), item.trial.added)
            staying += [item] if again is not None and evidence(fitted, again) > DECISIVE else []
        beside = search.fits.solved([*rest, *_terms(staying)], noises, beside=added)
        curve, more = learned(Projector(beside), form)
        total = more + _gain(bare, beside, _terms(staying))
        if best is None or total > best[0]:
            best = total, more, curve, staying, beside
    if best is None or best[0] <= usual + DECISIVE:
        return None
    _, more, curve, staying, before = best
    after = search.fits.solved([*rest, *_terms(staying), curve])
    candidate = _judged(before, after, curve, more, unseen=search.fits.unseen_with(search.added))
    unseen = [bins for bins in search.fits.unseen_with(search.added) if bins.joint == joint]
    if candidate.fault is not None or (unseen and rmse_of(after, unseen)[0] > rmse_of(last, unseen)[0]):
        return None
    return CurveOffer(candidate, before, tuple(item for item in there if item not in staying))


def _best(on: Fit, joint: int) -> tuple[EffectTerm, float]:
    return learned(Projector(on), EffectTerm(catalogue()["curve"], joint))


def _terms(items: Iterable[EvaluatedCandidate]) -> list[EffectTerm]:
    return [item.trial.added for item in items]


def _gain(without: Fit, fitted: Fit, terms: Sequence[EffectTerm]) -> float:
    """Evidence of several effects at once: by how much they lower the square, less what parameters gain by chance."""
    count = max(without.size - without.rank, 1)
    width = sum(len(term.effect.parameters(without.model.robot, term.number)) + len(term.shape) for term in terms)
    runs = sum(len(row.bins.runs) for row in without.joints) / len(without.joints)
    return count * float(np.log(without.square / fitted.square)) - width * float(np.log(max(runs, 2.0)))


def _judged(
    before: Fit, after: Fit, curve: EffectTerm, more: float, *, unseen: Sequence[JointBins]
) -> EvaluatedCandidate:
    joint = curve.joint or 0
    scores, information, prior, sizes = informed(Projector(before), curve)
    fall = float(scores.sum(axis=0) @ sizes)
    trial = ScoreTest(curve, fall, information + np.diag(prior), sizes, scores, 1.0, 0.0 * sizes)
    row, misfit = before.by_bin[joint], misfit_with(before, trial)
    chance = min((test.p_value for test in free_form_tests(before, joint)), default=1.0)
    return EvaluatedCandidate(
        trial,
        before,
        min(1.0, len(before.joints) * chance),
        more,
        cache(partial(leave_out, before, (curve,), replicate_folds(before, [joint]), prior=prior)),
        {joint: row.rmse},
        {joint: replace(row, misfit=misfit[joint]).rmse},
        transfer=confirmed_share(after, curve, unseen) if unseen else None,
    )


def curve_size(candidate: EvaluatedCandidate) -> tuple[Size, ...]:
    """RMS of a curve (A) over the runs of its joint, with its standard error."""
    term, solved = candidate.trial.added, candidate.on
    bins = solved.by_bin[term.joint or 0].bins
    columns, weight = term.linear(solved.model.robot, bins.samples), bins.count / bins.count.sum()
    drawn = columns @ candidate.trial.sizes
    size = float(np.sqrt(weight @ drawn**2))
    slope = columns.T @ (weight * drawn) / max(size, 1e-300)
    variance = float(slope @ np.linalg.pinv(candidate.trial.information, hermitian=True) @ slope) * solved.scale
    return (Size("rms", size, float(np.sqrt(max(variance, 0.0))), "A"),)
