"""Gravity of a virtual arm: masses and centres of mass, the loads of its joints, and the paper's constants of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.kinematics import frames, link_rotation
from pumaid.robot import Robot

Floats = NDArray[np.float64]

#: Of a robot that is known by constants in amperes alone: A/(N m), its middle motor's gain; m, the distance of a link's
#: centre of mass from its axis, and the largest share of the motor's inertia that the mass adds there.
_GAIN, _DISTANCE, _SWUNG = 0.1, 0.1, 0.05


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

    def loaded(self, mass: float, place: Sequence[float]) -> Links:
        """With `mass` (kg) more on the last link, at `place` (m, in its frame)."""
        total, centre = self.mass.copy(), self.centre.copy()
        total[-1] += mass
        centre[-1] = (self.mass[-1] * centre[-1] + mass * np.array(place)) / total[-1]
        return Links(total, centre)


def gravity_load(robot: Robot, links: Links, position: Floats) -> Floats:
    """What each joint needs to hold the arm still: the slope of the potential energy.

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
    """(N, J) N m: size of the weight's moment across each turning joint's axis, which bearings carry; 0 for sliding."""
    axis, arm, _ = _outward(robot, links, position)
    moment = np.cross(arm, np.broadcast_to(np.asarray(robot.gravity, dtype=float), arm.shape))
    across = np.linalg.norm(np.cross(axis, moment), axis=2)
    return np.where(robot.is_revolute, across, 0.0)


def _outward(robot: Robot, links: Links, position: Floats) -> tuple[Floats, Floats, Floats]:
    """(N, J, 3) axes, (N, J, 3) first moment of links i..n about origin i, kg m, and (J,) their mass."""
    angles, displacements = robot.dh_angles(position), robot.dh_displacements(position)
    rotations, origin = frames(robot.alphas, robot.lengths, offsets=displacements, thetas=angles)
    centres = origin + np.einsum("njab,jb->nja", rotations, links.centre)
    outer_mass = np.cumsum(links.mass[::-1])[::-1]
    outer_moment = np.cumsum((links.mass[:, None] * centres)[:, ::-1], axis=1)[:, ::-1]
    return rotations[..., 2], outer_moment - outer_mass[:, None] * origin, outer_mass


@dataclass(frozen=True, eq=False, slots=True)
class Constants:
    """What gravity is worth in amperes, as in the paper's Table I.

    Attributes
    ----------
    x, y
        (J,) k*_ix, k*_iy of revolute links, A s2/m; not used of prismatic ones.
    mass
        (J,) m^*_i of prismatic links, A s2/m; not used of revolute ones.
    ratio
        (J-1,) eta_i / eta_{i+1}.
    """

    x: Floats
    y: Floats
    mass: Floats
    ratio: Floats


def constants(robot: Robot, links: Links, gain: Floats) -> Constants:
    """Constants of an arm whose masses are known: the paper's (13)-(15), (21), (22).

    Parameters
    ----------
    robot
        J joints.
    links
        Masses and centres.
    gain
        (J,) eta: current per load, A/(N m) or A/N.
    """
    outer_mass = np.cumsum(links.mass[::-1])[::-1]
    k = links.mass[:, None] * links.centre
    for i in range(robot.n_joints - 2, -1, -1):
        k[i] += _carried(robot, i, outer_mass[i + 1], k[i + 1])
    return Constants(gain * k[:, 0], gain * k[:, 1], gain * outer_mass, gain[:-1] / gain[1:])


def _carried(robot: Robot, i: int, outer_mass: float, k: Floats) -> Floats:
    """(3,) kg m: what the links beyond link i (from 0), of mass `outer_mass` and constants `k` (3,), add to its own."""
    after = robot.joints[i + 1]
    turn = link_rotation(after.alpha, after.theta)
    if after.is_revolute:
        # R [0, 0, k_z] does not depend on the joint's angle: z of frame i+1 is fixed in frame i.
        return np.asarray(outer_mass * lengthwise(robot)[i] + turn[:, 2] * k[2])
    return np.asarray(outer_mass * np.array([after.a, 0.0, 0.0]) + turn @ k)


def lengthwise(robot: Robot) -> Floats:
    """(J, 3) m from each link's origin to the next, in its own frame; zero for the last."""
    out = np.zeros((robot.n_joints, 3))
    for i, after in enumerate(robot.joints[1:]):
        out[i] = [after.a, -after.d * np.sin(after.alpha), after.d * np.cos(after.alpha)]
    return out


def links_of(robot: Robot, known: Constants, inertia: Floats) -> tuple[Links, Floats]:
    """Masses and gains (J,) of an arm that has these constants; of all that have, one with usual motors.

    Parameters
    ----------
    robot
        J joints.
    known
        Constants in amperes.
    inertia
        (J,) A s2/rad or A s2/m of the motors, which tell the sign of the gains; 0 where nothing is known.
    """
    n = robot.n_joints
    ratio = np.where(known.ratio == 0.0, 1e-12, known.ratio)
    gain = np.append(np.cumprod(ratio[::-1])[::-1], 1.0) * (-1.0 if inertia[-1] < 0 else 1.0)
    mass, moment, k, outer = np.zeros(n), np.zeros((n, 3)), np.zeros(3), 0.0
    for i in range(n - 1, -1, -1):
        carried = _carried(robot, i, outer, k) if i < n - 1 else np.zeros(3)
        k, rotor = carried, abs(inertia[i] / gain[i])
        if robot.joints[i].is_revolute:
            moment[i, :2] = np.array([known.x[i], known.y[i]]) / gain[i] - carried[:2]
            k = carried + moment[i]
            size = float(np.linalg.norm(moment[i]))
            mass[i] = max(size / _DISTANCE, size**2 / (_SWUNG * rotor) if rotor else 0.0, rotor, 1e-9)
        else:
            mass[i] = known.mass[i] / gain[i] - outer
        outer += mass[i]
    share = float(np.median(np.abs(gain))) / _GAIN
    return Links(share * mass, moment / mass[:, None]), gain / share
