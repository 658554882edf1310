"""A plausible robot for a recipe: masses, motors, friction and noise drawn from a seed."""

import numpy as np

from pumaid.maths import Floats
from pumaid.robot import Robot
from pumaid.simulation.virtual_robot import Friction, Links, Noise, Truth, gravity_load, lengthwise
from pumaid.trajectory import accelerations, highest_speeds, span

#: kg a metre of an arm's first link; links grow lighter outward.
_LINK_DENSITY = 22.0
#: A link's body where the geometry gives it no length (a wrist), as a share of the arm's reach.
_SHORTEST = 0.08
#: A link's mass against that of the link before, at equal length.
_TAPER = 0.72
#: A: current at which a motor gives its rated load.
_RATED = (3.0, 6.0)
#: Motor encoder counts a turn, and the gear taken where the recipe states none.
_COUNTS, _GEAR = 65536, 100.0
#: Counts a metre of a sliding joint.
_COUNTS_PER_METRE = 1e6
#: A: noise of a sample, and resolution of the current sensor.
_NOISE, _CURRENT_STEP = 0.02, 0.001
#: Break-away friction as a multiple of Coulomb friction.
_BREAKAWAY = (1.05, 1.2)
#: Significant digits of what is drawn: the last ones of a sum differ between machines, a robot must not.
_DIGITS = 9


def draw(robot: Robot, seed: int) -> Truth:
    """A virtual robot with the recipe's geometry and whatever a recipe does not say drawn from `seed`.

    Masses follow the links' lengths and fall outward; centres of mass lie along the link, off its axes. Each motor is
    sized for the greatest load that its joint meets, so that gravity, friction and noise are in the proportions of real
    arms whatever the arm's size; some motors count their current against the joint's direction.
    """
    rng, sticking = np.random.default_rng([seed, 1]), np.random.default_rng([seed, 1, 1])
    n, along = robot.n_joints, lengthwise(robot)
    length = np.linalg.norm(along, axis=1)
    shortest = _SHORTEST * (np.sum(length) or 1.0)
    mass = _LINK_DENSITY * np.maximum(length, shortest) * _TAPER ** np.arange(n) * rng.uniform(0.8, 1.25, n)
    across = shortest * rng.uniform(0.15, 0.6, (n, 3)) * rng.choice([-1.0, 1.0], (n, 3))
    links = Links(_shortened(mass), _shortened(along * rng.uniform(0.3, 0.6, (n, 1)) + across))
    # A motor is rated for the greatest load that gravity asks in any of many postures, with something to spare.
    # Turning joints stand at any angle, sliding joints where a plan may move them.
    share = rng.uniform(-np.pi, np.pi, (400, n)) / np.pi
    ends = np.array([(-np.pi, np.pi) if joint.is_revolute else span(joint) for joint in robot.joints])
    position = 0.5 * ends.sum(axis=1) + 0.5 * np.diff(ends, axis=1)[:, 0] * share
    load = np.max(np.abs(gravity_load(robot, links, position)), axis=0)
    # Rounding of right angles is no load, and a motor sized for it would turn it into amperes.
    load[load < 1e-9 * np.sum(links.mass) * np.linalg.norm(robot.gravity)] = 0.0
    # A joint that never lifts (parallel to gravity) still has a motor: one for a tenth of the kind's greatest load.
    kinds = robot.is_revolute
    for kind in np.unique(kinds):
        largest = np.max(load[kinds == kind])
        load = np.where(kinds == kind, np.maximum(load, 0.1 * largest if largest > 0 else 1.0), load)
    capacity = load * rng.uniform(1.3, 2.2, n)
    sign = np.where(rng.random(n) < 0.25, -1.0, 1.0)
    gain = _shortened(sign * rng.uniform(*_RATED, n) / capacity)
    gears = np.array([joint.gear_ratio or _GEAR for joint in robot.joints])
    counts = np.where(robot.is_revolute, _COUNTS * np.abs(gears) / (2 * np.pi), _COUNTS_PER_METRE)
    std = _NOISE * rng.uniform(0.7, 1.3, n)
    # Coulomb friction of 0.25 to 0.7 A and as much viscous current at the highest speed, each direction its own.
    coulomb = rng.uniform(0.25, 0.7, n)
    viscous = rng.uniform(0.25, 0.8, n) * coulomb / highest_speeds(robot)
    uneven = rng.uniform(0.8, 1.2, (4, n))
    return Truth(
        robot=robot,
        friction=Friction(*(sign * uneven * [coulomb, -coulomb, viscous, viscous])),
        noise=Noise(std, current_step=_CURRENT_STEP, counts=np.asarray(np.round(counts), dtype=float)),
        links=links,
        gain=gain,
        inertia=sign * rng.uniform(0.3, 0.8, n) / accelerations(robot),
        seed=seed,
        breakaway=_shortened(sticking.uniform(*_BREAKAWAY, n)),
    )


def _shortened(values: Floats) -> Floats:
    """Each to `_DIGITS` significant digits."""
    return np.array([float(f"{value:.{_DIGITS}g}") for value in values.flat]).reshape(values.shape)
