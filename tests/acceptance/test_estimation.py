"""What the estimate promises, held against hundreds of simulated experiments: intervals, efficiency, exactness."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pumaid.files.recipe import read_recipe, shipped_recipes
from pumaid.fit.system import Fitted, solve
from pumaid.maths.joint_fit import Bilinear
from pumaid.model import Model
from pumaid.records import Estimate, Evidence
from pumaid.verbs.identify import identify
from pumaid.verbs.plan import plan
from pumaid.virtual import Bench, Noise, Truth, draw, table1

EXPERIMENTS = 200
#: Seeds of this file start here; development used seeds below 20000.
SEEDS = 70_000
#: Four binomial standard deviations of 200 experiments below 95 %.
LEAST = 0.95 - 4 * (0.95 * 0.05 / EXPERIMENTS) ** 0.5
#: Experiments on which white-noise intervals are shown to fail; they fail by far.
WHITE = 40


def white_errors(fitted: Fitted) -> dict[str, float]:
    """Standard errors as if every sample were independent: what a plain least-squares program prints."""
    information = np.zeros((len(fitted.model.names) + len(fitted.gains.edges),) * 2)
    for row in fitted.rows:
        plain = Bilinear(np.full(row.target.size, row.joint - 1), row.stacked, row.target.ravel(), fitted.system.owners)
        J = plain.jacobian(fitted.gains, fitted.solution.values)
        misfit = row.target.ravel() - plain.scaled(fitted.gains) @ fitted.solution.values
        information += J.T @ J / ((misfit @ misfit + row.rest) / row.samples)
    root = np.sqrt(np.diag(information))
    inverse = np.linalg.inv(information / np.outer(root, root)) / np.outer(root, root)
    return dict(zip(fitted.model.names, np.sqrt(np.diag(inverse)), strict=False))


def coverage(truth: Truth, bench: Bench, *, white: bool = False) -> tuple[dict[str, float], dict[str, float]]:
    """Share of 95 % intervals that hold the truth, by parameter: ours, and (where asked) white-noise ones."""
    known = truth.parameters()
    ours: dict[str, list[bool]] = {}
    theirs: dict[str, list[bool]] = {}
    for seed in range(EXPERIMENTS):
        runs = bench.runs(np.random.default_rng(SEEDS + seed))
        estimate = identify(Evidence(runs), truth.robot)
        for value in estimate.values:
            if value.ci95 is not None:
                ours.setdefault(value.name, []).append(value.ci95[0] <= known[value.name] <= value.ci95[1])
        if white and seed < WHITE:
            errors = white_errors(solve(Model.of_runs(truth.robot, runs), runs))
            for name, error in errors.items():
                deviation = estimate.solution[estimate.names.index(name)] - known[name]
                theirs.setdefault(name, []).append(abs(deviation) <= 1.96 * error)
    return tuple({name: float(np.mean(hits)) for name, hits in found.items()} for found in (ours, theirs))


@pytest.mark.slow
def test_puma_intervals_hold_where_white_noise_ones_fail():
    """On the paper's PUMA 95 % intervals cover 93-97 % of the truths though samples of a run share noise and level.

    Of single parameters only the least is judged, by four binomial standard deviations since it is the least of some
    forty. Link 5's own x covers always: its interval carries the ignorance of eta_5/eta_6, which is zero in the table.
    """
    truth = table1.puma560()
    ours, theirs = coverage(truth, Bench(truth, table1.experiment(2), rate=50.0), white=True)
    assert 0.93 <= np.mean(list(ours.values())) <= 0.97
    assert min(ours.values()) > LEAST
    assert np.mean(list(theirs.values())) < 0.75


@pytest.mark.slow
@pytest.mark.parametrize(("name", "seed"), [("ur3e", 11), ("stanford", 12), ("pendulum2", 13)])
def test_other_arms_intervals_hold(name, seed):
    """So they do on drawn arms, one with a prismatic joint, whose experiment is the planner's."""
    robot = read_recipe(shipped_recipes()[name])
    truth = draw(robot, seed)
    ours, _ = coverage(truth, Bench(truth, plan(robot, seed=seed, replicates=1), rate=50.0))
    assert 0.93 <= np.mean(list(ours.values())) <= 0.97
    assert min(ours.values()) > LEAST


def bound(truth: Truth, bench: Bench) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Names, true values and Cramer-Rao standard errors of parameters and neighbours' ratios, noise being white."""
    quiet = Bench(replace(truth, noise=Noise(np.zeros(truth.robot.n_joints))), bench.plan, rate=bench.rate)
    runs = quiet.runs(np.random.default_rng(0))
    fitted = solve(Model.of_runs(truth.robot, runs), runs)
    rows = []
    for row in fitted.rows:
        plain = Bilinear(np.full(row.target.size, row.joint - 1), row.stacked, row.target.ravel(), fitted.system.owners)
        rows.append(plain.jacobian(fitted.gains, fitted.solution.values) / truth.noise.std[row.joint - 1])
    J = np.vstack(rows)
    root = np.linalg.norm(J, axis=0)
    inverse = np.linalg.inv((J / root).T @ (J / root)) / np.outer(root, root)
    names = [*fitted.model.names, *(f"ratio of {edge + 1}" for edge in fitted.gains.edges)]
    exact = np.concatenate([fitted.solution.values, [fitted.gains.edge[edge] for edge in fitted.gains.edges]])
    return names, exact, np.sqrt(np.diag(inverse))


@pytest.mark.slow
def test_joint_estimate_sits_on_the_cramer_rao_bound_and_the_recursion_does_not():
    """Over 200 experiments with white noise the joint fit is within 5 % of the bound; the recursion is not in k4y, k5x.

    The geometric mean over parameters is judged: one RMS of 200 experiments is itself uncertain by 5 %.
    """
    truth = table1.puma560()
    white = replace(truth, noise=Noise(truth.noise.std, level_share=0.0, correlation_time=0.0))
    bench = Bench(white, table1.experiment(), rate=50.0)
    names, exact, least = bound(white, bench)
    joint, first = [], []
    for seed in range(EXPERIMENTS):
        runs = bench.runs(np.random.default_rng(SEEDS + seed))
        fitted = solve(Model.of_runs(truth.robot, runs), runs)
        for kept, values, gains in (
            (joint, fitted.solution.values, fitted.gains),
            (first, fitted.first_values, fitted.first_gains),
        ):
            kept.append(np.concatenate([values, [gains.edge[edge] for edge in gains.edges]]) - exact)
    joint_loss, first_loss = (np.sqrt(np.mean(np.square(kept), axis=0)) / least for kept in (joint, first))
    assert np.exp(np.mean(np.log(joint_loss))) < 1.05
    assert joint_loss.max() < 1.2
    for name in ("gravity.l4.y", "gravity.l5.x"):
        assert first_loss[names.index(name)] > 2.0


def exact(truth: Truth, estimate: Estimate, *, scale: float) -> float:
    """Largest deviation from the truth of an identified parameter, relative to `scale` or the parameter's own size."""
    known = truth.parameters()
    found = [value for value in estimate.values if value.value is not None]
    assert len(found) > 30
    return max(abs(value.value - known[value.name]) / max(abs(known[value.name]), scale) for value in found)


@pytest.mark.parametrize("name", ["stanford", "puma560", "panda"])
def test_without_noise_every_parameter_is_exact(name):
    """From noise-free samples an arm's parameters come back to 1e-9, the Stanford arm's prismatic joint among them."""
    robot = read_recipe(shipped_recipes()[name])
    truth = draw(robot, 5).with_noise(0.0)
    runs = Bench(truth, plan(robot, seed=5, replicates=1), rate=20.0).runs(np.random.default_rng(0))
    assert exact(truth, identify(Evidence(runs), robot), scale=1e-3) < 1e-9
