"""Learned curves: how smooth one is, by restricted maximum likelihood, and what a fit says of it."""

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pumaid.effect_spec import EffectTerm
from pumaid.effects.curve import CHOSEN, COEFFICIENTS, OF, variable
from pumaid.errors import ModelError, Where
from pumaid.estimate import NOT_IDENTIFIABLE, Value
from pumaid.estimation.covariance import interval
from pumaid.estimation.fit import Fit, Projector
from pumaid.maths import Floats
from pumaid.robot import SHAPE_WORDS

#: Of, odd and times of the curves that are tried where a choice leaves these open: even and odd in position and time,
#: a viscous friction that varies with position, and frictions by the other variables.
USUAL = {(0, 0, 0), (0, 1, 0), (0, 1, 1), (1, 1, 0), (2, 1, 0), (3, 1, 0), (4, 0, 0), (4, 1, 0), (5, 1, 0)}
#: Deviations of bends that are tried, as shares of the joint's current: the error of the fit hardly changes with a
#: step. Range of a variable, as a share of its size, below which it does not vary.
SPREADS, STANDS = np.geomspace(1e-5, 10.0, 41), 1e-6


def learned(projector: Projector, term: EffectTerm) -> tuple[EffectTerm, float]:
    """The curve, with the shapes that `term` states, that explains best what a fit leaves, and its evidence.

    Form and smoothness have the largest marginal likelihood, the variance that which is left with the curve. Evidence
    is as of any effect: twice the gain in log likelihood less (effective degrees of freedom and smoothness) x
    log(runs). Raises ModelError (effect-shape) where no variable varies.

    Source: S. N. Wood, Generalized Additive Models, 2nd ed., section 6.2 (REML as marginal likelihood), 6.2.1 (in the
    eigenbasis); D. Ruppert, M. P. Wand and R. J. Carroll, Semiparametric Regression, section 4.9.
    """
    tried = [(_smoothed(projector, form), form) for form in _forms(projector, term)]
    usable = [(*fit, form) for fit, form in tried if fit is not None]
    if not usable:
        word = SHAPE_WORDS["of"][int(term.shape["of"])] if "of" in term.shape else "variable"
        what = f"the {word} hardly varies in the runs of joint {term.number}, so no curve of it can be learned"
        raise ModelError("effect-shape", what, Where(joint=term.joint, field="curve"), "leave it out")
    _, evidence, spread, form = max(usable, key=lambda item: item[0])
    return form.at({"spread": term.shape.get("spread", spread)}), evidence


def _forms(projector: Projector, term: EffectTerm) -> Iterator[EffectTerm]:
    """The curves that a choice leaves open, over the range that the runs cover; of a stated variable nothing times."""
    given = ({"times": 0.0} if "of" in term.shape else {}) | dict(term.shape)
    forms = [
        form
        for form in itertools.product(range(len(OF)), (0, 1), (0, 1))
        if all(given.get(name, size) == size for name, size in zip(CHOSEN, form, strict=True))
    ]
    for form in [form for form in forms if form in USUAL] or forms:
        shape = dict(zip(CHOSEN, map(float, form), strict=True))
        x = variable(projector.solved.model.robot, projector.samples[term.number], shape)
        low, high = float(x.min()), float(x.max())
        if high - low > STANDS * max(abs(low), abs(high), STANDS):
            yield term.at({**shape, "low": given.get("low", low), "high": given.get("high", high)})


def _smoothed(projector: Projector, term: EffectTerm) -> tuple[float, float, float] | None:
    """The highest marginal likelihood of a curve (twice its logarithm's gain), its evidence and the deviation of its
    bends (A) there."""
    solved, columns = projector.solved, projector.columns([term])
    if not columns:
        return None
    scores, information, _ = projector.scores(projector.whitened(columns), COEFFICIENTS.shape[1])
    total, bins, best = scores.sum(axis=0), solved.by_bin[term.number].bins, (-np.inf, 0.0, 0.0)
    runs = sum(len(row.bins.runs) for row in solved.joints) / len(solved.joints)
    usual, count = np.sqrt(bins.mean_square), max(solved.size - solved.rank, 1)
    for share in SPREADS:
        root = usual * np.append(1.0, np.full(len(total) - 1, share))
        values, vectors = np.linalg.eigh(root[:, None] * information[0] * root)
        values = np.maximum(values, 0.0)
        fall = float(np.sum((vectors.T @ (root * total)) ** 2 / (1.0 + values)))
        remaining = max(solved.square - fall, 1e-9 * solved.square)
        gain = float(count * np.log(solved.square / remaining))
        freedom, likelihood = float(np.sum(values / (1.0 + values))), gain - float(np.log1p(values).sum())
        if likelihood > best[0]:
            evidence = gain - (freedom + 1.0) * float(np.log(max(runs, 2.0)))
            best = likelihood, evidence, float(usual * share * np.sqrt(remaining / count))
    return best


def informed(projector: Projector, curve: EffectTerm) -> tuple[Floats, Floats, Floats, Floats]:
    """(R, K) scores and (K, K) information of a curve's coefficients, (K,) what their prior adds, and these (A)."""
    scores, information, _ = projector.scores(projector.whitened(projector.columns([curve])), COEFFICIENTS.shape[1])
    usual = np.sqrt(projector.solved.by_bin[curve.number].bins.mean_square)
    prior = np.append(usual, np.full(len(COEFFICIENTS.T) - 1, curve.shape["spread"])) ** -2.0
    return scores, information[0], prior, np.linalg.solve(information[0] + np.diag(prior), scores.sum(axis=0))


def curve_values(fitted: Fit, covariance: Floats) -> Iterator[Value]:
    """Of each curve of a model its RMS (A) over the runs that were fitted, and its effective degrees of freedom.

    The error is by the (P, P) covariance of all parameters, which with the curve's prior is that of its distribution
    after the data: G. Wahba, J. R. Stat. Soc. B 45 (1983) 133-150; S. N. Wood, section 6.10.
    """
    for place, term in enumerate(fitted.model.effects):
        row = next((row for row in fitted.rows if row.joint == term.joint), None)
        if not term.effect.is_free:
            continue
        numbers, name = fitted.columns_of(place), f"curve.j{term.number}."
        bare = Value(f"{name}rms{term.mark}", f"f{term.number}{term.mark}", term.joint, "A")
        if row is None:
            yield replace(bare, state=NOT_IDENTIFIABLE, reason="waits for logs in which its joint moves alone")
            continue
        design, weight = row.design[:, numbers], row.bins.count / row.bins.count.sum()
        drawn = design @ fitted.values[numbers]
        rms = float(np.sqrt(weight @ drawn**2))
        slope = design.T @ (weight * drawn) / max(rms, 1e-300)
        error = float(np.sqrt(max(slope @ covariance[np.ix_(numbers, numbers)] @ slope, 0.0)))
        yield replace(bare, value=rms, std_error=error, ci95=interval(rms, error, np.inf), dof=float("inf"))
        freedom = float(np.sum(1.0 - fitted.prior[numbers] ** 2 * np.diag(fitted.inverse)[numbers]))
        yield Value(f"{name}edf{term.mark}", f"edf{term.number}{term.mark}", term.joint, "1", value=freedom)
