"""FreeForm forms: what is left as a free function of one variable, compared by the same evidence as effects."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from pumaid.diagnosis.score_test import Projector, ScoreTest, score_of
from pumaid.effect_spec import EffectTerm
from pumaid.effects.base import NO_SHAPE, Effect, Family, Parameter
from pumaid.estimation.fit import Fit
from pumaid.joint_bins import JointBins
from pumaid.robot import Robot
from pumaid.samples import Samples

Floats = NDArray[np.float64]

#: Knots of a free function over the span of its variable: a bump of an eighth of the span is still seen.
KNOTS = {"q": 16, "v": 8, "load": 8, "t": 8, "travel": 8}
#: Share of a knot's square below which it is absorbed by the model.
ABSORBED = 1e-4


@dataclass(frozen=True, slots=True)
class FormSpec:
    """A free form: its name, variable, unit (``{unit}`` is rad or m) and what multiplies it (1, s or v)."""

    name: str
    variable: str
    unit: str
    factor: str


FORMS = (
    FormSpec("f(q)", "q", "{unit}", "1"),
    FormSpec("s f(q)", "q", "{unit}", "s"),
    FormSpec("v f(q)", "q", "{unit}", "v"),
    FormSpec("s f(v)", "v", "{unit}/s", "s"),
    FormSpec("s f(load)", "load", "A", "s"),
    FormSpec("s f(t)", "t", "s", "s"),
    FormSpec("f(t)", "t", "s", "1"),
    FormSpec("s f(travel)", "travel", "{unit}", "s"),
)


class FreeForm(Effect):
    """A free function of one variable, as hat functions; no physics, so not in the catalogue."""

    title = "A free function"
    source = "C. de Boor, A Practical Guide to Splines, ch. 9 (linear B-splines)"
    family = Family.SUSPECT
    needs_loads: ClassVar[bool] = True

    def __init__(self, form: FormSpec, knots: Floats) -> None:
        self.form, self.knots = form, knots

    @property
    def name(self) -> str:
        """The form."""
        return self.form.name

    def parameters(self, robot: Robot, number: int) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"b{k}", "A", "at a knot", f"b{k}") for k in range(len(self.knots)))

    def columns(
        self, robot: Robot, samples: Samples, *, number: int | None = None, shape: Mapping[str, float] = NO_SHAPE
    ) -> Floats:
        factors = {"s": samples.direction, "v": samples.velocity[:, samples.joint - 1]}
        factor = factors.get(self.form.factor, np.ones(len(samples)))
        return hats(variable(samples, self.form.variable), self.knots) * factor[:, None]


def variable(samples: Samples, name: str) -> Floats:
    """(M,) values of a form's variable."""
    column = samples.joint - 1
    if name == "load":
        return np.zeros(len(samples)) if samples.loads is None else samples.loads.moving
    variables = {
        "q": samples.position[:, column],
        "v": np.abs(samples.velocity[:, column]),
        "t": samples.time,
        "travel": samples.travel,
    }
    return variables[name]


def hats(x: Floats, knots: Floats) -> Floats:
    """(M, K) hat functions: one at a knot, zero at its neighbours, linear between."""
    place = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, len(knots) - 2)
    share = np.clip((x - knots[place]) / (knots[place + 1] - knots[place]), 0.0, 1.0)
    out = np.zeros((len(x), len(knots)))
    rows = np.arange(len(x))
    out[rows, place], out[rows, place + 1] = 1.0 - share, share
    return out


def forms(field: JointBins) -> Iterable[FreeForm]:
    """Every form that the runs of a joint can show."""
    for form in FORMS:
        x = variable(field.samples, form.variable)
        low, high = float(x.min()), float(x.max())
        if high - low <= 1e-6 * max(abs(high), 1.0):
            continue
        knots: Floats = np.linspace(low, high, KNOTS[form.variable])
        if form.variable == "v":
            speeds = np.array(field.speeds)
            knots = speeds if len(speeds) <= KNOTS["v"] else np.quantile(speeds, np.linspace(0.0, 1.0, KNOTS["v"]))
        if len(knots) > 1:
            yield FreeForm(form, knots)


def free_form_scores(solved: Fit, joint: int) -> list[ScoreTest]:
    """Every free form at one joint, tried on a system with loads."""
    row, projector, out = solved.row(joint), Projector(solved), []
    for free in forms(row.bins):
        term = EffectTerm(free, joint, NO_SHAPE)
        scores, information, raw = _hat_scores(projector, term)
        share = np.divide(np.diagonal(information), raw, out=np.zeros(len(raw)), where=raw > 0)
        trial = _in_visible_directions(term, scores, information, np.flatnonzero(share > ABSORBED))
        if trial is not None:
            out.append(trial)
    return out


def _hat_scores(projector: Projector, term: EffectTerm) -> tuple[Floats, Floats, Floats]:
    """(R, K) scores, (K, K) information and (K,) squares of the hats of a form."""
    row = projector.solved.row(term.number)
    columns = term.linear(projector.solved.model.robot, row.bins.samples)
    scores, information, raw = projector.scores({term.number: row.noise.whiten(row.bins, columns)}, columns.shape[1])
    return scores, information[0], raw


#: Combinations of hats of which the model absorbs more than all but this share are not drawn: their sizes are told with
#: errors far above anything that is left.
DRAWN = 0.1
#: Eigenvalues of what is left of the hats below this share of the largest are combinations that the model absorbs.
FLAT = 1e-3


def _in_visible_directions(
    term: EffectTerm, scores: Floats, information: Floats, visible: NDArray[np.int64]
) -> ScoreTest | None:
    """The trial in the directions of the `visible` hats that the model does not absorb."""
    if len(visible) < 2:
        return None
    values, vectors = np.linalg.eigh(information[np.ix_(visible, visible)])
    good = values > FLAT * values[-1]
    if not good.any():
        return None
    turn = np.zeros((len(information), int(good.sum())))
    turn[visible] = vectors[:, good]
    width = turn.shape[1]
    return score_of(term, scores @ turn, turn.T @ information @ turn, share=np.ones(width), signs=np.zeros(width))


def knot_values(solved: Fit, trial: ScoreTest) -> tuple[Floats, Floats, Floats]:
    """Knots, values there (A, as a current in the direction of motion where the form says so) and standard errors."""
    free = trial.added.effect
    assert isinstance(free, FreeForm)
    scores, information, raw = _hat_scores(Projector(solved), trial.added)
    unit = np.divide(1.0, np.sqrt(raw), out=np.zeros_like(raw), where=raw > 0.0)
    values, vectors = np.linalg.eigh(information * np.outer(unit, unit))
    good = values > DRAWN
    inverse = unit[:, None] * ((vectors[:, good] / values[good]) @ vectors[:, good].T) * unit
    return free.knots, inverse @ scores.sum(axis=0), np.sqrt(np.diagonal(inverse) * solved.scale)
