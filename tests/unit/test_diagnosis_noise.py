"""Noise of bins, and the whitened system against the whole problem written out bin by bin."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.optimize import least_squares
from searches import LEVER, Din, Lab, covariances, design, left, lever, pendulum, roots, whitened
from worlds import course, run_of

from pumaid.dataset import first_motions
from pumaid.diagnosis.candidates import settling
from pumaid.effect_spec import EffectTerm
from pumaid.effects import Scope, catalogue
from pumaid.estimation.fit import Fit, design_of
from pumaid.estimation.noise import NoiseModel, noise_of
from pumaid.joint_bins import JointBins, joint_bins
from pumaid.model import Model

#: Draws of noise over which an estimate's mean is taken.
DRAWS = 60


@cache
def uneven() -> JointBins:
    """Runs of 12, 1, 2 and 7 bins."""
    path = course("constant", -1.0, 1.0, duration=2.0, samples=48)
    runs = [run_of(LEVER, 1, [0.0], course=path, current=np.sin(path[1]), bins=bins) for bins in (12, 1, 2, 7)]
    return joint_bins(LEVER, runs, begun=first_motions(runs))[0]


STATED = NoiseModel(
    np.array([0.6, 0.3, 0.9, 0.0]), np.array([0.02, 0.01, 0.03, 0.05]), np.full(4, 0.04), from_replicates=True
)
NO_LEVEL = NoiseModel(STATED.correlation, STATED.spread, np.zeros(4), from_replicates=True)


@pytest.mark.parametrize("stated", [STATED, NO_LEVEL])
def test_whitening_is_an_inverse_root_of_the_covariance(stated):
    """W' W times the covariance that is stated is the identity; unwhitening is W'."""
    root = stated.whiten(uneven(), np.eye(len(uneven())))
    np.testing.assert_allclose(root.T @ root @ block_diag(*covariances(uneven(), stated)), np.eye(22), atol=1e-9)
    v = np.random.default_rng(1).normal(size=len(uneven()))
    np.testing.assert_allclose(stated.unwhiten(uneven(), v), root.T @ v, rtol=1e-10, atol=1e-8)


def estimates(lab: Lab, din: Din, pattern: float = 0.0) -> list[NoiseModel]:
    """What is found in pure noise of a known kind, on a course of the position (A) that every run repeats."""
    (one,) = lab.bins()
    same = pattern * np.sin(5.0 * one.samples.position[:, 0])
    draws = [din.draw(np.random.default_rng(seed), one.lengths) for seed in range(DRAWS)]
    return [noise_of(one, same + drawn) for drawn in draws]


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.8])
@pytest.mark.parametrize("pattern", [0.0, 0.1])
def test_replicates_show_the_noise_whatever_the_model_misses(correlation, pattern):
    """Correlation and spread within 3 %, the level's square within 4 standard errors, beside ten times the physics."""
    din = Din(spread=0.01, correlation=correlation, level=0.006)
    found = estimates(lever(), din, pattern)
    assert all(one.from_replicates for one in found)
    assert np.mean([one.correlation.mean() for one in found]) == pytest.approx(correlation, abs=0.03)
    assert np.mean([one.spread.mean() for one in found]) == pytest.approx(0.01, rel=0.03)
    squares = np.array([float(one.level[0]) ** 2 for one in found])
    assert abs(squares.mean() - 0.006**2) < 4.0 * squares.std() / np.sqrt(DRAWS)


def test_without_replicates_missing_physics_passes_for_noise():
    """The residual alone takes what the runs share for noise: twice the spread here; none where nothing hides."""
    din = Din(spread=0.01, correlation=0.5, level=0.006)
    unrepeated = Lab.of(LEVER, design(LEVER, postures=1, speeds=(0.25, 0.35, 0.5, 0.7, 1.0, 1.5), repeats=1))
    clean, missing = (estimates(unrepeated, din, pattern) for pattern in (0.0, 0.03))
    assert not any(one.from_replicates for one in clean + missing)
    assert np.mean([one.spread.mean() for one in clean]) == pytest.approx(0.01, rel=0.05)
    assert np.mean([one.spread.mean() for one in missing]) > 2.0 * 0.01


def test_short_runs_hide_correlation_and_that_is_mended():
    """With 16 bins a run the plain estimate of a correlation of 0.8 is short by 0.2; what is told is within 0.06."""
    short = Lab.of(LEVER, design(LEVER), bins=16)
    (one,) = short.bins()
    plain = []
    for seed in range(DRAWS):
        parts = np.split(Din(correlation=0.8).draw(np.random.default_rng(seed), one.lengths), one.first[1:])
        centred = [part - part.mean() for part in parts]
        plain.append(sum(c[1:] @ c[:-1] for c in centred) / sum(c @ c for c in centred))
    found = estimates(short, Din(correlation=0.8))
    assert np.mean(plain) < 0.62
    assert np.mean([one.correlation.mean() for one in found]) == pytest.approx(0.8, abs=0.06)
    assert np.mean([one.spread.mean() for one in found]) == pytest.approx(0.01, rel=0.1)


def test_runs_whose_cells_last_otherwise_have_their_own_noise(monkeypatch):
    """Slow runs made noisy and quick ones quiet are told apart, though they repeat in one field."""
    monkeypatch.setattr("pumaid.estimation.noise.FEWEST_BINS", 200)
    (one,) = lever().bins()
    is_slow = np.abs([run.speed for run in one.runs]) < 0.4
    rng, parts = np.random.default_rng(3), []
    for length, slow in zip(one.lengths, is_slow, strict=True):
        parts.append(Din(0.02 if slow else 0.005, 0.7 if slow else 0.2, 0.0).draw(rng, [length]))
    found = noise_of(one, np.concatenate(parts))
    for group, spread, correlation in ((is_slow, 0.02, 0.7), (~is_slow, 0.005, 0.2)):
        np.testing.assert_allclose(found.spread[group], spread, rtol=0.15)
        np.testing.assert_allclose(found.correlation[group], correlation, atol=0.15)


def test_no_noise_at_all_is_not_zero():
    """What a simulation without noise leaves is rounding; a spread of nothing could not be divided by."""
    (one,) = lever().bins()
    assert np.all(noise_of(one, np.zeros(len(one))).spread > 0.0)


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
