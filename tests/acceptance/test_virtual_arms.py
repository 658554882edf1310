"""Planned, simulated, found again: arms drawn from recipes, through logs to parameters."""

from functools import cache

import numpy as np
import pytest

from pumaid.dataset import Dataset
from pumaid.design.information import gravity_names, predicted_errors
from pumaid.design.plan import plan
from pumaid.estimation.estimate import identify
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.model import minimal
from pumaid.preprocessing.hold_out import match_with_plan
from pumaid.preprocessing.segment import segment
from pumaid.robot import Robot
from pumaid.simulation import Bench, draw, simulate
from pumaid.trajectory import Plan

pytestmark = pytest.mark.slow


def arm(name: str) -> Robot:
    """A shipped recipe."""
    return read_recipe(shipped_recipes()[name])


#: Robots that no tuning saw.
SEEDS = {"puma560": 104, "stanford": 111}


@cache
def session(name: str) -> tuple[Plan, Dataset, np.ndarray]:
    """A drawn robot's session: plan, runs in its logs, and the errors of its parameters in standard errors."""
    robot, seed = arm(name), SEEDS[name]
    made, truth = plan(robot, minutes=12, seed=9), draw(robot, seed)
    logs = simulate(robot, made, seed=seed, truth=truth, rate=100.0)
    dataset = match_with_plan(segment(logs, robot), made)
    known = truth.parameters()
    values = [v for v in identify(dataset, robot).values if v.value is not None and v.name in known]
    return made, dataset, np.array([(v.value - known[v.name]) / v.std_error for v in values])


def test_truth_is_found_through_logs():
    """Parameters of two robots lie as far from the truth as their standard errors say, of each and of all."""
    errors = [session(name)[2] for name in SEEDS]
    # Some 38 parameters a robot, correlated in pairs, know their RMS to a fifth, two robots to a seventh; intervals
    # of some twenty degrees of freedom leave 5 to 7 % beyond 2 standard errors, give or take 2.
    assert all(0.6 < np.sqrt(np.mean(off**2)) < 1.6 for off in errors)
    off = np.concatenate(errors)
    assert 0.7 < np.sqrt(np.mean(off**2)) < 1.4
    assert np.mean(np.abs(off) > 2.0) < 0.13


def test_planned_runs_are_found_and_held_out():
    """Every planned run of a session is found in its logs, and those for judging are kept from the fit."""
    made, dataset, _ = session("puma560")
    assert [note.slug for note in dataset.notes] == []
    planned = sum(motion.purpose == "heldout" for motion in made.motions)
    # A move between postures may happen to repeat a run for judging.
    assert planned <= sum(run.heldout for run in dataset.runs) <= planned + 3


def test_forecast_is_what_experiments_scatter():
    """Over 40 experiments the joint estimate scatters by the predicted standard errors."""
    robot = arm("pendulum2")
    made, truth = plan(robot, minutes=6, seed=9), draw(robot, 105)
    names = [name for name in gravity_names(robot) if name not in minimal(robot).absent]
    promised = predicted_errors([truth], made.motions, names)
    bench, rng = Bench(truth, made, rate=50.0), np.random.default_rng(106)
    found = [identify(Dataset(bench.runs(rng)), robot) for _ in range(40)]
    # 40 experiments know a scatter to 11 %; three times that.
    for name, error in promised.items():
        scatter = np.std([estimate.value(name).value for estimate in found])
        assert scatter == pytest.approx(error, rel=0.34), name
