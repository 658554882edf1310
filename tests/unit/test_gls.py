"""The fit before it is put into words: rows, weights, which gain links are in, what noise is taken for."""

from dataclasses import replace

import numpy as np
import pytest
from worlds import CRANE, PENDULUM, STANFORD, dataset, drawn, experiment, fit_runs, only

from pumaid.maths import RATIO_SPREAD
from pumaid.model import Model
from pumaid.simulation import Bench
from pumaid.trajectory import Motion, Plan


def test_weights_are_each_joints_own():
    """A noisy joint does not loosen what a quiet one says of its own friction."""
    truth = drawn(CRANE)
    loud = replace(truth, noise=replace(truth.noise, std=truth.noise.std * np.array([30.0, 1.0, 1.0])))
    errors = []
    for one in (truth, loud):
        runs = dataset(one, experiment(CRANE)).runs
        fitted = fit_runs(CRANE, runs)
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
        fitted = fit_runs(PENDULUM, runs)
        assert fitted.weak == (2,) and not fitted.noises[2].level.any()
        noise, count = fitted.noises[2], fitted.row(2).bins.count
        density = noise.spread**2 * (1.0 + noise.correlation) / (1.0 - noise.correlation)
        found.append(np.mean(density) * np.mean(count))
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
    fitted = fit_runs(STANFORD, runs)
    assert abs(fitted.gains.ratio(1, 2)) < RATIO_SPREAD
    assert not fitted.solution.linear.determined[Model(STANFORD).names.index("gravity.l3.mass")]
