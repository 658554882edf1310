"""Free forms: what is left as a free function of one variable, compared by the same evidence as effects."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from pumaid.diagnosis.score_test import ScoreTest, score_of
from pumaid.effect_spec import EffectTerm
from pumaid.effects.base import NO_SHAPE, Effect, Family, Parameter
from pumaid.estimation.fit import Fit, Projector
from pumaid.joint_bins import JointBins
from pumaid.robot import Robot
from pumaid.samples import Samples

Floats = NDArray[np.float64]

#: Variable -> its unit (``{unit}`` is rad or m), and knots of a free function over its span: a bump of an eighth of the
#: span is still seen.
VARIABLES = {"q": ("{unit}", 16), "v": ("{unit}/s", 8), "load": ("A", 8), "t": ("s", 8), "travel": ("{unit}", 8)}
#: Variable of each form, and what multiplies the function of it: nothing, the direction s or the velocity v.
FORMS = (("q", ""), ("q", "s"), ("q", "v"), ("v", "s"), ("load", "s"), ("t", "s"), ("t", ""), ("travel", "s"))
#: Share of a knot's square below which it is absorbed by the model, and eigenvalues of what is left of the hats, as a
#: share of the largest, below which it absorbs a combination of them.
ABSORBED, FLAT = 1e-4, 1e-3
#: Combinations of hats of which the model absorbs more than all but this share are not drawn: their sizes are told with
#: errors far above anything that is left.
DRAWN = 0.1


class FreeForm(Effect):
    """A free function of one variable, as hat functions; no physics, so not in the catalogue."""

    title = "A free function"
    source = "C. de Boor, A Practical Guide to Splines, ch. 9 (linear B-splines)"
    family = Family.SUSPECT
    needs_loads: ClassVar[bool] = True

    def __init__(self, variable: str, factor: str, knots: Floats) -> None:
        self.variable, self.factor, self.knots = variable, factor, knots

    @property
    def name(self) -> str:
        """The form, such as ``s f(q)``."""
        return f"{self.factor} f({self.variable})".strip()

    @property
    def unit(self) -> str:
        """Of the variable."""
        return VARIABLES[self.variable][0]

    def parameters(self, robot: Robot, number: int) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"b{k}", "A", "at a knot", f"b{k}") for k in range(len(self.knots)))

    def columns(
        self, robot: Robot, samples: Samples, *, number: int | None = None, shape: Mapping[str, float] = NO_SHAPE
    ) -> Floats:
        factors = {"s": samples.direction, "v": samples.velocity[:, samples.joint - 1]}
        factor = factors.get(self.factor, np.ones(len(samples)))
        return hats(variable(samples, self.variable), self.knots) * factor[:, None]


def variable(samples: Samples, name: str) -> Floats:
    """(M,) values of a form's variable."""
    column = samples.joint - 1
    variables = {
        "q": samples.position[:, column],
        "v": np.abs(samples.velocity[:, column]),
        "load": np.zeros(len(samples)) if samples.loads is None else samples.loads.moving,
        "t": samples.time,
        "travel": samples.travel,
    }
    return variables[name]


def hats(x: Floats, knots: Floats) -> Floats:
    """(M, K) hat functions: one at a knot, zero at its neighbours, linear between."""
    return np.column_stack([np.interp(x, knots, hat) for hat in np.eye(len(knots))])


def forms(bins: JointBins) -> Iterator[FreeForm]:
    """Every form that the runs of a joint can show."""
    for name, factor in FORMS:
        x, count = variable(bins.samples, name), VARIABLES[name][1]
        low, high = float(x.min()), float(x.max())
        if high - low <= 1e-6 * max(abs(high), 1.0):
            continue
        knots: Floats = np.linspace(low, high, count)
        if name == "v":
            speeds = np.array(bins.speeds)
            knots = speeds if len(speeds) <= count else np.quantile(speeds, np.linspace(0.0, 1.0, count))
        if len(knots) > 1:
            yield FreeForm(name, factor, knots)


def free_form_scores(solved: Fit, joint: int) -> list[ScoreTest]:
    """Every free form at one joint, in the directions of its hats that a fit with loads does not absorb."""
    projector, out = Projector(solved), []
    for form in forms(solved.row(joint).bins):
        term = EffectTerm(form, joint)
        scores, information, raw = _hat_scores(projector, term)
        visible = np.flatnonzero(np.diagonal(information) > ABSORBED * raw)
        if len(visible) < 2:
            continue
        values, vectors = np.linalg.eigh(information[np.ix_(visible, visible)])
        turn = vectors[:, values > FLAT * values[-1]]
        information, width = turn.T @ information[np.ix_(visible, visible)] @ turn, turn.shape[1]
        shares, signs = np.ones(width), np.zeros(width)
        trial = score_of(term, scores[:, visible] @ turn, information, share=shares, signs=signs)
        out += [] if trial is None else [trial]
    return out


def _hat_scores(projector: Projector, term: EffectTerm) -> tuple[Floats, Floats, Floats]:
    """(R, K) scores, (K, K) information and (K,) squares of the hats of a form."""
    columns = projector.columns([term])
    scores, information, raw = projector.scores(projector.whitened(columns), columns[term.number].shape[1])
    return scores, information[0], raw


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
