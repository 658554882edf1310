"""A virtual robot: everything about it that a real one keeps to itself, and a plausible one for a recipe."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pumaid.robot import Robot
from pumaid.simulation.gravity import Constants, Links, constants, gravity_load, links_of, side_load
from pumaid.simulation.hidden_effects import ArmState, Hidden, JointState, Kind, Typical, added, sized, values_of, whole
from pumaid.trajectory import QUICKEST_SLIDE, QUICKEST_TURN, accelerations, highest_speeds, span

Floats = NDArray[np.float64]

#: Break-away friction as a multiple of Coulomb friction, where nothing states it.
BREAKAWAY = 1.1
#: Postures over which loads are looked at, and a load that is rounding: share of the arm's greatest.
_POSTURES, _NOTHING = 400, 1e-6
#: Most rounds in which a sagging drive comes to rest, and A: a change that is none.
_ROUNDS, _SETTLED = 30, 1e-10


@dataclass(frozen=True, eq=False, slots=True)
class Friction:
    """Friction of every joint, (J,) each, signed as currents: ``coulomb + viscous * velocity`` by direction.

    Coulomb terms in A, viscous ones in A s/rad or A s/m.
    """

    coulomb_plus: Floats
    coulomb_minus: Floats
    viscous_plus: Floats
    viscous_minus: Floats

    def currents(self, velocity: Floats) -> Floats:
        """(..., J) A that the joints spend on friction at `velocity` (..., J); nothing where they rest."""
        forward = self.coulomb_plus + self.viscous_plus * velocity
        backward = self.coulomb_minus + self.viscous_minus * velocity
        return np.where(velocity > 0, forward, np.where(velocity < 0, backward, 0.0))

    def current(self, joint: int, velocity: Floats) -> Floats:
        """(N,) A that joint `joint` (from 1) spends on friction at `velocity` (N,)."""
        return np.asarray(self.currents(np.asarray(velocity)[:, None])[:, joint - 1])


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

    def correlation(self, rate: float) -> float:
        """Correlation of one sample with the next at `rate` (Hz)."""
        return float(np.exp(-1.0 / (rate * self.correlation_time))) if self.correlation_time > 0 else 0.0

    def series(self, rng: np.random.Generator, shape: tuple[int, ...], *, rate: float, start: Floats | float) -> Floats:
        """Stationary noise of unit variance along the first axis, of the first order.

        Parameters
        ----------
        rng
            Source of randomness.
        shape
            (N, ...) of the result.
        rate
            Samples a second.
        start
            The sample before the first, shaped as the other axes.
        """
        from scipy.signal import lfilter  # it takes a second to import

        white, phi = rng.standard_normal(shape), self.correlation(rate)
        out, _ = lfilter([np.sqrt(1.0 - phi**2)], [1.0, -phi], white, axis=0, zi=phi * np.asarray(start)[None])
        return np.asarray(out)


@dataclass(frozen=True, eq=False, slots=True)
class Truth:
    """A virtual robot.

    Attributes
    ----------
    robot
        Geometry, limits, speeds.
    friction, noise
        Of every joint.
    links, gain
        Masses and centres of mass, and (J,) A/(N m) or A/N; where they are not given they follow from `known`.
    known
        The paper's constants in amperes, of a robot of which nothing else is known, or none.
    inertia
        (J,) A s2/rad or A s2/m: current per acceleration of the motor.
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
        if (self.links is None or self.gain is None) and self.known is None:
            raise ValueError("a virtual robot needs either links and gain, or constants")
        if len(self.inertia) != self.robot.n_joints:
            object.__setattr__(self, "inertia", np.zeros(self.robot.n_joints))
        if len(self.breakaway) != self.robot.n_joints:
            object.__setattr__(self, "breakaway", np.full(self.robot.n_joints, BREAKAWAY))
        if self.known is not None and self.links is None:
            links, gain = links_of(self.robot, self.known, self.inertia)
            object.__setattr__(self, "links", links)
            object.__setattr__(self, "gain", gain)

    @property
    def masses(self) -> tuple[Links, Floats]:
        """Masses and centres of mass; (J,) A/(N m) or A/N."""
        assert self.links is not None and self.gain is not None
        return self.links, self.gain

    @property
    def constants(self) -> Constants:
        """The paper's constants of this arm."""
        return constants(self.robot, *self.masses) if self.known is None else self.known

    @property
    def sides(self) -> Floats:
        """(J,) +1 where a motor counts its current along the joint's motion, else -1."""
        return np.where(self.friction.coulomb_plus < 0, -1.0, 1.0)

    @property
    def coulomb(self) -> Floats:
        """(J,) A: size of Coulomb friction, mean of both directions."""
        return np.asarray(0.5 * (np.abs(self.friction.coulomb_plus) + np.abs(self.friction.coulomb_minus)))

    def hides(self, *effects: str) -> bool:
        """Whether any of these effects is hidden."""
        return any(hidden.effect in effects for hidden in self.hidden)

    def gravity_current(self, position: Floats) -> Floats:
        """(N, J) A that carry the weight at `position` (N, J), rad or m, nothing being hidden."""
        links, gain = self.masses
        return self._shared(gravity_load(self.robot, links, position)) * gain

    def _shared(self, load: Floats) -> Floats:
        """(N, J) what the motors carry, geared to their joints, of (N, J) loads of the joints (N m or N)."""
        return load @ np.linalg.inv(self.robot.shaft_speeds) if self.robot.coupling else load

    def hiding(self, hidden: Sequence[Hidden]) -> Truth:
        """The same robot with other hidden effects; values that they do not name are made to show at this robot."""
        return replace(self, hidden=sized(hidden, self.typical(), has_masses=self.known is None))

    def carried(self, position: Floats, elapsed: Floats) -> tuple[Floats, Floats]:
        """A that the weight draws, and that its moments across the axes would draw, with hidden bodies and drives.

        Parameters
        ----------
        position
            (N, J) rad or m, as the encoders tell it.
        elapsed
            (N,) s since the arm's first run began.

        Returns
        -------
        load, across
            (N, J) A each.
        """
        links, gain = self.masses
        arm = replace(self.robot, gravity=self.gravity())
        bodies = [(links, np.ones(len(position), dtype=bool))]
        for hidden in self.hidden:
            if hidden.effect == "payload":
                values, (last, there) = hidden.values, bodies[-1]
                comes = elapsed > values["time"]
                bodies += [(last.loaded(values["mass"], [values[key] for key in "xyz"]), there & comes)]
        n = self.robot.n_joints
        offset = values_of(self.hidden, "zero_offset", "delta", n_joints=n)
        sag = self.sides * values_of(self.hidden, "flexibility", "c", n_joints=n)
        load, across, link = np.zeros_like(position), np.zeros_like(position), position + offset
        for _ in range(_ROUNDS if sag.any() else 1):
            before = load.copy()
            for body, there in bodies:
                load[there] = self._shared(gravity_load(arm, body, link[there])) * gain
            link = position + offset - sag * load
            if np.max(np.abs(load - before), initial=0.0) < _SETTLED:
                break
        if self.hides("side_load_friction"):
            for body, there in bodies:
                across[there] = side_load(arm, body, link[there]) * np.abs(gain)
        return load, across

    def gravity(self) -> tuple[float, float, float]:
        """m/s2 in the axes of the base, which a hidden tilt turns about its own."""
        x, y = (sum(hidden.values[key] for hidden in self.hidden if hidden.effect == "tilt") for key in "xy")
        turned = Rotation.from_rotvec([x, y, 0.0]).inv().apply(np.asarray(self.robot.gravity, dtype=float))
        return (float(turned[0]), float(turned[1]), float(turned[2])) if x or y else self.robot.gravity

    def current(self, joint: int, at: ArmState) -> Floats:
        """(N,) A of the motor of `joint` (from 1): gravity, friction, inertia and what is hidden; no stiction.

        Parameters
        ----------
        joint
            From 1.
        at
            The arm at N instants; its loads and friction are set to this robot's.
        """
        j = joint - 1
        at.load, at.across = self.carried(at.position, at.time - np.min(at.first))
        turning = self.robot.shaft_velocity(at.velocity)
        at.friction = self.friction.currents(turning)
        out = at.load[:, j] + at.friction[:, j] + self.inertia[j] * at.acceleration[:, j]
        state = JointState(replace(at, velocity=turning), joint, float(self.sides[j]))
        out = (
            out
            + state.opposing * sum(added(self.hidden, state, Kind.FRICTION))
            + sum(added(self.hidden, state, Kind.LOAD))
        )
        return whole(self.hidden, state, out)

    def parameters(self) -> dict[str, float]:
        """Every parameter of the paper's model by its public name, SI; also those that no run can show."""
        worth, values = self.constants, {}
        for joint in self.robot.joints:
            j, n = joint.number - 1, joint.number
            if joint.is_revolute:
                values[f"gravity.l{n}.x"], values[f"gravity.l{n}.y"] = worth.x[j], worth.y[j]
            else:
                values[f"gravity.l{n}.mass"] = worth.mass[j]
            values[f"coulomb.j{n}.plus"] = self.friction.coulomb_plus[j]
            values[f"coulomb.j{n}.minus"] = self.friction.coulomb_minus[j]
            values[f"viscous.j{n}.plus"] = self.friction.viscous_plus[j]
            values[f"viscous.j{n}.minus"] = self.friction.viscous_minus[j]
            if n < self.robot.n_joints:
                values[f"gain_ratio.{n}.{n + 1}"] = worth.ratio[j]
        return {name: float(value) for name, value in values.items()}

    def with_noise(self, std: float) -> Truth:
        """The same robot with `std` (A) as noise of every joint; 0 leaves none at all, nor any quantisation."""
        size = np.full(self.robot.n_joints, float(std))
        noise = replace(self.noise, std=size) if std > 0 else Noise(size)
        return replace(self, noise=noise)

    def typical(self) -> tuple[Typical, ...]:
        """What is usual of every joint: of its friction, its speeds, and its loads over many postures."""
        robot, (links, gain), coulomb = self.robot, self.masses, self.coulomb
        low, high = np.array([span(joint) for joint in robot.joints]).T
        rng = np.random.default_rng(0)
        postures = low + rng.random((_POSTURES, robot.n_joints)) * (high - low)
        load = self.gravity_current(postures)
        load[:, np.max(np.abs(load), axis=0) < _NOTHING * (np.max(np.abs(load)) or 1.0)] = 0.0
        across = side_load(robot, links, postures) * np.abs(gain)
        quickest = np.where(robot.is_revolute, QUICKEST_TURN, QUICKEST_SLIDE)
        return tuple(
            Typical(
                joint=j + 1,
                coulomb=float(coulomb[j]),
                speed=float(np.minimum(highest_speeds(robot), quickest)[j]),
                acceleration=float(accelerations(robot)[j]),
                half_span=float(0.5 * (high[j] - low[j])),
                load=float(np.sqrt(np.mean(load[:, j] ** 2))),
                peak_load=float(np.max(np.abs(load[:, j]))),
                across=float(np.sqrt(np.mean(across[:, j] ** 2))),
                coulomb_before=float(coulomb[j - 1 if j else min(1, robot.n_joints - 1)]),
                last_mass=float(links.mass[-1]),
                reach=float(sum(abs(joint.a) + abs(joint.d) for joint in robot.joints)) or 1.0,
            )
            for j in range(robot.n_joints)
        )
