"""The paper's own recursion: what each motor current carries, from constants in amperes alone.

Equation numbers are those of S.-K. Lin, "Identification of a Class of Nonlinear Deterministic Systems with Application
to Manipulators". Letters: k*, m*, l* are the paper's starred quantities, s_{i+1} the vector from origin i
to origin i+1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.maths.frames import axes, link_rotation
from pumaid.records import Robot
from pumaid.virtual.links import Links

Floats = NDArray[np.float64]


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
    """Constants of an arm whose masses are known: (13)-(15), (21), (22).

    Parameters
    ----------
    robot
        J joints.
    links
        Masses and centres.
    gain
        (J,) eta: current per load, A/(N m) or A/N.
    """
    n = robot.n_joints
    outer_mass = np.cumsum(links.mass[::-1])[::-1]
    k = links.mass[:, None] * links.centre
    for i in range(n - 2, -1, -1):
        after = robot.joints[i + 1]
        turn = link_rotation(after.alpha, after.theta)
        if after.is_revolute:
            s = np.array([after.a, -after.d * np.sin(after.alpha), after.d * np.cos(after.alpha)])
            # R [0, 0, k_z] does not depend on the joint's angle: z of frame i+1 is fixed in frame i.
            k[i] += outer_mass[i + 1] * s + turn[:, 2] * k[i + 1, 2]
        else:
            k[i] += outer_mass[i + 1] * np.array([after.a, 0.0, 0.0]) + turn @ k[i + 1]
    return Constants(gain * k[:, 0], gain * k[:, 1], gain * outer_mass, gain[:-1] / gain[1:])


def gravity_current(robot: Robot, known: Constants, position: Floats) -> Floats:
    """Current that carries the weight, by (11) and (23)-(25), from the tip inward.

    Parameters
    ----------
    robot
        J joints.
    known
        Constants and neighbour ratios.
    position
        (N, J) measured positions, rad or m.

    Returns
    -------
    current
        (N, J) A.
    """
    angles, displacements = robot.dh_angles(position), robot.dh_displacements(position)
    gravity = axes(robot.alphas, angles).transpose(0, 1, 3, 2) @ np.asarray(robot.gravity, dtype=float)
    samples, n = angles.shape
    current, varying = np.zeros((samples, n)), np.zeros((samples, 3))
    for i in range(n - 1, -1, -1):
        # varying holds l*_i = eta_{i+1} l_i here, so that (eta_i / eta_{i+1}) l*_i is in amperes of joint i.
        ratio = known.ratio[i] if i < n - 1 else 0.0
        if robot.joints[i].is_revolute:
            across = np.column_stack([-gravity[:, i, 1], gravity[:, i, 0]])
            nu = np.sum(across * varying[:, :2], axis=1)
            current[:, i] = across @ np.array([known.x[i], known.y[i]]) + ratio * nu
            seen = ratio * varying + np.array([known.x[i], known.y[i], 0.0])
        else:
            current[:, i] = -gravity[:, i, 2] * known.mass[i]
            seen = ratio * varying + known.mass[i] * displacements[:, i, None] * np.array([0.0, 0.0, 1.0])
        turn = link_rotation(robot.joints[i].alpha, angles[:, i])
        varying = np.einsum("nab,nb->na", turn, seen)
    return current
