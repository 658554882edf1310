"""Arms in two rigid-body engines that know masses and nothing of the package's regressors."""

import mujoco
import numpy as np
import pinocchio as pin

from pumaid.robot import Robot


def pinocchio_model(robot: Robot, bodies) -> pin.Model:
    """The arm with these bodies (`pin.Inertia`) as links."""
    model, parent = pin.Model(), 0
    for joint, body in zip(robot.joints, bodies, strict=True):
        before = pin.SE3(pin.utils.rotate("x", joint.alpha), np.array([joint.a, 0.0, 0.0]))
        place = before * pin.SE3(pin.utils.rotate("z", joint.theta), np.array([0.0, 0.0, joint.d]))
        kind = pin.JointModelRZ() if joint.is_revolute else pin.JointModelPZ()
        parent = model.addJoint(parent, kind, place, joint.name)
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
    model.gravity.linear = np.array(robot.gravity)
    return model


def held_by_pinocchio(model: pin.Model, position: np.ndarray) -> np.ndarray:
    """(N, J) torques and forces that hold the arm still."""
    data = model.createData()
    return np.array([pin.computeGeneralizedGravity(model, data, q).copy() for q in position])


def held_by_mujoco(model: mujoco.MjModel, position: np.ndarray) -> np.ndarray:
    """(N, J) torques and forces that hold the arm still."""
    data, out = mujoco.MjData(model), []
    for q in position:
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        out.append(data.qfrc_bias.copy())
    return np.array(out)


def by_mujoco(model: mujoco.MjModel, motion) -> np.ndarray:
    """(N, J) N m of inverse dynamics, without friction."""
    out = []
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    model.dof_damping[:], data = 0.0, mujoco.MjData(model)
    for data.qpos[:], data.qvel[:], data.qacc[:] in zip(*motion, strict=True):
        mujoco.mj_inverse(model, data)
        out.append(data.qfrc_inverse.copy())
    return np.array(out)
