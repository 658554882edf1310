"""URDF texts written by tests, and what pinocchio, an independent reader, makes of a URDF."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pumaid.effects import Samples
from pumaid.effects.gravity import Gravity
from pumaid.io.urdf import UrdfRecipe
from pumaid.robot import Robot


class Stated(NamedTuple):
    """One joint of a serial arm, as a URDF states it."""

    kind: str = "revolute"
    xyz: Sequence[float] = (0.0, 0.0, 0.0)
    rpy: Sequence[float] = (0.0, 0.0, 0.0)
    axis: Sequence[float] = (0.0, 0.0, 1.0)
    limit: str = '<limit lower="-2" upper="2" velocity="1" effort="9"/>'


def numbers(values: Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def joint_text(name: str, ends: tuple[str, str], stated: Stated, inside: str = "") -> str:
    """A joint element."""
    return (
        f'<joint name="{name}" type="{stated.kind}"><parent link="{ends[0]}"/><child link="{ends[1]}"/>'
        f'<origin xyz="{numbers(stated.xyz)}" rpy="{numbers(stated.rpy)}"/><axis xyz="{numbers(stated.axis)}"/>'
        f"{stated.limit}{inside}</joint>"
    )


def serial_text(joints: Sequence[Stated], *, name: str = "arm", more: str = "") -> str:
    """A serial arm of links l0, l1, ... and joints j1, j2, ..., each link with a kilogram off its axis."""
    weight = (
        '<inertial><origin xyz="0.1 -0.2 0.3"/><mass value="1"/>'
        '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    )
    links = "".join(f'<link name="l{n}">{weight}</link>\n' for n in range(len(joints) + 1))
    text = "\n".join(joint_text(f"j{n}", (f"l{n - 1}", f"l{n}"), joint) for n, joint in enumerate(joints, start=1))
    return f'<?xml version="1.0"?>\n<robot name="{name}">\n{links}{text}\n{more}</robot>\n'


def tree_text(*joints: tuple[str, str, str], inside: dict[str, str] | None = None) -> str:
    """A tree of (joint, parent, child) at zero, all about z; a joint whose name starts with a type has that type."""
    links = dict.fromkeys(link for _, parent, child in joints for link in (parent, child))
    kinds = ("fixed", "floating", "planar", "prismatic", "continuous")
    lines = [
        joint_text(
            name,
            (parent, child),
            Stated(
                next((kind for kind in kinds if name.startswith(kind)), "revolute"), (0.1, 0.0, 0.2), (1.0, 0.5, 0.0)
            ),
            (inside or {}).get(name, ""),
        )
        for name, parent, child in joints
    ]
    return f'<robot name="tree">{"".join(f"<link name={link!r}/>" for link in links)}{"".join(lines)}</robot>'


class Engine:
    """A URDF in pinocchio: axes as lines, and torques of gravity, of the joints of a recipe made from it."""

    def __init__(self, path: Path, made: UrdfRecipe) -> None:
        import pinocchio

        self.pin, self.made = pinocchio, made
        self.model = pinocchio.buildModelFromUrdf(os.fspath(path))
        self.model.gravity.linear = np.array([0.0, 0.0, -9.80665])
        self.data = self.model.createData()
        self.joints = [self.model.getJointId(joint.name) for joint in made.path if joint.moves]
        self.places = [self.model.joints[joint].idx_v for joint in self.joints]

    def full(self, position: np.ndarray) -> np.ndarray:
        """The whole robot's configuration with the arm's joints at (J,) `position` and all others at zero."""
        velocity = np.zeros(self.model.nv)
        velocity[self.places] = position
        return self.pin.integrate(self.model, self.pin.neutral(self.model), velocity)

    def off(self, position: np.ndarray) -> tuple[float, float]:
        """Farthest that an axis of the recipe is from the engine's in one posture: rad, and m across it."""
        made, pin = self.made, self.pin
        pin.computeJointJacobians(self.model, self.data, self.full(position))
        pin.updateFramePlacements(self.model, self.data)
        base = self.data.oMf[self.model.getFrameId(made.base)].homogeneous
        turned, placed = made.robot.frames(position[None])
        z, points = turned[0, :, :, 2] @ base[:3, :3].T, placed[0] @ base[:3, :3].T
        theirs = np.array([self._axis(joint, place) for joint, place in zip(self.joints, self.places, strict=True)])
        apart = points + base[:3, 3] - [self.data.oMi[joint].translation for joint in self.joints]
        across = np.linalg.norm(np.cross(apart, theirs), axis=-1)
        return float(np.linalg.norm(z - theirs, axis=-1).max()), float(across.max())

    def _axis(self, joint: int, place: int) -> np.ndarray:
        jacobian = self.pin.getJointJacobian(self.model, self.data, joint, self.pin.LOCAL_WORLD_ALIGNED)
        column = jacobian.reshape(6, -1)[:, place]
        return column[3:] if np.linalg.norm(column[3:]) > 0.5 else column[:3]

    def holding(self, position: np.ndarray) -> np.ndarray:
        """(N, J) torques and forces that hold the arm still, for (N, J) positions."""
        rows = [self.pin.computeGeneralizedGravity(self.model, self.data, self.full(q)) for q in position]
        return np.array([row[self.places] for row in rows])


def gravity_columns(robot: Robot, position: np.ndarray) -> np.ndarray:
    """(J, N, p) gravity's columns of all links in every joint's row, all gain ratios 1."""
    effect, numbers = Gravity(), range(1, robot.n_joints + 1)

    def block(moving: int, link: int) -> np.ndarray:
        if link < moving:
            return np.zeros((len(position), len(effect.parameters(robot, link))))
        return effect.columns(robot, Samples(moving, position, np.zeros_like(position)), number=link)

    return np.array([np.hstack([block(moving, link) for link in numbers]) for moving in numbers])


def span_miss(robot: Robot, position: np.ndarray, torque: np.ndarray) -> float:
    """Largest relative error of the columns for (J, N) torques, fitted to half of the postures, on the other half."""
    regressor, half = gravity_columns(robot, position), len(position) // 2
    width = regressor.shape[-1]
    fitted = np.linalg.lstsq(regressor[:, :half].reshape(-1, width), torque[:, :half].ravel(), rcond=1e-9)[0]
    # An arm that gravity never loads has torques of rounding only: then a kilogram on a metre is the measure.
    scale = max(np.abs(torque).max(), np.linalg.norm(robot.gravity))
    return float(np.abs(regressor[:, half:] @ fitted - torque[:, half:]).max() / scale)
