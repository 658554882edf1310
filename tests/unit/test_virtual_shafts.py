"""A virtual robot whose gears couple its wrist: motors' speeds, what they carry, and what friction does to joints."""

from dataclasses import replace

import numpy as np
import pytest

from pumaid.simulation import draw, table1
from pumaid.simulation.hidden import Instants
from pumaid.simulation.links import Links
from pumaid.simulation.shafts import borne, shafts
from pumaid.simulation.truth import Friction

GEARS = (-62.6, 107.8, -53.7, 76.0, 71.9, 76.7)
RATIOS = {(5, 4): 0.0139, (6, 4): 0.013, (6, 5): 0.18}


def wrist(ratios=None):
    """The PUMA with these ratios of its motors."""
    bare = table1.robot()
    joints = tuple(replace(joint, gear_ratio=gear) for joint, gear in zip(bare.joints, GEARS, strict=True))
    return replace(bare, joints=joints, coupling=RATIOS if ratios is None else ratios)


def test_motors_turn_as_the_paper_writes():
    """Speeds of the motors, geared to their joints, are r_i qdS_i of eq. (38)-(40), worked out one after the other."""
    qd = np.random.default_rng(1).normal(size=6)
    four = GEARS[3] * qd[3]
    five = GEARS[4] * qd[4] + 0.0139 * four
    six = GEARS[5] * qd[5] + 0.013 * four + 0.18 * five
    expected = [*qd[:3], four / GEARS[3], five / GEARS[4], six / GEARS[5]]
    np.testing.assert_allclose(shafts(wrist()) @ qd, expected, rtol=1e-13)


def test_motors_carry_what_they_pass_on():
    """The power of the loads at the joints is that of what the motors carry at their own speeds."""
    rng = np.random.default_rng(2)
    load, qd = rng.normal(size=(20, 6)), rng.normal(size=(20, 6))
    carried = borne(wrist(), load)
    np.testing.assert_allclose(
        np.sum(carried * (qd @ shafts(wrist()).T), axis=1), np.sum(load * qd, axis=1), atol=1e-12
    )
    assert np.allclose(carried[:, 5], load[:, 5])  # nothing lies beyond the last
    assert np.array_equal(borne(replace(wrist(), coupling={}), load), load)


def test_joint_4_turns_the_motors_behind_it():
    """While joint 4 moves alone, motors 5 and 6 draw their friction, as those of joint 4 alone would not."""
    truth = draw(wrist(), 3)
    velocity = np.zeros((2, 6))
    velocity[:, 3] = 0.8
    still = np.zeros((2, 6))
    at = Instants(np.zeros(2), np.zeros(6), still, velocity, still, still, still)
    found = np.column_stack([truth.current(joint, at) for joint in range(1, 7)]) - truth.gravity_current(still)
    for joint, ratio in ((5, 0.0139 * 76.0 / 71.9), (6, (0.013 + 0.18 * 0.0139) * 76.0 / 76.7)):
        np.testing.assert_allclose(found[:, joint - 1], truth.friction.current(joint, np.full(2, 0.8 * ratio)))
    np.testing.assert_allclose(found[:, :3], 0.0, atol=1e-12)


@pytest.fixture(scope="module")
def engine():
    """The rigid-body arm, where MuJoCo is there."""
    pytest.importorskip("mujoco")
    from pumaid.simulation.physics.rigid import Rigid

    return Rigid


def test_an_engine_holds_the_arm_with_what_the_motors_carry(engine):
    """With gravity's currents of the coupled motors, and no friction to help, the arm stays where it is."""
    truth = draw(wrist(), 3)
    nothing = np.zeros(6)
    arm = engine(replace(truth, friction=Friction(nothing, nothing, nothing, nothing)))
    posture = np.array([0.0, -1.0, 0.5, 0.3, 0.7, 0.2])
    arm.place(posture)
    for _ in range(50):
        arm.advance(truth.gravity_current(arm.position[None])[0], 0.001)
    np.testing.assert_allclose(arm.position, posture, atol=1e-7)


def test_a_motor_without_current_drags_its_joint(engine):
    """Joint 5 of a weightless arm turns with joint 4 just so that its own motor, held by its friction, stands still."""
    truth = draw(wrist({(5, 4): 0.3}), 3)
    arm = engine(replace(truth, links=Links(truth.links.mass, np.zeros((6, 3))), robot=weightless(truth.robot)))
    arm.place(np.zeros(6))
    push = np.zeros(6)
    push[3] = 3.0 * truth.friction.coulomb_plus[3]
    arm.advance(push, 0.4)
    assert arm.velocity[3] > 0.1
    assert abs(arm.velocity[4] + 0.3 * 76.0 / 71.9 * arm.velocity[3]) < 1e-3 * arm.velocity[3]


def weightless(robot):
    """The same in orbit."""
    return replace(robot, gravity=(0.0, 0.0, -1e-9))
