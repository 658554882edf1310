"""Frames and the rigid-body regressor against 4 x 4 matrices and pinocchio; base parameters by rank."""

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from worlds import arm, course, random_arm, run_of

from pumaid.dataset import Dataset
from pumaid.effects import Samples
from pumaid.estimation.estimate import identify
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.model import Model, loads
from pumaid.rigid_body import PARAMETERS, RigidBody, base_parameters, of_last_link, of_payload
from pumaid.robot import Joint, Robot, of_point, placement, roll_pitch_yaw, turn_of_z

pin = pytest.importorskip("pinocchio", reason="the engine is pinocchio (pip install pumaid[test])")
engines = pytest.importorskip("engines")

#: Relative to the largest torque: what sums of a hundred products lose in double precision.
EXACT = 1e-12


def engine(robot: Robot, rng: np.random.Generator) -> tuple[pin.Model, np.ndarray]:
    """The arm with random bodies and rotors, and its parameters (11 J,) in the order of `PARAMETERS`."""
    pin.seed(int(rng.spawn(1)[0].integers(2**31)))
    bodies, rotors = [pin.Inertia.Random() for _ in robot.joints], rng.uniform(0.1, 1.0, robot.n_joints)
    model = engines.pinocchio_model(robot, bodies)
    model.armature = rotors
    # The engine has xx, xy, yy, xz, yz, zz.
    table = np.array([body.toDynamicParameters() for body in bodies])[:, [0, 1, 2, 3, 4, 5, 7, 6, 8, 9]]
    return model, np.column_stack([table, rotors]).ravel()


def states(robot: Robot, rng: np.random.Generator, count: int) -> list[np.ndarray]:
    """Positions, velocities and accelerations (J, N)."""
    return [rng.normal(0.0, size, (robot.n_joints, count)) for size in (1.5, 2.0, 6.0)]


def dense(body: RigidBody, motion: list[np.ndarray]) -> np.ndarray:
    """(J, N, p) the regressor of all joints, zero where one does not feel a link."""
    rows = body.rows(*motion)
    return np.array([np.pad(part.T, ((0, 0), (len(rows[0]) - len(part), 0))) for part in rows])


def torques(model: pin.Model, motion: list[np.ndarray]) -> np.ndarray:
    """(J, N) by the engine's inverse dynamics."""
    data = model.createData()
    return np.array([pin.rnea(model, data, *state) for state in zip(*(part.T for part in motion), strict=True)]).T


ARMS = [*sorted(shipped_recipes()), "RRP", "PPP", "RPRPR", "PRRRRRR", "RRRRRRRRRR"]


@pytest.mark.parametrize("name", ARMS)
def test_torques_are_those_of_inverse_dynamics(name):
    rng = np.random.default_rng(3)
    robot = read_recipe(shipped_recipes()[name]) if name in shipped_recipes() else random_arm(name, rng)
    model, values = engine(robot, rng)
    motion = states(robot, rng, 40)
    torque = torques(model, motion)
    everything = RigidBody(robot, (tuple(range(len(PARAMETERS))),) * robot.n_joints)
    assert np.abs(dense(everything, motion) @ values - torque).max() < EXACT * np.abs(torque).max()
    payload = (1.7, 0.1, -0.05, 0.2)
    model.inertias[model.njoints - 1] += pin.Inertia(payload[0], np.array(payload[1:]), np.zeros((3, 3)))
    base, constants = (part @ of_payload(payload) for part in of_last_link(robot))
    more = dense(base_parameters(robot), motion) @ base + constants[:, None]
    assert np.abs(more - torques(model, motion) + torque).max() < 1e-9 * np.abs(torque).max()
    moments = payload[0] * np.array(payload[1:])
    point = of_point(robot, payload[0], moments) @ [payload[0], *moments]  # the tangent has all of it, by Euler
    assert np.linalg.norm(payload[1:]) > robot.length or point == pytest.approx(of_payload(payload)[:10])


@pytest.mark.parametrize("name", ARMS)
def test_base_parameters_explain_every_motion_and_are_as_many_as_any_motion_shows(name):
    """The rank is that of the engine's own regressor, rotors beside it; what is left out is regrouped into the rest."""
    rng = np.random.default_rng(4)
    robot = read_recipe(shipped_recipes()[name]) if name in shipped_recipes() else random_arm(name, rng)
    model, _ = engine(robot, rng)
    motion, base = states(robot, rng, 200), base_parameters(robot)
    columns = dense(base, motion).reshape(-1, len(base.names))
    data, instants = model.createData(), zip(*(part.T for part in motion), strict=True)
    bodies = [pin.computeJointTorqueRegressor(model, data, *state) for state in instants]
    rotors = np.array([np.diag(rates) for rates in motion[2].T])
    whole = np.concatenate([np.array(bodies), rotors], axis=2).transpose(1, 0, 2).reshape(len(columns), -1)
    # A load of a slide that is the same in any posture is its friction's.
    constant = np.repeat(np.eye(robot.n_joints)[:, ~robot.is_revolute], 200, axis=0)
    columns, whole = np.hstack([constant, columns]), np.hstack([constant, whole])
    rank = np.linalg.matrix_rank(whole, tol=1e-8 * len(whole))
    assert constant.shape[1] + len(base.names) == np.linalg.matrix_rank(columns) == rank
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
        assert values == pytest.approx([dry, viscous], rel=1e-6)
    felt = {part.text[:23]: part.value for part in estimate.combinations if part.text.startswith("inertia")}
    inertia = np.diag(pin.crba(model, model.createData(), held[0])) * gains
    assert felt == {f"inertia felt by joint {n}": pytest.approx(inertia[n - 1], rel=1e-8) for n in (1, 2, 3)}


RNG = np.random.default_rng(2)


def mixed_arm() -> Robot:
    """Joints of both kinds, stated by Denavit-Hartenberg parameters and by placements."""
    joints = []
    for number, kind in enumerate(("revolute", "prismatic", "revolute", "prismatic", "revolute"), start=1):
        constants = dict(zip(("theta", "alpha", "a", "d"), RNG.uniform(-2, 2, 4).tolist(), strict=True))
        if number > 2:
            constants = {"placement": tuple(map(tuple, placement(RNG.normal(size=3), RNG.normal(size=3)).tolist()))}
        joints.append(Joint(number, f"j{number}", kind, **constants))
    return Robot("random", tuple(joints))


def test_frames_of_a_batch():
    """Every link's frame in the base is Trans_x(a) Rot_x(alpha) Trans_z(d) Rot_z(theta) or its placement, and so on."""
    robot, positions = mixed_arm(), RNG.uniform(-2, 2, (6, 5))
    rotations, origins = robot.frames(positions)
    assert np.array_equal(rotations, robot.rotations(positions))
    for row, position in enumerate(positions):
        frame = np.eye(4)
        for k, (joint, q) in enumerate(zip(robot.joints, position, strict=True)):
            before, moved = np.eye(4), np.eye(4)
            before[:3, :3], before[0, 3] = Rotation.from_euler("x", joint.alpha).as_matrix(), joint.a
            if joint.placement is not None:
                before = np.array(joint.placement)
            turn, slide = (joint.theta + q, joint.d) if joint.is_revolute else (joint.theta, joint.d + q)
            moved[:3, :3], moved[2, 3] = Rotation.from_euler("z", turn).as_matrix(), slide
            frame = frame @ before @ moved
            assert rotations[row, k] == pytest.approx(frame[:3, :3], abs=1e-14)
            assert origins[row, k] == pytest.approx(frame[:3, 3], abs=1e-13)


def test_placement_is_pinocchios() -> None:
    """Roll, pitch and yaw are about fixed axes, as pinocchio has them, and come back."""
    frame = placement([1.0, 2.0, 3.0], [0.3, -0.7, 1.9])
    assert frame[:3, :3] == pytest.approx(pin.rpy.rpyToMatrix(0.3, -0.7, 1.9), abs=1e-15)
    assert frame[:3, 3].tolist() == [1.0, 2.0, 3.0]
    assert roll_pitch_yaw(frame[:3, :3]) == pytest.approx((0.3, -0.7, 1.9), abs=1e-15)


@pytest.mark.parametrize("axis", [(0, 0, 2), (0, 0, -1), (1, 0, 0), (0.3, -0.2, -0.9), (1e-9, 0, -1)])
def test_turn_of_z_is_the_least(axis) -> None:
    turn, unit = turn_of_z(axis), np.array(axis) / np.linalg.norm(axis)
    assert turn @ turn.T == pytest.approx(np.eye(3), abs=1e-7)
    assert turn[:, 2] == pytest.approx(unit, abs=2e-9)
    assert Rotation.from_matrix(turn).magnitude() == pytest.approx(np.arccos(unit[2]), abs=1e-7)


@pytest.mark.parametrize("name", ["puma560", "stanford", "RRPR", "PRPRR", "PP", "scara"])
def test_the_weight_of_a_rigid_body_is_what_holds_it(name):
    """Loads of a model with inertia, and its columns at constant speed, beside the regressor's static torques."""
    rng = np.random.default_rng(5)
    scara = arm("RRPR", [0.0] * 4)
    named = {key: read_recipe(path) for key, path in shipped_recipes().items()} | {"scara": scara}
    robot = named.get(name) or random_arm(name, rng)
    model, body, n = Model(robot, is_dynamic=True), base_parameters(robot), robot.n_joints
    solution, gain = rng.normal(size=len(model.columns)), rng.uniform(0.5, 2.0, n)
    scales, position = np.triu(gain[:, None] / gain), rng.uniform(-2.0, 2.0, (30, n))
    still = np.zeros_like(position)
    torque = dense(body, [position.T, still.T, still.T])
    links = np.array([link for link, _ in body.names]) - 1
    # Only constants of gravity ask anything at rest, so that inertia takes nothing of what rest tells of them.
    assert np.abs(torque[:, :, ~model.is_weight[model.inertial]]).max() < 1e-9
    for joint in range(n):
        weighted = scales[joint][links] * solution[model.inertial]
        samples = Samples(joint + 1, position, still, direction=np.ones(30), acceleration=np.zeros(30))
        difference = loads(model, samples, solution=solution, scales=scales).moving - torque[joint] @ weighted
        assert np.abs(difference).max() < 1e-9
        columns = model.base(samples)[:, model.inertial]
        np.testing.assert_allclose(columns @ weighted, torque[joint] @ weighted, atol=1e-9)
