"""Exported inverse dynamics of a model of any motion, beside a rigid-body engine's with gains and friction."""

import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from pumaid.estimate import Estimate
from pumaid.estimation.estimate import identify
from pumaid.exports import export
from pumaid.exports.possible_bodies import possible
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.model import Model
from pumaid.preprocessing.segment import segment
from pumaid.rigid_body import base_parameters
from pumaid.robot import Robot
from pumaid.simulation import draw
from pumaid.simulation.mujoco_engine import RigidArm
from tests.exported import EXACT, fitted, off
from tests.free_motion import reach, recorded, waves
from tests.matlab_lines import as_python
from tests.unit.test_export_source import compiled, needs_gcc
from tests.worlds import random_arm

pin = pytest.importorskip("pinocchio", reason="an engine is pinocchio (pip install pumaid[test])")
mujoco = pytest.importorskip("mujoco", reason="an engine is mujoco (pip install pumaid[test])")
engines = pytest.importorskip("engines")

#: Sums of a hundred products in another order, and values of base parameters by least squares.
CLOSE = 1e3 * EXACT


def cloud(rng: np.random.Generator) -> "pin.Inertia":
    """A body that is possible: a cloud of points about its centre of mass."""
    mass, size = rng.uniform(0.3, 8.0), rng.normal(0.0, 0.06, (3, 3))
    spread = mass * size @ size.T
    return pin.Inertia(mass, rng.normal(0.0, 0.1, 3), np.trace(spread) * np.eye(3) - spread)


@cache
def case(name: str) -> tuple[Robot, Estimate, list[np.ndarray], np.ndarray, dict[int, float]]:
    """An arm, a model with its true inertia, motions (3 of (N, J)), the engine's currents, and torque constants.

    Behind a bar stand arms of which the first joint is upright.
    """
    rng = np.random.default_rng(8)
    robot = read_recipe(shipped_recipes()[name]) if name in shipped_recipes() else random_arm(name.strip("|"), rng)
    if name[0] == "|":
        robot = replace(robot, joints=(replace(robot.joints[0], alpha=0.0), *robot.joints[1:]))
    n, model, body = robot.n_joints, Model(robot, is_dynamic=True), base_parameters(robot)
    engine = engines.pinocchio_model(robot, [cloud(rng) for _ in robot.joints])
    engine.armature = rng.uniform(0.1, 1.0, n)

    def torques(motion: list[np.ndarray]) -> np.ndarray:
        data = engine.createData()
        return np.array([pin.rnea(engine, data, *state) for state in zip(*motion, strict=True)])

    motion = [rng.normal(0.0, size, (200, n)) for size in (1.5, 2.0, 6.0)]
    rows = body.rows(*(part.T for part in motion))
    table = np.vstack([np.pad(part.T, ((0, 0), (len(rows[0]) - len(part), 0))) for part in rows])
    # Coulomb friction takes up what is the same in every posture.
    same = np.repeat(np.eye(n)[:, ~robot.is_revolute], 200, axis=0)
    values = np.linalg.lstsq(np.hstack([table, same]), torques(motion).T.ravel(), rcond=None)[0]
    held = np.zeros(n)
    held[~robot.is_revolute], values = values[table.shape[1] :], values[: table.shape[1]]
    gain, links = rng.uniform(0.2, 0.5, n) * rng.choice([-1.0, 1.0], n), np.array([link for link, _ in body.names])
    solution = rng.uniform(0.1, 1.0, len(model.columns))
    if name[0] == "|":
        solution[model.names.index("coulomb.j1.minus")] = -solution[model.names.index("coulomb.j1.plus")]
    solution[model.inertial] = gain[links - 1] * values
    scales = np.triu(gain[:, None] / gain)
    errors, blind = np.zeros((len(solution),) * 2), np.zeros((len(solution), 0))
    changed = {"names": model.names, "solution": solution, "scales": scales, "covariance": errors, "blind": blind}
    estimate = replace(fitted(robot), **changed)
    friction = dict(zip(model.names, solution.tolist(), strict=True))
    ways = np.where(motion[1] > 0, "plus", "minus")
    currents = gain * torques(motion)
    for joint in range(n):
        for row, way in enumerate(ways[:, joint]):
            slowed = friction[f"viscous.j{joint + 1}.{way}"] * motion[1][row, joint]
            currents[row, joint] += friction[f"coulomb.j{joint + 1}.{way}"] + slowed
        for way in ("plus", "minus"):
            solution[model.names.index(f"coulomb.j{joint + 1}.{way}")] += gain[joint] * held[joint]
    constants = dict(enumerate((1.0 / gain).tolist(), start=1))
    return robot, estimate, [part[:20] for part in motion], currents[:20], constants


NAMES = ("puma560", "stanford", "RRPRR")


@needs_gcc
@pytest.mark.parametrize("name", NAMES)
def test_c(name: str, tmp_path: Path):
    """Gravity, friction and inertia add up to what the engine asks."""
    robot, estimate, motion, wanted, _ = case(name)
    call = compiled(tmp_path, robot, estimate)
    rows = list(zip(*motion, strict=True))
    assert off(np.array([call("dynamics", *row, None) for row in rows]), wanted) < CLOSE
    parts = [call("current", *row[:2], None) + call("inertia", *row) for row in rows]
    assert off(np.array(parts), wanted) < CLOSE


@pytest.mark.parametrize("name", NAMES)
def test_python(name: str):
    robot, estimate, motion, wanted, _ = case(name)
    space: dict = {}
    exec(export(estimate, robot, form="python").files[".py"], space)
    assert off(space["dynamics"](*motion), wanted) < CLOSE
    assert off(space["dynamics"](*(part[0] for part in motion))[None], wanted[:1]) < CLOSE


@pytest.mark.parametrize("name", NAMES)
def test_matlab(name: str):
    robot, estimate, (q, qd, qdd), wanted, _ = case(name)
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


def by_pinocchio(found, gravity: float, motion) -> np.ndarray:
    """(N, J) N m of inverse dynamics of an exported URDF, with the rotors that its head tells."""
    model = pin.buildModelFromXML(found.files[".urdf"])
    (rotors,) = (lack.reason for lack in found.left_out if lack.name == "inertia of rotors")
    model.armature = np.array(re.search(r"set (.*?) kg m2", rotors)[1].split(", "), dtype=float)
    model.gravity.linear, data = np.array([0.0, 0.0, -gravity]), model.createData()
    rows = [(pin.integrate(model, pin.neutral(model), q), qd, qdd) for q, qd, qdd in zip(*motion, strict=True)]
    return np.array([pin.rnea(model, data, *row) for row in rows])


def loads(robot: Robot, estimate: Estimate, motion) -> np.ndarray:
    """(N, J) A of weight and inertia, by the exported Python."""
    space: dict = {}
    exec(export(estimate, robot, form="python").files[".py"], space)
    return space["dynamics"](*motion) - space["friction"](*motion[:2])


@pytest.mark.parametrize("name", ["puma560", "ur5e", "panda", "stanford", "RRPRR", "|PRR"])
def test_bodies_have_the_loads_of_the_model(name: str):
    """MuJoCo of the MJCF and pinocchio of the URDF ask what the model does, motors that count backwards among them."""
    robot, estimate, motion, _, constants = case(name)
    wanted = loads(robot, estimate, motion)
    if name[0] == "|":  # the weight of what slides is in its friction
        values = dict(zip(estimate.names, estimate.solution, strict=True))
        wanted[:, 0] += 0.5 * (values["coulomb.j1.plus"] + values["coulomb.j1.minus"])
    wanted = wanted * [*constants.values()]
    mjcf, urdf = (export(estimate, robot, form=form, torque_constants=constants) for form in ("mjcf", "urdf"))
    assert off(engines.by_mujoco(mujoco.MjModel.from_xml_string(mjcf.files[".xml"]), motion), wanted) < 1e-8
    assert off(by_pinocchio(urdf, np.linalg.norm(robot.gravity), motion), wanted) < 1e-8
    assert [text for text in mjcf.remarks if "of all possible links" in text]
    assert not [text for text in mjcf.remarks if "RMS" in text]


@pytest.mark.parametrize("seconds", [8.0, 30.0])
def test_bodies_of_an_arm_at_work_move_as_it_does(seconds: float):
    """Logs tell inertia that no links have: the nearest load MuJoCo no farther from the true arm than the model is, and
    how far from the model that is, is told.
    """
    robot, rng = read_recipe(shipped_recipes()["ur5e"]), np.random.default_rng(31)
    truth = draw(robot, 31)
    log = recorded(truth, waves(rng, seconds, reach(robot)), rng, counts=2e4)
    estimate = identify(segment([log], robot), robot)
    found = export(estimate, robot, form="mjcf", torque_constants={2: 1.0 / float(truth.gain[1])})
    far = [text for text in found.remarks if "no possible links" in text]
    model = mujoco.MjModel.from_xml_string(found.files[".xml"])
    size = np.array([[np.pi], *([[joint.max_velocity * k] for joint in robot.joints[:1] for k in (1.0, 2.5)])])
    motion = rng.uniform(-1.0, 1.0, (3, 2000, 6)) * size[:, :, None]
    told = loads(robot, estimate, motion)
    asked = engines.by_mujoco(model, motion) / model.actuator_gear[:, 0]
    true = engines.by_mujoco(RigidArm(truth, step=0.001).model, motion) * truth.gain
    rms = [np.sqrt(np.mean((a - b) ** 2, axis=0)) for a, b in ((told, true), (asked, true), (asked, told), (true, 0))]
    assert (rms[1] < 1.1 * rms[0]).all() and (rms[1] < 0.1 * rms[3]).all()
    moved = [float(text.split()[5]) for text in found.remarks if "RMS" in text] / np.abs(model.actuator_gear[:, 0])
    assert np.allclose(moved, rms[2], rtol=0.2)  # two hundred states against two thousand
    assert len(far) == 1 and "noise alone" not in far[0]


def test_the_nearest_possible_links_are_the_nearest():
    """Beside least squares over Cholesky factors of pseudo-inertias, which knows nothing of divergences."""
    rng, n = np.random.default_rng(3), 1
    sums, wanted = rng.normal(size=(9, 11 * n)), rng.normal(size=9)
    errors = np.diag(rng.uniform(0.5, 2.0, 9))
    guess = np.tile([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0], (n, 1))
    links, distance = possible(guess, sums, wanted, covariance=errors)

    def parameters(factors: np.ndarray) -> np.ndarray:
        lower = np.zeros((n, 4, 4))
        lower[:, *np.tril_indices(4)] = factors.reshape(n, 11)[:, :10]
        whole = lower @ lower.transpose(0, 2, 1)
        moments = np.trace(whole[:, :3, :3], axis1=1, axis2=2)[:, None, None] * np.eye(3) - whole[:, :3, :3]
        a, b = np.triu_indices(3)
        parts = whole[:, 3, [3]], whole[:, 3, :3], moments[:, a, b], factors.reshape(n, 11)[:, 10:] ** 2
        return np.hstack(parts)

    def missed(values: np.ndarray) -> np.ndarray:
        return (sums @ values.ravel() - wanted) / np.sqrt(np.diag(errors))

    slow = min(
        (least_squares(lambda x: missed(parameters(x)), rng.normal(size=11 * n)) for _ in range(3)),
        key=lambda found: found.cost,
    )
    assert distance is not None and distance > 0.3
    assert np.isclose(distance**2, 2.0 * slow.cost, atol=0.02) and np.isclose(np.linalg.norm(missed(links)), distance)


def test_a_model_of_constant_speed_has_no_inertia():
    robot = read_recipe(shipped_recipes()["puma560"])
    assert "qdd" not in export(fitted(robot), robot, form="python").files[".py"]
