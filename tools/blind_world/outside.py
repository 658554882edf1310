"""Hidden physics that no catalogue has: what a diagnosis must call unexplained, or explain to the noise."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from blind_world.friction_effects import clock
from blind_world.hidden import SENSOR, Builder, Hidden, Unfit, drag, dry, load, plain, speeds, spread, turning
from blind_world.world import State, World

Floats = NDArray[np.float64]


def local_bump(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """A patch of the gear that rubs."""
    low, high = spread(world, joint)
    wide = (high - low) * rng.uniform(0.03, 0.08)
    at = rng.uniform(low + 3 * wide, high - 3 * wide)
    q = world.motion.position[world.rows(joint), joint]
    column = drag(world, joint) * np.exp(-0.5 * ((q - at) / wide) ** 2)
    return plain("local_bump", joint, column, largest=1.2 * dry(world, joint), at=at, width=wide)


def viscous_of_position(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """Grease that is thicker at some positions: viscous friction in one or two waves a turn."""
    turning(world, joint)
    waves, phase = float(rng.integers(1, 3)), rng.uniform(0, 2 * np.pi)
    rows = world.rows(joint)
    q, v = world.motion.position[rows, joint], world.motion.velocity[rows, joint] / speeds(world, joint)[-1]
    column = v * world.sign[joint] * np.cos(waves * q - phase)
    return plain("viscous_of_position", joint, column, largest=1.2 * dry(world, joint), waves=waves)


def load_hysteresis(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """A gear that keeps a share of the load while it rises and gives it back while it falls."""
    torque = load(world, joint)
    if np.ptp(torque) < 0.05:
        raise Unfit("the joint's load does not change")
    rate = np.gradient(torque)
    return plain("load_hysteresis", joint, np.abs(torque) * np.tanh(rate / 1e-5), largest=0.3, unit="1")


def dead_zone(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """Play of the gear: where the load turns its sign, the teeth part and the gear's friction is gone."""
    torque = load(world, joint)
    if np.abs(torque).max() < 0.02 or min(torque.max(), -torque.min()) < 0.2 * np.abs(torque).max():
        raise Unfit("the joint's load does not change its sign")
    wide = rng.uniform(0.12, 0.3) * float(np.abs(torque).max())
    column = -drag(world, joint) * np.maximum(0.0, 1.0 - np.abs(torque) / wide)
    return plain("dead_zone", joint, column, largest=1.0 * dry(world, joint), width=wide)


def square_cogging(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """Cogging in square waves (odd harmonics) whose phase slips with the posture."""
    rows = world.rows(joint)
    low, high = spread(world, joint)
    waves = rng.uniform(3.0, 8.0) * 2 * np.pi / (high - low)
    stroke = world.motion.moving[rows]
    holds = {hold: rng.uniform(0, 2 * np.pi) for hold in dict.fromkeys(one.hold for one in world.campaign.strokes)}
    phase = np.array([holds[one.hold] for one in world.campaign.strokes])[stroke]
    column = np.tanh(8.0 * np.cos(waves * world.motion.position[rows, joint] + phase))
    return plain("square_cogging", joint, column, largest=0.5 * dry(world, joint), frequency=float(waves))


def neighbour_friction(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """A hose that rubs as another joint is bent: friction by the position of a joint that is held."""
    other = int(rng.choice([k for k in range(world.arm.n) if k != joint and not world.arm.slides[k]]))
    rows, phase = world.rows(joint), rng.uniform(0, 2 * np.pi)
    column = drag(world, joint) * np.cos(world.motion.position[rows, other] - phase)
    return plain("neighbour_friction", joint, column, largest=0.8 * dry(world, joint), other=other + 1)


def crooked_sensor(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """A current sensor whose gain differs between the signs, with a knee."""
    side = rng.choice([-1.0, 1.0])

    def change(world: World, state: State, amplitude: float) -> State:
        current = state.current.copy()
        current[:, joint] += side * amplitude * np.abs(current[:, joint])
        return replace(state, current=current)

    return Hidden("crooked_sensor", joint, SENSOR, change, 0.3, "1", 1, (joint,), {"side": side})


def wandering_sensor(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """A current sensor whose zero swings over the day."""
    t, whole = clock(world, joint)
    slow = 2 * np.pi / (whole * rng.uniform(0.35, 0.9))
    column = np.sin(slow * t + rng.uniform(0, 2 * np.pi))
    return plain("wandering_sensor", joint, column, largest=0.3 * dry(world, joint), period=2 * np.pi / slow)


OUTSIDE: dict[str, Builder] = {
    builder.__name__: builder
    for builder in (
        *(local_bump, viscous_of_position, load_hysteresis, dead_zone, square_cogging, neighbour_friction),
        *(crooked_sensor, wandering_sensor),
    )
}
