"""Gears that couple a virtual robot's joints: how its motors turn, and what they carry of one another's loads."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pumaid.robot import Robot

Floats = NDArray[np.float64]


def shafts(robot: Robot) -> Floats:
    """(J, J) velocities of the motors' shafts, geared to their joints, per velocity of each joint.

    Solves the motors' speeds m from m = G qd + R m, with the gear ratios G and R of what motors turn of others, and
    divides by G. What it is multiplied by from the left carries torques: the joints get its transpose times what the
    motors give, since power is the same on either side.
    """
    n = robot.n_joints
    turned, gears = np.zeros((n, n)), np.ones(n)
    for (driven, driving), ratio in robot.coupling.items():
        turned[driven - 1, driving - 1] = ratio
        gears[driven - 1], gears[driving - 1] = (robot.joints[k - 1].gear_ratio or 1.0 for k in (driven, driving))
    return np.asarray(np.linalg.solve(np.eye(n) - turned, np.diag(gears)) / gears[:, None])


def borne(robot: Robot, load: Floats) -> Floats:
    """(N, J) what the motors carry, geared to their joints, of (N, J) loads of the joints (N m or N)."""
    return load @ np.linalg.inv(shafts(robot)) if robot.coupling else load
