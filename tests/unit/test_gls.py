"""The model's names, equations and fit before it is put into words."""

import re
from dataclasses import replace

import numpy as np
import pytest
from worlds import CRANE, PENDULUM, STANFORD, course, dataset, drawn, experiment, fit_runs, only, run_of

from pumaid.effects import Samples
from pumaid.estimation.estimate import identify
from pumaid.joint_bins import joint_bins
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


#: A name as interfaces.md has it.
NAME = re.compile(
    r"gravity\.l\d\.(x|y|mass)|(coulomb|viscous)\.j\d\.(plus|minus)|inertia\.l\d\.(m[xyz]?|[xyz]{2})|rotor\.j\d"
)


def sampled(robot, joint, hold, moves) -> tuple:
    """A run with random currents, and its samples as effects see them."""
    t, q, qd, qdd = moves
    current = np.random.default_rng(joint).normal(size=len(q))
    position, velocity = np.tile(hold, (len(q), 1)), np.zeros((len(q), robot.n_joints))
    position[:, joint - 1], velocity[:, joint - 1] = q, qd
    direction = np.full(len(q), np.sign(q[-1] - q[0]))
    samples = Samples(joint, position, velocity, acceleration=qdd, direction=direction, time=t)
    return run_of(robot, joint, hold, course=moves, current=current), samples, current


def test_names_are_the_contracts():
    """Every parameter of the Stanford arm has a name of the contract, and the paper's symbol."""
    model = Model(STANFORD, is_dynamic=True)
    assert [name for name in model.names if not NAME.fullmatch(name)] == []
    some = "gravity.l3.mass gravity.l6.x coulomb.j3.minus viscous.j1.plus inertia.l2.zz rotor.j3"
    assert set(some.split()) <= set(model.names)
    symbols = {column.name: (column.symbol, column.unit) for column in model.columns}
    assert symbols["gravity.l3.mass"] == ("m3", "A s2/m")
    assert symbols["gravity.l6.x"] == ("k6x", "A s2/m")
    assert symbols["viscous.j3.plus"] == ("lambda2+", "A s/m") and symbols["viscous.j2.plus"][1] == "A s/rad"
    assert symbols["rotor.j3"][1] == "A s2/m" and symbols["inertia.l2.zz"][1] == "A s2/rad"


def test_outer_links_act_on_inner_joints_only():
    """Gravity of link 1 is nothing to joint 2; friction is the moving joint's own."""
    model = Model(PENDULUM)
    samples = sampled(PENDULUM, 2, (0.3, 0.4), course("constant", -1.0, 1.0))[1]
    moved = dict(zip(model.names, np.abs(model.regressor(samples)).max(axis=0), strict=True))
    assert moved["gravity.l1.x"] == moved["coulomb.j1.plus"] == moved["viscous.j1.minus"] == 0.0
    assert moved["gravity.l2.x"] > 1.0 and moved["coulomb.j2.plus"] == 1.0 and moved["coulomb.j2.minus"] == 0.0


def test_inertia_is_in_the_model_where_something_accelerates():
    """A stroke brings the rigid body's parameters, of which a run at constant speed shows weight alone."""
    stroke, steady = (sampled(CRANE, 2, (0.0, 0.0, 0.1), course(kind, -0.2, 0.2))[0] for kind in ("stroke", "constant"))
    assert not any(name.startswith(("inertia", "rotor")) for name in Model.of_runs(CRANE, [steady]).names)
    model = Model.of_runs(CRANE, [stroke, steady])
    inertial = [n for n, name in enumerate(model.names) if name.startswith(("inertia", "rotor"))]
    shown = [model.design(joint_bins(CRANE, [run])[0])[:, inertial].any() for run in (stroke, steady)]
    assert inertial and shown == [True, False]


def test_prediction_is_the_truth_where_the_fit_is_exact():
    """Predicted currents of a noise-free arm are the truth's, in postures that were never run."""
    truth = drawn(STANFORD, noisy=False)
    estimate = identify(dataset(truth, experiment(STANFORD)), STANFORD)
    model, rng = Model.of_estimate(STANFORD, estimate), np.random.default_rng(3)
    for joint in range(1, 7):
        position = rng.uniform(-1.0, 1.0, (20, 6))
        velocity = np.zeros((20, 6))
        velocity[:, joint - 1] = rng.choice([-0.4, 0.7], 20)
        own = velocity[:, joint - 1]
        samples = Samples(joint, position, velocity, acceleration=np.zeros(20), direction=np.sign(own))
        wanted = truth.gravity_current(position)[:, joint - 1] + truth.friction.currents(velocity)[:, joint - 1]
        assert model.predict(estimate, samples) == pytest.approx(wanted, abs=1e-9)
