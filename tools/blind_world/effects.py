"""Hidden effects: laws of our own, drawn by seed; where weight changes, MuJoCo computes gravity anew."""

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from blind_world.arms import GRAVITY, model_of
from blind_world.gravity import holding, inverse
from blind_world.hidden import DRIVE, SENSOR, WEIGHT, Builder, Hidden, Strokes, Unfit, added
from blind_world.motion import FREE
from blind_world.world import State, World

Floats = NDArray[np.float64]

#: Every so many rows gravity is computed; between them it is interpolated.
SPARSE = 5
#: The fastest ripple that the log shows well, as a share of its rate.
FASTEST = 0.3


def stribeck(at: Strokes, rng: np.random.Generator) -> Hidden:
    """Friction that is higher at low speed."""
    slow, next_to_it = at.speeds[0], at.speeds[min(1, len(at.speeds) - 1)]
    bend = float(np.exp(rng.uniform(np.log(0.4 * slow), np.log(next_to_it))))
    power = rng.uniform(0.6, 2.0)
    column = at.drag * np.exp(-((np.abs(at.v) / bend) ** power))
    return at.effect("stribeck", column, 1.2 * at.dry, velocity=bend, exponent=power)


def viscous_power(at: Strokes, rng: np.random.Generator) -> Hidden:
    """Friction that grows with another power of speed than the first."""
    power = float(rng.uniform(0.3, 0.7) if rng.random() < 0.5 else rng.uniform(1.6, 2.6))
    column = at.drag * (np.abs(at.v) / at.speeds[-1]) ** power
    return at.effect("viscous_power", column, 2.0 * at.dry, exponent=power)


def load_friction(at: Strokes, rng: np.random.Generator) -> Hidden:
    """A gear that loses a share of the load, more where it lifts than where it lowers."""
    at.loaded()
    back = rng.uniform(0.3, 1.0)
    lifts = at.load * at.world.sign[at.joint] * at.v > 0
    column = at.drag * np.abs(at.load) * np.where(lifts, 1.0, back)
    return at.effect("load_friction", column, 0.4, unit="1", back=back)


def side_load_friction(at: Strokes, rng: np.random.Generator) -> Hidden:
    """Bearings that drag in proportion to the moment across the axis."""
    at.turning()
    moment = at.world.motion.across[at.rows] * abs(at.world.arm.gain[at.joint])
    return at.effect("side_load_friction", at.drag * moment, 0.2, unit="1")


def position_friction(at: Strokes, rng: np.random.Generator) -> Hidden:
    """An eccentric gear: friction with one, two or three waves a turn."""
    at.turning()
    waves, phase = float(rng.integers(1, 4)), rng.uniform(0, 2 * np.pi)
    column = at.drag * np.cos(waves * at.q - phase)
    return at.effect("position_friction", column, 0.8 * at.dry, freedoms=2, harmonic=waves)


def presliding(at: Strokes, rng: np.random.Generator) -> Hidden:
    """Friction that builds up with the travel since the last reversal."""
    low, high = (0.004, 0.03) if at.world.arm.slides[at.joint] else (0.02, 0.15)
    length = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    v, q = at.world.motion.velocity[:, at.joint], at.world.motion.position[:, at.joint]
    way = np.sign(v) * (np.abs(v) > 2e-3)
    moved = np.maximum.accumulate(np.where(way != 0, np.arange(len(way)), 0))
    turned = np.append(True, np.diff(way[moved]) != 0)
    began = np.maximum.accumulate(np.where(turned, np.arange(len(way)), 0))
    travelled = np.abs(q - q[began])[at.rows]
    return at.effect("presliding", -at.drag * np.exp(-travelled / length), 1.2 * at.dry, travel=length)


def warmup(at: Strokes, rng: np.random.Generator) -> Hidden:
    """Cold grease."""
    t, whole = at.clock
    lasting = whole * rng.uniform(0.1, 0.5)
    return at.effect("warmup", at.drag * np.exp(-t / lasting), at.dry, time_constant=lasting)


def thermal_friction(at: Strokes, rng: np.random.Generator) -> Hidden:
    """Friction that falls as the measured temperature rises."""
    warm = at.world.temperature[at.rows, at.joint]
    return at.effect("thermal_friction", -at.drag * (warm - 25.0), 0.04 * at.dry, unit="A/K")


def friction_step(at: Strokes, rng: np.random.Generator) -> Hidden:
    """A seal that seats or a brake that rubs from an instant on."""
    t, whole = at.clock
    instant, side = whole * rng.uniform(0.2, 0.8), rng.choice([-1.0, 1.0])
    return at.effect("friction_step", side * at.drag * (t > instant), 0.7 * at.dry, time=instant)


def spring(at: Strokes, rng: np.random.Generator) -> Hidden:
    """A cable or hose that pulls in proportion to position."""
    pull = at.q - rng.uniform(at.q.min(), at.q.max())
    largest = float((np.abs(at.load).max() + at.dry) / np.ptp(at.q))
    return at.effect("spring", rng.choice([-1.0, 1.0]) * pull, largest, unit="A/rad")


def counterbalance(at: Strokes, rng: np.random.Generator) -> Hidden:
    """A spring between two pins: its lever changes as the joint turns."""
    at.turning()
    ratio, angle = rng.uniform(0.3, 0.8), rng.uniform(at.q.min() - 0.5, at.q.max() + 0.5)
    q = at.q - angle
    column = np.sin(q) / np.sqrt(1.0 + ratio**2 - 2.0 * ratio * np.cos(q))
    largest = float(np.abs(at.load).max() + 1.5 * at.dry)
    return at.effect("counterbalance", column, largest, length=ratio, angle=angle)


def ripple(at: Strokes, rng: np.random.Generator) -> Hidden:
    """Cogging at the motor's turn where the recipe tells the gear, else teeth at any frequency."""
    arm, top = at.world.arm, fastest(at)
    if arm.is_geared and not arm.slides[at.joint]:
        waves = float(arm.gear[at.joint])
        if waves > top:
            raise Unfit("too fast for the log's rate")
    else:
        low, high = (60.0, 300.0) if arm.slides[at.joint] else (10.0, 90.0)
        waves = float(np.exp(rng.uniform(np.log(low), np.log(min(high, top)))))
    return line(at, rng, waves)


def fastest(at: Strokes) -> float:
    """Waves a turn (or per 2 pi m) that the log's rate still shows well at the joint's highest speed."""
    return float(FASTEST * at.world.campaign.rate * 2 * np.pi / at.speeds[-1])


def line(at: Strokes, rng: np.random.Generator, waves: float) -> Hidden:
    """A ripple of so many waves a turn (or per 2 pi m)."""
    column = np.cos(waves * at.q - rng.uniform(0, 2 * np.pi))
    return at.effect("ripple", column, 0.5 * at.dry, freedoms=2, frequency=waves)


def weight(world: World, model: mujoco.MjModel, shift: Floats | float = 0.0) -> Floats:
    """(K, J) N m or N that holds the arm still at every SPARSE-th row, its positions shifted."""
    return holding(model, world.motion.position[::SPARSE] + shift)


def dense(world: World, values: Floats) -> Floats:
    """(N, J) from (K, J) at every SPARSE-th row."""
    rows = np.arange(len(world.motion))
    return np.column_stack([np.interp(rows, rows[::SPARSE], column) for column in values.T])


def _of_weight(name: str, joint: int | None, torque: Callable[[float], Floats], **given: float) -> Hidden:
    """An effect on gravity: `torque` gives (K, J) N m of change at an amplitude; the last is kept."""
    last: dict[float, Floats] = {}

    def change(world: World, state: State, amplitude: float) -> State:
        if amplitude not in last:
            last.clear()
            last[amplitude] = dense(world, torque(amplitude) * world.arm.gain)
        return replace(state, current=state.current + last[amplitude])

    largest, freedoms = given.pop("largest"), int(given.pop("freedoms"))
    unit = {"payload": "kg", "flexibility": "rad/(N m)"}.get(name, "rad")
    return Hidden(name, joint, WEIGHT, change, largest, unit, freedoms, tuple(range(6)), given)


def tilt(at: Strokes, rng: np.random.Generator) -> Hidden:
    """The base stands askew."""
    world = at.world
    way, still = rng.uniform(0, 2 * np.pi), weight(world, world.model)

    def torque(angle: float) -> Floats:
        model = model_of(world.arm)
        leaning = [np.sin(angle) * np.cos(way), np.sin(angle) * np.sin(way), -np.cos(angle)]
        model.opt.gravity[:] = GRAVITY * np.array(leaning)
        return weight(world, model) - still

    return _of_weight("tilt", None, torque, largest=0.09, freedoms=2, way=way)


def zero_offset(at: Strokes, rng: np.random.Generator) -> Hidden:
    """A joint stands elsewhere than its encoder says."""
    at.turning()
    world, unit = at.world, np.eye(at.world.arm.n)[at.joint]
    still, side = weight(world, world.model), rng.choice([-1.0, 1.0])

    def torque(angle: float) -> Floats:
        return weight(world, world.model, side * angle * unit) - still

    return _of_weight("zero_offset", at.joint, torque, largest=0.12, freedoms=1, side=side)


def payload(at: Strokes, rng: np.random.Generator) -> Hidden:
    """The gripper takes something up."""
    world = at.world
    place = np.array([rng.uniform(-0.05, 0.05), rng.uniform(-0.05, 0.05), rng.uniform(0.05, 0.2)])
    instant = world.time[-1] * rng.uniform(0.25, 0.75)
    still = weight(world, world.model)
    after = (world.time[::SPARSE] > instant)[:, None]

    def torque(mass: float) -> Floats:
        model = model_of(world.arm)
        old, last = model.body_mass[-1], model.body_ipos[-1].copy()
        model.body_ipos[-1] = (old * last + mass * place) / (old + mass)
        model.body_mass[-1] = old + mass
        return (weight(world, model) - still) * after

    return _of_weight("payload", None, torque, largest=4.0, freedoms=4, time=instant)


def flexibility(at: Strokes, rng: np.random.Generator) -> Hidden:
    """A soft drive: the link sags by its load times a compliance."""
    at.turning()
    world, unit = at.world, np.eye(at.world.arm.n)[at.joint]
    still = weight(world, world.model)
    most = float(np.abs(still[:, at.joint]).max())
    if most < 0.05:
        raise Unfit("the joint carries no load")

    def torque(compliance: float) -> Floats:
        return weight(world, world.model, -compliance * still[:, [at.joint]] * unit) - still

    return _of_weight("flexibility", at.joint, torque, largest=0.06 / most, freedoms=1)


def backlash(at: Strokes, rng: np.random.Generator) -> Hidden:
    """Play of the gear: the link rests on the side to which its load pushes it."""
    at.turning()
    world, unit = at.world, np.eye(at.world.arm.n)[at.joint]
    still = weight(world, world.model)
    if np.abs(still[:, at.joint]).max() < 0.05:
        raise Unfit("the joint carries no load")

    def torque(play: float) -> Floats:
        return weight(world, world.model, -0.5 * play * np.sign(still[:, [at.joint]]) * unit) - still

    return _of_weight("backlash", at.joint, torque, largest=0.0175, freedoms=1)


def coupling(at: Strokes, rng: np.random.Generator) -> Hidden:
    """Wrist gears in each other: motor `on` also carries a share of the joint's load."""
    world, pairs = at.world, {5: 4, 4: 3} if rng.random() < 0.7 else {5: 3}
    if at.joint not in pairs or world.arm.slides[pairs[at.joint]]:
        raise Unfit("its drive does not pass through another joint")
    on, side = pairs[at.joint], rng.choice([-1.0, 1.0])
    carried = dense(world, weight(world, world.model))[world.rows(on), at.joint] * world.arm.gain[on]
    if world.campaign.design == FREE:  # friction and inertia too
        carried = world.base.current[world.rows(on), at.joint] * world.arm.gain[on] / world.arm.gain[at.joint]

    def change(world: World, state: State, amplitude: float) -> State:
        return added(world, state, on, side * amplitude * carried)

    return Hidden("coupling", at.joint, WEIGHT, change, 1.0, "1", 1, (on,), {"on": on + 1})


def torque_constant_drift(at: Strokes, rng: np.random.Generator) -> Hidden:
    """Magnets that warm: more current for the same torque."""
    t, whole = at.clock
    lasting = float(whole * rng.uniform(0.1, 0.5))
    share = 1.0 - np.exp(-t / lasting)

    def change(world: World, state: State, amplitude: float) -> State:
        return added(world, state, at.joint, amplitude * share * state.current[at.rows, at.joint])

    shape = {"time_constant": lasting}
    return Hidden("torque_constant_drift", at.joint, DRIVE, change, 0.3, "1", 1, (at.joint,), shape)


def strongest(at: Strokes) -> float:
    """A: the joint's largest current in a fitted run."""
    world, run = at.world, at.world.motion.run
    fitted = (run >= 0) & (world.joint_of[run] == at.joint) & ~world.heldout[run]
    return float(np.abs(world.base.current[fitted, at.joint]).max())


def torque_droop(at: Strokes, rng: np.random.Generator) -> Hidden:
    """Iron that saturates: a motor that gives less per ampere at high current."""
    most = strongest(at)

    def change(world: World, state: State, amplitude: float) -> State:
        drawn = state.current[at.rows, at.joint]
        return added(world, state, at.joint, amplitude * drawn * np.minimum(np.abs(drawn) / most, 2.0) ** 2)

    return Hidden("torque_droop", at.joint, DRIVE, change, 0.4, "1", 1, (at.joint,))


def _of_sensor(
    name: str, at: Strokes, read: Callable[[Floats, float], Floats], largest: float, unit: str = "1", **shape: float
) -> Hidden:
    """What a sensor makes of the joint's current (N,) at an amplitude."""

    def change(world: World, state: State, amplitude: float) -> State:
        current = state.current.copy()
        current[:, at.joint] = read(current[:, at.joint], amplitude)
        return replace(state, current=current)

    return Hidden(name, at.joint, SENSOR, change, largest, unit, 1, (at.joint,), shape)


def saturation(at: Strokes, rng: np.random.Generator) -> Hidden:
    """A sensor that ends before the current does: clipped at (1 - amplitude) of the largest current in a run."""
    most = strongest(at)

    def read(current: Floats, amplitude: float) -> Floats:
        return np.clip(current, -most * (1.0 - amplitude), most * (1.0 - amplitude))

    return _of_sensor("saturation", at, read, 0.4, most=most)


def delay(at: Strokes, rng: np.random.Generator) -> Hidden:
    """A drive whose current is stamped late, or early."""
    at.turning()
    at.loaded()
    side, rows = rng.choice([-1.0, 1.0]), np.arange(len(at.world.motion), dtype=float)

    def read(current: Floats, amplitude: float) -> Floats:
        return np.interp(rows - side * amplitude * at.world.campaign.rate, rows, current)

    return _of_sensor("delay", at, read, 0.06, "s", side=side)


def inertia(at: Strokes, rng: np.random.Generator) -> Hidden:
    """A loop that does not hold its speed: waves of 2 to 6 Hz, of the amplitude's share of the speed, in every stroke.

    The current gains what the joint's inertia by MuJoCo takes, and the log shows the waves in position.
    """
    world, rows = at.world, at.rows
    stroke = world.motion.moving[rows]
    speed = world.speed_of[stroke]
    rate = 2 * np.pi * rng.uniform(2.0, 6.0, len(world.speed_of))[stroke]
    phase = rng.uniform(0, 2 * np.pi, len(world.speed_of))[stroke]
    inside = np.clip(np.abs(at.v / speed), 0.0, 1.0) ** 4
    wave = inside * speed * np.sin(rate * at.world.time[rows] + phase)
    q = world.motion.position[rows][::SPARSE]
    still = np.zeros_like(q)
    pushed = still + np.eye(world.arm.n)[at.joint]
    heavy = (inverse(world.model, q, still, pushed) - inverse(world.model, q, still, still))[:, at.joint]
    mass = np.interp(np.arange(len(rows)), np.arange(len(rows))[::SPARSE], heavy)

    def change(world: World, state: State, amplitude: float) -> State:
        position = state.position.copy()
        position[rows, at.joint] += amplitude * wave / rate
        torque = -amplitude * wave * rate * mass
        return added(world, replace(state, position=position), at.joint, torque * world.arm.gain[at.joint])

    return Hidden("inertia", at.joint, WEIGHT, change, 0.025, "1", 1, (at.joint,))


def local_bump(at: Strokes, rng: np.random.Generator) -> Hidden:
    """A patch of the gear that rubs."""
    low, high = at.q.min(), at.q.max()
    wide = (high - low) * rng.uniform(0.03, 0.08)
    place = rng.uniform(low + 3 * wide, high - 3 * wide)
    column = at.drag * np.exp(-0.5 * ((at.q - place) / wide) ** 2)
    return at.effect("local_bump", column, 1.2 * at.dry, at=place, width=wide)


def snag(at: Strokes, rng: np.random.Generator) -> Hidden:
    """A hose that is taut beyond a position: a pull that begins there."""
    side, reach = rng.choice([-1.0, 1.0]), float(np.ptp(at.q))
    place = float(rng.uniform(at.q.min() + 0.3 * reach, at.q.max() - 0.3 * reach))
    column = side * np.maximum(side * (at.q - place), 0.0) / (0.3 * reach)
    return at.effect("snag", column, at.dry, at=place, side=side)


def viscous_of_position(at: Strokes, rng: np.random.Generator) -> Hidden:
    """Grease that is thicker at some positions: viscous friction in one or two waves a turn."""
    at.turning()
    waves, phase = float(rng.integers(1, 3)), rng.uniform(0, 2 * np.pi)
    column = at.v / at.speeds[-1] * at.world.sign[at.joint] * np.cos(waves * at.q - phase)
    return at.effect("viscous_of_position", column, 1.2 * at.dry, waves=waves)


def load_hysteresis(at: Strokes, rng: np.random.Generator) -> Hidden:
    """A gear that keeps a share of the load while it rises and gives it back while it falls."""
    if np.ptp(at.load) < 0.05:
        raise Unfit("the joint's load does not change")
    column = np.abs(at.load) * np.tanh(np.gradient(at.load) / 1e-5)
    return at.effect("load_hysteresis", column, 0.3, unit="1")


def dead_zone(at: Strokes, rng: np.random.Generator) -> Hidden:
    """Play of the gear: where the load turns its sign, the teeth part and the gear's friction is gone."""
    most = np.abs(at.load).max()
    if most < 0.02 or min(at.load.max(), -at.load.min()) < 0.2 * most:
        raise Unfit("the joint's load does not change its sign")
    wide = rng.uniform(0.12, 0.3) * float(most)
    column = -at.drag * np.maximum(0.0, 1.0 - np.abs(at.load) / wide)
    return at.effect("dead_zone", column, at.dry, width=wide)


def square_cogging(at: Strokes, rng: np.random.Generator) -> Hidden:
    """Cogging in square waves (odd harmonics) whose phase slips with the posture."""
    waves, strokes = rng.uniform(3.0, 8.0) * 2 * np.pi / np.ptp(at.q), at.world.campaign.strokes
    phases = {hold: rng.uniform(0, 2 * np.pi) for hold in dict.fromkeys(stroke.hold for stroke in strokes)}
    phase = np.array([phases[stroke.hold] for stroke in strokes])[at.world.motion.moving[at.rows]]
    column = np.tanh(8.0 * np.cos(waves * at.q + phase))
    return at.effect("square_cogging", column, 0.5 * at.dry, frequency=float(waves))


def neighbour_friction(at: Strokes, rng: np.random.Generator) -> Hidden:
    """A hose that rubs as another joint is bent: friction by the position of a joint that is held."""
    arm = at.world.arm
    other = int(rng.choice([k for k in range(arm.n) if k != at.joint and not arm.slides[k]]))
    column = at.drag * np.cos(at.world.motion.position[at.rows, other] - rng.uniform(0, 2 * np.pi))
    return at.effect("neighbour_friction", column, 0.8 * at.dry, other=other + 1)


def crooked_sensor(at: Strokes, rng: np.random.Generator) -> Hidden:
    """A current sensor whose gain differs between the signs, with a knee."""
    side = rng.choice([-1.0, 1.0])

    def read(current: Floats, amplitude: float) -> Floats:
        return np.asarray(current + side * amplitude * np.abs(current))

    return _of_sensor("crooked_sensor", at, read, 0.3, side=side)


def wandering_sensor(at: Strokes, rng: np.random.Generator) -> Hidden:
    """A current sensor whose zero swings over the day."""
    t, whole = at.clock
    slow = 2 * np.pi / (whole * rng.uniform(0.35, 0.9))
    column = np.sin(slow * t + rng.uniform(0, 2 * np.pi))
    return at.effect("wandering_sensor", column, 0.3 * at.dry, period=2 * np.pi / slow)


def _by_name(*builders: Builder) -> dict[str, Builder]:
    return {builder.__name__: builder for builder in builders}


CATALOGUE = _by_name(
    *(stribeck, viscous_power, load_friction, side_load_friction, position_friction, presliding, warmup),
    *(thermal_friction, friction_step, spring, counterbalance, ripple),
    *(tilt, zero_offset, payload, flexibility, backlash, coupling, torque_constant_drift, torque_droop, saturation),
    *(delay, inertia),
)
#: Physics that no catalogue has: what a diagnosis must call unexplained, or explain to the noise.
OUTSIDE = _by_name(
    *(local_bump, viscous_of_position, load_hysteresis, dead_zone, square_cogging, neighbour_friction),
    *(crooked_sensor, wandering_sensor),
)
