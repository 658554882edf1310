"""The fit before it is put into words: rows, weights, which gain links are in, what noise is taken for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from worlds import CRANE, PENDULUM, STANFORD, course, dataset, drawn, experiment, only, run_of

from pumaid.estimation import system
from pumaid.estimation.rows import Row
from pumaid.estimation.system import assign, solve
from pumaid.model import Model
from pumaid.simulation import Bench
from pumaid.trajectory import Motion, Plan


def blocks(robot, runs):
    return Model.of_runs(robot, runs).blocks(runs)


def test_rows_pad_short_runs_with_nothing():
    """A row of runs of different length keeps every equation and adds none."""
    runs = []
    for kind in ("constant", "stroke"):
        moves = course(kind, -1.0, 1.0)
        runs.append(run_of(PENDULUM, 1, (0.0, 0.4), course=moves, current=np.cos(moves[1]) + 0.1 * moves[3]))
    parts = blocks(PENDULUM, runs)
    row = Row.of(1, parts)
    assert row.counts.tolist() == [3, 5] and row.target.shape == (2, 5)
    assert not row.target[0, 3:].any() and not row.regressors[0, 3:].any()
    assert row.stacked.T @ row.stacked == pytest.approx(
        sum(part.regressors.T @ part.regressors for part in parts), rel=1e-12
    )


def test_mean_square_is_that_of_the_samples():
    """Nothing of the current is lost on the way to a row, also what no model of its columns can explain."""
    rng = np.random.default_rng(1)
    moves = course("constant", -1.0, 1.0)
    currents = [rng.normal(size=200), 3.0 * rng.normal(size=200)]
    runs = [run_of(PENDULUM, 1, (0.0, 0.4), course=moves, current=current) for current in currents]
    row = Row.of(1, blocks(PENDULUM, runs))
    assert row.mean_square == pytest.approx(np.mean(np.concatenate(currents) ** 2), rel=1e-10)


@pytest.mark.parametrize(
    ("moving", "wanted"),
    [
        ((1, 2, 3, 4, 5, 6), [0, 1, 2, 3, 4, 5]),
        ((1, 2, 3, 4, 6), [0, 1, 2, 3, 3, 5]),
        ((1, 2, 3, 5, 6), [0, 1, 2, 1, 4, 5]),  # joint 3 slides: it does not feel link 4's first moments
        ((3,), [-1, -1, 2, -1, -1, -1]),
        ((5, 6), [-1, -1, -1, -1, 4, 5]),
        ((2,), [-1, 1, 1, 1, 1, 1]),
    ],
)
def test_links_of_unmoved_joints_are_in_an_inner_gain(moving, wanted):
    """Its own, or the next inner moving joint's that feels the link, or none."""
    assert assign(Model(STANFORD), moving).tolist() == wanted


@pytest.mark.parametrize("missing", [2, 4, 5])
def test_joint_fit_without_a_joint_explains_all(missing):
    """Whichever joint's rows are missing, the fit over the rest leaves no misfit of noise-free data."""
    truth = drawn(STANFORD, noisy=False)
    runs = dataset(truth, only(experiment(STANFORD), lambda motion: motion.joint != missing)).runs
    fitted = solve(Model.of_runs(STANFORD, runs), runs)
    for row in fitted.rows:
        scales = np.nan_to_num(fitted.gains.scales()[row.joint - 1])[fitted.system.owners]
        misfit = row.target - row.regressors @ (scales * fitted.solution.values)
        assert np.sqrt(np.sum(misfit**2) / row.samples) < 1e-9


def test_levels_of_runs_are_found():
    """The level that a run shares is estimated without bias from 72 runs of one joint."""
    truth, found = drawn(CRANE), []
    bench = Bench(truth, only(experiment(CRANE, repeats=4), lambda motion: motion.joint == 3), rate=50.0)
    for seed in range(8):
        runs = bench.runs(np.random.default_rng(seed))
        found.append(solve(Model.of_runs(CRANE, runs), runs).levels[3].level)
    # 72 runs know a variance to 18 %, eight experiments to 6 %; four of these.
    assert np.mean(found) == pytest.approx(truth.noise.level_std[2] ** 2, rel=0.25)


def test_weights_are_each_joints_own():
    """A noisy joint does not loosen what a quiet one says of its own friction."""
    truth = drawn(CRANE)
    loud = replace(truth, noise=replace(truth.noise, std=truth.noise.std * np.array([30.0, 1.0, 1.0])))
    errors = []
    for one in (truth, loud):
        runs = dataset(one, experiment(CRANE)).runs
        fitted = solve(Model.of_runs(CRANE, runs), runs)
        errors.append(np.sqrt(np.diag(fitted.solution.linear.inverse)))
    index = Model(CRANE).names.index("viscous.j3.plus")
    assert errors[1][index] == pytest.approx(errors[0][index], rel=0.05)


def test_few_runs_take_their_noise_from_inside():
    """With two runs the noise comes from inside them: right within a factor of two, its correlation heeded."""
    truth = drawn(PENDULUM)
    quiet = replace(truth, noise=replace(truth.noise, level_share=0.0, correlation_time=0.05))
    motions = tuple(Motion(2, (0.3, 0.0), -2.0 * s, 2.0 * s, 0.4) for s in (1, -1))
    found = []
    for seed in range(20):
        runs = Bench(quiet, Plan("two", motions), rate=100.0).runs(np.random.default_rng(seed))
        fitted = solve(Model.of_runs(PENDULUM, runs), runs)
        assert fitted.weak == (2,) and fitted.levels[2].level == 0.0
        found.append(fitted.levels[2].sample)
    phi = np.exp(-1.0 / (100.0 * 0.05))
    long_run = quiet.noise.std[1] ** 2 * (1 + phi) / (1 - phi)
    assert np.mean(found) == pytest.approx(long_run, rel=0.5)


def test_a_load_of_unknown_size_gets_a_usual_ratio():
    """A slide held nearly level in its runs: only ratio times load is known, and the ratio stays of order one."""
    truth, plan = drawn(STANFORD, noisy=False), experiment(STANFORD)
    runs = dataset(truth, only(plan, lambda motion: motion.joint != 3)).runs
    hold = (0.3, 1.558, 0.1, -0.2, 0.4, 0.1)
    slides = tuple(Motion(3, hold, -0.3 * s, 0.3 * s, v) for v in (0.06, 0.2) for s in (1, -1))
    runs = (*runs, *dataset(truth, Plan("level", slides)).runs)
    fitted = solve(Model.of_runs(STANFORD, runs), runs)
    assert abs(fitted.gains.ratio(1, 2)) < system.RATIO_SPREAD
    assert not fitted.solution.linear.determined[Model(STANFORD).names.index("gravity.l3.mass")]


def test_recursion_is_kept_beside_the_joint_fit():
    """The recursion's result and noise are those of `recursive=True`, untouched by the refinement."""
    runs = dataset(drawn(CRANE), experiment(CRANE)).runs
    both, alone = (solve(Model.of_runs(CRANE, runs), runs, recursive=flag) for flag in (False, True))
    assert np.array_equal(both.first_values, alone.solution.values)
    assert both.first_levels == alone.levels and both.levels != alone.levels
    assert alone.first_gains.edge == alone.gains.edge
