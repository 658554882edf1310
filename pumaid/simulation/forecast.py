"""Slopes of the virtual robot's gravity currents by its parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pumaid.robot import Robot
from pumaid.simulation.recursion import Constants, Geometry, carried

Floats = NDArray[np.float64]


def jacobian(robot: Robot, known: Constants, position: Floats) -> Floats:
    """Change of every joint's gravity current per unit of every parameter of `gravity_names`.

    The current is linear in each constant and in each ratio alone, so differences are exact.

    Parameters
    ----------
    robot
        J joints.
    known
        Where the slope is taken.
    position
        (N, J) rad or m.

    Returns
    -------
    slopes
        (N, J, p), A per unit of the parameter.
    """
    n, zero, geometry = robot.n_joints, np.zeros(robot.n_joints), Geometry.of(robot, position)
    columns = []
    for j, joint in enumerate(robot.joints):
        unit = np.eye(n)[j]
        if joint.is_revolute:
            columns.append(carried(robot, Constants(unit, zero, zero, known.ratio), geometry))
            columns.append(carried(robot, Constants(zero, unit, zero, known.ratio), geometry))
        else:
            columns.append(carried(robot, Constants(zero, zero, unit, known.ratio), geometry))
    at_known = carried(robot, known, geometry)
    for i in range(n - 1):
        without = replace(known, ratio=np.where(np.arange(n - 1) == i, 0.0, known.ratio))
        columns.append((at_known - carried(robot, without, geometry)) / known.ratio[i])
    return np.stack(columns, axis=-1)
