"""Whether a recipe's axes are those of the URDF that it was made from, posture by posture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.kinematics import axes, origins
from pumaid.maths.chain import SerialChain
from pumaid.robot import Robot

#: Random postures that are compared; joints that slide go this far each way (m), joints that turn half a turn.
POSTURES, SLIDE = 200, 1.0


@dataclass(frozen=True, slots=True)
class Agreement:
    """Farthest that any axis is off in any posture: in direction (rad), and in place (m, across the axis)."""

    direction: float
    place: float

    def within(self, tolerance: float) -> bool:
        """Whether both are at most this (rad and m)."""
        return self.direction <= tolerance and self.place <= tolerance


def agreement(robot: Robot, chain: SerialChain, base: NDArray[np.float64]) -> Agreement:
    """Compare a recipe's axes, as lines in space, with homogeneous transforms straight from a URDF's elements.

    Parameters
    ----------
    robot
        The arm as the recipe states it.
    chain
        The same joints as the URDF states them.
    base
        (4, 4) the recipe's frame 0 in the chain's base (m).
    """
    spans = np.where(robot.is_revolute, np.pi, SLIDE)
    random = np.random.default_rng(0)
    positions = random.uniform(-spans, spans, (POSTURES, robot.n_joints))
    positions[0] = 0.0
    theirs, on_theirs = chain.lines(positions)
    ours, on_ours = _lines(robot, positions)
    ours, on_ours = ours @ base[:3, :3].T, on_ours @ base[:3, :3].T + base[:3, 3]
    across = np.cross(on_ours - on_theirs, theirs)
    return Agreement(_longest(ours - theirs), _longest(across))


def _lines(robot: Robot, positions: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    angles, displacements = robot.dh_angles(positions), robot.dh_displacements(positions)
    points = origins(robot.alphas, robot.lengths, offsets=displacements, thetas=angles)
    return axes(robot.alphas, angles)[..., 2], points


def _longest(vectors: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(vectors, axis=-1).max())
