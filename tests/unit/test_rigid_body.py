"""The rigid-body regressor against pinocchio, which knows no columns; base parameters by rank."""

import itertools

import numpy as np
import pytest
from worlds import course, random_arm, run_of

from pumaid.dataset import Dataset
from pumaid.estimation.estimate import identify
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.rigid_body import PARAMETERS, RigidBody, base_parameters
from pumaid.robot import Robot

pin = pytest.importorskip("pinocchio", reason="the engine is pinocchio (pip install pumaid[test])")

#: Relative to the largest torque: what sums of a hundred products lose in double precision.
EXACT = 1e-12


def engine(robot: Robot, rng: np.random.Generator) -> tuple[pin.Model, np.ndarray]:
    """The arm with random bodies and rotors, and its parameters (11 J,) in the order of `PARAMETERS`."""
    model, parent, values = pin.Model(), 0, []
    for joint in robot.joints:
        kind = pin.JointModelRZ() if joint.is_revolute else pin.JointModelPZ()
        parent = model.addJoint(parent, kind, pin.SE3(joint.frame[:3, :3], joint.frame[:3, 3]), joint.name)
        body, rotor = pin.Inertia.Random(), float(rng.uniform(0.1, 1.0))
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
        m, x, y, z, xx, xy, yy, xz, yz, zz = body.toDynamicParameters()
        values += [m, x, y, z, xx, xy, xz, yy, yz, zz, rotor]
    model.gravity.linear = np.array(robot.gravity)
    model.armature = np.array(values[10::11])
    return model, np.array(values)


def states(robot: Robot, rng: np.random.Generator, count: int) -> list[np.ndarray]:
    """Positions, velocities and accelerations (J, N)."""
    return [rng.normal(0.0, size, (robot.n_joints, count)) for size in (1.5, 2.0, 6.0)]


def everything(robot: Robot) -> RigidBody:
    return RigidBody(robot, tuple(tuple(range(len(PARAMETERS))) for _ in robot.joints))


def torques(model: pin.Model, motion: list[np.ndarray]) -> np.ndarray:
    """(J, N) by the engine's inverse dynamics."""
    data = model.createData()
    return np.array([pin.rnea(model, data, *state) for state in zip(*(part.T for part in motion), strict=True)]).T


ARMS = [*sorted(shipped_recipes()), "RRP", "PPP", "RPRPR", "PRRRRRR", "RRRRRRRRRR"]


@pytest.mark.parametrize("name", ARMS)
def test_torques_are_those_of_inverse_dynamics(name):
    """On every recipe and on random chains, slides among them."""
    rng = np.random.default_rng(3)
    robot = read_recipe(shipped_recipes()[name]) if name in shipped_recipes() else random_arm(name, rng)
    model, values = engine(robot, rng)
    motion = states(robot, rng, 40)
    torque = torques(model, motion)
    assert np.abs(everything(robot).dense(*motion) @ values - torque).max() < EXACT * np.abs(torque).max()


@pytest.mark.parametrize("name", ARMS)
def test_base_parameters_explain_every_motion_and_are_as_many_as_any_motion_shows(name):
    """The rank is that of the engine's own regressor, rotors beside it; what is left out is regrouped into the rest."""
    rng = np.random.default_rng(4)
    robot = read_recipe(shipped_recipes()[name]) if name in shipped_recipes() else random_arm(name, rng)
    model, _ = engine(robot, rng)
    motion, base = states(robot, rng, 200), base_parameters(robot)
    columns = base.dense(*motion).reshape(-1, base.width(1))
    data = model.createData()
    bodies = [
        pin.computeJointTorqueRegressor(model, data, *state) for state in zip(*(p.T for p in motion), strict=True)
    ]
    rotors = np.array([np.diag(rates) for rates in motion[2].T])
    whole = np.concatenate([np.array(bodies), rotors], axis=2).transpose(1, 0, 2).reshape(len(columns), -1)
    # A load of a slide that is the same in any posture is its friction's.
    constant = np.repeat(np.eye(robot.n_joints)[:, ~robot.is_revolute], 200, axis=0)
    columns, whole = np.hstack([constant, columns]), np.hstack([constant, whole])
    rank = np.linalg.matrix_rank(whole, tol=1e-8 * len(whole))
    assert constant.shape[1] + base.width(1) == np.linalg.matrix_rank(columns) == rank
    torque = torques(model, motion).ravel()
    left = torque - columns @ np.linalg.lstsq(columns, torque, rcond=None)[0]
    assert np.abs(left).max() < 1e-9 * np.abs(torque).max()


@pytest.mark.parametrize(
    ("name", "widths"),
    [
        ("puma560", [1, 7, 8, 8, 8, 8]),
        ("ur5e", [1, 7, 8, 8, 8, 8]),
        ("panda", [1, 7, 8, 8, 8, 8, 8]),
        ("stanford", [1, 7, 5, 8, 8, 8]),
    ],
)
def test_known_arms_have_known_numbers_of_base_parameters(name, widths):
    """40, 40, 48 and 37 in all."""
    assert [len(kept) for kept in base_parameters(read_recipe(shipped_recipes()[name])).counted] == widths


def test_strokes_and_runs_of_an_engines_arm():
    """Of one joint at a time, friction and the inertia that each feels come back, in A of motors of unknown gains."""
    rng, runs = np.random.default_rng(8), []
    robot = random_arm("RRR", rng)
    model, _ = engine(robot, rng)
    gains, friction = rng.uniform(0.5, 2.0, 3), rng.uniform(0.2, 1.0, (3, 2))
    held = [rng.uniform(-1.0, 1.0, 3) for _ in range(4)]
    for joint, (number, hold), way in itertools.product((1, 2, 3), enumerate(held), (1.5, -1.5)):
        for kind, duration in (("constant", 2.0), ("constant", 4.0), *[("stroke", 2.0)] * (number == 0)):
            moves = course(kind, -way, way, duration=duration, samples=400)
            state = [np.zeros((3, 400)) for _ in range(3)]
            state[0][:] = hold[:, None]
            for part, values in zip(state, moves[1:], strict=True):
                part[joint - 1] = values
            dry, viscous = friction[joint - 1]
            current = torques(model, state)[joint - 1] * gains[joint - 1] + np.sign(way) * dry + viscous * moves[2]
            runs.append(run_of(robot, joint, hold, course=moves, current=current, bins=200))
    estimate = identify(Dataset(tuple(runs)), robot)
    for joint, (dry, viscous) in enumerate(friction, start=1):
        values = [estimate.value(f"{name}.j{joint}.plus").value for name in ("coulomb", "viscous")]
        assert values == pytest.approx([dry, viscous], rel=1e-4)
    felt = {part.text[:23]: part.value for part in estimate.combinations if part.text.startswith("inertia")}
    inertia = np.diag(pin.crba(model, model.createData(), held[0])) * gains
    assert felt == {f"inertia felt by joint {n}": pytest.approx(inertia[n - 1], rel=1e-8) for n in (1, 2, 3)}
