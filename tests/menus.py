"""Small menus of laps for tests of the planner, and slow, obvious readings of what they tell."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from pumaid.clearance import Clearance
from pumaid.design.assume import Assumed, drawn
from pumaid.design.laps import courses, free, speeds
from pumaid.design.menu import Menu, Ways, menu
from pumaid.design.outlook import existing
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.records import Motion
from pumaid.robot import Robot
from pumaid.simulation.ranges import candidates
from pumaid.structure import minimal


@cache
def arm(name: str) -> Robot:
    """A shipped recipe."""
    return read_recipe(shipped_recipes()[name])


@cache
def assumed(name: str, seed: int = 1) -> Assumed:
    """Robots drawn from a shipped recipe."""
    return drawn(arm(name), seed)


def names(robot: Robot) -> list[str]:
    """Gravity parameters and ratios that an arm has."""
    return existing(robot, minimal(robot))


@cache
def small_menu(name: str, *, postures: int = 4, shares: tuple[float, ...] = (0.1, 0.4, 1.0), seed: int = 1) -> Menu:
    """Laps of a shipped arm in a few random postures, for two drawn robots."""
    robot, rng, ways = arm(name), np.random.default_rng(seed), []
    for joint in range(1, robot.n_joints + 1):
        others = [k for k in range(1, robot.n_joints + 1) if k != joint]
        holds = candidates(robot, joint, free=others, count=postures, rng=rng)[-postures:]
        some = courses(robot, joint, speeds(robot, joint, shares))
        ways.append(Ways(joint, holds, some, free(Clearance.of(robot), holds, some)))
    return menu(assumed(name, seed).truths[:2], ways, names=names(robot), rate=100.0)


def motions_of(found: Menu, laps: Sequence[int]) -> list[Motion]:
    """The runs of some laps."""
    out = []
    for lap in laps:
        joint, hold = found.block_of(lap)
        out += found.course_of(lap).motions(tuple(found.of(joint).holds[hold].tolist()))
    return out
