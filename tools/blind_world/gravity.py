"""Torques by MuJoCo: inverse dynamics, gravity under changed conditions, and gravity as linear in the links' masses."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from blind_world.arms import GRAVITY

Floats = NDArray[np.float64]

#: Share of the largest pivot below which a column of the link regressor is no new one.
RANK = 1e-7


def inverse(model: mujoco.MjModel, position: Floats, velocity: Floats, acceleration: Floats) -> Floats:
    """(N, J) torques (N m or N) that a motion (N, J) takes of an arm without friction and actuators."""
    data = mujoco.MjData(model)
    q, v, a, f = data.qpos, data.qvel, data.qacc, data.qfrc_inverse
    out, solve = np.empty_like(position), mujoco.mj_inverse
    for k in range(len(position)):
        q[:], v[:], a[:] = position[k], velocity[k], acceleration[k]
        solve(model, data)
        out[k] = f
    return out


def holding(model: mujoco.MjModel, position: Floats) -> Floats:
    """(N, J) torques (N m or N) that hold the arm still."""
    still = np.zeros_like(position)
    return inverse(model, position, still, still)


def statics(
    model: mujoco.MjModel, position: Floats, joint: NDArray[np.int64], *, slides: NDArray[np.bool_]
) -> tuple[Floats, Floats, Floats]:
    """Gravity of the moving joint from the places of MuJoCo's bodies, by virtual work; zero where none moves.

    `position` is (N, J), `joint` (N,) the moving joint from 0, -1 for none, `slides` (J,) which joints are prismatic.
    Returns (N,) N m or N of load; (N,) N m, the size of gravity's moment across the joint's axis (zero for a sliding
    joint); (N, p) load per unit of p independent link parameters (masses, kg, first moments, kg m).
    """
    n = len(slides)
    data = mujoco.MjData(model)
    rows = np.flatnonzero(joint >= 0)
    places, turns = np.empty((len(rows), n, 3)), np.empty((len(rows), n, 9))
    axis, anchor = np.empty((len(rows), 3)), np.empty((len(rows), 3))
    q, solve = data.qpos, mujoco.mj_kinematics
    for number, row in enumerate(rows):
        q[:] = position[row]
        solve(model, data)
        places[number], turns[number] = data.xpos[1:], data.xmat[1:]
        axis[number], anchor[number] = data.xaxis[joint[row]], data.xanchor[joint[row]]
    frames = turns.reshape(-1, n, 3, 3)
    own = joint[rows]
    columns = np.zeros((len(rows), n, 4))
    sliding = slides[own]
    for k in range(n):
        felt = own <= k
        lever = places[:, k] - anchor
        columns[:, k, 0] = np.where(sliding, axis[:, 2], np.cross(axis, lever)[:, 2]) * GRAVITY * felt
        for c in range(3):
            turned = np.cross(axis, frames[:, k, :, c])[:, 2]
            columns[:, k, 1 + c] = np.where(sliding, 0.0, turned) * GRAVITY * felt
    mass, centre = model.body_mass[1:], model.body_ipos[1:]
    theta = np.column_stack([mass, mass[:, None] * centre]).ravel()
    flat = columns.reshape(len(rows), -1)
    kept = _independent(flat)
    moment = np.zeros((len(rows), 3))
    for k in range(n):
        lever = places[:, k] - anchor + frames[:, k] @ centre[k]
        moment += np.cross(lever, [0.0, 0.0, -GRAVITY]) * mass[k] * (own <= k)[:, None]
    along = np.einsum("mk,mk->m", moment, axis)
    across = np.where(sliding, 0.0, np.linalg.norm(moment - along[:, None] * axis, axis=1))
    load, across, regressor = (_spread(part, rows, len(position)) for part in (flat @ theta, across, flat[:, kept]))
    return load, across, regressor


def whole_torque(model: mujoco.MjModel, position: Floats, velocity: Floats, acceleration: Floats) -> Floats:
    """(N, J, p) N m or N of a motion (N, J) per unit of p independent link parameters: of 1 kg at places in each link.

    Mass, first moments and inertia are polynomials of second order in the place, which ten places span. The masses of
    `model` are lost.
    """
    data, n = mujoco.MjData(model), position.shape[1]
    places = np.vstack([np.zeros(3), np.eye(3), -np.eye(3), 1.0 - np.eye(3)])
    out, drawn = np.empty((len(position), n, n, len(places))), np.empty(n)
    model.body_inertia[:] = 0.0
    for k in range(n):
        model.body_mass[:] = np.arange(n + 1) == k + 1
        for c, place in enumerate(places):
            model.body_ipos[k + 1] = place
            for row in range(len(position)):
                data.qpos[:], data.qvel[:], data.qacc[:] = position[row], velocity[row], acceleration[row]
                mujoco.mj_kinematics(model, data)
                mujoco.mj_comPos(model, data)
                mujoco.mj_comVel(model, data)
                mujoco.mj_rne(model, data, 1, drawn)
                out[row, :, k, c] = drawn
    columns = out.reshape(len(position), n, -1)
    return columns[:, :, _independent(columns.swapaxes(0, 1).reshape(len(position) * n, -1))]


def _spread(values: Floats, rows: NDArray[np.int64], size: int) -> Floats:
    out = np.zeros((size, *values.shape[1:]))
    out[rows] = values
    return out


def _independent(columns: Floats) -> list[int]:
    """Columns, left to right, that none before them make up."""
    kept: list[int] = []
    thin = columns[:: max(1, len(columns) // 4000)]
    basis = np.zeros((len(thin), 0))
    for k in range(thin.shape[1]):
        rest = thin[:, k] - basis @ (basis.T @ thin[:, k])
        rest -= basis @ (basis.T @ rest)
        size = np.linalg.norm(rest)
        if size > RANK * max(np.linalg.norm(thin[:, k]), 1e-9 * np.sqrt(len(thin))) and size > 1e-9:
            kept.append(k)
            basis = np.column_stack([basis, rest / size])
    return kept
