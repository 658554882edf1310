"""Kinematics: link frames against products of 4 x 4 matrices, placements against pinocchio's, groups of postures."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pumaid.kinematics import placement, roll_pitch_yaw, turn_of_z
from pumaid.robot import Joint, Robot

RNG = np.random.default_rng(2)


def random_arm() -> Robot:
    """Joints of both kinds, stated by Denavit-Hartenberg parameters and by placements."""
    joints = []
    for number, kind in enumerate(("revolute", "prismatic", "revolute", "prismatic", "revolute"), start=1):
        constants = dict(zip(("theta", "alpha", "a", "d"), RNG.uniform(-2, 2, 4).tolist(), strict=True))
        if number > 2:
            constants = {"placement": tuple(map(tuple, placement(RNG.normal(size=3), RNG.normal(size=3)).tolist()))}
        joints.append(Joint(number, f"j{number}", kind, **constants))
    return Robot("random", tuple(joints))


def test_frames_of_a_batch():
    """Every link's frame in the base is Trans_x(a) Rot_x(alpha) Trans_z(d) Rot_z(theta) or its placement, and so on."""
    robot, positions = random_arm(), RNG.uniform(-2, 2, (6, 5))
    rotations, origins = robot.frames(positions)
    assert np.array_equal(rotations, robot.rotations(positions))
    for row, position in enumerate(positions):
        frame = np.eye(4)
        for k, (joint, q) in enumerate(zip(robot.joints, position, strict=True)):
            before, moved = np.eye(4), np.eye(4)
            before[:3, :3], before[0, 3] = Rotation.from_euler("x", joint.alpha).as_matrix(), joint.a
            if joint.placement is not None:
                before = np.array(joint.placement)
            turn, slide = (joint.theta + q, joint.d) if joint.is_revolute else (joint.theta, joint.d + q)
            moved[:3, :3], moved[2, 3] = Rotation.from_euler("z", turn).as_matrix(), slide
            frame = frame @ before @ moved
            assert rotations[row, k] == pytest.approx(frame[:3, :3], abs=1e-14)
            assert origins[row, k] == pytest.approx(frame[:3, 3], abs=1e-13)


def test_placement_is_pinocchios() -> None:
    """Roll, pitch and yaw are about fixed axes, as pinocchio has them, and come back."""
    pin = pytest.importorskip("pinocchio")
    frame = placement([1.0, 2.0, 3.0], [0.3, -0.7, 1.9])
    assert frame[:3, :3] == pytest.approx(pin.rpy.rpyToMatrix(0.3, -0.7, 1.9), abs=1e-15)
    assert frame[:3, 3].tolist() == [1.0, 2.0, 3.0]
    assert roll_pitch_yaw(frame[:3, :3]) == pytest.approx((0.3, -0.7, 1.9), abs=1e-15)


@pytest.mark.parametrize("axis", [(0, 0, 2), (0, 0, -1), (1, 0, 0), (0.3, -0.2, -0.9), (1e-9, 0, -1)])
def test_turn_of_z_is_the_least(axis) -> None:
    """z goes to the axis, by the angle between the two."""
    turn, unit = turn_of_z(axis), np.array(axis) / np.linalg.norm(axis)
    assert turn @ turn.T == pytest.approx(np.eye(3), abs=1e-7)
    assert turn[:, 2] == pytest.approx(unit, abs=2e-9)
    assert Rotation.from_matrix(turn).magnitude() == pytest.approx(np.arccos(unit[2]), abs=1e-7)
