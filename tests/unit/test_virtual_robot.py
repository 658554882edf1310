"""The virtual robot's weight: from masses, by the paper's recursion, and by a rigid-body engine."""

from __future__ import annotations

import numpy as np
import pytest
from paper_recursion import gravity_current

from pumaid.robot import Joint, Robot
from pumaid.simulation.virtual_robot import Links, constants, gravity_load

#: Relative to the largest load: sums of some dozen products in double precision, with a margin of a thousand.
EXACT = 1e-11
CHAINS = ("R", "RR", "PR", "RPR", "RRPRRR", "PPRRPR", "RRRRRR", "RPPRPRR")


def chain(kinds: str, seed: int) -> tuple[Robot, Links, np.ndarray, np.ndarray]:
    """A random arm of these joint kinds: its masses, gains and some postures; half of its twists are right angles."""
    rng = np.random.default_rng(seed)
    joints = tuple(
        Joint(
            number=number,
            name=f"joint {number}",
            kind="revolute" if kind == "R" else "prismatic",
            alpha=float(rng.choice([0.0, np.pi / 2, -np.pi / 2, rng.uniform(-3, 3)])),
            a=rng.uniform(-0.5, 0.5),
            d=rng.uniform(-0.5, 0.5),
            theta=rng.uniform(-3, 3),
        )
        for number, kind in enumerate(kinds, start=1)
    )
    robot = Robot(name=kinds, joints=joints, gravity=(1.0, -2.0, -9.0))
    n = len(kinds)
    links = Links(rng.uniform(0.5, 10.0, n), rng.uniform(-0.3, 0.3, (n, 3)))
    gain = rng.uniform(0.1, 2.0, n) * rng.choice([-1.0, 1.0], n)
    return robot, links, gain, rng.uniform(-2.0, 2.0, (40, n))


@pytest.mark.parametrize("kinds", CHAINS)
def test_load_is_that_of_a_rigid_body_engine(kinds):
    """What holds the arm still is what pinocchio computes from the same masses."""
    pin = pytest.importorskip("pinocchio", reason="the engine is pinocchio (pip install pumaid[test])")
    robot, links, _, position = chain(kinds, seed=11)
    model, parent = pin.Model(), 0
    for joint, mass, centre in zip(robot.joints, links.mass, links.centre, strict=True):
        before = pin.SE3(pin.utils.rotate("x", joint.alpha), np.array([joint.a, 0.0, 0.0]))
        offset = pin.SE3(pin.utils.rotate("z", joint.theta), np.array([0.0, 0.0, joint.d]))
        kind = pin.JointModelRZ() if joint.is_revolute else pin.JointModelPZ()
        parent = model.addJoint(parent, kind, before * offset, joint.name)
        model.appendBodyToJoint(parent, pin.Inertia(mass, centre, np.eye(3)), pin.SE3.Identity())
    model.gravity.linear = np.array(robot.gravity)
    data = model.createData()
    theirs = np.array([pin.computeGeneralizedGravity(model, data, q).copy() for q in position])
    ours = gravity_load(robot, links, position)
    assert np.max(np.abs(ours - theirs)) < EXACT * np.max(np.abs(theirs))


@pytest.mark.parametrize("kinds", CHAINS)
def test_recursion_agrees_with_masses(kinds):
    """The paper's recursion from constants in amperes gives the masses' load times the gains."""
    robot, links, gain, position = chain(kinds, seed=12)
    wanted = gravity_load(robot, links, position) * gain
    recursive = gravity_current(robot, constants(robot, links, gain), position)
    assert np.max(np.abs(recursive - wanted)) < EXACT * np.max(np.abs(wanted))
