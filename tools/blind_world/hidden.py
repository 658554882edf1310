"""What a hidden effect is: how it changes an experiment at a given amplitude, and how large it may physically be."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

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


@dataclass(frozen=True, eq=False)
class Strokes:
    """A joint (from 0) of a world at the M rows of its strokes: what effects are made of."""

    world: World
    joint: int

    @cached_property
    def rows(self) -> NDArray[np.int64]:
        """(M,)."""
        return self.world.rows(self.joint)

    @cached_property
    def q(self) -> Floats:
        """(M,) positions."""
        return np.asarray(self.world.motion.position[self.rows, self.joint])

    @cached_property
    def v(self) -> Floats:
        """(M,) velocities."""
        return np.asarray(self.world.motion.velocity[self.rows, self.joint])

    @cached_property
    def drag(self) -> Floats:
        """(M,) +1 or -1: the sign that friction's current has, smooth at standstill."""
        return np.asarray(np.tanh(self.v / TURNOVER) * self.world.sign[self.joint])

    @cached_property
    def dry(self) -> float:
        """Mean Coulomb friction, A."""
        return float(self.world.friction.plus[self.joint] + self.world.friction.minus[self.joint]) / 2.0

    @cached_property
    def load(self) -> Floats:
        """(M,) A: gravity's current, in motion that accelerates inertia's too."""
        return self.world.load(self.joint)

    @cached_property
    def speeds(self) -> Floats:
        """Distinct speeds of the fitted strokes, rising; quantiles in any motion."""
        if not self.world.campaign.is_steady:
            return np.asarray(np.quantile(np.abs(self.v), (0.2, 0.5, 0.8, 1.0)))
        fitted = (self.world.joint_of == self.joint) & ~self.world.heldout
        return np.unique(np.abs(self.world.speed_of[fitted]))

    @cached_property
    def clock(self) -> tuple[Floats, float]:
        """(M,) s since the joint's first stroke, and the whole duration."""
        t = self.world.time[self.rows]
        return t - t[0], float(t[-1] - t[0])

    def turning(self) -> None:
        """Refuse a sliding joint."""
        if self.world.arm.slides[self.joint]:
            raise Unfit("a sliding joint has none")

    def loaded(self) -> None:
        """Refuse a joint that gravity hardly loads."""
        if np.abs(self.load).max() < 0.02:
            raise Unfit("the joint carries no load")

    def effect(
        self, name: str, column: Floats, largest: float, *, unit: str = "A", freedoms: int = 1, **shape: float
    ) -> Hidden:
        """An effect that adds amplitude x column (M,) A to the joint's current."""

        def change(world: World, state: State, amplitude: float) -> State:
            return added(world, state, self.joint, amplitude * column)

        return Hidden(name, self.joint, DRAG, change, largest, unit, freedoms, (self.joint,), shape)


Builder = Callable[[Strokes, np.random.Generator], Hidden]


def applied(world: World, effects: Sequence[tuple[Hidden, float]], base: State | None = None) -> State:
    """The state with effects at their amplitudes, in the order of their stages; from the world's base if none."""
    state = world.base if base is None else base
    for hidden, amplitude in sorted(effects, key=lambda pair: pair[0].stage):
        state = hidden.change(world, state, amplitude)
    return state


def signature(world: World, oracle: Oracle, hidden: Hidden, amplitude: float) -> dict[int, Floats]:
    """By joint: current (A) at the rows of its fitted runs that the effect alone adds."""
    change = applied(world, [(hidden, amplitude)]).current - world.base.current
    return {joint: change[oracle.joints[joint], joint] for joint in hidden.felt if joint < len(oracle.joints)}


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


def added(world: World, state: State, joint: int, extra: Floats) -> State:
    """The state with `extra` (A) in a joint's current at the rows of its strokes."""
    current = state.current.copy()
    current[world.rows(joint), joint] += extra
    return replace(state, current=current)
