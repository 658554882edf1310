"""The shipped recipes against kinematics that others published: every joint's axis, as a line in space."""

import os
from pathlib import Path

import numpy as np
import pytest
from menus import arm

from pumaid.io.recipe import shipped_recipes

pin = pytest.importorskip("pinocchio", reason="the independent kinematics is pinocchio (pip install pumaid[test])")

published = pytest.importorskip("published")
HALF = np.pi / 2
#: Published numbers have four to twelve digits (1.5708 for a quarter turn is off by 4e-6).
ROUNDED_TO_FOUR_DIGITS = 3e-5
ROUNDED_TO_TEN_DIGITS = 1e-8

GEN3 = [link[:2] for link in published.GEN3]
#: Staubli TX40. figaroh-plus (Apache-2.0), models/staubli_tx40_description/urdf/tx40_mdh_modified.urdf.
TX40 = (
    ((0, 0, 0.320), (0, 0, 0)),
    ((0, 0, 0), (-HALF, 0, 0)),
    ((0.225, 0, 0.035), (0, 0, 0)),
    ((0, -0.225, 0), (HALF, 0, 0)),
    ((0, 0, 0), (-HALF, 0, 0)),
    ((0, 0, 0), (HALF, np.pi, 0)),
)


def universal(d1: float, a2: float, a3: float, d4: float, d5: float, d6: float) -> tuple:
    """A UR arm of these sizes. ros-industrial/universal_robot (BSD-3-Clause), config/*/default_kinematics.yaml."""
    places = ((0, 0, d1), (0, 0, 0), (a2, 0, 0), (a3, 0, d4), (0, -d5, 0), (0, d6, 0))
    turns = (
        (0, 0, 0),
        (1.570796327, 0, 0),
        (0, 0, 0),
        (0, 0, 0),
        (1.570796327, 0, 0),
        (1.570796326589793, np.pi, np.pi),
    )
    return tuple(zip(places, turns, strict=True))


UR3E = universal(0.15185, -0.24355, -0.2132, 0.13105, 0.08535, 0.0921)
UR5E = universal(0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996)
#: Position of the arm in the published convention = the controller's position + these (deg).
ZERO = {"staubli_tx40": (0, -90, 90, 0, 0, 0)}


def postures(n_joints: int, *, count: int = 40, seed: int = 7) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-np.pi, np.pi, (count, n_joints))


def of_model(model: pin.Model, position: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Directions of the first joints' axes, their frames' rotations and origins, by pinocchio."""
    data, joints = model.createData(), range(1, position.shape[1] + 1)
    local = [
        {"RX": 0, "RY": 1, "RZ": 2}[model.joints[joint].shortname().removeprefix("JointModel")] for joint in joints
    ]
    frames, points = [], []
    for q in position:
        full = pin.neutral(model)
        full[: len(q)] = q
        pin.forwardKinematics(model, data, full)
        frames.append([data.oMi[joint].rotation.copy() for joint in joints])
        points.append([data.oMi[joint].translation.copy() for joint in joints])
    rotations = np.array(frames)
    return np.stack([rotations[:, k, :, axis] for k, axis in enumerate(local)], axis=1), rotations, np.array(points)


def published_model(published: tuple | str) -> pin.Model:
    """A pinocchio model of published joint origins, or of a URDF of example-robot-data, without meshes."""
    if isinstance(published, str):
        pytest.importorskip("example_robot_data", reason="it brings the URDFs (pip install pumaid[test])")
        from example_robot_data.robots_loader import getModelPath

        return pin.buildModelFromUrdf(os.fspath(Path(getModelPath(published)) / published))
    model, parent = pin.Model(), 0
    for number, (xyz, rpy) in enumerate(published, start=1):
        placement = pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(xyz, dtype=float))
        parent = model.addJoint(parent, pin.JointModelRZ(), placement, f"j{number}")
    return model


def distance_to_line(point: np.ndarray, on_line: np.ndarray, direction: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.cross(point - on_line, direction), axis=-1)


PANDA = "panda_description/urdf/panda.urdf"


@pytest.mark.parametrize(
    ("name", "published", "has_frames"),
    [
        ("kinova_gen3", GEN3, True),
        ("staubli_tx40", TX40, True),
        ("ur3e", UR3E, False),
        ("ur5e", UR5E, False),
        ("panda", PANDA, True),
    ],
)
def test_axes_are_the_published_lines(name: str, published: tuple | str, has_frames: bool) -> None:
    """Direction and place of every joint's axis agree with the vendor's published joint origins in random postures."""
    # Whole link frames agree where the vendor's have the joints' z: a published centre of mass compares with k_x, k_y.
    robot = arm(name)
    position = postures(robot.n_joints)
    rotations, points = robot.frames(position)
    z, frames, theirs = of_model(published_model(published), position + np.deg2rad(ZERO.get(name, 0.0)))
    assert np.abs(rotations[..., 2] - z).max() < ROUNDED_TO_TEN_DIGITS
    assert distance_to_line(points, theirs, z).max() < ROUNDED_TO_TEN_DIGITS
    assert not has_frames or np.abs(rotations - frames).max() < ROUNDED_TO_TEN_DIGITS


@pytest.mark.parametrize(("name", "other"), [("ur3e", "ur3"), ("ur5e", "ur5"), ("ur10e", "ur10")])
def test_universal_robots_turn_like_their_urdf(name: str, other: str) -> None:
    """The e-series has other lengths but the axes of the older URDFs, in a base turned half about the vertical."""
    position = postures(6)
    z, _, _ = of_model(published_model(f"ur_description/urdf/{other}_robot.urdf"), position)
    rotations = arm(name).rotations(position)
    assert np.abs(rotations[..., 2] - z * np.array([-1.0, -1.0, 1.0])).max() < ROUNDED_TO_FOUR_DIGITS


def turn(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def by_screws(directions: np.ndarray, points: np.ndarray, slides: list[bool], q: np.ndarray) -> tuple:
    """Axes and points on them after moving each joint, outer ones carried along: no link frames at all."""
    directions, points = directions.copy(), points.copy()
    for joint, angle in reversed(list(enumerate(q))):
        if slides[joint]:
            points[joint + 1 :] += directions[joint] * angle
            continue
        rotation = turn(directions[joint], angle)
        points[joint + 1 :] = points[joint] + (points[joint + 1 :] - points[joint]) @ rotation.T
        directions[joint + 1 :] = directions[joint + 1 :] @ rotation.T
    return directions, points


X, Y, Z = np.eye(3)
#: Axes at zero, seen by eye: direction, and a point on each, in the base.
BY_EYE = {
    # Upper arm level along x, forearm upright; shoulder offset 0.1501 m to the left (Armstrong, Khatib and Burdick, The
    # explicit dynamic model and inertial parameters of the PUMA 560 arm, 1986, figure 1 and table of link lengths).
    "puma560": (
        np.array([Z, Y, Y, Z, Y, Z]),
        np.array(
            [[0, 0, 0], [0, 0, 0], [0.4318, 0, 0], [0.4115, 0.1501, 0], [0.4115, 0, 0.4331], [0.4115, 0.1501, 0.4331]]
        ),
    ),
    # Boom upright and retracted: its axis passes beside the shoulder at 0.154 m; the wrist's three axes meet there.
    "stanford": (
        np.array([Z, Y, Z, Z, X, Z]),
        np.array(
            [[0, 0, 0], [0, 0, 0.412], [0, 0.154, 0.412], [0, 0.154, 0.412], [0, 0.154, 0.412], [0, 0.154, 0.412]]
        ),
    ),
    # Hanging: both axes level and parallel, the knee 0.3 m below the hip.
    "pendulum2": (np.array([-Y, -Y]), np.array([[0, 0, 0], [0, 0, -0.3]])),
}


@pytest.mark.parametrize("name", sorted(BY_EYE))
def test_axes_are_those_seen_by_eye(name: str) -> None:
    """Every joint's line agrees with turning the arm's axes, read off a drawing at zero, about one another."""
    robot = arm(name)
    directions, on_lines = BY_EYE[name]
    slides = [not joint.is_revolute for joint in robot.joints]
    for q in postures(robot.n_joints, count=20):
        rotations, points = robot.frames(q[None])
        z, theirs = by_screws(directions, on_lines, slides, q)
        assert np.abs(rotations[0, :, :, 2] - z).max() < 1e-12
        assert distance_to_line(points[0], theirs, z).max() < 1e-12


def test_every_shipped_recipe_is_checked_here() -> None:
    checked = {"kinova_gen3", "staubli_tx40", "ur3e", "ur5e", "ur10e", "panda", *BY_EYE}
    assert set(shipped_recipes()) == checked
