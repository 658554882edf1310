"""Gravity of the virtual robot and of the regressor against a rigid-body engine that knows masses and no regressors."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from paper_recursion import gravity_current
from urdfs import span_miss
from worlds import random_arm

from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.robot import Robot
from pumaid.simulation import Links, constants, gravity_load

pin = pytest.importorskip("pinocchio", reason="the engine is pinocchio (pip install pumaid[test])")
engines = pytest.importorskip("engines")

#: Relative to the largest torque (N m or N): what sums of a dozen products lose in double precision, times 1e3.
EXACT = 1e-9
STRINGS = ["".join(kinds) for n in range(1, 6) for kinds in product("RP", repeat=n)]


def random_links(robot: Robot, rng: np.random.Generator) -> Links:
    """A random mass at a random place on every link."""
    return Links(rng.uniform(0.5, 10.0, robot.n_joints), rng.uniform(-0.3, 0.3, (robot.n_joints, 3)))


def holding(robot: Robot, links: Links, position: np.ndarray) -> np.ndarray:
    """(N, J) torques and forces that hold the arm still, by the engine."""
    bodies = [pin.Inertia(mass, centre, np.eye(3)) for mass, centre in zip(links.mass, links.centre, strict=True)]
    return engines.held_by_pinocchio(engines.pinocchio_model(robot, bodies), position)


def postures(robot: Robot, rng: np.random.Generator, *, count: int = 80) -> np.ndarray:
    span = np.where(robot.is_revolute, np.pi, 0.5)
    return rng.uniform(-span, span, (count, robot.n_joints))


def miss(robot: Robot, rng: np.random.Generator) -> float:
    """Largest relative error of the columns for the engine's torques, on postures that were not fitted."""
    position = postures(robot, rng)
    return span_miss(robot, position, holding(robot, random_links(robot, rng), position).T)


def some_arm(kinds: str, rng: np.random.Generator, *, special: bool) -> Robot:
    """A random arm of the given joints (R, P); special twists are quarter turns, and gravity then along an axis."""
    robot = random_arm(kinds, rng)
    if not special:
        return robot
    twists = rng.integers(-1, 3, (len(kinds), 2)) * np.pi / 2
    joints = [replace(joint, theta=a, alpha=b) for joint, (a, b) in zip(robot.joints, twists, strict=True)]
    return replace(robot, joints=tuple(joints), gravity=(0.0, 0.0, -9.80665))


@pytest.mark.parametrize("special", [False, True])
def test_virtual_robots_weigh_what_the_engine_says(special: bool) -> None:
    """What holds a virtual robot still is the engine's from the same masses, and the paper's recursion's in amperes."""
    rng = np.random.default_rng(11)
    for kinds in [*STRINGS[::5], "RRPRRR", "PPRRPR", "RRRRRR", "RPPRPRR"]:
        robot = some_arm(kinds, rng, special=special)
        links, position = random_links(robot, rng), postures(robot, rng, count=20)
        wanted, load = holding(robot, links, position), gravity_load(robot, links, position)[0]
        least = 1e-11 * max(np.abs(wanted).max(), np.linalg.norm(robot.gravity))
        assert np.abs(load - wanted).max() < least
        gain = rng.uniform(0.1, 2.0, robot.n_joints) * rng.choice([-1.0, 1.0], robot.n_joints)
        recursive = gravity_current(robot, constants(robot, links, gain), position)
        assert np.abs(recursive - load * gain).max() < 4.0 * least


@pytest.mark.parametrize("name", sorted(shipped_recipes()))
def test_shipped_arms_lie_in_the_span(name: str) -> None:
    """Gravity of random links of a shipped arm is a combination of the columns, exactly, on postures not fitted."""
    robot = read_recipe(shipped_recipes()[name])
    assert miss(robot, np.random.default_rng(3)) < EXACT


@pytest.mark.parametrize("special", [False, True])
def test_random_arms_lie_in_the_span(special: bool) -> None:
    """The same for every string of revolute and prismatic joints up to five, at random and at special twists."""
    rng = np.random.default_rng(11)
    arms = [some_arm(kinds, rng, special=special) for kinds in STRINGS if "R" in kinds or not special]
    worst = {arm.name: miss(arm, rng) for arm in arms}
    assert max(worst.values()) < EXACT, max(worst, key=worst.__getitem__)
