"""An experiment on which the recursion goes astray: two postures, one ratio with the wrong sign."""

from __future__ import annotations

import numpy as np
import pytest

from pumaid.dataset import Dataset
from pumaid.estimation.estimate import identify
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.simulation import Bench, draw
from pumaid.trajectory import Motion, Plan

ARM, DESIGN = 21, 910_000


def thin(robot) -> Plan:
    """Every joint in two random postures, at two speeds, both ways, twice, in random order."""
    rng, motions = np.random.default_rng(DESIGN), []
    holds = {joint.number: [tuple(rng.uniform(-2.0, 2.0, 6)) for _ in range(2)] for joint in robot.joints}
    for _ in range(2):
        for joint in robot.joints:
            own = [
                Motion(joint.number, hold, -2.0 * way, 2.0 * way, speed)
                for hold in holds[joint.number]
                for speed in (0.3, 0.9)
                for way in (1, -1)
            ]
            motions += [own[k] for k in rng.permutation(len(own))]
    return Plan(robot.name, tuple(motions))


def test_the_joint_fit_leaves_a_wrong_minimum():
    """Every joint ends at its noise floor, and the ratio has its true size within four standard errors."""
    robot = read_recipe(shipped_recipes()["ur3e"])
    truth = draw(robot, ARM)
    runs = Bench(truth, thin(robot), rate=100.0, bins=128).runs(np.random.default_rng(DESIGN))
    estimate = identify(Dataset(runs), robot)
    assert all(one.rmse < 1.2 * one.noise_floor for one in estimate.joints)
    (ratio,) = (value for value in estimate.values if value.name == "gain_ratio.5.6")
    expected = truth.gain[4] / truth.gain[5]
    assert abs(ratio.value) == pytest.approx(abs(expected), abs=4.0 * ratio.std_error)
