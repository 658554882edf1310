"""The virtual robot against a rigid-body engine that knows nothing of it: cruise, ramps, joints that are pushed."""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from pumaid.errors import ModelError
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.robot import Joint, Robot
from pumaid.simulation import Hidden, Session, draw, table1
from pumaid.simulation.links import swung
from pumaid.simulation.physics.joints import Joints, inertia
from pumaid.simulation.physics.rigid import Rigid
from pumaid.simulation.ranges import anywhere
from pumaid.simulation.timing import stretches
from pumaid.trajectory import Motion, Plan

pytest.importorskip("mujoco", reason="the engine is mujoco (pip install pumaid[test])")

RATE = 250.0
#: Arm -> where its joints are held; the Stanford arm's third slides.
HOLDS = {"puma560": (0.2, -0.7, 0.5, 0.3, 0.6, 0.1), "stanford": (0.2, -0.7, 0.6, 0.3, 0.6, 0.1)}


def there_and_back(name: str) -> tuple[Robot, Plan]:
    """An arm whose joints 2, 3 and 5 move one after the other."""
    robot, motions = read_recipe(shipped_recipes()[name]), []
    for joint in (2, 3, 5):
        turns = robot.joint(joint).is_revolute
        low, high, speed = (-1.0, 1.0, 0.8) if turns else (0.4, 0.9, 0.15)
        for start, end in ((low, high), (high, low)):
            motions.append(Motion(joint, HOLDS[name], start, end, speed))
    return robot, Plan(robot.name, tuple(motions))


@cache
def executed(name: str, physics: str) -> list:
    """(stretch, its log) without noise."""
    robot, plan = there_and_back(name)
    session = Session(draw(robot, 3).with_noise(0.0), plan, np.random.default_rng(1), rate=RATE, physics=physics)
    return list(zip(stretches(robot, plan), session.logs(), strict=True))


def runs(name: str, physics: str) -> list:
    """(joint, log) of the planned runs."""
    return [(stretch.motion.joint, log) for stretch, log in executed(name, physics) if stretch.motion is not None]


def loss(truth, joint: int, log) -> tuple[np.ndarray, np.ndarray]:
    """(N,) A that gravity and friction do not explain, and (N,) acceleration, at the log's samples."""
    j, v = joint - 1, log.velocity[:, joint - 1]
    after = np.append(v[1:], 0.0)
    explained = truth.gravity_current(log.position)[:, j] + truth.friction.current(joint, 0.5 * (v + after))
    return log.current[:, j] - explained, (after - v) * RATE


@pytest.mark.parametrize("name", HOLDS)
def test_both_cruise_with_the_same_current(name):
    """Mean currents of each run's middle agree within two milliamperes between the engine and the built-in physics."""
    truth = draw(there_and_back(name)[0], 3)
    arm = Rigid(truth)
    for (joint, own), (_, engine) in zip(runs(name, "builtin"), runs(name, "mujoco"), strict=True):
        means = []
        whole = truth.gain[joint - 1] * arm.inertia(own.position[0])[joint - 1, joint - 1]
        for log, moved in ((own, inertia(truth)[joint - 1]), (engine, whole)):
            q = log.position[:, joint - 1]
            middle = np.abs(q - q.mean()) < 0.3 * np.ptp(q)
            moving = middle & (np.abs(log.velocity[:, joint - 1]) > 0.05)
            left, rising = loss(truth, joint, log)
            means.append(np.mean((left - moved * rising)[moving]))
        # Held joints give a milliradian, which changes the weight by a milliampere or two, of 1 to 4 A.
        assert means == pytest.approx([0.0, 0.0], abs=2.5e-3)


@pytest.mark.parametrize("name", HOLDS)
def test_engine_feels_the_whole_inertia_in_ramps(name):
    """A ramp draws the mass matrix's own term, in the engine of the posture, built in of many together."""
    truth = draw(there_and_back(name)[0], 3)
    arm = Rigid(truth)
    for physics in ("builtin", "mujoco"):
        for joint, log in runs(name, physics):
            left, rising = loss(truth, joint, log)
            j, v = joint - 1, np.abs(log.velocity[:, joint - 1])
            fast = (v > 0.3 * v.max()) & (v < 0.9 * v.max()) & (np.abs(rising) > 0.3 * np.abs(rising).max())
            slope = left[fast] @ rising[fast] / (rising[fast] @ rising[fast])
            held = log.position[0]
            whole = truth.gain[j] * arm.inertia(held)[j, j]
            wanted = inertia(truth)[j] if physics == "builtin" else whole
            # Held joints give a little where they are pushed hard, and take a part of the inertia with them.
            assert slope == pytest.approx(wanted, rel=0.02 if physics == "builtin" else 0.1)


@pytest.mark.parametrize("name", HOLDS)
def test_links_move_with_the_joint(name):
    """Links' share of the inertia is that of the engine's mass matrix, less their turning about their own centres."""
    robot = there_and_back(name)[0]
    truth = draw(robot, 3)
    arm = Rigid(replace(truth, inertia=np.zeros(robot.n_joints)))
    places = anywhere(robot, 20, np.random.default_rng(8))
    whole = np.array([np.diag(arm.inertia(place)) for place in places])
    found = swung(robot, truth.links, places)
    assert np.all(found <= whole * (1 + 1e-9))
    # Turned without its bodies' own tensors, link by link, the engine agrees to the last digits.
    arm.model.body_inertia[:] = 1e-12
    whole = np.array([np.diag(arm.inertia(place)) for place in places])
    np.testing.assert_allclose(found, whole, rtol=1e-6, atol=1e-9)


def test_a_ramp_pushes_held_joints():
    """Braking hard, joint 2 pushes joint 3 by the mass matrix's cross term; stiction and the drive share it."""
    truth = draw(there_and_back("puma560")[0], 3)
    arm, place = Rigid(truth, step=0.0005), np.array(HOLDS["puma560"])
    arm.place(place)
    weight = truth.gravity_current(place[None])[0]
    pushed = weight.copy()
    pushed[1] += 6.0 * np.sign(truth.gain[1])
    arm.advance(pushed, 0.02)
    moved = arm.velocity
    cross = arm.inertia(place)
    torque = (pushed - weight)[1] / truth.gain[1] - truth.coulomb[1] / abs(truth.gain[1])
    # Joint 3 feels M_32 qdd_2: more than what holds it, so it moves against its link's will.
    felt = cross[2, 1] * torque / cross[1, 1]
    holds = truth.breakaway[2] * truth.coulomb[2] / abs(truth.gain[2])
    assert (abs(felt) > holds) == (abs(moved[2]) > 1e-3)
    assert abs(moved[1]) > 0.05


def test_break_away_is_the_same():
    """Just below the break-away level no joint moves in either physics; just above, all do, and by the same push."""
    truth = draw(table1.robot(), 3)
    place = np.array(HOLDS["puma560"])
    weight = truth.gravity_current(place[None])[0]
    for share, moves in ((0.97, False), (1.05, True)):
        for j in range(6):
            arm = Rigid(truth)
            arm.place(place)
            uneven = 0.5 * (truth.friction.coulomb_plus + truth.friction.coulomb_minus)[j]
            half = 0.5 * (truth.friction.coulomb_plus - truth.friction.coulomb_minus)[j]
            current = weight.copy()
            current[j] += uneven + share * truth.breakaway[j] * half
            arm.advance(current, 0.1)
            assert (arm.position[j] - place[j] > 1e-5) == moves


def test_coasting_ends_where_it_should():
    """A joint that slides without current stops after a way that grows with its inertia, the same in both physics."""
    robot = Robot("level", (Joint(1, "hub", "revolute"),))  # turns about the vertical: no weight
    truth = draw(robot, 5)
    arm, plant = Rigid(truth, step=0.0005), Joints(truth, step=0.0005)
    arm.place(np.zeros(1), np.ones(1))
    plant.start(np.zeros((1, 1)))
    plant.move(np.ones((1, 1)))
    for _ in range(6000):
        arm.advance(np.zeros(1), 0.0005)
        plant.advance(np.zeros((1, 1)), np.zeros((1, 1)), None)
    share = inertia(truth)[0] / (truth.gain[0] * arm.inertia(np.zeros(1))[0, 0])
    assert plant.position[0, 0] == pytest.approx(share * arm.position[0], rel=0.01)
    assert abs(arm.velocity[0]) < 1e-6


@pytest.mark.parametrize("effect", ["stribeck", "spring", "ripple", "position_friction", "tilt"])
def test_engine_hides_the_same(effect):
    """What is hidden shows in a run's middle with the engine as it does with the built-in physics."""
    robot, plan = there_and_back("puma560")
    truth = draw(robot, 3).with_noise(0.0).hiding([Hidden(effect, None if effect == "tilt" else 2)])
    plan = replace(plan, motions=plan.motions[:2])
    found = []
    for physics in ("builtin", "mujoco"):
        for log in Session(truth, plan, np.random.default_rng(1), rate=RATE, physics=physics).logs():
            left, rising = loss(truth, 2, log)
            q = log.position[:, 1]
            inertia = (
                truth.inertia[1]
                if physics == "builtin"
                else truth.gain[1] * Rigid(truth).inertia(log.position[0])[1, 1]
            )
            found.append(np.interp(np.linspace(-0.6, 0.6, 20), *_rising(q, left - inertia * rising)))
    assert np.max(np.abs(found[0])) > 0.005
    # The engine's mass matrix is taken at one posture, and the speed wavers under a ripple.
    assert found[2] == pytest.approx(found[0], abs=0.03)


def _rising(q: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    order = np.argsort(q, kind="stable")
    return q[order], values[order]


@pytest.mark.parametrize("effect", ["flexibility", "payload", "zero_offset"])
def test_what_is_no_force_is_refused(effect):
    """Links that stand elsewhere and masses that come are told with one message."""
    robot, plan = there_and_back("puma560")
    truth = draw(robot, 3).hiding([Hidden(effect, None if effect == "payload" else 2)])
    with pytest.raises(ModelError) as caught:
        Session(truth, plan, np.random.default_rng(1), physics="mujoco")
    assert (caught.value.slug, effect in caught.value.what) == ("physics-wrong", True)


def test_constants_alone_are_refused():
    """The paper's robot has no masses."""
    with pytest.raises(ModelError) as caught:
        Session(table1.puma560(), table1.experiment(), np.random.default_rng(1), physics="mujoco")
    assert caught.value.slug == "physics-wrong"


def test_a_missing_engine_is_told(monkeypatch):
    """Without MuJoCo the message is the command that installs it."""
    monkeypatch.setitem(sys.modules, "mujoco", None)
    robot, plan = there_and_back("puma560")
    with pytest.raises(ModelError) as caught:
        Session(draw(robot, 3), plan, np.random.default_rng(1), physics="mujoco")
    assert "pip install 'pumaid[mujoco]'" in caught.value.mend
