"""One experiment's physics: the arm's motion, its motors' friction and noise, and what a log would hold."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray
from scipy.signal import lfilter

from blind_world.arms import GRAVITY, Arm, model_of
from blind_world.motion import Campaign, Motion

Floats = NDArray[np.float64]

#: rad/s or m/s below which friction turns over smoothly.
TURNOVER = 0.004
#: Log of what is held out where no plan says it.
LATER = "logs/later.parquet"


@dataclass(frozen=True, eq=False)
class Friction:
    """(J,) Coulomb (A) and viscous (A s/rad or A s/m) friction of both directions, all positive."""

    plus: Floats
    minus: Floats
    viscous_plus: Floats
    viscous_minus: Floats


@dataclass(frozen=True, eq=False)
class Noise:
    """What sensors add; (J,) by joint."""

    sigma: Floats  # A, of a sample
    memory: Floats  # correlation of one sample with the next (AR(1))
    level: Floats  # A, spread of what a whole stroke shares
    louder: Floats  # share by which all of it grows up to the joint's highest speed
    step: float  # A, of the current's quantisation
    tick: Floats  # rad or m, of the encoder
    drift: float = 0.0  # spread of a random walk over the whole log, as a share of sigma
    spikes: float = 0.0  # share of the samples that are off by 5 to 15 sigma


@dataclass(frozen=True, eq=False)
class State:
    """What sensors see before they add noise: N rows of J joints."""

    current: Floats
    position: Floats


@dataclass(frozen=True, eq=False)
class World:
    """Motion and all that was drawn for one experiment. Joints count from 0 here."""

    arm: Arm
    campaign: Campaign
    motion: Motion
    friction: Friction
    noise: Noise
    temperature: Floats
    has_temperature: bool
    has_velocity: bool

    @cached_property
    def joint_of(self) -> NDArray[np.int64]:
        """(R,) moving joint of every stroke."""
        return np.array([stroke.joint for stroke in self.campaign.strokes])

    @cached_property
    def speed_of(self) -> Floats:
        """(R,) signed commanded speed of every stroke."""
        return np.array([stroke.speed * stroke.sign for stroke in self.campaign.strokes])

    @cached_property
    def heldout(self) -> NDArray[np.bool_]:
        """(R,) which strokes are for judging only."""
        return np.array([stroke.is_heldout for stroke in self.campaign.strokes])

    @cached_property
    def sign(self) -> Floats:
        """(J,) of the motors' wiring."""
        return np.sign(self.arm.gain)

    @cached_property
    def model(self) -> mujoco.MjModel:
        """The arm in MuJoCo, without friction."""
        return model_of(self.arm)

    def rows(self, joint: int) -> NDArray[np.int64]:
        """(M,) rows in which a stroke of `joint` is under way, or any motion."""
        moving = self.motion.moving
        return np.flatnonzero((moving >= 0) & np.isin(self.joint_of[moving], (joint, -1)))

    def load(self, joint: int) -> Floats:
        """(M,) A at these rows: what the gear passes on, which is gravity's current where speed is constant."""
        motion, rows = self.motion, self.rows(joint)
        rotor = self.arm.armature[joint] * motion.acceleration[rows, joint]
        passed = motion.load[rows] if self.campaign.is_steady else motion.torque[rows, joint] - rotor
        return np.asarray(passed * self.arm.gain[joint])

    @cached_property
    def time(self) -> Floats:
        """(N,) s."""
        return np.arange(len(self.motion)) / self.campaign.rate

    @cached_property
    def late(self) -> float:
        """S from which what is logged is held out as a log of its own; infinite where the plan says what is."""
        first = int(np.argmax(self.motion.moving >= int(np.argmax(self.heldout))))
        return np.inf if self.campaign.is_steady else float(self.time[first])

    @cached_property
    def base(self) -> State:
        """Without any hidden effect: inverse dynamics, Coulomb and viscous friction."""
        v, f = self.motion.velocity, self.friction
        way = np.tanh(v / TURNOVER)
        drag = np.where(v > 0, f.plus, f.minus) * way + np.where(v > 0, f.viscous_plus, f.viscous_minus) * v
        return State(self.motion.torque * self.arm.gain + self.sign * drag, self.motion.position)

    @cached_property
    def resting(self) -> State:
        """The base, at constant speed without what acceleration draws in the joint that moves."""
        if not self.campaign.is_steady:
            return self.base
        on = np.flatnonzero(self.motion.moving >= 0)
        moving = self.joint_of[self.motion.moving[on]]
        current = self.base.current.copy()
        current[on, moving] -= (self.motion.torque[on, moving] - self.motion.load[on]) * self.arm.gain[moving]
        return replace(self.base, current=current)


def draw_world(arm: Arm, campaign: Campaign, motion: Motion, *, rng: np.random.Generator) -> World:
    """Friction, noise, temperature and the log's columns of one experiment."""
    n = arm.n
    rate, coulomb = campaign.rate, arm.coulomb * rng.uniform(0.7, 1.3, n)
    lean = rng.uniform(-0.25, 0.25, n)
    viscous = coulomb * rng.uniform(0.1, 0.5, n) / arm.speed
    tilt = rng.uniform(-0.25, 0.25, n)
    friction = Friction(coulomb * (1 + lean), coulomb * (1 - lean), viscous * (1 + tilt), viscous * (1 - tilt))
    sigma = arm.coulomb * np.exp(rng.uniform(np.log(0.02), np.log(0.06), n))
    noise = Noise(
        sigma=sigma,
        memory=np.exp(-1.0 / (rate * rng.uniform(0.012, 0.08, n))),
        level=sigma * rng.uniform(0.1, 0.45, n),
        louder=np.full(n, rng.uniform(0.3, 1.2) if rng.random() < 1 / 3 else 0.0),
        step=float(sigma.min() * rng.uniform(0.2, 0.8)),
        tick=np.where(arm.slides, 1e-5, 2 * np.pi / 2.0 ** rng.integers(16, 20)),
    )
    warm, is_thermal = _temperature(motion, arm, rng, rate=rate), bool(rng.random() < 0.4)
    return World(arm, campaign, motion, friction, noise, warm, is_thermal, bool(rng.random() < 0.7))


def _temperature(motion: Motion, arm: Arm, rng: np.random.Generator, *, rate: float) -> Floats:
    """(N, J) degC: each motor warms while it moves and cools in between, in a room that drifts."""
    memory = np.exp(-1.0 / (rate * rng.uniform(150.0, 600.0, arm.n)))
    heat = np.abs(motion.velocity) / arm.speed * rng.uniform(60.0, 140.0, arm.n)
    out = np.empty_like(heat)
    for joint, keep in enumerate(memory):
        out[:, joint] = lfilter([1.0 - keep], [1.0, -keep], heat[:, joint])
    room = rng.uniform(18.0, 26.0) + rng.uniform(-2.0, 2.0) * np.linspace(0.0, 1.0, len(motion)) ** 2
    return out + room[:, None] + rng.uniform(0.0, 6.0, arm.n)


def loudness(world: World) -> Floats:
    """(R,) factor by which noise of the moving joint is louder in each stroke."""
    share = np.abs(world.speed_of) / world.arm.speed[world.joint_of]
    return 1.0 + world.noise.louder[world.joint_of] * share


def noises(world: World, rng: np.random.Generator) -> Floats:
    """(N, J) A: correlated noise, and in the moving joint the level of each stroke."""
    noise, moving = world.noise, world.motion.moving
    size = (len(world.motion), world.arm.n)
    white = rng.standard_normal(size)
    out = np.empty(size)
    for joint, keep in enumerate(noise.memory):
        first = keep * rng.standard_normal(1)
        out[:, joint] = lfilter([np.sqrt(1 - keep**2)], [1.0, -keep], white[:, joint], zi=first)[0]
    out *= noise.sigma
    on = np.flatnonzero((moving >= 0) & (world.joint_of[moving] >= 0))
    own, loud = world.joint_of[moving[on]], loudness(world)
    levels = rng.standard_normal(len(loud)) * noise.level[world.joint_of]
    out[on, own] = loud[moving[on]] * (out[on, own] + levels[moving[on]])
    if noise.drift:
        walk = np.cumsum(rng.standard_normal(size), axis=0)
        out += noise.drift * noise.sigma * (walk - walk.mean(axis=0)) / walk.std(axis=0)
    if noise.spikes:
        out += (rng.random(size) < noise.spikes) * noise.sigma * rng.uniform(5.0, 15.0, size) * np.sign(white)
    return out


def sensed(world: World, state: State, noise: Floats) -> State:
    """What the log holds: noise added, current and position in whole steps."""
    current = np.round((state.current + noise) / world.noise.step) * world.noise.step
    return replace(state, current=current, position=np.round(state.position / world.noise.tick) * world.noise.tick)


def write_experiment(folder: Path, world: World, sensed: State) -> None:
    """Write the folder as a user has it: recipe.yaml and plan.yaml as plain text, the log as Parquet.

    Without runs at constant speed there is no plan, and the last part of the log is a file of its own, `LATER`.
    """
    (folder / "logs").mkdir(parents=True, exist_ok=True)
    (folder / "recipe.yaml").write_text(recipe(world.arm), encoding="utf-8")
    rows, is_late = table(world, sensed), world.time >= world.late
    pq.write_table(rows.filter(~is_late), folder / "logs" / "campaign.parquet", compression="snappy")
    if world.campaign.is_steady:
        (folder / "plan.yaml").write_text(plan(world.arm, world.campaign), encoding="utf-8")
    else:
        pq.write_table(rows.filter(is_late), folder / LATER, compression="snappy")


def table(world: World, sensed: State) -> pa.Table:
    """The log's columns: t, q, qd (some arms), i, temp (some arms)."""
    columns = {"t": np.round(world.time, 6)}
    groups = {"q": sensed.position, "i": sensed.current}
    if world.has_velocity:
        groups["qd"] = np.round(world.motion.velocity, 4)
    if world.has_temperature:
        groups["temp"] = np.round(world.temperature * 4.0) / 4.0
    for name, values in groups.items():
        columns |= {f"{name}{k + 1}": np.ascontiguousarray(values[:, k]) for k in range(world.arm.n)}
    return pa.table(columns)


def recipe(arm: Arm) -> str:
    """The recipe's text: geometry and gravity, and the gear ratios of some arms."""
    lines = [f"name: {arm.name}", f"gravity: [0.0, 0.0, {-GRAVITY}]", "joints:"]
    for k in range(arm.n):
        kind = "prismatic" if arm.slides[k] else "revolute"
        gear = f", gear_ratio: {arm.gear[k]:g}" if arm.is_geared and not arm.slides[k] else ""
        lines.append(
            f"  - {{name: axis{k + 1}, type: {kind}, theta: {arm.theta[k]:.12g}, alpha: {arm.alpha[k]:.12g}, "
            f"a: {arm.a[k]:.9g}, d: {arm.d[k]:.9g}, limits: [{arm.low[k]:g}, {arm.high[k]:g}], "
            f"max_velocity: {arm.speed[k] * 1.05:.4f}{gear}}}"
        )
    return "\n".join(lines) + "\n"


def plan(arm: Arm, campaign: Campaign) -> str:
    """The plan's text: a row a stroke, in the order of execution."""
    lines = ["kind: plan", "format: 1", f"robot: {arm.name}", "units: {angle: rad}", "runs:"]
    for stroke in campaign.strokes:
        hold = ", ".join(f"{value:g}" for value in stroke.hold)
        purpose = "heldout" if stroke.is_heldout else "fit"
        lines.append(
            f"  - {{joint: {stroke.joint + 1}, hold: [{hold}], from: {stroke.start:g}, to: {stroke.end:g}, "
            f"velocity: {stroke.speed:g}, purpose: {purpose}}}"
        )
    return "\n".join(lines) + "\n"
