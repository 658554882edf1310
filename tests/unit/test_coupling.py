"""Gears that couple joints: the speeds at which motors turn, and what friction makes of them."""

from dataclasses import replace

import numpy as np
import pytest
import worlds

from pumaid.effects import Samples, catalogue
from pumaid.robot import Joint, Robot

GEARS = (-62.6, 107.8, -53.7, 76.0, 71.9, 76.7)
RATIOS = {(5, 4): 0.0139, (6, 4): -0.013, (6, 5): 0.18}
ARM = Robot(
    "six", tuple(Joint(n, f"j{n}", "revolute", gear_ratio=gear) for n, gear in enumerate(GEARS, 1)), coupling=RATIOS
)


def motor_turns(qd):
    """Eq. (38)-(40) of the paper as they stand: motor speeds of joints 4, 5, 6 from joint speeds."""
    r = [1.0 / gear for gear in GEARS]
    four = qd[3] / r[3]
    five = qd[4] / r[4] + 0.0139 * four
    six = qd[5] / r[5] - 0.013 * four + 0.18 * five
    return np.array([r[3] * four, r[4] * five, r[5] * six])


def test_a_coupled_wrist_turns_its_motors_as_the_paper_writes():
    """Friction of joints 4, 5, 6 is driven by r_i qdS_i of eq. (38)-(40), that of joints 1 to 3 by their own speed."""
    qd = np.random.default_rng(3).uniform(-2.0, 2.0, (20, 6))
    seen = ARM.shaft_velocity(qd)
    np.testing.assert_allclose(seen[:, :3], qd[:, :3], rtol=0, atol=0)
    np.testing.assert_allclose(seen[:, 3:], [motor_turns(row) for row in qd], rtol=1e-13)


def test_a_joint_that_moves_alone_drives_its_own_friction_at_its_own_speed():
    """In the runs that identification uses, coupling changes nothing in the moving joint."""
    for joint in range(6):
        qd = np.zeros((1, 6))
        qd[0, joint] = 0.7
        assert ARM.shaft_velocity(qd)[0, joint] == 0.7
        assert np.all(ARM.shaft_velocity(qd)[0, :joint] == 0.0)


#: The pendulum with its second motor turned by the first: the motors' own speeds, by hand, are qd2 + 0.9 * 50/90 qd1.
GEARED_PENDULUM = replace(
    worlds.PENDULUM,
    joints=(replace(worlds.PENDULUM.joint(1), gear_ratio=50.0), replace(worlds.PENDULUM.joint(2), gear_ratio=90.0)),
    coupling={(2, 1): 0.9},
)


def friction(v):
    """A of either joint of the pendulum at the speed of its motor, rad/s of the joint."""
    return np.where(v > 0, 0.4 + 0.2 * v, -0.3 + 0.1 * v)


def seen(joint, qd):
    """Instants at these velocities (N, 2)."""
    q = np.zeros_like(qd)
    return Samples(joint, q, qd, direction=np.sign(GEARED_PENDULUM.shaft_velocity(qd)[:, joint - 1]))


@pytest.mark.parametrize(
    ("name", "shape", "law"),
    [
        ("stribeck", {"velocity": 0.2, "exponent": 1.0}, lambda v: np.sign(v) * np.exp(-np.abs(v) / 0.2)),
        ("viscous_power", {"exponent": 0.5}, lambda v: np.sign(v) * np.sqrt(np.abs(v))),
    ],
)
def test_effects_of_speed_follow_the_motor(name, shape, law):
    """Friction that hangs on speed is that of the motor's shaft, which joint 1 turns as well."""
    qd = np.random.default_rng(5).uniform(-1.0, 1.0, (30, 2))
    for joint, driving in ((1, qd[:, 0]), (2, qd[:, 1] + qd[:, 0] * 0.9 * 50.0 / 90.0)):
        columns = catalogue()[name].columns(GEARED_PENDULUM, seen(joint, qd), shape=shape)
        np.testing.assert_allclose(columns[:, 0], law(driving), rtol=1e-12)


def test_held_joints_that_tremble_drive_no_friction():
    """What the encoder of a held joint shows during a run is no speed of its motor."""
    course = worlds.course("constant", -1.0, 1.0, duration=2.0)
    run = worlds.run_of(GEARED_PENDULUM, 2, [0.3, 0.3], course=course, current=friction(course[2]))
    rough = run.bins.position + np.array([0.005, 0.0]) * np.sin(np.arange(len(run.bins)))[:, None]
    rough_run = replace(run, bins=replace(run.bins, position=rough))
    assert np.array_equal(rough_run.velocity[:, 0], np.zeros(len(run.bins)))
    assert np.array_equal(rough_run.velocity[:, 1], run.bins.velocity)
