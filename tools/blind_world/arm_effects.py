"""Hidden effects of weight, drive, sensor and motion: MuJoCo computes gravity anew under the changed condition."""

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from blind_world.arms import GRAVITY, compiled, mjcf
from blind_world.friction_effects import clock
from blind_world.gravity import holding, inverse
from blind_world.hidden import DRIVE, SENSOR, WEIGHT, Builder, Hidden, Unfit, added, load, turning
from blind_world.motion import RATE
from blind_world.world import State, World

Floats = NDArray[np.float64]

#: Every so many rows gravity is computed; between them it is interpolated.
SPARSE = 5


def weight(world: World, model: mujoco.MjModel, shift: Floats | float = 0.0) -> Floats:
    """(K, J) N m or N that holds the arm still at every SPARSE-th row, its positions shifted."""
    return holding(model, world.motion.position[::SPARSE] + shift)


def dense(world: World, values: Floats) -> Floats:
    """(N, J) from (K, J) at every SPARSE-th row."""
    rows = np.arange(len(world.motion))
    return np.column_stack([np.interp(rows, rows[::SPARSE], one) for one in values.T])


def _of_weight(name: str, joint: int | None, torque: Callable[[float], Floats], **told: float) -> Hidden:
    """An effect on gravity: `torque` gives (K, J) N m of change at an amplitude; last one kept."""
    kept: dict[float, Floats] = {}

    def change(world: World, state: State, amplitude: float) -> State:
        if amplitude not in kept:
            kept.clear()
            kept[amplitude] = dense(world, torque(amplitude) * world.arm.gain)
        return replace(state, current=state.current + kept[amplitude])

    largest, freedoms = told.pop("largest"), int(told.pop("freedoms"))
    unit = "kg" if name == "payload" else "rad/(N m)" if name == "flexibility" else "rad"
    return Hidden(name, joint, WEIGHT, change, largest, unit, freedoms, tuple(range(6)), told)


def tilt(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """The base stands askew."""
    way, still = rng.uniform(0, 2 * np.pi), weight(world, world.model)

    def torque(angle: float) -> Floats:
        model = compiled(mjcf(world.arm))
        leaning = [np.sin(angle) * np.cos(way), np.sin(angle) * np.sin(way), -np.cos(angle)]
        model.opt.gravity[:] = GRAVITY * np.array(leaning)
        return weight(world, model) - still

    return _of_weight("tilt", None, torque, largest=0.09, freedoms=2, way=way)


def zero_offset(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """A joint stands elsewhere than its encoder says."""
    turning(world, joint)
    still, side = weight(world, world.model), rng.choice([-1.0, 1.0])
    unit = np.eye(world.arm.n)[joint]

    def torque(angle: float) -> Floats:
        return weight(world, world.model, side * angle * unit) - still

    return _of_weight("zero_offset", joint, torque, largest=0.12, freedoms=1, side=side)


def payload(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """The gripper takes something up."""
    place = np.array([rng.uniform(-0.05, 0.05), rng.uniform(-0.05, 0.05), rng.uniform(0.05, 0.2)])
    at = len(world.motion) / RATE * rng.uniform(0.25, 0.75)
    still = weight(world, world.model)
    after = (np.arange(len(world.motion))[::SPARSE] / RATE > at)[:, None]

    def torque(mass: float) -> Floats:
        model = compiled(mjcf(world.arm))
        old, last = model.body_mass[-1], model.body_ipos[-1].copy()
        model.body_ipos[-1] = (old * last + mass * place) / (old + mass)
        model.body_mass[-1] = old + mass
        return (weight(world, model) - still) * after

    return _of_weight("payload", None, torque, largest=4.0, freedoms=4, time=at)


def flexibility(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """A soft drive: the link sags by its load times a compliance."""
    turning(world, joint)
    still = weight(world, world.model)
    most = float(np.abs(still[:, joint]).max())
    if most < 0.05:
        raise Unfit("the joint carries no load")
    unit = np.eye(world.arm.n)[joint]

    def torque(compliance: float) -> Floats:
        return weight(world, world.model, -compliance * still[:, [joint]] * unit) - still

    return _of_weight("flexibility", joint, torque, largest=0.06 / most, freedoms=1)


def coupling(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """Wrist gears in each other: motor `on` also carries a share of joint `joint`'s load."""
    pairs = {5: 4, 4: 3} if rng.random() < 0.7 else {5: 3}
    if joint not in pairs or world.arm.slides[pairs[joint]]:
        raise Unfit("its drive does not pass through another joint")
    on, side = pairs[joint], rng.choice([-1.0, 1.0])
    held = dense(world, weight(world, world.model))[world.rows(on), joint] * world.arm.gain[on]

    def change(world: World, state: State, amplitude: float) -> State:
        return added(world, state, on, side * amplitude * held)

    return Hidden("coupling", joint, WEIGHT, change, 1.0, "1", 1, (on,), {"on": on + 1})


def torque_constant_drift(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """Magnets that warm: more current for the same torque."""
    t, whole = clock(world, joint)
    lasting = whole * rng.uniform(0.1, 0.5)
    share = 1.0 - np.exp(-t / lasting)

    def change(world: World, state: State, amplitude: float) -> State:
        drawn = state.current[world.rows(joint), joint]
        return added(world, state, joint, amplitude * share * drawn)

    return Hidden(
        "torque_constant_drift", joint, DRIVE, change, 0.3, "1", 1, (joint,), {"time_constant": float(lasting)}
    )


def strongest(world: World, joint: int) -> float:
    """A: the joint's largest current in a fitted run."""
    run = world.motion.run
    own = (run >= 0) & (world.joint_of[run] == joint) & ~world.heldout[run]
    return float(np.abs(world.base.current[own, joint]).max())


def torque_droop(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """Iron that saturates: a motor that gives less per ampere at high current."""
    most = strongest(world, joint)

    def change(world: World, state: State, amplitude: float) -> State:
        drawn = state.current[world.rows(joint), joint]
        return added(world, state, joint, amplitude * drawn * np.minimum(np.abs(drawn) / most, 2.0) ** 2)

    return Hidden("torque_droop", joint, DRIVE, change, 0.4, "1", 1, (joint,), {})


def saturation(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """A sensor that ends before the current does: clipped at (1 - amplitude) of the largest current in a run."""
    most = strongest(world, joint)

    def change(world: World, state: State, amplitude: float) -> State:
        current, end = state.current.copy(), most * (1.0 - amplitude)
        current[:, joint] = np.clip(current[:, joint], -end, end)
        return replace(state, current=current)

    return Hidden("saturation", joint, SENSOR, change, 0.4, "1", 1, (joint,), {"most": most})


def delay(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """A drive whose current is stamped late, or early."""
    turning(world, joint)
    if np.abs(load(world, joint)).max() < 0.02:
        raise Unfit("the joint carries no load")
    side, rows = rng.choice([-1.0, 1.0]), np.arange(len(world.motion), dtype=float)

    def change(world: World, state: State, amplitude: float) -> State:
        current = state.current.copy()
        current[:, joint] = np.interp(rows - side * amplitude * RATE, rows, current[:, joint])
        return replace(state, current=current)

    return Hidden("delay", joint, SENSOR, change, 0.06, "s", 1, (joint,), {"side": side})


def inertia(world: World, rng: np.random.Generator, joint: int) -> Hidden:
    """A loop that does not hold its speed: waves of 2 to 6 Hz, of the amplitude's share of the speed, in every stroke.

    The current gains what the joint's inertia by MuJoCo takes, and the log shows the waves in position.
    """
    rows, moving = world.rows(joint), world.motion.moving
    stroke = moving[rows]
    rate = 2 * np.pi * rng.uniform(2.0, 6.0, len(world.speed_of))[stroke]
    phase = rng.uniform(0, 2 * np.pi, len(world.speed_of))[stroke]
    inside = np.clip(np.abs(world.motion.velocity[rows, joint] / world.speed_of[stroke]), 0.0, 1.0) ** 4
    wave = inside * world.speed_of[stroke] * np.sin(rate * rows / RATE + phase)
    q = world.motion.position[rows][::SPARSE]
    still = np.zeros_like(q)
    pushed = still + np.eye(world.arm.n)[joint]
    heavy = (inverse(world.model, q, still, pushed) - inverse(world.model, q, still, still))[:, joint]
    mass = np.interp(np.arange(len(rows)), np.arange(len(rows))[::SPARSE], heavy)

    def change(world: World, state: State, amplitude: float) -> State:
        position = state.position.copy()
        position[rows, joint] += amplitude * wave / rate
        torque = -amplitude * wave * rate * mass
        return added(world, replace(state, position=position), joint, torque * world.arm.gain[joint])

    return Hidden("inertia", joint, WEIGHT, change, 0.025, "1", 1, (joint,), {})


ARM: dict[str, Builder] = {
    builder.__name__: builder
    for builder in (
        *(tilt, zero_offset, payload, flexibility, coupling, torque_constant_drift, torque_droop, saturation),
        *(delay, inertia),
    )
}
