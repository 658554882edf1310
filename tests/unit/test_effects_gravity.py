"""Effects of gravity against MuJoCo, which knows masses and nothing of our regressors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import mujoco
import numpy as np
import pytest
from engines import held_by_mujoco
from worlds import CRANE, PENDULUM, STANFORD

from pumaid.effects import Samples, catalogue
from pumaid.model import Model, loads, loads_along
from pumaid.robot import Robot
from pumaid.simulation import table1

ARMS = {"puma": table1.robot(), "stanford": STANFORD, "crane": CRANE, "pendulum": PENDULUM}
#: Every joint of every arm.
JOINTS = [(name, joint.number) for name, robot in ARMS.items() for joint in robot.joints]
#: Relative to the largest current: what double precision and the engine's own tolerances leave, times 1e2.
EXACT = 1e-8
#: rad, s, rad/A: an effect so small that what is left out of its first order is a thousandth of it.
SMALL = 1e-3


@dataclass(frozen=True)
class World:
    """An arm in MuJoCo with random masses, and motors with random gains (A per N m or N, some negative)."""

    robot: Robot
    bodies: tuple[tuple[float, np.ndarray], ...]
    gains: np.ndarray

    @classmethod
    def of(cls, name: str, seed: int = 3) -> World:
        robot, rng = ARMS[name], np.random.default_rng(seed)
        bodies = tuple((rng.uniform(0.5, 5.0), rng.uniform(-0.3, 0.3, 3)) for _ in robot.joints)
        return cls(robot, bodies, rng.uniform(0.05, 0.2, robot.n_joints) * rng.choice([-1.0, 1.0], robot.n_joints))

    def engine(self, tilt: tuple[float, float] = (0.0, 0.0)) -> mujoco.MjModel:
        """The arm, its base turned by a rotation vector (x, y, 0)."""
        spec = mujoco.MjSpec()
        spec.option.gravity = self.robot.gravity
        spec.compiler.degree = False
        parent = spec.worldbody.add_body(name="base", quat=_turn(np.array([*tilt, 0.0])))
        for joint, (mass, centre) in zip(self.robot.joints, self.bodies, strict=True):
            x, z = np.array([joint.alpha, 0.0, 0.0]), np.array([0.0, 0.0, joint.theta])
            quat, rotation = np.zeros(4), np.zeros(9)
            mujoco.mju_mulQuat(quat, _turn(x), _turn(z))
            mujoco.mju_quat2Mat(rotation, _turn(x))
            along = rotation.reshape(3, 3)[:, 2] * joint.d
            parent = parent.add_body(name=joint.name, pos=np.array([joint.a, 0.0, 0.0]) + along, quat=quat)
            kind = mujoco.mjtJoint.mjJNT_HINGE if joint.is_revolute else mujoco.mjtJoint.mjJNT_SLIDE
            parent.add_joint(name=joint.name, type=kind, axis=[0, 0, 1])
            parent.mass, parent.ipos, parent.inertia, parent.explicitinertial = mass, centre, [1.0, 1.0, 1.0], True
        return spec.compile()

    def currents(self, position: np.ndarray, tilt: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
        """(N, J) A that hold the arm still, by the engine."""
        return held_by_mujoco(self.engine(tilt), position) * self.gains

    def seen(self, joint: int, seed: int = 0) -> Samples:
        """Random postures of a moving joint with the loads of a model that was fitted to the engine's currents."""
        rng, n = np.random.default_rng(seed), self.robot.n_joints
        position = rng.uniform(-1.5, 1.5, (40, n))
        velocity = np.zeros_like(position)
        velocity[:, joint - 1] = rng.uniform(-1.0, 1.0, 40)
        filled = {name: np.ones(40) for name in ("acceleration", "time", "elapsed", "travel", "temperature")}
        bare = Samples(joint, position, velocity, direction=np.sign(velocity[:, joint - 1]), **filled)
        model, solution = self.fitted()
        return replace(bare, loads=loads(model, bare, solution=solution, scales=self.scales))

    @property
    def scales(self) -> np.ndarray:
        """(J, J) ratios of gains, as an estimate holds them."""
        return np.triu(self.gains[:, None] / self.gains[None, :])

    def fitted(self, position: np.ndarray | None = None, currents: np.ndarray | None = None):
        """The base model's gravity on random postures of all joints: the model and its solution."""
        model, rng = Model(self.robot), np.random.default_rng(11)
        if position is None:
            position = rng.uniform(-2.0, 2.0, (60, self.robot.n_joints))
        currents = self.currents(position) if currents is None else currents
        rows = self.rows(model, position)
        solution = np.linalg.lstsq(rows, currents.T.ravel(), rcond=1e-10)[0]
        return model, solution

    def rows(self, model: Model, position: np.ndarray) -> np.ndarray:
        """(J N, p) gravity's regressor of all joints, one below the other; a constant where a slide's load hides."""
        heavy = np.array([column.effect == "gravity" for column in model.columns])
        blocks = []
        for joint in self.robot.joints:
            samples = Samples(joint.number, position, np.ones_like(position), direction=np.ones(len(position)))
            blocks.append(model.regressor(samples) * heavy * self.scales[joint.number - 1][model.owners - 1])
        return np.vstack(blocks)


def _turn(vector: np.ndarray) -> np.ndarray:
    """The quaternion of a rotation vector."""
    quat, angle = np.zeros(4), float(np.linalg.norm(vector))
    mujoco.mju_axisAngle2Quat(quat, vector / angle if angle else np.array([0.0, 0.0, 1.0]), angle)
    return quat


def columns(name: str, world: World, seen: Samples, **given) -> np.ndarray:
    """Columns of an effect, its owner the moving joint unless it is given."""
    given = {"shape": {"waist": 1.0}} | given if name == "tilt" else given
    return catalogue()[name].columns(world.robot, seen, **({"number": seen.joint} | given))


def assert_first_order(found: np.ndarray, wanted: np.ndarray, world: World, seen: Samples) -> None:
    """What a small effect changes is predicted, but for its square: both angles are of the size `SMALL`."""
    largest = np.abs(world.currents(seen.position)[:, seen.joint - 1]).max()
    assert np.allclose(found, wanted, atol=2.0 * SMALL**2 * largest + EXACT)


def balanced(name: str) -> World:
    """An arm whose first link's centre of mass lies so that no first moment of it is unknown."""
    # Under an upright waist no current shows the first moment of link 1, lengths of others included, so effects cannot
    # know it either. Its load in a tilted base is linear in the centre's x and y: two trials tell where it is nothing.
    world, tilt = World.of(name), (SMALL, SMALL)
    mass, centre = world.bodies[0]

    def lack(x: float, y: float) -> tuple[World, np.ndarray]:
        moved = replace(world, bodies=((mass, np.array([x, y, centre[2]])), *world.bodies[1:]))
        seen = moved.seen(1)
        change = (moved.currents(seen.position, tilt) - moved.currents(seen.position))[:, 0]
        return moved, change - columns("tilt", moved, seen, number=0)[:, :2] @ tilt

    start = lack(0.0, 0.0)[1]
    ways = np.column_stack([lack(1.0, 0.0)[1] - start, lack(0.0, 1.0)[1] - start])
    return lack(*np.linalg.lstsq(ways, -start, rcond=1e-6)[0])[0]


def test_a_waist_under_a_tilt_lacks_its_first_links_moment():
    """What the columns of a tilt lack at an upright waist is a sinusoid of its own position, and not nothing."""
    world = World.of("puma")
    seen, tilt = world.seen(1), (SMALL, 0.0)
    change = (world.currents(seen.position, tilt) - world.currents(seen.position))[:, 0]
    lack, q = change - columns("tilt", world, seen, number=0)[:, :2] @ tilt, seen.position[:, 0]
    sinusoid = np.column_stack([np.cos(q), np.sin(q)])
    left = lack - sinusoid @ np.linalg.lstsq(sinusoid, lack, rcond=None)[0]
    assert np.abs(left).max() < 2.0 * SMALL * np.abs(change).max() < 0.1 * np.abs(lack).max()


@pytest.mark.parametrize(("name", "joint"), JOINTS)
def test_tilt(name, joint):
    """A base turned about x and y changes every joint's current as the columns say, a slide's too."""
    world = balanced(name) if joint == 1 else World.of(name)
    seen, tilt = world.seen(joint), (0.8 * SMALL, -0.6 * SMALL)
    change = (world.currents(seen.position, tilt) - world.currents(seen.position))[:, joint - 1]
    assert_first_order(columns("tilt", world, seen, number=0)[:, :2] @ tilt, change, world, seen)


@pytest.mark.parametrize(("name", "joint"), JOINTS)
def test_zero_offset(name, joint):
    """Where joint m stands a little beyond what its sensor says, every joint's current changes as m's column says."""
    world = World.of(name)
    seen = world.seen(joint)
    for m in range(1, world.robot.n_joints + 1):
        shifted = seen.position + SMALL * (np.arange(world.robot.n_joints) == m - 1)
        change = (world.currents(shifted) - world.currents(seen.position))[:, joint - 1]
        assert_first_order(SMALL * columns("zero_offset", world, seen, number=m)[:, 0], change, world, seen)


@pytest.mark.parametrize(("name", "m"), JOINTS)
def test_zero_offset_says_where_it_cannot_be_seen(name, m):
    """Refitted, gravity's constants absorb a shifted zero exactly at those joints where the effect says so."""
    world = World.of(name)
    position = np.random.default_rng(2).uniform(-2.0, 2.0, (80, world.robot.n_joints))
    currents = world.currents(position + 0.05 * (np.arange(world.robot.n_joints) == m - 1))
    model, solution = world.fitted(position, currents)
    left = np.abs(world.rows(model, position) @ solution - currents.T.ravel()).max() / np.abs(currents).max()
    refusal = catalogue()["zero_offset"].applies(world.robot, m)
    assert left < EXACT if refusal else left > 1e-4  # a thousandth of what 0.05 rad does to the load itself


@pytest.mark.parametrize(("name", "joint"), [one for one in JOINTS if ARMS[one[0]].joint(one[1]).is_revolute])
def test_flexibility(name, joint):
    """A link that sags behind its motor by c times the current that holds it draws what the column says."""
    world = World.of(name)
    seen, sagging = world.seen(joint), None
    largest = np.abs(world.currents(seen.position)[:, joint - 1]).max()
    c = SMALL / max(largest, EXACT)
    sagging = seen.position.copy()
    for _ in range(5):  # q_link = q_motor - c i(q_link), to where it stays
        current = world.currents(sagging)[:, joint - 1]
        sagging[:, joint - 1] = seen.position[:, joint - 1] - c * current
    change = (world.currents(sagging) - world.currents(seen.position))[:, joint - 1]
    assert_first_order(c * columns("flexibility", world, seen)[:, 0], change, world, seen)


@pytest.mark.parametrize(("name", "joint"), JOINTS)
def test_delay(name, joint):
    """The current of a moment ago beside the position of now is what the column adds."""
    world = World.of(name)
    seen = world.seen(joint)
    ago = world.currents(seen.position - SMALL * seen.velocity)[:, joint - 1]
    change = ago - world.currents(seen.position)[:, joint - 1]
    assert_first_order(SMALL * columns("delay", world, seen)[:, 0], change, world, seen)


@pytest.mark.parametrize(("name", "joint"), JOINTS)
def test_payload(name, joint):
    """A body added to the last link draws its mass and first moments times the columns, from its instant on."""
    world = World.of(name)
    mass, centre = 1.3, np.array([0.05, -0.11, 0.2])
    old_mass, old_centre = world.bodies[-1]
    both = (old_mass + mass, (old_mass * old_centre + mass * centre) / (old_mass + mass))
    loaded = replace(world, bodies=(*world.bodies[:-1], both))
    seen = world.seen(joint)
    change = (loaded.currents(seen.position) - world.currents(seen.position))[:, joint - 1]
    size = np.array([mass, *(mass * centre)]) * world.gains[-1]
    assert np.allclose(columns("payload", world, seen, number=0, shape={"time": 0.5}) @ size, change, atol=EXACT)
    assert not columns("payload", world, seen, number=0, shape={"time": 1.5}).any()


def test_payload_is_silent_where_the_gain_is_not_known():
    """A joint whose ratio to the last joint is not known gets no payload rather than a wrong one."""
    world = World.of("puma")
    seen = world.seen(3)
    unknown = replace(seen.loads, gains=np.where(np.arange(6) == 5, np.nan, seen.loads.gains))
    assert columns("payload", world, seen, number=0, shape={"time": 0.5}).any()
    assert not columns("payload", world, replace(seen, loads=unknown), number=0, shape={"time": 0.5}).any()


@pytest.mark.parametrize("name", ["puma", "stanford"])
def test_side_load_of_an_upright_waist(name):
    """Under an upright axis the moment across it is that of all weights, taken one by one from the engine."""
    world = balanced(name)
    seen, model = world.seen(1), world.engine()
    data, moments = mujoco.MjData(model), []
    for q in seen.position:
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        weights = model.body_mass[2:, None] * np.array(world.robot.gravity)
        moments.append(np.cross(data.xipos[2:] - data.xanchor[0], weights).sum(axis=0))
    wanted = np.linalg.norm(np.array(moments)[:, :2], axis=1) * abs(world.gains[0])
    unit_gain = seen.direction * columns("side_load_friction", world, seen)[:, 0]
    assert np.allclose(unit_gain, wanted, atol=EXACT)


@pytest.mark.parametrize(("m", "on"), [(6, 5), (5, 4), (6, 4), (3, 2)])
def test_coupling(m, on):
    """A motor that turns its own joint by 1 and joint m by c carries the slope of the energy along that motion."""
    world, c, step = World.of("puma"), 0.3, 1e-5
    seen, model = world.seen(on), world.engine()
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data, way = mujoco.MjData(model), np.eye(6)[on - 1] + c * np.eye(6)[m - 1]
    energy = np.zeros((2, len(seen)))
    for row, sign in enumerate((1.0, -1.0)):
        for k, q in enumerate(seen.position):
            data.qpos[:] = q + sign * step * way
            mujoco.mj_forward(model, data)
            energy[row, k] = data.energy[0]
    carried = (energy[0] - energy[1]) / (2.0 * step) * world.gains[on - 1]
    ratio = c * world.gains[on - 1] / world.gains[m - 1]
    predicted = seen.loads.moving + ratio * columns("coupling", world, seen, number=m, shape={"on": on})[:, 0]
    assert np.allclose(predicted, carried, atol=1e-6)  # the difference quotient's own rounding
    assert not columns("coupling", world, seen, number=m, shape={"on": on - 1}).any()


def test_unknown_ratio_hides_another_joints_load_and_its_gain():
    """Where eta2/eta3 is not known the load of joint 2 is not, nor the gain between them; joint 3's own is."""
    world = World.of("puma")
    (model, solution), scales = world.fitted(), world.scales
    scales[1, 2:] = np.nan
    found = loads(model, world.seen(3), solution=solution, scales=scales)
    assert np.isnan(found.by_joint[:, 1]).all() and np.isfinite(found.moving).all()
    assert np.isnan(found.gains[1]) and np.isfinite(found.gains[2:]).all()


@pytest.mark.parametrize(("name", "joint"), JOINTS)
def test_loads_along_runs_are_the_loads(name, joint):
    """While one joint moves alone in three runs, five positions of a run say what its load is at all others."""
    world, rng, sizes = World.of(name), np.random.default_rng(joint), np.array([40, 25, 60])
    position = np.repeat(rng.uniform(-2.0, 2.0, (3, world.robot.n_joints)), sizes, axis=0)
    position[:, joint - 1] = rng.uniform(-3.0, 3.0, len(position))
    velocity = rng.uniform(-1.0, 1.0, position.shape)
    samples = Samples(joint, position, velocity, np.zeros(125), np.sign(velocity[:, joint - 1]))
    (model, solution), scales = world.fitted(), world.scales
    scales[0, -1] = np.nan  # an unknown ratio
    ours = loads_along(model, samples, sizes, solution=solution, scales=scales)
    theirs = loads(model, samples, solution=solution, scales=scales)
    for part in ("moving", "by_joint", "slopes", "tilts", "across", "drawn", "gains"):
        np.testing.assert_allclose(getattr(ours, part), getattr(theirs, part), atol=1e-11, err_msg=part)
