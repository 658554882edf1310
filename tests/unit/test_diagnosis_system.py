"""The whitened system: its minimum and its derivatives are those of the whole problem written out bin by bin."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.optimize import least_squares
from searches import Lab, left, lever, pendulum, roots, whitened

from pumaid.diagnosis.candidates import settling
from pumaid.effect_spec import EffectTerm
from pumaid.effects import Scope, catalogue
from pumaid.estimation.fit import Fit, design_of
from pumaid.model import Model

STRIBECK = EffectTerm(catalogue()["stribeck"], 1, {"velocity": 0.3, "exponent": 1.0})
WARMUP = EffectTerm(catalogue()["warmup"], 1, {"time_constant": 60.0})
SPRING = EffectTerm(catalogue()["spring"], 1, {})


class Written:
    """The bilinear problem in the paper's words: link parameters of an outer link times a ratio of gains."""

    def __init__(self, fitted: Fit) -> None:
        self.fitted, self.base = fitted, Model(fitted.model.robot)
        self.edges = fitted.gains.edges
        self.begin = np.concatenate([fitted.values, [fitted.gains.edge[edge] for edge in self.edges]])
        self.roots = [block_diag(*roots(row.bins, row.noise)) for row in fitted.joints]
        self.designs = {row.bins.joint: design_of(fitted.model, row.bins, fitted) for row in fitted.joints}

    def predicted(self, joint: int, theta: np.ndarray) -> np.ndarray:
        """(N,) A in a joint, column after column."""
        out = np.zeros(len(self.designs[joint]))
        for number, column in enumerate(self.fitted.model.columns):
            ratio = 1.0
            if column.scope is Scope.LINK:
                for member in range(joint, column.owner):
                    ratio *= theta[len(self.fitted.values) + self.edges.index(member)]
            out += ratio * theta[number] * self.designs[joint][:, number]
        return out

    def misfits(self, theta: np.ndarray) -> np.ndarray:
        """All whitened residuals, and how far effects are from what is likely before any data."""
        parts = [
            root @ (row.bins.current - self.predicted(row.bins.joint, theta))
            for root, row in zip(self.roots, self.fitted.joints, strict=True)
        ]
        return np.concatenate([*parts, (self.fitted.prior * theta)[: len(self.fitted.values)]])

    def least(self) -> np.ndarray:
        """The minimum, from what was found moved by a tenth."""
        return least_squares(self.misfits, 0.9 * self.begin, x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14).x


def noisy(lab: Lab, *added: EffectTerm) -> Fit:
    """An experiment with noise, solved."""
    return lab.fitted(lab.noisy(3), added)


@pytest.mark.parametrize("added", [(), (SPRING,)])
def test_the_minimum_is_that_of_the_whole_problem(added):
    """Residuals of both joints agree with a general least-squares program on dense, Cholesky-whitened residuals."""
    solved = noisy(pendulum(), *added)
    written = Written(solved)
    theta = written.least()
    for row in solved.joints:
        misfit = row.bins.current - written.predicted(row.bins.joint, theta)
        np.testing.assert_allclose(row.misfit, misfit, atol=1e-6)
    total = float(np.sum(written.misfits(theta)[: solved.size] ** 2))
    assert solved.square == pytest.approx(total, rel=1e-8)


def test_jacobian_is_the_derivative_of_the_prediction():
    """By every parameter, ratios of gains included, against central differences of the problem written out."""
    solved = noisy(pendulum())
    written = Written(solved)
    theta = written.begin
    for row in solved.joints:
        for place in range(len(theta)):
            step = np.zeros(len(theta))
            step[place] = 1e-5 * max(abs(theta[place]), 1.0)
            ends = [written.predicted(row.bins.joint, theta + sign * step) for sign in (1.0, -1.0)]
            slope = row.noise.whiten(row.bins, (ends[0] - ends[1]) / (2.0 * step[place]))
            np.testing.assert_allclose(row.jacobian[:, place], slope, atol=1e-5 * (1.0 + np.abs(slope).max()))


def test_effects_and_their_shapes_are_fitted_with_all_else():
    """One joint is linear: the square is what a dense fit of base, effects and derivatives by their shapes leaves."""
    # To a thousandth: shapes have a prior in the fit.
    solved = noisy(lever(), STRIBECK, WARMUP)
    row = solved.row(1)
    columns = [Model(lever().robot).design(row.bins)]
    for one in solved.model.effects:
        here = one.linear(solved.model.robot, row.bins.samples)
        near = [replace(one, shape={**one.shape, name: value * 1.0001}) for name, value in one.shape.items()]
        columns += [here, *[other.linear(solved.model.robot, row.bins.samples) - here for other in near]]
    dense = whitened(row.bins, row.noise, np.column_stack([*columns, row.bins.current]))
    assert solved.square == pytest.approx(left(dense[:, :-1], dense[:, -1]), rel=1e-3)


def test_settling_is_free_at_every_speed_and_nowhere_else():
    """A transient of each speed's own size at the start of runs leaves nothing; the same in mid-run stays."""
    lab = lever()
    (field,) = lab.bins()
    t = field.samples.travel / np.abs(field.samples.velocity[:, 0])
    own = np.abs(field.samples.velocity[:, 0]) ** 0.3
    early, late = (0.3 * field.samples.direction * own * np.exp(-np.abs(t - at) / 0.025) for at in (0.0, 1.0))
    (free,) = settling([field])
    columns = np.column_stack([lab.model.design(field), free.linear(lab.model.robot, field.samples)])
    assert left(columns, early) < 1e-6 * float(early @ early)
    assert left(columns, late) > 0.5 * float(late @ late)
