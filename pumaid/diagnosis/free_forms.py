"""Free functions of one variable, scored like effects: the shape of what has no name."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from pumaid.diagnosis.candidates import Candidates, Expansion
from pumaid.diagnosis.effect_fits import with_noise_beside
from pumaid.diagnosis.score_test import (
    ScoreTable,
    ScoreTest,
    chance_of_pieces,
    evidence,
    is_few,
    score_of,
    sign_flips,
)
from pumaid.effect_spec import EffectTerm
from pumaid.effects import Samples
from pumaid.estimation.fit import Fit, Projector
from pumaid.joint_bins import JointBins
from pumaid.maths import Floats

#: Variable -> its unit (``{unit}`` is rad or m), and knots of a free function over its span: a bump of an eighth of the
#: span is still seen.
FORM_VARIABLES = {"q": ("{unit}", 16), "v": ("{unit}/s", 8), "load": ("A", 8), "t": ("s", 8), "travel": ("{unit}", 8)}
#: Variable of each form, and what multiplies the function of it: nothing, the direction s or the velocity v.
FORMS = (("q", ""), ("q", "s"), ("q", "v"), ("v", "s"), ("load", "s"), ("t", "s"), ("t", ""), ("travel", "s"))
#: Share of a knot's square below which it is absorbed by the model, and eigenvalues of what is left of the hats, as a
#: share of the largest, below which it absorbs a combination of them.
KNOT_ABSORBED, HATS_FLAT = 1e-4, 1e-3
#: Combinations of hats of which the model absorbs more than all but this share are not drawn: their sizes are told with
#: errors far above anything that is left.
DRAWN = 0.1


class FreeForm(Expansion):
    """A free function of one variable, as hat functions, named like ``s f(q)``.

    Source: C. de Boor, A Practical Guide to Splines, ch. 9 (linear B-splines).
    """

    needs_loads: ClassVar[bool] = True

    def __init__(self, variable: str, factor: str, knots: Floats) -> None:
        super().__init__(f"{factor} f({variable})".strip(), len(knots), self._made)
        self.variable, self.factor, self.knots = variable, factor, knots

    def _made(self, samples: Samples) -> Floats:
        factors = {"": np.ones(len(samples)), "s": samples.direction, "v": samples.velocity[:, samples.joint - 1]}
        x = variable(samples, self.variable)
        hats = np.column_stack([np.interp(x, self.knots, hat) for hat in np.eye(len(self.knots))])
        return np.asarray(hats * factors[self.factor][:, None])


def variable(samples: Samples, name: str) -> Floats:
    """(M,) values of a form's variable."""
    column = samples.joint - 1
    return {
        "q": samples.position[:, column],
        "v": np.abs(samples.velocity[:, column]),
        "load": np.zeros(len(samples)) if samples.loads is None else samples.loads.moving,
        "t": samples.time,
        "travel": samples.travel,
    }[name]


def forms(bins: JointBins) -> Iterator[FreeForm]:
    """Every form that the runs of a joint can show."""
    for name, factor in FORMS:
        x, count = variable(bins.samples, name), FORM_VARIABLES[name][1]
        low, high = float(x.min()), float(x.max())
        if high - low <= 1e-6 * max(abs(high), 1.0):
            continue
        knots: Floats = np.linspace(low, high, count)
        if name == "v":
            speeds = np.array(bins.speeds)
            knots = speeds if len(speeds) <= count else np.quantile(speeds, np.linspace(0.0, 1.0, count))
        if len(knots) > 1:
            yield FreeForm(name, factor, knots)


@dataclass(frozen=True, eq=False, slots=True)
class FormTest:
    """A free form's score, the fit that shows it, its noise that which the form leaves, and the chance that any form
    at the joint makes as much."""

    trial: ScoreTest
    on: Fit
    p_value: float

    @property
    def form(self) -> FreeForm:
        """The form."""
        assert isinstance(self.trial.added.effect, FreeForm)
        return self.trial.added.effect

    @property
    def evidence(self) -> float:
        """As of a candidate."""
        return evidence(self.on, self.trial)


def free_form_tests(solved: Fit, joint: int) -> list[FormTest]:
    """Every free form at one joint, the likeliest first, in the directions of its hats that a fit with loads does not
    absorb. Where runs are few their flips tell nothing, and each hat is tested by pieces of runs."""
    row, tests = solved.by_bin[joint], list[tuple[ScoreTest, Fit]]()
    for form in forms(row.bins):
        term = EffectTerm(form, joint)
        on = solved if row.noise.from_replicates else with_noise_beside(solved, row, term)
        trial = _scored(on, term)
        tests += [(trial, on)] if trial is not None else []
    chances = sign_flips(ScoreTable(solved, Candidates(), tuple(trial for trial, _ in tests)))
    counts, out = [len(trial.added.parameters(solved.model.robot)) for trial, _ in tests], list[FormTest]()
    for (trial, on), count in zip(tests, counts, strict=True):
        chance = chances.p_value(trial.added.key, trial.surprise(on.scale))
        if evidence(on, trial) > 0.0:
            hats = [replace(trial, sizes=hat) for hat in np.eye(count)]
            if is_few(solved, joint):
                chance = min(1.0, 2.0 * min(chance, *(chance_of_pieces(on, hat, sum(counts)) for hat in hats)))
            chance = max(chance, min(chance_of_pieces(on, hat, sum(counts), of_motion=True) for hat in hats))
        out.append(FormTest(trial, on, chance))
    return sorted(out, key=lambda test: -test.evidence)


def _scored(solved: Fit, term: EffectTerm) -> ScoreTest | None:
    scores, information, raw = _hat_scores(Projector(solved), term)
    visible = np.flatnonzero(np.diagonal(information) > KNOT_ABSORBED * raw)
    if len(visible) < 2:
        return None
    values, vectors = np.linalg.eigh(information[np.ix_(visible, visible)])
    turn = vectors[:, values > HATS_FLAT * values[-1]]
    information, free = turn.T @ information[np.ix_(visible, visible)] @ turn, np.zeros(turn.shape[1])
    return score_of(term, scores[:, visible] @ turn, information, share=free + 1.0, signs=free)


def _hat_scores(projector: Projector, term: EffectTerm) -> tuple[Floats, Floats, Floats]:
    columns = projector.columns([term])
    scores, information, raw = projector.scores(projector.whitened(columns), columns[term.number].shape[1])
    return scores, information[0], raw


def knot_values(test: FormTest) -> tuple[Floats, Floats, Floats]:
    """Knots, values there (A, as a current in the direction of motion where the form says so) and standard errors."""
    scores, information, raw = _hat_scores(Projector(test.on), test.trial.added)
    unit = np.divide(1.0, np.sqrt(raw), out=np.zeros_like(raw), where=raw > 0.0)
    values, vectors = np.linalg.eigh(information * np.outer(unit, unit))
    good = values > DRAWN
    inverse = unit[:, None] * ((vectors[:, good] / values[good]) @ vectors[:, good].T) * unit
    return test.form.knots, inverse @ scores.sum(axis=0), np.sqrt(np.diagonal(inverse) * test.on.scale)
