"""What a hidden effect is: how it changes an experiment at a given amplitude, and how large it may physically be."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from blind_world.oracle import Oracle, threshold
from blind_world.world import TURNOVER, State, World

Floats = NDArray[np.float64]

#: Order in which effects act: on the arm's weight and motion, on friction, in the drive, in the sensors.
WEIGHT, DRAG, DRIVE, SENSOR = range(4)
#: The amplitude is found to this share of the noncentrality, in at most so many steps.
CLOSE, STEPS = 0.02, 14


class Unfit(ValueError):
    """An effect cannot act at a joint, or never at a physical size that could be seen."""


@dataclass(frozen=True, eq=False)
class Hidden:
    """One effect, drawn: at which joint, of which shape."""

    name: str  # the catalogue's, or another for an effect outside of it
    joint: int | None  # from 0; None for the whole arm. The joint that causes it, where another one feels it
    stage: int  # when it acts
    change: Callable[[World, State, float], State]  # (world, state, amplitude) -> state
    largest: float  # physical amplitude, in `unit`
    unit: str
    freedoms: int  # linear parameters that a model of it has
    felt: tuple[int, ...]  # joints whose current changes
    shape: Mapping[str, float] = field(default_factory=dict)  # what was drawn, for the record


Builder = Callable[[World, np.random.Generator, int], Hidden]


def applied(world: World, effects: Sequence[tuple[Hidden, float]], base: State | None = None) -> State:
    """The state with effects at their amplitudes, in the order of their stages; from the world's base if none."""
    state = world.base if base is None else base
    for hidden, amplitude in sorted(effects, key=lambda pair: pair[0].stage):
        state = hidden.change(world, state, amplitude)
    return state


def signature(world: World, oracle: Oracle, hidden: Hidden, amplitude: float) -> dict[int, Floats]:
    """By joint: current (A) at the rows of its fitted runs that the effect alone adds."""
    current = applied(world, [(hidden, amplitude)]).current
    base = world.base.current
    return {joint: (current - base)[oracle.joints[joint], joint] for joint in hidden.felt}


def sized(world: World, oracle: Oracle, hidden: Hidden, multiple: float) -> tuple[float, float]:
    """The amplitude at `multiple` of the detection limit, and the noncentrality there.

    At a multiple m the visible part's noncentrality is m^2 times that of the limit, so that the multiple scales the
    signature's visible size also where it is not linear in the amplitude. `Unfit` where that is more than is physical.
    """
    wanted = multiple**2 * threshold(hidden.freedoms)
    x = np.log(0.3 * hidden.largest)
    slope, last = 2.0, None
    for _ in range(STEPS):
        reached = oracle.noncentrality(signature(world, oracle, hidden, float(np.exp(x))))
        if reached <= 1e-9:
            raise Unfit("the base model absorbs it")
        miss = np.log(wanted / reached)
        if abs(miss) < CLOSE:
            return float(np.exp(x)), reached
        if last is not None and abs(x - last[0]) > 1e-9:
            slope = float(np.clip((last[1] - miss) / (x - last[0]), 0.5, 12.0))
        last = (x, miss)
        step = x + float(np.clip(miss / slope, -3.0, 3.0))
        if x >= np.log(hidden.largest) - 1e-9 and step >= x:
            raise Unfit("larger than is physical")
        x = min(step, float(np.log(hidden.largest)))
    raise Unfit("its size does not settle")


def plain(
    name: str, joint: int, column: Floats, *, largest: float, unit: str = "A", freedoms: int = 1, **shape: float
) -> Hidden:
    """An effect that adds amplitude x column (M,) A to its joint's current at the rows of the joint's strokes."""

    def change(world: World, state: State, amplitude: float) -> State:
        return added(world, state, joint, amplitude * column)

    return Hidden(name, joint, DRAG, change, largest, unit, freedoms, (joint,), shape)


def added(world: World, state: State, joint: int, extra: Floats) -> State:
    """The state with `extra` (A) in a joint's current at the rows of its strokes."""
    current = state.current.copy()
    current[world.rows(joint), joint] += extra
    return replace(state, current=current)


def drag(world: World, joint: int) -> Floats:
    """(M,) +1 or -1: the sign that friction's current has at the rows of a joint's strokes, smooth at standstill."""
    way = np.tanh(world.motion.velocity[world.rows(joint), joint] / TURNOVER)
    return np.asarray(way * world.sign[joint])


def dry(world: World, joint: int) -> float:
    """Mean Coulomb friction of a joint, A."""
    return float(world.friction.plus[joint] + world.friction.minus[joint]) / 2.0


def load(world: World, joint: int) -> Floats:
    """(M,) A: gravity's current at the rows of a joint's strokes."""
    return np.asarray(world.motion.load[world.rows(joint)] * world.arm.gain[joint])


def speeds(world: World, joint: int) -> Floats:
    """Distinct speeds of a joint's fitted strokes, rising."""
    own = (world.joint_of == joint) & ~world.heldout
    return np.unique(np.abs(world.speed_of[own]))


def turning(world: World, joint: int) -> None:
    """Refuse a sliding joint."""
    if world.arm.slides[joint]:
        raise Unfit("a sliding joint has none")


def spread(world: World, joint: int) -> tuple[float, float]:
    """Lowest and highest position of a joint's strokes."""
    q = world.motion.position[world.rows(joint), joint]
    return float(q.min()), float(q.max())
