"""Any motion of virtual arms, all joints at once, in closed loop: MuJoCo's dynamics, friction and noise of its own."""

from dataclasses import replace

import numpy as np

from pumaid.dataset import Log
from pumaid.robot import Robot
from pumaid.simulation import Truth
from pumaid.simulation.mujoco_engine import RigidArm

#: Hz of the log, and steps of the engine a sample.
RATE, TICKS = 250.0, 4
#: rad/s and rad/s2 of the joints at most.
FASTEST, HARDEST = 1.5, 6.0


def reach(robot: Robot) -> np.ndarray:
    """(J,) nine tenths of half of each joint's range, 2 rad to either side at most."""
    limits = np.array([joint.limits or (-2.0, 2.0) for joint in robot.joints])
    return 0.45 * np.ptp(np.clip(limits, -2.0, 2.0), axis=1)


def fourier(rng: np.random.Generator, joints: int, seconds: float, rate: float) -> tuple[np.ndarray, list[np.ndarray]]:
    """(N,) times, and positions, velocities and accelerations (J, N) of five harmonics of a tenth of a hertz."""
    t = np.arange(0.0, seconds, 1.0 / rate)
    w = 2.0 * np.pi * 0.1 * np.arange(1, 6)[:, None, None]
    size, phase = rng.uniform(0.2, 0.6, (5, joints, 1)), rng.uniform(0.0, 2.0 * np.pi, (5, joints, 1))
    parts = size * np.sin(w * t + phase), size * w * np.cos(w * t + phase), -size * w**2 * np.sin(w * t + phase)
    return t, [part.sum(axis=0) for part in parts]


def waves(rng: np.random.Generator, seconds: float, farthest: np.ndarray) -> np.ndarray:
    """(N, J) positions: five harmonics of a tenth of a hertz, within `farthest` (J,) and the highest speed."""
    t = np.arange(0.0, seconds, 1.0 / (RATE * TICKS))[:, None, None]
    w = 2.0 * np.pi * 0.1 * np.arange(1, 6)[:, None]
    size = rng.normal(size=(5, len(farthest))) / np.arange(1, 6)[:, None]
    phase = rng.uniform(0.0, 2.0 * np.pi, (5, len(farthest)))
    q, v = (size * np.sin(w * t + phase)).sum(axis=1), (size * w * np.cos(w * t + phase)).sum(axis=1)
    return q * np.minimum(farthest / np.abs(q).max(axis=0), FASTEST / np.abs(v).max(axis=0))


def picks(
    rng: np.random.Generator, seconds: float, farthest: np.ndarray, pauses: tuple[float, float] = (0.1, 0.4)
) -> np.ndarray:
    """(N, J) positions: smooth moves of all joints from place to place, with `pauses` of some length (s)."""
    step, parts, at, count = 1.0 / (RATE * TICKS), [], rng.uniform(-farthest, farthest), 0
    while count < seconds / step:
        to = rng.uniform(-farthest, farthest)
        lasts = max((2.0 * np.abs(to - at) / FASTEST).max(), np.sqrt(8.0 * np.abs(to - at) / HARDEST).max(), 0.5)
        s = np.linspace(0.0, 1.0, int(lasts / step))[1:, None]
        pause = np.tile(to, (int(rng.uniform(*pauses) / step), 1))
        parts += [at + (to - at) * (10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5), pause]
        at, count = to, count + len(s) + len(pause)
    return np.concatenate(parts)[: int(seconds / step)]


def recorded(truth: Truth, wanted: np.ndarray, rng: np.random.Generator, *, counts: float) -> Log:
    """What is logged of an arm whose motors follow the `wanted` (N, J) positions, about the middle of its range."""
    # Encoders have `counts` steps a rad; currents are means over a sample's time, with the robot's own noise.
    n, step = truth.robot.n_joints, 1.0 / (RATE * TICKS)
    limits = np.array([joint.limits or (-2.0, 2.0) for joint in truth.robot.joints])
    target = wanted + np.clip(limits, -2.0, 2.0).mean(axis=1)
    speed = np.gradient(target, step, axis=0)
    pull = np.gradient(speed, step, axis=0)
    arm = RigidArm(truth, step=step)
    arm.state.first = np.zeros(n)
    arm.place(target[0])
    position, drawn, missed = np.zeros((len(target), n)), np.zeros((len(target), n)), np.zeros(n)
    for k, goal in enumerate(target):
        if k % 50 == 0:
            inertia = arm.inertia(arm.position)
        position[k] = arm.reading
        missed += (goal - arm.position) * step
        asked = pull[k] + 60.0 * (speed[k] - arm.velocity) + 900.0 * (goal - arm.position) + 2000.0 * missed
        drawn[k] = truth.gain * (inertia @ asked) + arm.load
        arm.advance(drawn[k])
    # The engine's second difference at a step is what that step's current causes: a sensor's mean is about it.
    half = TICKS // 2
    around = np.lib.stride_tricks.sliding_window_view(
        np.pad(drawn, ((half, half), (0, 0)), mode="edge"), TICKS + 1, axis=0
    )
    current = (around @ (np.pad(np.ones(TICKS - 1), 1, constant_values=0.5) / TICKS))[::TICKS]
    noise = truth.noise.series(rng, current.shape, rate=RATE, start=rng.normal(size=n))
    time = np.arange(len(current)) / RATE
    read = np.rint(position[::TICKS] * counts) / counts
    rows = np.arange(2, len(time) + 2)
    return Log("work.csv", rows, time, read, None, current + truth.noise.sample_std * noise)


def loaded(truth: Truth, mass: float) -> Truth:
    """The arm with a tool of so many kg."""
    return replace(truth, links=truth.links.loaded({"mass": mass, "x": 0.05, "y": 0.02, "z": 0.1, "time": 0.0}))
