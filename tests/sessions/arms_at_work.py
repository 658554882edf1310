"""Arms at work in MuJoCo, with published masses, and what is read of their motors: none of the package's code."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

#: Standard Denavit-Hartenberg rows (d, a, alpha) of the UR5e, masses (kg) and centres of mass (m, in the frame after
#: the row): Universal Robots, DH Parameters for calculations of kinematics and dynamics.
UR5E = (
    (0.1625, 0.0, np.pi / 2, 3.761, (0.0, -0.02561, 0.00193)),
    (0.0, -0.425, 0.0, 8.058, (0.2125, 0.0, 0.11336)),
    (0.0, -0.3922, 0.0, 2.846, (0.15, 0.0, 0.0265)),
    (0.1333, 0.0, np.pi / 2, 1.37, (0.0, -0.0018, 0.01634)),
    (0.0997, 0.0, -np.pi / 2, 1.3, (0.0, 0.0018, 0.01634)),
    (0.0996, 0.0, 0.0, 0.365, (0.0, 0.0, -0.001159)),
)


#: Length of a recording, s.
SECONDS = 50.0


@dataclass(frozen=True)
class Recording:
    """N samples of J joints: time (N,) s, positions, velocities and torques of the motors, (N, J) in rad and N m."""

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    torque: np.ndarray


def ur5e() -> mujoco.MjSpec:
    """The UR5e, from its standard table."""
    spec = mujoco.MjSpec()
    body, place = spec.worldbody, np.eye(4)
    for number, (d, a, alpha, mass, centre) in enumerate(UR5E, 1):
        turn = np.zeros(4)
        mujoco.mju_mat2Quat(turn, place[:3, :3].ravel())
        body = body.add_body(name=f"link{number}", pos=place[:3, 3], quat=turn)
        body.add_joint(name=f"joint{number}", axis=[0, 0, 1])
        c, s = np.cos(alpha), np.sin(alpha)
        place = np.array([[1, 0, 0, a], [0, c, -s, 0], [0, s, c, d], [0, 0, 0, 1]])
        body.mass, body.ipos = mass, place[:3] @ [*centre, 1.0]
        body.inertia, body.explicitinertial = mass * np.array([0.004, 0.004, 0.004]), True
    return spec


def of_urdf(path: Path) -> mujoco.MjSpec:
    """A URDF's arm as MuJoCo reads it, without its meshes."""
    text = re.sub(r"<(visual|collision)\b.*?</\1>", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    return mujoco.MjSpec.from_string(text)


def worked(
    spec: mujoco.MjSpec, *, middle: Sequence[float], friction: Sequence[float], rotor: float, seed: int
) -> tuple[mujoco.MjModel, Recording]:
    """50 s of moves of all joints within 0.9 rad of `middle` (J,), under a digital controller that is not ideal.

    Friction (J,) N m, as much damping (N m s/rad) and rotors' inertia (kg m2 per N m of friction) are MuJoCo's own.
    """
    spec.option.timestep, spec.option.integrator = 0.001, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for joint, size in zip(spec.joints, friction, strict=True):
        joint.frictionloss, joint.damping[0], joint.armature = size, size, rotor * size
        joint.limited, joint.solref_friction = mujoco.mjtLimited.mjLIMITED_FALSE, [0.002, 1.0]
    model = spec.compile()
    data, rng, step = mujoco.MjData(model), np.random.default_rng(seed), 0.002
    wanted = moves(rng, np.array(middle), round(SECONDS / step), step)
    speed = np.gradient(wanted, step, axis=0)
    pull = np.gradient(speed, step, axis=0)
    data.qpos[:] = wanted[0]
    rows, missed, needed = [], np.zeros(model.nv), np.zeros(model.nv)
    for k in range(len(wanted)):
        mujoco.mj_forward(model, data)
        error = wanted[k] - data.qpos
        missed += error * step
        asked = pull[k] + 50.0 * (speed[k] - data.qvel) + 900.0 * error + 2000.0 * missed
        mujoco.mj_mulM(model, data, needed, asked)
        torque = needed + 0.9 * data.qfrc_bias
        rows.append((data.qpos.copy(), data.qvel.copy(), torque))
        data.qfrc_applied[:] = torque
        mujoco.mj_step(model, data, nstep=2)
    position, velocity, torque = map(np.array, zip(*rows, strict=True))
    return model, Recording(np.arange(len(rows)) * step, position, velocity, torque)


def moves(rng: np.random.Generator, middle: np.ndarray, count: int, step: float) -> np.ndarray:
    """(count, J) positions: smooth moves of all joints from place to place within 0.9 rad of `middle`, short pauses."""
    at, parts = middle + rng.uniform(-0.9, 0.9, len(middle)), []
    while sum(map(len, parts)) < count:
        to = middle + rng.uniform(-0.9, 0.9, len(middle))
        s = np.arange(0.0, 1.0, step / rng.uniform(1.5, 3.0))[:, None]
        parts += [at + (to - at) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2), np.tile(to, (round(0.2 / step), 1))]
        at = to
    return np.concatenate(parts)[:count]
