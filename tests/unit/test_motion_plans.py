"""Planned trajectories: within limits and clear of what is forbidden, and their promises come true."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from menus import arm

from pumaid.cli.commands.experiments import ATTENTION
from pumaid.design import motion
from pumaid.design.collision import Collision
from pumaid.design.information import prior_robots
from pumaid.design.motion import MotionInformation, best_motion, check_motion, inertial_values, plan_motion
from pumaid.errors import ModelError
from pumaid.estimation.estimate import identify
from pumaid.model import Model
from pumaid.preprocessing.segment import segment
from pumaid.rigid_body import base_parameters
from pumaid.robot import Box, Safety
from pumaid.simulation import Truth, draw, simulate
from pumaid.simulation.mujoco_engine import RigidArm
from pumaid.trajectory import Plan, Trajectory, accelerations, highest_speeds

PENDULUM = arm("pendulum2")
#: Where the tip comes by when the hip stands half a radian from straight down.
POST = Safety((Box("post", (0.3, -0.1, -0.7), (0.4, 0.1, -0.55)),), (0.4, 0.0, 0.0), 0.01)


@cache
def planned() -> Plan:
    """A minute and a half of a pendulum."""
    return plan_motion(PENDULUM, "fourier", minutes=1.5, seed=3)


@pytest.mark.parametrize("name", ["puma560", "stanford"])
def test_inertia_is_the_engines(name):
    """By its parameters and gains each motor of a drawn arm draws what MuJoCo's inverse dynamics asks of it."""
    truth, rng = draw(arm(name), 5), np.random.default_rng(1)
    n = truth.robot.n_joints
    engine = RigidArm(truth, step=0.001)
    columns = [Model(truth.robot, is_dynamic=True).columns[k] for k in Model(truth.robot, is_dynamic=True).inertial]
    values = truth.parameters() | inertial_values(truth)
    torque = np.array([values[column.name] / truth.gain[column.owner - 1] for column in columns])
    slides = ~truth.robot.is_revolute
    offsets = []
    for _ in range(5):
        q, v, a = rng.uniform(-1.0, 1.0, (3, n))
        engine.position[:], engine.velocity[:] = q, v
        engine._begin(engine.model, engine.data)
        wanted = engine.inertia(q) @ a + engine._bias
        rows = base_parameters(truth.robot).rows(q[:, None], v[:, None], a[:, None])
        found = np.array([torque[-len(part) :] @ part[:, 0] for part in rows])
        np.testing.assert_allclose(found[~slides], wanted[~slides], atol=1e-6)
        offsets.append(wanted[slides] - found[slides])
    np.testing.assert_allclose(np.ptp(offsets, axis=0), 0.0, atol=1e-6)  # a constant load is Coulomb friction's


@pytest.mark.parametrize(("name", "kind"), [("puma560", "fourier"), ("pendulum2", "picks")])
def test_limits_are_kept_between_knots(name, kind, monkeypatch):
    """A thousand times a second positions, and their differences, are within what the recipe allows."""
    monkeypatch.setattr(motion, "TRIED", 10)
    robot = arm(name)
    information = MotionInformation(prior_robots(robot))
    made, _ = best_motion(kind, information, collision=Collision(robot), seconds=60.0, seed=2)
    assert made.seconds == pytest.approx(60.0) and made.repeats >= 2
    q = made.at(np.arange(-100, 1000 * 60 + 100) * 1e-3)[0]
    low, high = np.array([joint.limits or (-np.inf, np.inf) for joint in robot.joints]).T
    assert (q >= low).all() and (q <= high).all() and np.ptp(q, axis=0).min() > 0.05
    assert (np.abs(np.diff(q, axis=0)) <= 1e-3 * highest_speeds(robot)).all()
    assert (np.abs(np.diff(q, 2, axis=0)) <= 1e-6 * accelerations(robot) * (1.0 + 1e-6)).all()
    assert np.abs(np.diff(q[[0, 100]], axis=0)).max() == np.abs(np.diff(q[[-100, -1]], axis=0)).max() == 0.0


@pytest.mark.parametrize("kind", ["fourier", "picks"])
def test_what_is_forbidden_is_passed_at_a_distance(kind, monkeypatch):
    """Looked at every millisecond no distance falls below the margin; the same arm without the post goes through it."""
    monkeypatch.setattr(motion, "TRIED", 40)
    nearest = []
    for safety in (POST, None):
        robot = replace(PENDULUM, safety=safety)
        information = MotionInformation(prior_robots(robot))
        made, _ = best_motion(kind, information, collision=Collision(robot), seconds=30.0, seed=4)
        looked = Collision(replace(PENDULUM, safety=POST))
        path = made.at(np.arange(0.0, made.cycle, 2e-3))[0]
        nearest.append(min(looked.distances(position).min() for position in path))
    assert nearest[0] >= POST.margin - 5e-4 and nearest[1] < 0.0


def experiments(truth: Truth, made: Plan, count: int) -> dict[str, list[float]]:
    """Name -> errors of what is identified of some experiments."""
    errors: dict[str, list[float]] = {}
    true = truth.parameters() | inertial_values(truth)
    for seed in range(count):
        found = identify(segment(simulate(truth.robot, made, seed=seed, truth=truth), truth.robot), truth.robot)
        for value in found.values:
            if value.value is not None and value.std_error and value.name in true:
                errors.setdefault(value.name, []).append(value.value - true[value.name])
    return errors


def test_promises_come_true():
    """Errors of experiments are as large as this robot was promised: within a third, what six can tell."""
    prior = prior_robots(PENDULUM)
    truth = prior.robots[1]
    information = MotionInformation(replace(prior, robots=(truth,)))
    promised = information.errors(information.of(planned().trajectory))
    errors = experiments(truth, planned(), 6)
    shown = [name for name in errors if len(errors[name]) == 6]
    assert len(shown) >= 14 and set(shown) <= set(promised)
    ratios = [np.sqrt(np.mean(np.square(errors[name]))) / promised[name] for name in shown]
    assert 0.75 < np.exp(np.mean(np.log(ratios))) < 1.33


def test_the_plan_says_what_tells_more():
    """Errors beside those of picks and of runs in the same time; looked at again, the plan promises the same."""
    (note,) = [note for note in planned().notes if note.slug == "plan-compared"]
    parts = (
        r"in 1.5 min this fourier trajectory promises errors (.*) times those of picks .*and (.*) times those of runs"
    )
    assert all(0.3 < float(share) < 1.2 for share in re.match(parts, note.text).groups())
    again = check_motion(PENDULUM, replace(planned(), expected={}, unseen={}, notes=()))
    assert again.expected == pytest.approx(check_motion(PENDULUM, planned()).expected)
    assert not {note.slug for note in again.notes} & set(ATTENTION)
    assert 89.0 < again.duration <= 90.0 + 1e-9
    assert {"inertia.l2.zz", "gravity.l1.x", "coulomb.j1.plus", "gain_ratio.1.2"} <= set(again.expected)


def test_faults_of_a_trajectory_are_told():
    """A joint at rest, too little time, a post in the way, parameters that do not show."""
    q = np.zeros((3, 2))
    q[1, 0] = 1.5
    still = np.zeros_like(q)
    given = Plan(PENDULUM.name, (), trajectory=Trajectory(np.array([0.0, 6.0, 12.0]), q, still, still))
    checked = check_motion(replace(PENDULUM, safety=POST), given)
    texts = {note.slug: note.text for note in reversed(checked.notes)}
    wanted = {"plan-strikes": "post", "plan-lacks": "12.0 s", "plan-dark": "coulomb.j2.plus"}
    assert all(word in texts[slug] for slug, word in wanted.items())
    assert "joint 2 (knee): it never moves" in "".join(note.text for note in checked.notes)
    with pytest.raises(ModelError, match="lasts for 24 s"):
        plan_motion(PENDULUM, "picks", minutes=0.3)


def test_an_earlier_model_is_planned_for():
    """Inertia that it knows is taken for the arm's; its noise sets the errors. Nothing is said to be missing."""
    truth = draw(PENDULUM, 8)
    found = identify(segment(simulate(PENDULUM, planned(), seed=1, truth=truth), PENDULUM), PENDULUM)
    assert "model-misses" not in {note.slug for note in found.notes}
    mine = check_motion(PENDULUM, planned(), prior=found)
    std = {value.name: value.std_error for value in found.values if value.std_error}
    ratios = [mine.expected[name] / error for name, error in std.items() if name in mine.expected]
    assert 0.6 < np.exp(np.mean(np.log(ratios))) < 1.6
