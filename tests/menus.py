"""Small sets of candidate runs for tests of the planner."""

from functools import cache
from pathlib import Path

import numpy as np

from pumaid.design.candidate_runs import free_blocks, postures, speeds, sweeps
from pumaid.design.collision import Collision
from pumaid.design.information import CandidateInformation, Prior, candidate_information, prior_robots, shown_names
from pumaid.io.plan_file import plan_text
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.robot import Robot
from pumaid.trajectory import Motion, Plan


@cache
def arm(name: str) -> Robot:
    """A shipped recipe."""
    return read_recipe(shipped_recipes()[name])


@cache
def prior(name: str, seed: int = 1) -> Prior:
    """Robots drawn from a shipped recipe."""
    return prior_robots(arm(name), seed=seed)


@cache
def small_set(name: str, *, count: int = 4, shares: tuple[float, ...] = (0.1, 0.4, 1.0)) -> CandidateInformation:
    """Candidates of a shipped arm in a few random postures, for two drawn robots."""
    robot, rng, blocks = arm(name), np.random.default_rng(1), []
    for joint in range(1, robot.n_joints + 1):
        holds = postures(robot, joint, count=count, rng=rng)[-count:]
        ways = sweeps(robot, joint, speeds(robot, joint, shares))
        blocks += free_blocks(Collision(robot), holds, ways)
    return candidate_information(prior(name).robots[:2], blocks, names=shown_names(robot))


def write_short_plan(path: Path) -> None:
    """A plan of four short runs of the pendulum, in the form that the file's name says."""
    ways = [(joint, end, -end) for joint in (1, 2) for end in (0.3, -0.3)]
    motions = tuple(Motion(joint, (0.3, 0.3), start, end, 1.0) for joint, start, end in ways)
    plan = Plan(arm("pendulum2").name, motions)
    path.write_text(plan_text(plan, arm("pendulum2"), format=path.suffix[1:]), encoding="utf-8")
