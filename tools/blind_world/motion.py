"""The arm's true motion: a stiff PD loop with an imperfect feedforward, simulated by MuJoCo and kept on disk."""

import hashlib
import os
import tempfile
from dataclasses import dataclass, fields
from pathlib import Path

import mujoco
import numpy as np
from mujoco import rollout
from numpy.typing import NDArray

from blind_world.arms import STEP, Arm, draw_arm, model_of
from blind_world.campaign import Campaign, draw_campaign, reference
from blind_world.gravity import inverse, statics

Floats = NDArray[np.float64]

#: Hz of the log, and steps of the simulation a row.
RATE = 100.0
EVERY = round(1.0 / (RATE * STEP))
#: s after a ramp in which the loop settles; what the oracle counts as a run starts there.
SETTLING = 0.1


@dataclass(frozen=True, eq=False)
class Motion:
    """What an arm did, N rows at `RATE`, and what MuJoCo says it took."""

    position: Floats  # (N, J), true, like the next three
    velocity: Floats
    acceleration: Floats
    torque: Floats  # N m or N, by inverse dynamics, without any friction
    moving: NDArray[np.int64]  # (N,) index of the stroke that is under way, -1 between strokes
    run: NDArray[np.int64]  # (N,) the same where its speed is commanded constant and the loop has settled, else -1
    load: Floats  # (N, ...) gravity of the moving joint, like the next two; see `gravity.statics`
    across: Floats
    regressor: Floats

    def __len__(self) -> int:
        return len(self.position)

    @property
    def time(self) -> Floats:
        """(N,) s."""
        return np.arange(len(self)) / RATE


def motion_of(kind: str, seed: int, *, is_thin: bool) -> tuple[Arm, Campaign, Motion]:
    """An arm, its campaign and its motion; simulated once and then read from the folder of kept motions."""
    arm = draw_arm(kind, seed)
    campaign = draw_campaign(arm, is_thin=is_thin)
    folder = Path(os.environ.get("BLIND_CACHE", Path(tempfile.gettempdir()) / "blind_motions"))
    path = folder / f"{kind}_{seed}_{'thin' if is_thin else 'full'}_{_version()}.npz"
    if path.is_file():
        with np.load(path) as kept:
            return arm, campaign, Motion(**{field.name: kept[field.name] for field in fields(Motion)})
    motion = _simulated(arm, campaign)
    folder.mkdir(parents=True, exist_ok=True)
    draft = path.with_suffix(f".{os.getpid()}.npz")
    np.savez(draft, **{field.name: getattr(motion, field.name) for field in fields(Motion)})
    draft.replace(path)
    return arm, campaign, motion


def _version() -> str:
    """Of the code that makes motions, so that a changed one is not answered from the folder."""
    here = Path(__file__).parent
    names = ("arms.py", "campaign.py", "gravity.py", "motion.py")
    return hashlib.sha256(b"".join((here / name).read_bytes() for name in names)).hexdigest()[:10]


def _simulated(arm: Arm, campaign: Campaign) -> Motion:
    rng = np.random.default_rng([arm.seed, 3])
    told = reference(campaign, arm)
    model = model_of(arm)
    middle = told.position[:: max(1, len(told.position) // 200)]
    still = np.zeros_like(middle)
    held = inverse(model, middle, still, still)
    pushed = [inverse(model, middle, still, still + unit)[:, k] - held[:, k] for k, unit in enumerate(np.eye(arm.n))]
    inertia = np.max(pushed, axis=1)
    pole, damped = 2 * np.pi * rng.uniform(9.0, 15.0, arm.n), rng.uniform(0.8, 1.1, arm.n)
    stiffness, damping = inertia * pole**2, 2 * damped * inertia * pole
    dry = arm.coulomb / np.abs(arm.gain) * rng.uniform(0.6, 1.0, arm.n)
    loop = model_of(arm, (stiffness, damping, dry))
    rows = told.position[::EVERY]
    known = rng.uniform(0.9, 1.0) * inverse(model, rows, told.velocity[::EVERY], told.acceleration[::EVERY])
    known += 0.7 * dry * np.tanh(told.velocity[::EVERY] / 0.02)
    steps, at = np.arange(len(told.position)), np.arange(len(known)) * EVERY
    forward = np.column_stack([np.interp(steps, at, one) for one in known.T])
    command = told.position + (damping * told.velocity + forward) / stiffness
    states = _rolled(loop, command, told.position[0])
    n = arm.n
    position, velocity = states[::EVERY, 1 : 1 + n], states[::EVERY, 1 + n : 1 + 2 * n]
    before = np.vstack([velocity[:1], states[EVERY - 1 :: EVERY, 1 + n : 1 + 2 * n][: len(velocity) - 1]])
    after = np.vstack([states[1::EVERY, 1 + n : 1 + 2 * n], velocity[-1:]])[: len(velocity)]
    acceleration = (after - before) / (2 * STEP)
    moving = _marks(len(position), told.opens, told.closes)
    run = _marks(len(position), told.begins + SETTLING, told.ends - 2.0 / RATE)
    joints = np.array([stroke.joint for stroke in campaign.strokes])
    torque = inverse(model, position, velocity, acceleration)
    weight = statics(model, position, np.where(moving >= 0, joints[moving], -1), slides=arm.slides)
    return Motion(position.copy(), velocity.copy(), acceleration, torque, moving, run, *weight)


def _rolled(model: mujoco.MjModel, command: Floats, start: Floats) -> Floats:
    """(K, 1 + 2J) time, positions and velocities of the closed loop; the loop is linear in its commands."""
    data = mujoco.MjData(model)
    data.qpos[:] = start
    spec = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.zeros((1, mujoco.mj_stateSize(model, spec)))
    mujoco.mj_getState(model, data, state[0], spec)
    found, _ = rollout.rollout(model, data, state, command[None])
    return np.asarray(found[0])


def _marks(count: int, begins: Floats, ends: Floats) -> NDArray[np.int64]:
    """(N,) number of the span that each row lies in, -1 for none."""
    out = np.full(count, -1)
    for number, (begin, end) in enumerate(zip(begins, ends, strict=True)):
        out[int(np.ceil(begin * RATE)) : int(np.floor(end * RATE)) + 1] = number
    return out
