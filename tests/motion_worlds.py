"""Logs whose runs are known to the sample, made without any code of the package but its records.

A world is a list of legs: one joint's commanded velocity over time (ramps linear or cosine, ringing after a ramp,
pauses, strokes of fourth order), integrated on a fine grid, then sampled, jittered, disturbed, quantised. The truth is
known from the command: a sample belongs to a run where the command holds a constant speed and no ringing is above 1 %.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.signal import lfilter

from pumaid.dataset import Log
from pumaid.robot import Joint, Robot

#: What every case changes in a plain world; thresholds were chosen on seeds 0 to 2 and are judged on others.
SCENARIOS: dict[str, dict] = {
    "plain": {},
    "no noise in position": {"position_noise": 0.0, "quantum": 0.0},
    "position noise 1 mrad": {"position_noise": 1e-3},
    "encoder step 1 mrad": {"quantum": 1e-3, "position_noise": 0.0},
    "cosine ramps": {"ramp": "cosine"},
    "soft ramps, 0.5 rad/s2": {"acceleration": 0.5},
    "hard ramps, 30 rad/s2": {"acceleration": 30.0},
    "ringing 15 %": {"ringing": 0.15},
    "ringing 30 %, 10 rad/s2": {"ringing": 0.3, "acceleration": 10.0},
    "reversal without dwell": {"reversal": True},
    "pause in mid-motion": {"pause": True},
    "two speeds a motion": {"two_speeds": True},
    "time jittered by 80 %": {"jitter": 0.8},
    "held joint creeps 1 %": {"creep": 0.01},
    "held joint twitches": {"twitch": True},
    "gaps of 0.12 s": {"gap": True},
    "prismatic": {"prismatic": True, "speeds": (0.05, 0.3), "acceleration": 1.0},
    "50 Hz": {"rate": 50.0},
    "125 Hz": {"rate": 125.0},
    "4 kHz": {"rate": 4000.0},
    "0.01 to 0.03 rad/s": {"speeds": (0.01, 0.03), "plateau": (3.0, 8.0), "acceleration": 0.5},
    "the same, step 1 mrad": {
        "speeds": (0.01, 0.03), "plateau": (3.0, 8.0), "acceleration": 0.5, "quantum": 1e-3, "position_noise": 0.0,
    },
    "1 to 3 rad/s": {"speeds": (1.0, 3.0), "plateau": (0.4, 1.0), "acceleration": 15.0},
    "runs across 4 files": {"files": 4},
}  # fmt: skip

FINE = 20000.0  # Hz, grid on which velocities are integrated
SETTLED = 0.01  # share of the speed that a ringing may still have in a run
COULOMB, VISCOUS, INERTIA, LOAD = 0.5, 0.3, 0.25, 1.0  # A, A s/rad, A s2/rad, A


@dataclass
class World:
    """What a scenario asks for; every length in rad or m, s, Hz."""

    rate: float = 1000.0
    joints: int = 3
    motions: int = 10
    speeds: tuple[float, float] = (0.2, 1.2)
    acceleration: float = 3.0
    plateau: tuple[float, float] = (0.8, 2.0)  # s
    ramp: str = "linear"  # linear, cosine
    ringing: float = 0.0  # share of the speed
    dwell: tuple[float, float] = (0.2, 0.6)  # s
    reversal: bool = False  # no dwell between motions
    pause: bool = False  # a stop in the middle of a motion
    two_speeds: bool = False
    strokes: bool = False  # quintic, never constant
    position_noise: float = 1e-4
    quantum: float = 1e-4
    jitter: float = 0.0  # share of the sampling interval
    creep: float = 0.0  # share of the moving joint's speed
    twitch: bool = False  # a held joint jerks in the middle of each motion
    gap: bool = False  # samples missing in the middle of some motions
    prismatic: bool = False
    noise_time: float = 0.01  # s, correlation of the current's noise
    signal_to_noise: float = 10.0
    files: int = 1


@dataclass
class Truth:
    """Per sample: joint in a run (0: none), number of the run, the current's inertial part and its noise; the logs."""

    joint: np.ndarray
    run: np.ndarray
    inertia: np.ndarray
    noise: np.ndarray
    logs: list[Log]


def robot(world: World) -> Robot:
    """An arm with as many joints as the world moves."""
    kind = "prismatic" if world.prismatic else "revolute"
    return Robot("oracle", tuple(Joint(n + 1, f"j{n + 1}", kind, alpha=-1.5 * (n % 2)) for n in range(world.joints)))


def _leg(world: World, speed: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Velocity on the fine grid, and where it is a run."""
    if world.strokes:
        x = np.linspace(0, 1, round(rng.uniform(*world.plateau) * FINE))
        return speed * 16 * x**2 * (1 - x) ** 2, np.zeros(len(x), bool)
    velocity, is_run = [], []

    def ramp(start: float, end: float) -> None:
        duration = abs(end - start) / world.acceleration * (1.5 if world.ramp == "cosine" else 1.0)
        size = max(2, round(duration * FINE))
        x = (np.arange(size) + 0.5) / size
        velocity.append(start + (end - start) * (x if world.ramp == "linear" else 0.5 - 0.5 * np.cos(np.pi * x)))
        is_run.append(np.zeros(len(velocity[-1]), bool))

    def hold(speed: float) -> None:
        t = np.arange(round(rng.uniform(*world.plateau) * FINE)) / FINE
        size = world.ringing * np.exp(-t / 0.05)
        velocity.append(speed * (1 + size * np.sin(2 * np.pi * 12.0 * t)))
        is_run.append(size <= SETTLED)

    ramp(0.0, speed)
    hold(speed)
    if world.two_speeds:
        ramp(speed, 0.6 * speed)
        speed = 0.6 * speed
        hold(speed)
    if world.pause:
        ramp(speed, 0.0)
        velocity.append(np.zeros(round(rng.uniform(0.1, 0.4) * FINE)))
        is_run.append(np.zeros(len(velocity[-1]), bool))
        ramp(0.0, speed)
        hold(speed)
    ramp(speed, 0.0)
    return np.concatenate(velocity), np.concatenate(is_run)


def make(world: World, seed: int) -> Truth:
    """Draw a world: the truth per sample, and its logs."""
    rng = np.random.default_rng(seed)
    legs: list[tuple[np.ndarray, np.ndarray, int]] = []

    def rest() -> None:
        still = np.zeros(round(rng.uniform(*world.dwell) * FINE))
        legs.append((still, still > 0, 0))

    rest()
    for motion in range(world.motions):
        speed = np.exp(rng.uniform(*np.log(world.speeds))) * (1 if motion % 2 == 0 else -1)
        legs.append((*_leg(world, speed, rng), motion // 2 % world.joints + 1))
        if not (world.reversal and motion % 2 == 0):
            rest()
    v, is_run = (np.concatenate([leg[k] for leg in legs]) for k in (0, 1))
    moving = np.repeat([leg[2] for leg in legs], [len(leg[0]) for leg in legs])
    fine_v = np.zeros((len(v), world.joints))
    fine_v[np.arange(len(v)), np.maximum(moving - 1, 0)] = v
    if world.creep:
        fine_v[:, 0] += np.where(moving > 1, world.creep * np.abs(v), 0.0)
    if world.twitch:
        is_run = is_run & ~_twitches(fine_v, moving, world)
    fine_q = np.cumsum(fine_v, axis=0) / FINE + rng.uniform(-0.5, 0.5, world.joints)
    time = np.arange(0, len(v) / FINE - 1 / world.rate, 1 / world.rate)
    time = time + world.jitter / world.rate * rng.uniform(-0.5, 0.5, len(time))
    index = np.clip(np.round(time * FINE).astype(int), 0, len(v) - 1)
    number = np.where(is_run, np.cumsum(np.diff(is_run.astype(int), prepend=0) == 1), -1)[index]
    logged = np.ones(len(time), bool)
    for k in np.unique(number[number >= 0])[::3] if world.gap else ():
        middle = int(np.median(np.flatnonzero(number == k)))
        logged[middle : middle + max(6, round(0.12 * world.rate))] = False
    time, index, number = time[logged], index[logged], number[logged]
    inertia = INERTIA * np.gradient(v)[index] * FINE
    signals = fine_q[index], fine_v[index], moving[index]
    logs, noise = _logs(world, rng, time, signals=signals, inertia=inertia)
    return Truth(np.where(is_run, moving, 0)[index], number, inertia, noise, logs)


def _twitches(fine_v: np.ndarray, moving: np.ndarray, world: World) -> np.ndarray:
    """Jerk the next joint for 0.15 s in the middle of every motion; where that is."""
    where = np.zeros(len(moving), bool)
    borders = np.flatnonzero(np.diff(np.concatenate([[0], moving, [0]])))
    for a, b in pairwise(borders):
        if moving[a] and b - a >= FINE:
            middle, size = (a + b) // 2, round(0.15 * FINE)
            jerk = 0.3 * np.sin(2 * np.pi * np.linspace(0, 1, size))
            fine_v[middle : middle + size, moving[a] % world.joints] += jerk
            where[middle : middle + size] = True
    return where


def _logs(
    world: World, rng: np.random.Generator, time: np.ndarray, *, signals: tuple, inertia: np.ndarray
) -> tuple[list[Log], np.ndarray]:
    """Disturbed and quantised logs of positions, velocities and moving joints; noise of the moving joint's current."""
    q, v, joint = signals
    moving = np.arange(len(time)), np.maximum(joint - 1, 0)
    friction = COULOMB * np.sign(v[moving]) + VISCOUS * v[moving]
    weight = LOAD * np.cos(q) * (not world.prismatic)
    sigma = np.sqrt(np.mean((weight[moving] + friction)[joint > 0] ** 2)) / world.signal_to_noise
    memory = np.exp(-1 / (world.rate * world.noise_time))
    white = rng.standard_normal(q.shape) * sigma * np.sqrt(1 - memory**2)
    noise = lfilter([1.0], [1.0, -memory], white, axis=0)
    current = noise + weight
    current[moving] += np.where(joint > 0, friction + inertia, 0.0)
    position = q + world.position_noise * rng.standard_normal(q.shape)
    if world.quantum:
        position = np.round(position / world.quantum) * world.quantum
    columns, logs = (time, position, np.round(v / 0.02) * 0.02, current), []
    for file, part in enumerate(np.array_split(np.arange(len(time)), world.files)):
        values = (column[part] for column in columns)
        logs.append(Log(f"log_{file}.csv", np.arange(len(part)) + 2, *values, starts_clock=file == 0))
    return logs, noise[moving]


@dataclass
class Score:
    """Samples truly in runs, and of these those kept; runs; worst bias of friction in standard errors."""

    true: int
    right: int
    runs: int
    bias: float


def score(truth: Truth, dataset) -> Score:
    """Compare what was kept with the truth, sample by sample; bias is by inertia in the runs, of Coulomb and viscous
    friction."""
    starts = np.cumsum([0, *(len(log) for log in truth.logs[:-1])]).tolist()
    offsets = {log.origin: start for log, start in zip(truth.logs, starts, strict=True)}
    kept, rows = np.zeros(len(truth.joint), int), []
    for run in dataset.runs:
        part = slice(offsets[run.origin] + run.first_row - 2, offsets[run.origin] + run.last_row - 1)
        if run.kind == "constant":
            kept[part] = run.joint
            rows.append((run.joint, run.direction, run.speed, truth.inertia[part].mean(), truth.noise[part].mean()))
    table, worst = np.array(rows).reshape(-1, 5), 0.0
    spread = np.sqrt(np.mean(table[:, 4] ** 2)) if len(table) else 1.0
    for joint in np.unique(table[:, 0]):
        part = table[table[:, 0] == joint]
        columns = np.column_stack([part[:, 1] > 0, part[:, 1] < 0, part[:, 2]]).astype(float)
        if len(part) >= 4:
            cov = np.linalg.pinv(columns.T @ columns)
            bias = cov @ columns.T @ part[:, 3]
            worst = max(worst, float(np.max(np.abs(bias) / (spread * np.sqrt(np.diag(cov))))))
    right = int(((kept == truth.joint) & (kept > 0)).sum())
    return Score(int((truth.joint > 0).sum()), right, len(rows), worst)
