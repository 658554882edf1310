"""Masses and centres of mass of a chain's links, and the loads that their weight puts on every joint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.kinematics import frames
from pumaid.robot import Robot

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
    axis, arm, outer_mass = _outward(robot, links, position)
    g = np.asarray(robot.gravity, dtype=float)
    # g . (z x r) = (g x z) . r, and g x z is a product with one matrix.
    turning = -np.einsum("nja,nja->nj", axis @ np.cross(g, np.eye(3)), arm)
    sliding = -outer_mass * (axis @ g)
    return np.where(robot.is_revolute, turning, sliding)


def side_load(robot: Robot, links: Links, position: Floats) -> Floats:
    """(N, J) N m: size of the weight's moment across each turning joint's axis, which bearings carry; 0 for sliding.

    Parameters
    ----------
    robot, links, position
        As for `gravity_load`.
    """
    axis, arm, _ = _outward(robot, links, position)
    moment = np.cross(arm, np.broadcast_to(np.asarray(robot.gravity, dtype=float), arm.shape))
    across = np.linalg.norm(np.cross(axis, moment), axis=2)
    return np.where(robot.is_revolute, across, 0.0)


def swung(robot: Robot, links: Links, position: Floats) -> Floats:
    """(N, J) kg m2 (turning) or kg (sliding): what each joint accelerates of the links' masses, these at their centres.

    Parameters
    ----------
    robot, links, position
        As for `gravity_load`.
    """
    rotations, origin, centres = _placed(robot, links, position)
    away = centres[:, None] - origin[:, :, None]
    lever = np.sum(np.cross(rotations[:, :, None, :, 2], away) ** 2, axis=3)
    outer = np.triu(np.ones((len(links.mass), len(links.mass)))) * links.mass
    return np.where(robot.is_revolute, np.einsum("njk,jk->nj", lever, outer), outer.sum(axis=1))


def _placed(robot: Robot, links: Links, position: Floats) -> tuple[Floats, Floats, Floats]:
    """(N, J, 3, 3) link frames, (N, J, 3) origins and centres of mass."""
    angles, displacements = robot.dh_angles(position), robot.dh_displacements(position)
    rotations, origin = frames(robot.alphas, robot.lengths, offsets=displacements, thetas=angles)
    return rotations, origin, origin + np.einsum("njab,jb->nja", rotations, links.centre)


def _outward(robot: Robot, links: Links, position: Floats) -> tuple[Floats, Floats, Floats]:
    """(N, J, 3) axes, (N, J, 3) first moment of links i..n about origin i, kg m, and (J,) their mass."""
    rotations, origin, centres = _placed(robot, links, position)
    # Mass and first moment (about the base) of links i..n, summed from the tip inward.
    outer_mass = np.cumsum(links.mass[::-1])[::-1]
    outer_moment = np.cumsum((links.mass[:, None] * centres)[:, ::-1], axis=1)[:, ::-1]
    return rotations[..., 2], outer_moment - outer_mass[:, None] * origin, outer_mass
