"""Gravity's loads and their slopes against finite differences of the model's own regressor."""

from dataclasses import replace

import numpy as np
import pytest

from pumaid.effects import Samples
from pumaid.model import Model, loads, loads_along
from pumaid.simulation import table1
from tests.worlds import STANFORD

PUMA = table1.robot()

STEP = 1e-5


def arm(robot):
    """A model of `robot` with drawn parameters and ratios of gains, and a function of its load."""
    model, rng = Model(robot), np.random.default_rng(5)
    gains = rng.uniform(0.5, 2.0, robot.n_joints)
    scales = np.triu(gains[:, None] / gains[None, :])
    solution = rng.uniform(-1.0, 1.0, len(model.columns))
    heavy = np.array([column.effect == "gravity" for column in model.columns])

    def own(samples, gravity=robot.gravity):
        turned = Model(robot)
        turned.robot = replace(robot, gravity=tuple(gravity))
        rows = turned.regressor(samples) * heavy
        return (rows * scales[samples.joint - 1][model.owners - 1]) @ solution

    return model, scales, solution, own


def instants(robot, joint):
    """Random postures."""
    position = np.random.default_rng(joint).uniform(-2.0, 2.0, (30, robot.n_joints))
    return Samples(joint, position, np.full_like(position, 0.3), np.zeros(30), np.ones(30))


@pytest.mark.parametrize("joint", range(1, 7))
@pytest.mark.parametrize("robot", [PUMA, STANFORD], ids=["puma", "stanford"])
def test_loads_and_slopes_are_those_of_the_regressor(robot, joint):
    """Load, its slope by every joint's position and by a turn of the base, by central differences."""
    model, scales, solution, own = arm(robot)
    samples = instants(robot, joint)
    found = loads(model, samples, solution=solution, scales=scales)
    assert np.allclose(found.moving, own(samples), atol=1e-12)
    assert np.allclose(found.by_joint[:, joint - 1], found.moving, atol=1e-12)
    for k, step in enumerate(np.eye(robot.n_joints) * STEP):
        ends = [own(replace(samples, position=samples.position + sign * step)) for sign in (1, -1)]
        assert np.allclose((ends[0] - ends[1]) / (2 * STEP), found.slopes[:, k], atol=1e-6)
    g = np.array(robot.gravity)
    for k, axis in enumerate(np.eye(3)[:2] * STEP):  # the base turns by axis: gravity turns back in its frame
        ends = [own(samples, g - sign * np.cross(axis, g)) for sign in (1, -1)]
        assert np.allclose((ends[0] - ends[1]) / (2 * STEP), found.tilts[:, k], atol=1e-6)


def test_unknown_ratio_hides_another_joints_load_and_its_gain():
    """Where eta2/eta3 is not known the load of joint 2 is not, nor the gain between them; joint 3's own is."""
    model, scales, solution, _ = arm(PUMA)
    scales = scales.copy()
    scales[1, 2:] = np.nan
    found = loads(model, instants(PUMA, 3), solution=solution, scales=scales)
    assert np.isnan(found.by_joint[:, 1]).all() and np.isfinite(found.moving).all()
    assert np.isnan(found.gains[1]) and np.isfinite(found.gains[2:]).all()


def swung(robot, joint):
    """Three runs in which `joint` alone moves."""
    rng, sizes = np.random.default_rng(joint), np.array([40, 25, 60])
    position = np.repeat(rng.uniform(-2.0, 2.0, (3, robot.n_joints)), sizes, axis=0)
    position[:, joint - 1] = rng.uniform(-3.0, 3.0, len(position))
    velocity = rng.uniform(-1.0, 1.0, position.shape)
    return Samples(joint, position, velocity, np.zeros(125), np.sign(velocity[:, joint - 1])), sizes


@pytest.mark.parametrize("joint", range(1, 7))
@pytest.mark.parametrize("robot", [PUMA, STANFORD], ids=["puma", "stanford"])
def test_loads_along_runs_are_the_loads(robot, joint):
    """While one joint moves alone, five positions of a run say what its load is at all others."""
    model, scales, solution, _ = arm(robot)
    scales[0, 4] = np.nan  # an unknown ratio
    samples, sizes = swung(robot, joint)
    ours = loads_along(model, samples, sizes, solution=solution, scales=scales)
    theirs = loads(model, samples, solution=solution, scales=scales)
    for name in ("moving", "by_joint", "slopes", "tilts", "across", "drawn", "gains"):
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), atol=1e-12, err_msg=name)
