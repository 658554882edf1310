"""What an arm is told to do, and what it does.

Postures, speeds, order, ramps and pauses are drawn by seed; a stiff PD loop with an imperfect feedforward follows the
reference, simulated by MuJoCo and kept on disk.
"""

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
from blind_world.gravity import inverse, statics, whole_torque

Floats = NDArray[np.float64]

#: Speeds of the full design, as shares of the joint's highest, and of the thin one.
FULL_SPEEDS: tuple[float, ...] = (0.2, 0.38, 0.65, 1.0)
THIN_SPEEDS: tuple[float, ...] = (0.35, 1.0)
HELDOUT_SPEEDS, PEAKS = (0.3, 0.8), (0.9, 0.5)
#: Designs: runs at constant speed, many and few; strokes from rest to rest in one posture; any motion of all joints.
FULL, THIN, STROKES, FREE = "full", "thin", "strokes", "free"
#: Hz of the log, unless a campaign has another rate; s, blocks of any motion and how many are fitted and held out.
RATE, BLOCK, BLOCKS = 100.0, 10.0, (6, 3)


@dataclass(frozen=True)
class Stroke:
    """One commanded motion of one joint (from 0) while the others are held; `speed` unsigned, SI, of strokes the peak.

    In any motion a block of time, in which all joints move: joint -1, speed 0.
    """

    joint: int
    hold: tuple[float, ...]
    start: float
    end: float
    speed: float
    replicate: int
    is_heldout: bool

    @property
    def sign(self) -> float:
        """Direction."""
        return 1.0 if self.end > self.start else -1.0


@dataclass(frozen=True, eq=False)
class Campaign:
    """All strokes in the order of execution, and how they are ramped."""

    strokes: tuple[Stroke, ...]
    ramp: Floats  # (J,) s of acceleration from rest to the joint's highest speed
    is_smooth: bool  # ramps are raised cosines in speed rather than straight
    pauses: Floats  # (R,) s before each
    design: str = FULL
    rate: float = RATE  # Hz of the log

    @property
    def step(self) -> float:
        """S of the simulation."""
        return min(STEP, 1.0 / self.rate)

    @property
    def is_steady(self) -> bool:
        """Whether its runs are at constant speed."""
        return self.design in (FULL, THIN)


@dataclass(frozen=True, eq=False)
class Reference:
    """The command in time."""

    position: Floats  # (K, J) at every step of the simulation, like the next two
    velocity: Floats
    acceleration: Floats
    begins: Floats  # (R,) s: where each stroke's speed is commanded constant
    ends: Floats
    opens: Floats  # (R,) s: where each stroke starts from and comes to rest
    closes: Floats


def draw_campaign(arm: Arm, design: str, rate: float = RATE) -> Campaign:
    """4 postures x 4 speeds x 2 directions x 2 replicates a joint, thin 2 x 2 x 2 x 1; held-out runs at one more.

    Rounds of one joint at one posture come in random order, all first replicates before all second ones. Strokes have
    one or two peak speeds, five times both ways, in one posture; held-out ones have other speeds and come last.
    """
    rng = np.random.default_rng([arm.seed, sum(map(ord, arm.kind)), 2, (FULL, THIN, STROKES, FREE).index(design)])
    if design == FREE:
        middle = (arm.low + arm.high) / 2.0
        blocks = [
            Stroke(-1, tuple(middle), 0.0, 0.0, 0.0, 0, late > 0) for late, n in enumerate(BLOCKS) for _ in range(n)
        ]
        return Campaign(tuple(blocks), np.zeros(arm.n), bool(rng.random() < 0.5), np.zeros(len(blocks)), design, rate)
    n_postures, replicates = {FULL: (4, 2), THIN: (2, 1), STROKES: (1, 5)}[design]
    speeds = FULL_SPEEDS if design == FULL else THIN_SPEEDS
    if design == STROKES:
        speeds = PEAKS[: rng.integers(1, 3)]
    spans = [_span(arm, joint, rng) for joint in range(arm.n)]
    shares = [np.array(speeds) * rng.uniform(0.93, 1.07, len(speeds)) for _ in range(arm.n)]
    outside = [np.array(HELDOUT_SPEEDS) * rng.uniform(0.93, 1.07, 2) for _ in range(arm.n)]
    postures = [_postures(arm, joint, rng, n_postures + 1) for joint in range(arm.n)]
    pairs, rounds = [(joint, posture) for joint in range(arm.n) for posture in range(n_postures)], []
    for replicate in range(replicates):
        rounds += [(*pairs[index], replicate) for index in rng.permutation(len(pairs))]
    for joint in range(arm.n):
        at = int(rng.integers(0, len(rounds) + 1)) if design != STROKES else len(rounds)
        rounds.insert(at, (joint, n_postures, 0))
    strokes: list[Stroke] = []
    for joint, posture, replicate in rounds:
        is_heldout = posture == n_postures
        own = outside[joint] if is_heldout else shares[joint]
        hold = tuple(postures[joint][posture] if design != STROKES else postures[0][0])
        low, high = spans[joint] if rng.random() < 0.5 else spans[joint][::-1]
        for share in rng.permutation(np.minimum(own, 1.0)):
            speed = round(float(share * arm.speed[joint]), 4)
            strokes.append(Stroke(joint, hold, low, high, speed, replicate, is_heldout))
            strokes.append(Stroke(joint, hold, high, low, speed, replicate, is_heldout))
    return Campaign(
        strokes=tuple(strokes),
        ramp=rng.uniform(0.2, 0.45, arm.n),
        is_smooth=bool(rng.random() < 0.5),
        pauses=rng.uniform(0.08, 0.35, len(strokes)),
        design=design,
        rate=rate,
    )


def _span(arm: Arm, joint: int, rng: np.random.Generator) -> tuple[float, float]:
    """Ends of a joint's strokes, the same in every posture."""
    width = float(arm.high[joint] - arm.low[joint])
    length = rng.uniform(0.55, 0.7) * width if arm.slides[joint] else min(rng.uniform(1.7, 2.2), 0.85 * width)
    low = arm.low[joint] + 0.03 * width + rng.uniform(0.0, 1.0) * (0.94 * width - length)
    return round(float(low), 4), round(float(low + length), 4)


def _postures(arm: Arm, joint: int, rng: np.random.Generator, count: int) -> list[Floats]:
    """Held positions that differ in at least two joints (of three, in one) by a fifth of the range."""
    out: list[Floats] = []
    width = arm.high - arm.low
    while len(out) < count:
        one = np.round(arm.low + width * rng.uniform(0.08, 0.92, arm.n), 3)
        apart = (np.delete(np.abs(one - other) > 0.2 * width, joint).sum() for other in out)
        if all(count >= min(2, arm.n - 2) for count in apart):
            out.append(one)
    return out


def reference(campaign: Campaign, arm: Arm) -> Reference:
    """The command at every step of the simulation, moves between the strokes included."""
    parts: list[Floats] = []
    marks: list[tuple[int, ...]] = []
    step = campaign.step
    if campaign.design == FREE:
        whole = _free(campaign, arm)
        first = np.arange(len(campaign.strokes), dtype=np.float64) * BLOCK
        last = np.asarray(first + BLOCK - 2 * step, dtype=np.float64)
        return Reference(whole[:, 0], whole[:, 1], whole[:, 2], first, last, first, last)
    at, clock = _before(campaign.strokes[0]), 0
    for stroke, pause in zip(campaign.strokes, campaign.pauses, strict=True):
        first = _before(stroke)
        if np.abs(first - at).max() > 1e-9:
            parts.append(_move(at, first, arm.speed, step))
            clock += len(parts[-1])
        still = _rest(first, float(pause), step)
        motion, inner = _stroke(stroke, first, campaign, arm)
        opens = clock + len(still)
        marks.append((opens, opens + inner[0], opens + inner[1], opens + len(motion)))
        clock = opens + len(motion)
        parts += [still, motion]
        at = first.copy()
        at[stroke.joint] = stroke.end
    parts.append(_rest(at, 0.3, step))
    whole = np.concatenate(parts)
    opens, begins, ends, closes = np.array(marks, dtype=float).T * step
    return Reference(whole[:, 0], whole[:, 1], whole[:, 2], begins, ends, opens, closes)


def _before(stroke: Stroke) -> Floats:
    out = np.array(stroke.hold)
    out[stroke.joint] = stroke.start
    return out


def _free(campaign: Campaign, arm: Arm) -> Floats:
    """(K, 3, J) of all joints at once: five waves of each, or moves from place to place with pauses."""
    rng, step = np.random.default_rng([arm.seed, 4]), campaign.step
    count = round(len(campaign.strokes) * BLOCK / step)
    middle, half = (arm.low + arm.high) / 2.0, 0.4 * (arm.high - arm.low)
    if campaign.is_smooth:
        w, size = 2 * np.pi * rng.uniform(0.05, 0.45, (5, arm.n)), rng.normal(size=(5, arm.n))
        angle = w * (np.arange(count) * step)[:, None, None]
        parts = [size * np.cos(angle), -size * w * np.sin(angle), -size * w**2 * np.cos(angle)]
        way = np.stack([part.sum(axis=1) for part in parts], axis=1)
        way *= np.minimum(half / np.abs(way[:, 0]).max(axis=0), arm.speed / np.abs(way[:, 1]).max(axis=0))
        way[:, 0] += middle
        return way
    at, moves = middle, [np.zeros((0, 3, arm.n))]
    while sum(map(len, moves)) < count:
        to = middle + half * rng.uniform(-1.0, 1.0, arm.n)
        moves += [_move(at, to, arm.speed, step), _rest(to, rng.uniform(0.1, 0.4), step)]
        at = to
    return np.concatenate(moves)[:count]


def _rest(position: Floats, seconds: float, step: float) -> Floats:
    """(K, 3, J)."""
    out = np.zeros((max(1, round(seconds / step)), 3, len(position)))
    out[:, 0] = position
    return out


def _move(start: Floats, end: Floats, speed: Floats, step: float) -> Floats:
    """(K, 3, J) all joints together, along the polynomial of least jerk, below the highest speeds (J,)."""
    seconds = float(np.max(1.9 * np.abs(end - start) / (0.9 * speed))) + 0.2
    count = max(2, round(seconds / step))
    u = (np.arange(count) + 0.5)[:, None] / count
    way, total = (end - start)[None], count * step
    place = start + way * (10 * u**3 - 15 * u**4 + 6 * u**5)
    rate = way * (30 * u**2 - 60 * u**3 + 30 * u**4) / total
    return np.stack([place, rate, way * (60 * u - 180 * u**2 + 120 * u**3) / total**2], axis=1)


def _stroke(stroke: Stroke, first: Floats, campaign: Campaign, arm: Arm) -> tuple[Floats, tuple[int, int]]:
    """(K, 3, J) of a trapezoid in speed, and the steps between which its speed is constant."""
    joint, way, step = stroke.joint, abs(stroke.end - stroke.start), campaign.step
    if campaign.design == STROKES:
        last = first.copy()
        last[joint] = stroke.end
        motion = _move(first, last, np.full(arm.n, stroke.speed / 0.9), step)
        return motion, (0, len(motion))
    ramp = max(0.05, campaign.ramp[joint] * stroke.speed / arm.speed[joint])
    total = way / stroke.speed + ramp  # each ramp covers half of what the constant speed would
    count = round(total / step)
    t = np.arange(count) * step
    u = np.clip(np.minimum(t, total - t) / ramp, 0.0, 1.0)
    side = np.where(t < total / 2, 1.0, -1.0) * (u < 1.0)
    if campaign.is_smooth:
        share, slope = 0.5 - 0.5 * np.cos(np.pi * u), 0.5 * np.pi * np.sin(np.pi * u)
    else:
        share, slope = u, np.ones(count)
    rate = stroke.sign * stroke.speed * share
    out = np.zeros((count, 3, arm.n))
    out[:, 0] = first
    travelled = np.cumsum(rate) * step
    out[:, 0, joint] = stroke.start + travelled * (stroke.end - stroke.start) / travelled[-1]
    out[:, 1, joint] = rate
    out[:, 2, joint] = stroke.sign * stroke.speed * slope * side / ramp
    inner = round(ramp / step)
    return out, (inner, count - inner)


#: s after a ramp in which the loop settles; what the oracle counts as a run starts there.
SETTLING = 0.1
#: Hz at which the torques of any motion are split by link parameters; between, they are interpolated.
SPARSE_HZ = 25.0


@dataclass(frozen=True, eq=False)
class Motion:
    """What an arm did, N rows at the campaign's rate, and what MuJoCo says it took."""

    position: Floats  # (N, J), true, like the next three
    velocity: Floats
    acceleration: Floats
    torque: Floats  # N m or N, by inverse dynamics, without any friction
    moving: NDArray[np.int64]  # (N,) index of the stroke that is under way, -1 between strokes
    run: NDArray[np.int64]  # (N,) the same where its speed is commanded constant and the loop has settled, else -1
    load: Floats  # (N, ...) gravity of the moving joint, like the next two; see `gravity.statics`
    across: Floats
    regressor: Floats  # of any motion (S, J, p) of the whole torque, at rows SPARSE_HZ times a second

    def __len__(self) -> int:
        return len(self.position)


def motion_of(
    kind: str, seed: int, design: str, *, rate: float = RATE, joints: int = 6
) -> tuple[Arm, Campaign, Motion]:
    """An arm, its campaign and its motion; simulated once and then read from the folder of kept motions."""
    arm = draw_arm(kind, seed, joints)
    campaign = draw_campaign(arm, design, rate)
    folder = Path(os.environ.get("BLIND_CACHE", Path(tempfile.gettempdir()) / "blind_motions"))
    path = folder / f"{kind}{joints}_{seed}_{design}_{rate:g}_{_version()}.npz"
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
    names = ("arms.py", "gravity.py", "motion.py")
    return hashlib.sha256(b"".join((here / name).read_bytes() for name in names)).hexdigest()[:10]


def _simulated(arm: Arm, campaign: Campaign) -> Motion:
    rng = np.random.default_rng([arm.seed, 3])
    told, rate = reference(campaign, arm), campaign.rate
    every = round(1.0 / (rate * campaign.step))
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
    loop.opt.timestep = campaign.step
    rows = told.position[::every]
    known = rng.uniform(0.9, 1.0) * inverse(model, rows, told.velocity[::every], told.acceleration[::every])
    known += 0.7 * dry * np.tanh(told.velocity[::every] / 0.02)
    steps, at = np.arange(len(told.position)), np.arange(len(known)) * every
    forward = np.column_stack([np.interp(steps, at, one) for one in known.T])
    command = told.position + (damping * told.velocity + forward) / stiffness
    states = _rolled(loop, command, told.position[0])
    n = arm.n
    position, velocity = states[::every, 1 : 1 + n], states[::every, 1 + n : 1 + 2 * n]
    before = np.vstack([velocity[:1], states[every - 1 :: every, 1 + n : 1 + 2 * n][: len(velocity) - 1]])
    after = np.vstack([states[1::every, 1 + n : 1 + 2 * n], velocity[-1:]])[: len(velocity)]
    acceleration = (after - before) / (2 * campaign.step)
    moving = _marks(len(position), told.opens, told.closes, rate)
    run = _marks(len(position), told.begins + SETTLING, told.ends - 2.0 / rate, rate)
    joints = np.array([stroke.joint for stroke in campaign.strokes])
    torque = inverse(model, position, velocity, acceleration)
    if campaign.design == FREE:
        none, sparse = np.zeros(len(position)), slice(None, None, sparseness(rate))
        columns = whole_torque(model_of(arm), position[sparse], velocity[sparse], acceleration[sparse])
        return Motion(position.copy(), velocity.copy(), acceleration, torque, moving, run, none, none, columns)
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


def sparseness(rate: float) -> int:
    """Rows of a log from one to the next at which any motion's link parameters' torques are computed."""
    return max(1, round(rate / SPARSE_HZ))


def _marks(count: int, begins: Floats, ends: Floats, rate: float) -> NDArray[np.int64]:
    """(N,) number of the span that each row lies in, -1 for none."""
    out = np.full(count, -1)
    for number, (begin, end) in enumerate(zip(begins, ends, strict=True)):
        out[int(np.ceil(begin * rate)) : int(np.floor(end * rate)) + 1] = number
    return out
