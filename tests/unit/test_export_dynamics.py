"""Exported inverse dynamics of a model of any motion, beside a rigid-body engine's with gains and friction."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from pumaid.estimate import Estimate
from pumaid.exports import export
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.model import Model
from pumaid.rigid_body import base_parameters
from pumaid.robot import Robot
from tests.exported import EXACT, fitted, off
from tests.matlab_lines import as_python
from tests.unit.test_export_source import compiled, needs_gcc
from tests.worlds import random_arm

pin = pytest.importorskip("pinocchio", reason="the engine is pinocchio (pip install pumaid[test])")
engines = pytest.importorskip("engines")

#: Sums of a hundred products in another order, and values of base parameters by least squares.
CLOSE = 1e3 * EXACT


@cache
def case(name: str) -> tuple[Robot, Estimate, list[np.ndarray], np.ndarray]:
    """An arm, a model with its true inertia, motions (3 of (N, J)) and the engine's currents."""
    rng = np.random.default_rng(8)
    robot = read_recipe(shipped_recipes()[name]) if name in shipped_recipes() else random_arm(name, rng)
    n, model, body = robot.n_joints, Model(robot, is_dynamic=True), base_parameters(robot)
    engine = engines.pinocchio_model(robot, [pin.Inertia.Random() for _ in robot.joints])
    engine.armature = rng.uniform(0.1, 1.0, n)

    def torques(motion: list[np.ndarray]) -> np.ndarray:
        data = engine.createData()
        return np.array([pin.rnea(engine, data, *state) for state in zip(*motion, strict=True)])

    motion = [rng.normal(0.0, size, (200, n)) for size in (1.5, 2.0, 6.0)]
    rows = body.rows(*(part.T for part in motion))
    table = np.vstack([np.pad(part.T, ((0, 0), (len(rows[0]) - len(part), 0))) for part in rows])
    values = np.linalg.lstsq(table, torques(motion).T.ravel(), rcond=None)[0]
    gain, links = rng.uniform(0.2, 0.5, n) * rng.choice([-1.0, 1.0], n), np.array([link for link, _ in body.names])
    solution = rng.uniform(0.1, 1.0, len(model.columns))
    solution[model.inertial] = gain[links - 1] * values
    scales = np.triu(gain[:, None] / gain)
    estimate = replace(fitted(robot), names=model.names, solution=solution, scales=scales)
    friction = dict(zip(model.names, solution.tolist(), strict=True))
    ways = np.where(motion[1] > 0, "plus", "minus")
    currents = gain * torques(motion)
    for joint in range(n):
        for row, way in enumerate(ways[:, joint]):
            slowed = friction[f"viscous.j{joint + 1}.{way}"] * motion[1][row, joint]
            currents[row, joint] += friction[f"coulomb.j{joint + 1}.{way}"] + slowed
    return robot, estimate, [part[:20] for part in motion], currents[:20]


NAMES = ("puma560", "stanford", "RRPRR")


@needs_gcc
@pytest.mark.parametrize("name", NAMES)
def test_c(name: str, tmp_path: Path):
    """Gravity, friction and inertia add up to what the engine asks."""
    robot, estimate, motion, wanted = case(name)
    call = compiled(tmp_path, robot, estimate)
    rows = list(zip(*motion, strict=True))
    assert off(np.array([call("dynamics", *row, None) for row in rows]), wanted) < CLOSE
    parts = [call("current", *row[:2], None) + call("inertia", *row) for row in rows]
    assert off(np.array(parts), wanted) < CLOSE


@pytest.mark.parametrize("name", NAMES)
def test_python(name: str):
    """Many postures at once, or one."""
    robot, estimate, motion, wanted = case(name)
    space: dict = {}
    exec(export(estimate, robot, form="python").files[".py"], space)
    assert off(space["dynamics"](*motion), wanted) < CLOSE
    assert off(space["dynamics"](*(part[0] for part in motion))[None], wanted[:1]) < CLOSE


@pytest.mark.parametrize("name", NAMES)
def test_matlab(name: str):
    """With accelerations the total has inertia in it."""
    robot, estimate, (q, qd, qdd), wanted = case(name)
    run = as_python(export(estimate, robot, form="matlab", name="arm").files[".m"], "arm")
    assert off(np.array([run(q[k], qd[k], np.sign(qd[k]), qdd[k])[0] for k in range(4)]), wanted[:4]) < CLOSE


@pytest.mark.parametrize("name", NAMES)
def test_json(name: str):
    """Its reference is the engine's current, and links without inertia have none in the table."""
    robot, estimate, *_ = case(name)
    document = json.loads(export(estimate, robot, form="json").files[".json"])
    space: dict = {}
    exec(export(estimate, robot, form="python").files[".py"], space)
    for row in document["reference"]:
        drawn = np.array(row["current"]) + row["inertia"]
        np.testing.assert_allclose(drawn, space["dynamics"](row["q"], row["qd"], row["qdd"]), rtol=1e-8, atol=1e-9)
    assert np.shape(document["bodies"]) == (robot.n_joints, 11)


def test_a_model_of_constant_speed_has_no_inertia():
    """Its files have no function of accelerations."""
    robot = read_recipe(shipped_recipes()["puma560"])
    assert "qdd" not in export(fitted(robot), robot, form="python").files[".py"]
