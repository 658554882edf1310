"""The gravity regressor against a rigid-body engine that knows masses and centres of mass, and no regressors."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from pumaid.effects.gravity import Gravity
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.robot import Joint, Robot
from pumaid.samples import Samples

pin = pytest.importorskip("pinocchio", reason="the engine is pinocchio (pip install pumaid[test])")

#: Relative to the largest torque (N m or N): what sums of a dozen products lose in double precision, times 1e3.
EXACT = 1e-9
#: Singular values below this share of gravity are zero; random geometry leaves a gap from 1e-2 to 1e-13.
RANK = 1e-9


def engine(robot: Robot, rng: np.random.Generator) -> pin.Model:
    """The recipe's chain with a random mass at a random place on every link."""
    model, parent = pin.Model(), 0
    for joint in robot.joints:
        before = pin.SE3(pin.utils.rotate("x", joint.alpha), np.array([joint.a, 0.0, 0.0]))
        offset = pin.SE3(pin.utils.rotate("z", joint.theta), np.array([0.0, 0.0, joint.d]))
        kind = pin.JointModelRZ() if joint.is_revolute else pin.JointModelPZ()
        parent = model.addJoint(parent, kind, before * offset, joint.name)
        inertia = pin.Inertia(rng.uniform(0.5, 10.0), rng.uniform(-0.3, 0.3, 3), np.eye(3))
        model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
    model.gravity.linear = np.array(robot.gravity)
    return model


def holding(model: pin.Model, position: np.ndarray) -> np.ndarray:
    """(N, J) torques and forces that hold the arm still, by the engine."""
    data = model.createData()
    return np.array([pin.computeGeneralizedGravity(model, data, q).copy() for q in position])


def columns(robot: Robot, position: np.ndarray) -> np.ndarray:
    """(J, N, p) columns of all links in every joint's row, all gain ratios 1."""
    effect = Gravity()
    rows = []
    for moving in range(1, robot.n_joints + 1):
        samples = Samples(moving, position, np.zeros_like(position))
        blocks = [
            effect.columns(robot, samples, number=link)
            if link >= moving
            else np.zeros((len(position), len(effect.parameters(robot, link))))
            for link in range(1, robot.n_joints + 1)
        ]
        rows.append(np.hstack(blocks))
    return np.array(rows)


def postures(robot: Robot, rng: np.random.Generator, *, count: int = 80) -> np.ndarray:
    span = np.where(robot.is_revolute, np.pi, 0.5)
    return rng.uniform(-span, span, (count, robot.n_joints))


def miss(robot: Robot, rng: np.random.Generator) -> float:
    """Largest relative error on postures that the constants were not fitted on."""
    position = postures(robot, rng)
    regressor, torque = columns(robot, position), holding(engine(robot, rng), position)
    half = len(position) // 2
    width = regressor.shape[-1]
    constants = np.linalg.lstsq(regressor[:, :half].reshape(-1, width), torque[:half].T.ravel(), rcond=RANK)[0]
    # An arm that gravity never loads has torques of rounding only: then a kilogram on a metre is the measure.
    scale = max(np.abs(torque).max(), np.linalg.norm(robot.gravity))
    return float(np.abs(regressor[:, half:] @ constants - torque[half:].T).max() / scale)


def independent(robot: Robot, rng: np.random.Generator) -> int:
    """Number of independent columns over all joints' rows."""
    regressor = columns(robot, postures(robot, rng))
    return int(
        np.linalg.matrix_rank(regressor.reshape(-1, regressor.shape[-1]), tol=RANK * np.linalg.norm(robot.gravity))
    )


def theorem_3(robot: Robot) -> int:
    """Parameters of gravity that exist, by the case rules of Theorem 3 (the method page, section 5)."""
    down = np.array(robot.gravity) / np.linalg.norm(robot.gravity)
    turning = [joint.is_revolute for joint in robot.joints]
    z = _axes(robot)
    n = robot.n_joints
    r = turning.index(True) if True in turning else n
    s = next((s for s in range(r + 1, n) if turning[s] and not _parallel(z[:, r], z[:, s])), n)
    upright = r < n and _parallel(z[:, r], down)
    delta = [2 * (not (upright and r <= i < s)) for i in range(n) if turning[i]]
    sigma = [bool(np.abs(z[:, i] @ down).max() > 1e-6) for i in range(n) if not turning[i]]
    return sum(delta) + sum(sigma)


def _axes(robot: Robot) -> np.ndarray:
    """(N, J, 3) the axes' directions in a few postures, by the engine."""
    rng = np.random.default_rng(0)
    model = engine(robot, rng)
    data, found = model.createData(), []
    for q in postures(robot, rng, count=5):
        pin.forwardKinematics(model, data, q)
        found.append([data.oMi[joint].rotation[:, 2].copy() for joint in range(1, robot.n_joints + 1)])
    return np.array(found)


def _parallel(one: np.ndarray, other: np.ndarray) -> bool:
    """In every posture."""
    return bool(np.linalg.norm(np.cross(one, other), axis=-1).max() < 1e-6)


def random_arm(kinds: str, rng: np.random.Generator, *, special: bool) -> Robot:
    """An arm of the given joints (R, P); special twists are quarter turns, and gravity then along an axis."""

    def twist() -> float:
        return float(rng.integers(-1, 3)) * np.pi / 2 if special else rng.uniform(-np.pi, np.pi)

    joints = tuple(
        Joint(
            number,
            f"joint{number}",
            "revolute" if kind == "R" else "prismatic",
            theta=twist(),
            alpha=twist(),
            a=rng.uniform(-0.5, 0.5),
            d=rng.uniform(-0.5, 0.5),
        )
        for number, kind in enumerate(kinds, start=1)
    )
    down = np.array([0.0, 0.0, -9.80665]) if special else rng.normal(size=3) * 5.0
    return Robot(f"random {kinds}", joints, tuple(down))


STRINGS = ["".join(kinds) for n in range(1, 6) for kinds in product("RP", repeat=n)]
SHIPPED = sorted(shipped_recipes())


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_arms_lie_in_the_span(name: str) -> None:
    """Gravity of random links of a shipped arm is a combination of the columns, exactly, on postures not fitted."""
    robot = read_recipe(shipped_recipes()[name])
    assert miss(robot, np.random.default_rng(3)) < EXACT


@pytest.mark.parametrize("special", [False, True])
def test_random_arms_lie_in_the_span(special: bool) -> None:
    """The same for every string of revolute and prismatic joints up to five, at random and at special twists."""
    rng = np.random.default_rng(11)
    worst = {
        kinds: miss(random_arm(kinds, rng, special=special), rng) for kinds in STRINGS if "R" in kinds or not special
    }
    assert max(worst.values()) < EXACT, max(worst, key=worst.__getitem__)


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_arms_have_the_parameters_of_theorem_3(name: str) -> None:
    """With all gain ratios 1 the number of independent columns is the number of parameters that Theorem 3 counts."""
    robot = read_recipe(shipped_recipes()[name])
    assert independent(robot, np.random.default_rng(5)) == theorem_3(robot)


@pytest.mark.parametrize("special", [False, True])
def test_random_arms_have_the_parameters_of_theorem_3(special: bool) -> None:
    """The same over two arms of every string of joints up to five."""
    rng = np.random.default_rng(17)
    wrong = []
    for kinds in STRINGS * 2:
        robot = random_arm(kinds, rng, special=special)
        counts = independent(robot, rng), theorem_3(robot)
        wrong += [(kinds, [joint.alpha for joint in robot.joints], *counts)] if counts[0] != counts[1] else []
    assert not wrong


def test_constants_of_the_last_link_are_its_first_moment() -> None:
    """k_x and k_y of the last link are mass times centre of mass, sign included: the current that holds is positive."""
    rng = np.random.default_rng(23)
    robot = read_recipe(shipped_recipes()["puma560"])
    model, position = engine(robot, rng), postures(robot, rng)
    last = model.inertias[6]
    row = Gravity().columns(robot, Samples(6, position, np.zeros_like(position)))
    assert np.allclose(row @ (last.mass * last.lever[:2]), holding(model, position)[:, 5], atol=1e-12)


def test_a_wrong_twist_leaves_the_span() -> None:
    """The engine can say no: an arm whose second twist is 5 degrees off is not in the span."""
    rng = np.random.default_rng(29)
    robot = read_recipe(shipped_recipes()["puma560"])
    bent = replace(robot, joints=(robot.joints[0], replace(robot.joints[1], alpha=np.deg2rad(-85)), *robot.joints[2:]))
    position = postures(robot, rng)
    regressor, torque = columns(robot, position), holding(engine(bent, rng), position)
    width = regressor.shape[-1]
    constants = np.linalg.lstsq(regressor.reshape(-1, width), torque.T.ravel(), rcond=RANK)[0]
    assert np.abs(regressor @ constants - torque.T).max() > 1e-3 * np.abs(torque).max()
