"""Hidden effects of friction and of what pushes with position: laws of our own, drawn by seed."""

import numpy as np
from numpy.typing import NDArray

from blind_world.hidden import Builder, Hidden, Unfit, drag, dry, load, plain, speeds, spread, turning
from blind_world.motion import RATE
from blind_world.world import World

Floats = NDArray[np.float64]


def stribeck(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """Friction that is higher at low speed."""
    known = speeds(world, joint)
    bend = float(np.exp(rng.uniform(np.log(0.4 * known[0]), np.log(known[min(1, len(known) - 1)]))))
    power = rng.uniform(0.6, 2.0)
    v = np.abs(world.motion.velocity[world.rows(joint), joint])
    column = drag(world, joint) * np.exp(-((v / bend) ** power))
    return plain("stribeck", joint, column, largest=1.2 * dry(world, joint), velocity=bend, exponent=power)


def viscous_power(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """Friction that grows with another power of speed than the first."""
    power = float(rng.uniform(0.3, 0.7) if rng.random() < 0.5 else rng.uniform(1.6, 2.6))
    v = np.abs(world.motion.velocity[world.rows(joint), joint]) / speeds(world, joint)[-1]
    return plain("viscous_power", joint, drag(world, joint) * v**power, largest=2.0 * dry(world, joint), exponent=power)


def load_friction(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """A gear that loses a share of the load, more where it lifts than where it lowers."""
    torque = load(world, joint)
    if np.abs(torque).max() < 0.02:
        raise Unfit("the joint carries no load")
    back = rng.uniform(0.3, 1.0)
    lifts = torque * world.sign[joint] * world.motion.velocity[world.rows(joint), joint] > 0
    column = drag(world, joint) * np.abs(torque) * np.where(lifts, 1.0, back)
    return plain("load_friction", joint, column, largest=0.4, unit="1", back=back)


def side_load_friction(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """Bearings that drag in proportion to the moment across the axis."""
    turning(world, joint)
    moment = world.motion.across[world.rows(joint)] * abs(world.arm.gain[joint])
    return plain("side_load_friction", joint, drag(world, joint) * moment, largest=0.2, unit="1")


def position_friction(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """An eccentric gear: friction with one, two or three waves a turn."""
    turning(world, joint)
    waves, phase = float(rng.integers(1, 4)), rng.uniform(0, 2 * np.pi)
    q = world.motion.position[world.rows(joint), joint]
    column = drag(world, joint) * np.cos(waves * q - phase)
    return plain("position_friction", joint, column, largest=0.8 * dry(world, joint), freedoms=2, harmonic=waves)


def presliding(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """Friction that builds up with the travel since the last reversal."""
    low, high = (0.004, 0.03) if world.arm.slides[joint] else (0.02, 0.15)
    length = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    travelled = since_reversal(world, joint)
    column = -drag(world, joint) * np.exp(-travelled / length)
    return plain("presliding", joint, column, largest=1.2 * dry(world, joint), travel=length)


def since_reversal(world: World, joint: int) -> Floats:
    """(M,) way (rad or m) since the joint last turned round, at the rows of its strokes."""
    v, q = world.motion.velocity[:, joint], world.motion.position[:, joint]
    way = np.sign(v) * (np.abs(v) > 2e-3)
    known = np.maximum.accumulate(np.where(way != 0, np.arange(len(way)), 0))
    turned = np.append(True, np.diff(way[known]) != 0)
    began = np.maximum.accumulate(np.where(turned, np.arange(len(way)), 0))
    return np.abs(q - q[began])[world.rows(joint)]


def clock(world: World, joint: int) -> tuple[Floats, float]:
    """(M,) s since the joint's first stroke, at the rows of its strokes, and the whole duration."""
    t = world.rows(joint) / RATE
    return t - t[0], float(t[-1] - t[0])


def warmup(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """Cold grease."""
    t, whole = clock(world, joint)
    lasting = whole * rng.uniform(0.1, 0.5)
    return plain(
        "warmup", joint, drag(world, joint) * np.exp(-t / lasting), largest=dry(world, joint), time_constant=lasting
    )


def thermal_friction(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """Friction that falls as the measured temperature rises."""
    warm = world.temperature[world.rows(joint), joint]
    return plain(
        "thermal_friction", joint, -drag(world, joint) * (warm - 25.0), largest=0.04 * dry(world, joint), unit="A/K"
    )


def friction_step(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """A seal that seats or a brake that rubs from an instant on."""
    t, whole = clock(world, joint)
    at, side = whole * rng.uniform(0.2, 0.8), rng.choice([-1.0, 1.0])
    return plain("friction_step", joint, side * drag(world, joint) * (t > at), largest=0.7 * dry(world, joint), time=at)


def spring(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """A cable or hose that pulls in proportion to position."""
    low, high = spread(world, joint)
    q = world.motion.position[world.rows(joint), joint] - rng.uniform(low, high)
    largest = (np.abs(load(world, joint)).max() + dry(world, joint)) / (high - low)
    return plain("spring", joint, rng.choice([-1.0, 1.0]) * q, largest=float(largest), unit="A/rad")


def counterbalance(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """A spring between two pins: its lever changes as the joint turns."""
    turning(world, joint)
    low, high = spread(world, joint)
    ratio, angle = rng.uniform(0.3, 0.8), rng.uniform(low - 0.5, high + 0.5)
    q = world.motion.position[world.rows(joint), joint] - angle
    column = np.sin(q) / np.sqrt(1.0 + ratio**2 - 2.0 * ratio * np.cos(q))
    largest = float(np.abs(load(world, joint)).max() + 1.5 * dry(world, joint))
    return plain("counterbalance", joint, column, largest=largest, length=ratio, angle=angle)


#: Hz; the fastest ripple that the log's rate still shows well.
FASTEST = 30.0


def ripple(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """Cogging at the motor's turn where the recipe tells the gear, else teeth at any frequency."""
    top = FASTEST * 2 * np.pi / speeds(world, joint)[-1]
    if world.arm.slides[joint]:
        waves = float(np.exp(rng.uniform(np.log(60.0), np.log(min(300.0, top)))))
    elif world.arm.is_geared:
        if world.arm.gear[joint] > top:
            raise Unfit("too fast for the log's rate")
        waves = float(world.arm.gear[joint])
    else:
        waves = float(np.exp(rng.uniform(np.log(10.0), np.log(min(90.0, top)))))
    q = world.motion.position[world.rows(joint), joint]
    column = np.cos(waves * q - rng.uniform(0, 2 * np.pi))
    return plain("ripple", joint, column, largest=0.5 * dry(world, joint), freedoms=2, frequency=waves)


FRICTION: dict[str, Builder] = {
    builder.__name__: builder
    for builder in (
        *(stribeck, viscous_power, load_friction, side_load_friction, position_friction, presliding, warmup),
        *(thermal_friction, friction_step, spring, counterbalance, ripple),
    )
}
