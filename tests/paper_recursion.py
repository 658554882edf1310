"""The paper's own recursion: what each motor current carries, from constants in amperes alone.

Equation numbers are those of S.-K. Lin, "Identification of a Class of Nonlinear Deterministic Systems with Application
to Manipulators". Letters: k*, m*, l* are the paper's starred quantities, s_{i+1} the vector from origin i
to origin i+1.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pumaid.robot import Robot
from pumaid.simulation import Constants

Floats = NDArray[np.float64]


def gravity_current(robot: Robot, known: Constants, position: Floats) -> Floats:
    """(N, J) A that carry the weight at `position` (N, J; rad or m), by (11) and (23)-(25), from the tip inward."""
    turns, gravity, n = [], [], robot.n_joints  # turns from frame i into frame i-1; gravity in every link's frame
    felt = np.broadcast_to(np.asarray(robot.gravity, dtype=float), (len(position), 3))
    for joint, q in zip(robot.joints, position.T, strict=True):
        angle = joint.theta + (q if joint.is_revolute else 0.0 * q)
        twist = Rotation.from_euler("x", joint.alpha)
        turns.append((twist * Rotation.from_euler("z", angle[:, None])).as_matrix())
        felt = np.einsum("nab,na->nb", turns[-1], felt)
        gravity.append(felt)
    displacements = robot.displacements(position)
    current, varying = np.zeros(position.shape), np.zeros((len(position), 3))
    for i in range(n - 1, -1, -1):
        # varying holds l*_i = eta_{i+1} l_i here, so that (eta_i / eta_{i+1}) l*_i is in amperes of joint i.
        ratio = known.ratio[i] if i < n - 1 else 0.0
        if robot.joints[i].is_revolute:
            across = np.column_stack([-gravity[i][:, 1], gravity[i][:, 0]])
            nu = np.sum(across * varying[:, :2], axis=1)
            current[:, i] = across @ np.array([known.x[i], known.y[i]]) + ratio * nu
            seen = ratio * varying + np.array([known.x[i], known.y[i], 0.0])
        else:
            current[:, i] = -gravity[i][:, 2] * known.mass[i]
            seen = ratio * varying
            seen[:, 2] += known.mass[i] * displacements[:, i]
        varying = np.einsum("nab,nb->na", turns[i], seen)
    return current
