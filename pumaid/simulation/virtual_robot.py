"""A virtual robot: all that a real one keeps to itself, its weight, the currents that it draws, and its document."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from pumaid.maths import Floats
from pumaid.robot import Robot
from pumaid.simulation.hidden_effects import ArmState, Hidden, JointState, Kind, acted, sized, values_of
from pumaid.trajectory import QUICKEST_SLIDE, QUICKEST_TURN, accelerations, highest_speeds, span

#: Break-away friction as a multiple of Coulomb friction, where nothing states it.
BREAKAWAY = 1.1
#: Postures over which loads are looked at, and a load that is rounding: share of the arm's greatest.
_POSTURES, _NOTHING = 400, 1e-6
#: Most rounds in which a sagging drive comes to rest, and A: a change that is none.
_ROUNDS, _SETTLED = 30, 1e-10
#: Of a robot that is known by constants in amperes alone: A/(N m), its middle motor's gain; m, the distance of a link's
#: centre of mass from its axis, and the largest share of the motor's inertia that the mass adds there.
_GAIN, _DISTANCE, _SWUNG = 0.1, 0.1, 0.05

#: A link's body where the geometry gives it no length (a wrist), as a share of the arm's reach.
_SHORTEST = 0.08
#: Significant digits of what is drawn: the last ones of a sum differ between machines, a robot must not.
_DIGITS = 9


@dataclass(frozen=True, eq=False, slots=True)
class Links:
    """The arm's masses."""

    mass: Floats  # (J,) kg
    centre: Floats  # (J, 3) m: each link's centre of mass in its frame (modified Denavit-Hartenberg)

    def loaded(self, payload: Mapping[str, float]) -> Links:
        """With ``mass`` (kg) more on the last link, at ``x``, ``y``, ``z`` (m, in its frame)."""
        total, centre = self.mass.copy(), self.centre.copy()
        total[-1] += payload["mass"]
        place = np.array([payload[key] for key in "xyz"])
        centre[-1] = (self.mass[-1] * centre[-1] + payload["mass"] * place) / total[-1]
        return Links(total, centre)


def gravity_load(robot: Robot, links: Links, position: Floats) -> tuple[Floats, Floats]:
    """(N, J) N m or N that each joint needs to hold the arm still at `position` (N, J): slope of the potential energy.

    And (N, J) N m: size of the weight's moment across each turning joint's axis, which bearings carry; 0 for sliding.

    U = -sum_k m_k g . p_k. Turning joint i moves p_k by z_i x (p_k - o_i), sliding it moves p_k by z_i, for k >= i.
    """
    rotations, origin = robot.frames(position)
    axis, g = rotations[..., 2], np.asarray(robot.gravity, dtype=float)
    centres = origin + np.einsum("njab,jb->nja", rotations, links.centre)
    outer_mass = np.cumsum(links.mass[::-1])[::-1]
    outer_moment = np.cumsum((links.mass[:, None] * centres)[:, ::-1], axis=1)[:, ::-1]
    arm = outer_moment - outer_mass[:, None] * origin  # first moment of links i..n about origin i, kg m
    # g . (z x r) = (g x z) . r, and g x z is a product with one matrix.
    turning = -np.einsum("nja,nja->nj", axis @ np.cross(g, np.eye(3)), arm)
    across = np.linalg.norm(np.cross(axis, np.cross(arm, g)), axis=2)
    turns = robot.is_revolute
    return np.where(turns, turning, -outer_mass * (axis @ g)), np.where(turns, across, 0.0)


@dataclass(frozen=True, eq=False, slots=True)
class Constants:
    """What gravity is worth in amperes, as in the paper's Table I."""

    x: Floats  # (J,) k*_ix of revolute links, A s2/m; not used of prismatic ones
    y: Floats  # (J,) k*_iy, likewise
    mass: Floats  # (J,) m*_i of prismatic links, A s2/m; not used of revolute ones
    ratio: Floats  # (J-1,) eta_i / eta_{i+1}


def constants(robot: Robot, links: Links, gain: Floats) -> Constants:
    """Constants of an arm with these masses and gains (J,), A/(N m) or A/N: the paper's (13)-(15), (21), (22)."""
    outer_mass = np.cumsum(links.mass[::-1])[::-1]
    k = links.mass[:, None] * links.centre
    for i in range(robot.n_joints - 2, -1, -1):
        k[i] += carried_moment(robot, i, outer_mass[i + 1], k=k[i + 1])
    return Constants(gain * k[:, 0], gain * k[:, 1], gain * outer_mass, gain[:-1] / gain[1:])


def carried_moment(robot: Robot, i: int, outer_mass: float, *, k: Floats) -> Floats:
    """(3,) kg m: what links beyond link i (from 0), of mass `outer_mass` and constants `k` (3,), add to its moment."""
    after = robot.joints[i + 1]
    if after.is_revolute:
        # R [0, 0, k_z] does not depend on the joint's angle: z of frame i+1 is fixed in frame i.
        k = np.array([0.0, 0.0, k[2]])
    return np.asarray(outer_mass * link_of(robot, i) + after.frame[:3, :3] @ k)


def link_of(robot: Robot, i: int) -> Floats:
    """(3,) m from link i's origin (from 0) to the next one's, in its frame; as far as a slide does not change it."""
    after = robot.joints[i + 1]
    return np.asarray(after.frame[:3, 3] - after.frame[:3, 2] * (0.0 if after.is_revolute else after.d))


def link_sizes(robot: Robot) -> tuple[Floats, Floats, float]:
    """(J, 3) m from each link's origin to the next, in its frame, zero for the last; (J,) their lengths.

    And the length (m) of a body where the geometry gives it none, as a wrist's.
    """
    along = np.vstack([robot.placements[1:, :3, 3], np.zeros(3)])
    length = np.linalg.norm(along, axis=1)
    return along, length, _SHORTEST * (float(np.sum(length)) or 1.0)


def links_of(robot: Robot, given: Constants, inertia: Floats) -> tuple[Links, Floats]:
    """Masses and gains (J,) of an arm that has these constants; of all that have, one with usual motors.

    The inertia (J,) of its motors, A s2/rad or A s2/m, tells the sign of the gains; 0 where it is not known.
    """
    n = robot.n_joints
    ratio = np.where(given.ratio == 0.0, 1e-12, given.ratio)
    gain = np.append(np.cumprod(ratio[::-1])[::-1], 1.0) * (-1.0 if inertia[-1] < 0 else 1.0)
    mass, moment, k, outer = np.zeros(n), np.zeros((n, 3)), np.zeros(3), 0.0
    for i in range(n - 1, -1, -1):
        carried = carried_moment(robot, i, outer, k=k) if i < n - 1 else np.zeros(3)
        k, rotor = carried, abs(inertia[i] / gain[i])
        if robot.joints[i].is_revolute:
            moment[i, :2] = np.array([given.x[i], given.y[i]]) / gain[i] - carried[:2]
            k = carried + moment[i]
            size = float(np.linalg.norm(moment[i]))
            mass[i] = max(size / _DISTANCE, size**2 / (_SWUNG * rotor) if rotor else 0.0, rotor, 1e-9)
        else:
            mass[i] = given.mass[i] / gain[i] - outer
        outer += mass[i]
    share = float(np.median(np.abs(gain))) / _GAIN
    return Links(share * mass, moment / mass[:, None]), gain / share


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


@dataclass(frozen=True, eq=False, slots=True)
class Noise:
    """What is added to the currents."""

    std: Floats  # (J,) A: standard deviation of a sample, levels included
    level_share: float = 0.2  # share of the variance that is a constant of the run
    correlation_time: float = 0.02  # s: noise at two instants t apart is correlated by exp(-t / this); 0 is white
    current_step: float = 0.0  # A: resolution of the current sensor; 0 is none
    counts: Floats | None = None  # (J,) encoder counts a rad or a metre; 0 is none

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
        """(N, ...) stationary noise of unit variance and first order along the first axis, after a sample `start`."""
        from scipy.signal import lfilter  # it takes a second to import

        white, phi = rng.standard_normal(shape), self.correlation(rate)
        out, _ = lfilter([np.sqrt(1.0 - phi**2)], [1.0, -phi], white, axis=0, zi=phi * np.asarray(start)[None])
        return np.asarray(out)


@dataclass(frozen=True, eq=False, slots=True)
class Truth:
    """A virtual robot.

    A robot that is known by the paper's constants in amperes alone has them as `given_constants`, and masses and gains
    that follow from them (`links_of`). Hidden effects have all their values; see `hiding`.
    """

    robot: Robot
    friction: Friction
    noise: Noise
    links: Links
    gain: Floats  # (J,) A/(N m) or A/N
    inertia: Floats  # (J,) A s2/rad or A s2/m: current per acceleration of the motor
    # (J,) at least 1: a joint at rest moves only when its motor's surplus passes this times Coulomb friction.
    breakaway: Floats
    given_constants: Constants | None = None
    seed: int | None = None  # from which it was drawn
    hidden: tuple[Hidden, ...] = ()

    @property
    def constants(self) -> Constants:
        """The paper's constants of this arm."""
        return self.given_constants or constants(self.robot, self.links, self.gain)

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
        return replace(self, hidden=()).carried(position, np.zeros(len(position)))[0]

    def hiding(self, hidden: Sequence[Hidden]) -> Truth:
        """The same robot with other hidden effects; values that they do not name are made to show at this robot."""
        return replace(self, hidden=sized(hidden, self.typical(), has_masses=self.given_constants is None))

    def carried(self, position: Floats, elapsed: Floats) -> tuple[Floats, Floats]:
        """(N, J) A that the weight draws and (N, J) A that its moments across the axes would, hidden bodies included.

        The arm stands where its encoders tell `position` (N, J), `elapsed` (N,) s after its first run began.
        """
        arm = replace(self.robot, gravity=self.gravity())
        bodies = [(self.links, np.ones(len(position), dtype=bool))]
        for hidden in self.hidden:
            if hidden.effect == "payload":
                links, there = bodies[-1]
                bodies.append((links.loaded(hidden.values), there & (elapsed > hidden.values["time"])))
        n = self.robot.n_joints
        offset = values_of(self.hidden, "zero_offset", "delta", n_joints=n)
        sag = self.sides * values_of(self.hidden, "flexibility", "c", n_joints=n)
        load, across, link = np.zeros_like(position), np.zeros_like(position), position + offset
        shares = np.linalg.inv(arm.shaft_speeds)  # what motors carry, geared to their joints, of their joints' loads
        for _ in range(_ROUNDS if sag.any() else 1):
            before = load.copy()
            for body, there in bodies:
                along, beside = gravity_load(arm, body, link[there])
                load[there], across[there] = along @ shares * self.gain, beside * np.abs(self.gain)
            link = position + offset - sag * load
            if np.max(np.abs(load - before), initial=0.0) < _SETTLED:
                break
        return load, across

    def gravity(self) -> tuple[float, float, float]:
        """m/s2 in the axes of the base, which a hidden tilt turns about its own."""
        x, y = (sum(hidden.values[key] for hidden in self.hidden if hidden.effect == "tilt") for key in "xy")
        turned = Rotation.from_rotvec([x, y, 0.0]).inv().apply(np.asarray(self.robot.gravity, dtype=float))
        return (float(turned[0]), float(turned[1]), float(turned[2])) if x or y else self.robot.gravity

    def current(self, joint: int, at: ArmState) -> Floats:
        """(N,) A of the motor of `joint` (from 1): gravity, friction, inertia and what is hidden; no stiction.

        Loads and friction of the arm's state `at` are set to this robot's.
        """
        j = joint - 1
        at.load, at.across = self.carried(at.position, at.time - np.min(at.first))
        turning = self.robot.shaft_velocity(at.velocity)
        at.friction = self.friction.currents(turning)
        state = JointState(replace(at, velocity=turning), joint, float(self.sides[j]))
        out = at.load[:, j] + at.friction[:, j] + self.inertia[j] * at.acceleration[:, j]
        out = out + state.opposing * acted(self.hidden, state, Kind.FRICTION) + acted(self.hidden, state, Kind.LOAD)
        return np.asarray(acted(self.hidden, state, Kind.CURRENT, current=out))

    def parameters(self) -> dict[str, float]:
        """Every parameter of the paper's model by its public name, SI; also those that no run can show."""
        worth, values = self.constants, {}
        for joint in self.robot.joints:
            j, n = joint.number - 1, joint.number
            if joint.is_revolute:
                values[f"gravity.l{n}.x"], values[f"gravity.l{n}.y"] = worth.x[j], worth.y[j]
            else:
                values[f"gravity.l{n}.mass"] = worth.mass[j]
            for kind, way in product(("coulomb", "viscous"), ("plus", "minus")):
                values[f"{kind}.j{n}.{way}"] = getattr(self.friction, f"{kind}_{way}")[j]
            if n < self.robot.n_joints:
                values[f"gain_ratio.{n}.{n + 1}"] = worth.ratio[j]
        return {name: float(value) for name, value in values.items()}

    def with_constants(self, given: Constants) -> Truth:
        """The same robot, known by these constants alone."""
        links, gain = links_of(self.robot, given, self.inertia)
        return replace(self, links=links, gain=gain, given_constants=given)

    def with_noise(self, std: float) -> Truth:
        """The same robot with `std` (A) as noise of every joint; 0 leaves none at all, nor any quantisation."""
        size = np.full(self.robot.n_joints, float(std))
        return replace(self, noise=replace(self.noise, std=size) if std > 0 else Noise(size))

    def typical(self) -> tuple[dict[str, float], ...]:
        """What is usual of every joint: its number, friction (A), what a plan asks of it (SI), and its loads (A)."""
        robot, coulomb = self.robot, self.coulomb
        low, high = np.array([span(joint) for joint in robot.joints]).T
        rng = np.random.default_rng(0)
        postures = low + rng.random((_POSTURES, robot.n_joints)) * (high - low)
        load, across = replace(self, hidden=()).carried(postures, np.zeros(_POSTURES))
        load[:, np.max(np.abs(load), axis=0) < _NOTHING * (np.max(np.abs(load)) or 1.0)] = 0.0
        table = {
            "joint": np.arange(1.0, len(low) + 1.0),
            "coulomb": coulomb,
            "coulomb_before": np.append(coulomb[1:2], coulomb)[: len(low)],
            "speed": np.minimum(highest_speeds(robot), np.where(robot.is_revolute, QUICKEST_TURN, QUICKEST_SLIDE)),
            "acceleration": accelerations(robot),
            "half_span": 0.5 * (high - low),
            "load": np.sqrt(np.mean(load**2, axis=0)),
            "peak_load": np.max(np.abs(load), axis=0),
            "across": np.sqrt(np.mean(across**2, axis=0)),
            "last_mass": np.full(len(low), self.links.mass[-1]),
            "reach": np.full(len(low), float(np.abs(robot.placements[:, :3, 3]).sum()) or 1.0),
        }
        return tuple({name: float(row[j]) for name, row in table.items()} for j in range(len(low)))


def draw(robot: Robot, seed: int) -> Truth:
    """A virtual robot with the recipe's geometry and whatever a recipe does not say drawn from `seed`.

    Masses follow the links' lengths and fall outward; centres of mass lie along the link, off its axes. Each motor is
    sized for the greatest load that its joint meets, so that gravity, friction and noise are in the proportions of real
    arms whatever the arm's size; some motors count their current against the joint's direction.
    """
    rng, sticking = np.random.default_rng([seed, 1]), np.random.default_rng([seed, 1, 1])
    n, (along, length, shortest) = robot.n_joints, link_sizes(robot)
    # 22 kg a metre of the first link, of each further one 0.72 of that of the link before.
    mass = 22.0 * np.maximum(length, shortest) * 0.72 ** np.arange(n) * rng.uniform(0.8, 1.25, n)
    across = shortest * rng.uniform(0.15, 0.6, (n, 3)) * rng.choice([-1.0, 1.0], (n, 3))
    links = Links(_shortened(mass), _shortened(along * rng.uniform(0.3, 0.6, (n, 1)) + across))
    # A motor is rated for the greatest load that gravity asks in any of many postures, with something to spare.
    # Turning joints stand at any angle, sliding joints where a plan may move them.
    share = rng.uniform(-np.pi, np.pi, (400, n)) / np.pi
    ends = np.array([(-np.pi, np.pi) if joint.is_revolute else span(joint) for joint in robot.joints])
    position = 0.5 * ends.sum(axis=1) + 0.5 * np.diff(ends, axis=1)[:, 0] * share
    load = np.max(np.abs(gravity_load(robot, links, position)[0]), axis=0)
    # Rounding of right angles is no load, and a motor sized for it would turn it into amperes.
    load[load < 1e-9 * np.sum(links.mass) * np.linalg.norm(robot.gravity)] = 0.0
    # A joint that never lifts (parallel to gravity) still has a motor: one for a tenth of the kind's greatest load.
    kinds = robot.is_revolute
    for kind in np.unique(kinds):
        largest = np.max(load[kinds == kind])
        load = np.where(kinds == kind, np.maximum(load, 0.1 * largest if largest > 0 else 1.0), load)
    capacity = load * rng.uniform(1.3, 2.2, n)
    sign = np.where(rng.random(n) < 0.25, -1.0, 1.0)
    gain = _shortened(sign * rng.uniform(3.0, 6.0, n) / capacity)  # A at its rated load
    # 65536 encoder counts a turn of the motor, or 1e6 a metre; a gear of 100 where the recipe states none.
    gears = np.array([joint.gear_ratio or 100.0 for joint in robot.joints])
    counts = np.where(robot.is_revolute, 65536 * np.abs(gears) / (2 * np.pi), 1e6)
    std = 0.02 * rng.uniform(0.7, 1.3, n)
    # Coulomb friction of 0.25 to 0.7 A and as much viscous current at the highest speed, each direction its own.
    coulomb = rng.uniform(0.25, 0.7, n)
    viscous = rng.uniform(0.25, 0.8, n) * coulomb / highest_speeds(robot)
    return Truth(
        robot=robot,
        friction=Friction(*(sign * rng.uniform(0.8, 1.2, (4, n)) * [coulomb, -coulomb, viscous, viscous])),
        noise=Noise(std, current_step=0.001, counts=np.asarray(np.round(counts), dtype=float)),
        links=links,
        gain=gain,
        inertia=sign * rng.uniform(0.3, 0.8, n) / accelerations(robot),
        seed=seed,
        breakaway=_shortened(sticking.uniform(1.05, 1.2, n)),
    )


def _shortened(values: Floats) -> Floats:
    return np.array([float(f"{value:.{_DIGITS}g}") for value in values.flat]).reshape(values.shape)
