"""A virtual robot: everything about it that a real one keeps to itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.robot import Robot
from pumaid.simulation.hidden import Hidden, Instants, sized, total
from pumaid.simulation.hidden.state import State
from pumaid.simulation.links import Links
from pumaid.simulation.recursion import Constants, constants
from pumaid.simulation.shafts import shafts
from pumaid.simulation.weight import Weight

Floats = NDArray[np.float64]

#: Break-away friction as a multiple of Coulomb friction, where nothing states it.
BREAKAWAY = 1.1


@dataclass(frozen=True, eq=False, slots=True)
class Friction:
    """Friction of every joint, (J,) each, signed as currents: ``coulomb + viscous * velocity`` by direction.

    Coulomb terms in A, viscous ones in A s/rad or A s/m.
    """

    coulomb_plus: Floats
    coulomb_minus: Floats
    viscous_plus: Floats
    viscous_minus: Floats

    def current(self, joint: int, velocity: Floats) -> Floats:
        """(N,) A that joint `joint` (from 1) spends on friction at `velocity` (N,); nothing where it rests."""
        j = joint - 1
        forward = self.coulomb_plus[j] + self.viscous_plus[j] * velocity
        backward = self.coulomb_minus[j] + self.viscous_minus[j] * velocity
        return np.where(velocity > 0, forward, np.where(velocity < 0, backward, 0.0))


@dataclass(frozen=True, eq=False, slots=True)
class Noise:
    """What is added to the currents.

    Attributes
    ----------
    std
        (J,) A: standard deviation of a sample, levels included.
    level_share
        Share of the variance that is a constant of the run (no unit).
    correlation_time
        s: noise at two instants t apart is correlated by exp(-t / correlation_time); 0 is white.
    current_step
        A: resolution of the current sensor; 0 is none.
    counts
        (J,) encoder counts a rad or a metre; 0 is none.
    """

    std: Floats
    level_share: float = 0.2
    correlation_time: float = 0.02
    current_step: float = 0.0
    counts: Floats | None = None

    @property
    def level_std(self) -> Floats:
        """(J,) A: standard deviation of the runs' levels."""
        return self.std * np.sqrt(self.level_share)

    @property
    def sample_std(self) -> Floats:
        """(J,) A: standard deviation of a sample about its run's level."""
        return self.std * np.sqrt(1.0 - self.level_share)


@dataclass(frozen=True, eq=False, slots=True)
class Truth:
    """A virtual robot.

    Its gravity comes from `links` and `gain` where they are given (masses, centres of mass, potential energy), else
    from `known` (the paper's constants in amperes and its recursion).

    Attributes
    ----------
    robot
        Geometry, limits, speeds.
    friction, noise
        Of every joint.
    links
        Masses and centres of mass, or none.
    gain
        (J,) A/(N m) or A/N, or none.
    known
        Constants in amperes, or none where `links` say it.
    inertia
        (J,) A s2/rad or A s2/m: current per acceleration of the moving joint.
    seed
        From which it was drawn, or none.
    hidden
        Physics beyond the paper's model, with all values; see `hiding`.
    breakaway
        (J,) at least 1: a joint at rest moves only when its motor's surplus passes this times Coulomb friction.
    """

    robot: Robot
    friction: Friction
    noise: Noise
    links: Links | None = None
    gain: Floats | None = None
    known: Constants | None = None
    inertia: Floats = field(default_factory=lambda: np.zeros(0))
    seed: int | None = None
    hidden: tuple[Hidden, ...] = ()
    breakaway: Floats = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        if (self.links is None or self.gain is None) == (self.known is None):
            raise ValueError("a virtual robot needs either links and gain, or constants")
        if len(self.inertia) != self.robot.n_joints:
            object.__setattr__(self, "inertia", np.zeros(self.robot.n_joints))
        if len(self.breakaway) != self.robot.n_joints:
            object.__setattr__(self, "breakaway", np.full(self.robot.n_joints, BREAKAWAY))

    @property
    def weight(self) -> Weight:
        """What the arm's weight draws."""
        return Weight(self.robot, self.links, self.gain, self.known)

    @property
    def coulomb(self) -> Floats:
        """(J,) A: size of Coulomb friction, mean of both directions."""
        return np.asarray(0.5 * (np.abs(self.friction.coulomb_plus) + np.abs(self.friction.coulomb_minus)))

    @property
    def has_warmth(self) -> bool:
        """Whether anything hidden depends on the motors' temperatures."""
        return any(one.effect == "thermal_friction" for one in self.hidden)

    def gravity_current(self, position: Floats) -> Floats:
        """(N, J) A that carry the weight at `position` (N, J), rad or m."""
        return self.weight.current(position)

    def hiding(self, hidden: Sequence[Hidden]) -> Truth:
        """The same robot with other hidden effects; values that they do not name are made to show at this robot."""
        return replace(self, hidden=sized(hidden, self))

    def current(self, joint: int, at: Instants) -> Floats:
        """(N,) A of the motor of `joint` (from 1): gravity, friction, inertia and what is hidden; no stiction."""
        j, load = joint - 1, self.gravity_current(at.position)
        turning = at.velocity @ shafts(self.robot).T if self.robot.coupling else at.velocity
        found = load[:, j] + self.friction.current(joint, turning[:, j]) + self.inertia[j] * at.acceleration[:, j]
        if not self.hidden:
            return np.asarray(found)
        sides = np.where(self.friction.coulomb_plus < 0, -1.0, 1.0)
        return total(self.hidden, State(joint, at, load, self.weight, self.friction.current, sides), found)

    @property
    def constants(self) -> Constants:
        """The paper's constants of this arm."""
        if self.links is not None and self.gain is not None:
            return constants(self.robot, self.links, self.gain)
        assert self.known is not None
        return self.known

    def parameters(self) -> dict[str, float]:
        """Every parameter of the paper's model by its public name, SI; also those that no run can show."""
        known, values = self.constants, {}
        for joint in self.robot.joints:
            j, n = joint.number - 1, joint.number
            if joint.is_revolute:
                values[f"gravity.l{n}.x"], values[f"gravity.l{n}.y"] = known.x[j], known.y[j]
            else:
                values[f"gravity.l{n}.mass"] = known.mass[j]
            values[f"coulomb.j{n}.plus"] = self.friction.coulomb_plus[j]
            values[f"coulomb.j{n}.minus"] = self.friction.coulomb_minus[j]
            values[f"viscous.j{n}.plus"] = self.friction.viscous_plus[j]
            values[f"viscous.j{n}.minus"] = self.friction.viscous_minus[j]
            if n < self.robot.n_joints:
                values[f"gain_ratio.{n}.{n + 1}"] = known.ratio[j]
        return {name: float(value) for name, value in values.items()}

    def with_noise(self, std: float) -> Truth:
        """The same robot with `std` (A) as noise of every joint; 0 leaves none at all, nor any quantisation."""
        size = np.full(self.robot.n_joints, float(std))
        noise = replace(self.noise, std=size) if std > 0 else Noise(size)
        return replace(self, noise=noise)
