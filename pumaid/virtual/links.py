"""Masses and centres of mass of a chain's links, and the loads that their weight puts on every joint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.maths.frames import axes, origins
from pumaid.records import Robot

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, slots=True)
class Links:
    """The arm's masses.

    Attributes
    ----------
    mass
        (J,) kg.
    centre
        (J, 3) m: each link's centre of mass in its own frame (modified Denavit-Hartenberg).
    """

    mass: Floats
    centre: Floats

    def __post_init__(self) -> None:
        if self.centre.shape != (len(self.mass), 3):
            raise ValueError(f"centre is {self.centre.shape}, {len(self.mass)} masses need {(len(self.mass), 3)}")


def gravity_load(robot: Robot, links: Links, position: Floats) -> Floats:
    """What each motor must give to hold the arm still: the slope of the potential energy.

    U = -sum_k m_k g . p_k. Turning joint i moves p_k by z_i x (p_k - o_i), sliding it moves p_k by z_i, for k >= i.

    Parameters
    ----------
    robot
        J joints.
    links
        Masses and centres.
    position
        (N, J) measured positions, rad or m.

    Returns
    -------
    load
        (N, J) N m (revolute) or N (prismatic).
    """
    angles, displacements = robot.dh_angles(position), robot.dh_displacements(position)
    rotations = axes(robot.alphas, angles)
    origin = origins(robot.alphas, robot.lengths, offsets=displacements, thetas=angles)
    centres = origin + np.einsum("njab,jb->nja", rotations, links.centre)
    # Mass and first moment (about the base) of links i..n, summed from the tip inward.
    outer_mass = np.cumsum(links.mass[::-1])[::-1]
    outer_moment = np.cumsum((links.mass[:, None] * centres)[:, ::-1], axis=1)[:, ::-1]
    g = np.asarray(robot.gravity, dtype=float)
    axis = rotations[..., 2]
    arm = outer_moment - outer_mass[:, None] * origin
    turning = -np.einsum("nja,nja->nj", np.cross(axis, arm), np.broadcast_to(g, axis.shape))
    sliding = -outer_mass * (axis @ g)
    return np.where(robot.is_revolute, turning, sliding)
