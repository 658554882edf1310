"""Laws of effects against what the books say of them, worked out another way; where they cannot act."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import mujoco
import numpy as np
import pytest
import table1
from engines import held_by_mujoco
from worlds import CRANE, PENDULUM, STANFORD

from pumaid.effect_spec import EffectTerm
from pumaid.effects import Extent, Loads, Samples, Trace, catalogue
from pumaid.joint_bins import JointBins
from pumaid.model import Model, loads, loads_at
from pumaid.rigid_body import of_body
from pumaid.robot import Joint, Robot
from pumaid.simulation import draw

COUNT = 50


def seen(*, way: float = 1.0, **given) -> Samples:
    """Instants of joint 1 of a pendulum, all as usual but for what is given; loads by name of their fields."""
    held = {"position": 0.6, "speed": 0.5, "travel": 1.0, "time": 100.0, "temperature": 30.0, "own": 1.0, "drawn": 2.0}
    unknown = set(given) - set(held)
    assert not unknown
    values = {name: np.broadcast_to(given.get(name, value), COUNT).astype(float) for name, value in held.items()}
    position, velocity = np.zeros((COUNT, 2)), np.zeros((COUNT, 2))
    position[:, 0], velocity[:, 0] = values["position"], way * values["speed"]
    own, nothing = values["own"], np.zeros((COUNT, 2))
    loads = Loads(own, nothing, nothing, nothing, np.abs(own), values["drawn"], way * own, np.ones(2))
    filled = {name: values[name] for name in ("travel", "time", "temperature")}
    return Samples(
        1, position, velocity, np.ones(COUNT), np.full(COUNT, way), elapsed=values["time"], loads=loads, **filled
    )


def current(name: str, samples: Samples, size=1.0, **shape: float) -> np.ndarray:
    """The current of an effect of joint 1 of this size."""
    columns = catalogue()[name].columns(PENDULUM, samples, number=1, shape=shape)
    return columns @ np.broadcast_to(size, columns.shape[1])


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("own", [2.0, -2.0])
def test_load_friction_is_a_gears_efficiency(own, way):
    """A gear that passes on 80 % of the power lets 80 % of it through, up and down, in either sense of the load."""
    drive, back = 1.0 / 0.8 - 1.0, 1.0 - 0.8
    motor = own + current("load_friction", seen(own=own, way=way), [drive, back])[0]
    lifts = own * way > 0
    power_in, power_out = (motor, own) if lifts else (own, motor)
    assert power_out / power_in == pytest.approx(0.8)


def test_presliding_is_dahls():
    """The current after a reversal follows Dahl's equation dF/dx = sigma (1 - F/F_C), integrated step by step."""
    coulomb, stiffness, steps = 0.4, 20.0, 20000
    travel = np.linspace(0.0, 0.2, steps + 1)
    force = np.empty(steps + 1)
    force[0] = -coulomb  # what the motion the other way left behind
    for k in range(steps):
        force[k + 1] = force[k] + (travel[1] - travel[0]) * stiffness * (1.0 - force[k] / coulomb)
    at = np.linspace(0, steps, COUNT).astype(int)
    shown = coulomb + current("presliding", seen(travel=travel[at]), 2.0 * coulomb, travel=coulomb / stiffness)
    assert np.allclose(shown, force[at], atol=1e-3 * coulomb)  # Euler's steps of 1e-5 rad


def test_temperature_that_is_missing_counts_as_the_reference():
    """Without a temperature the effect is nothing; with one it is in proportion to what is above the reference."""
    samples = seen(temperature=np.where(np.arange(COUNT) < 10, np.nan, 35.0))
    found = current("thermal_friction", samples, 0.01)
    assert np.allclose(found[:10], 0.0) and np.allclose(found[10:], 0.1)


def test_counterbalance_is_the_slope_of_its_cylinders_length():
    """A cylinder with a constant force does work as its length changes: the current is that work's slope."""
    lever, foot, in_line, force, step = 0.3, 0.8, 0.4, 5.0, 1e-6
    q = np.linspace(-2.5, 2.5, COUNT)

    def length(angle: np.ndarray) -> np.ndarray:
        return np.hypot(foot - lever * np.cos(angle - in_line), lever * np.sin(angle - in_line))

    wanted = force * (length(q + step) - length(q - step)) / (2.0 * step)
    found = current("counterbalance", seen(position=q), force * lever, length=lever / foot, angle=in_line)
    assert np.allclose(found, wanted, atol=1e-8)


@pytest.mark.parametrize("name", [n for n, e in catalogue().items() if Trace.DIRECTION in e.trace and not e.base])
def test_friction_turns_round_with_the_motion(name):
    """What a direction shows changes its sign with it, all else equal."""
    effect = catalogue()[name]
    size = [1.0] * len(effect.parameters(PENDULUM, 1))
    shape = {one.name: one.example for one in effect.shapes(PENDULUM, 1)}
    there, back = (current(name, seen(way=way, own=1.0), size, **shape) for way in (1.0, -1.0))
    assert np.allclose(there, -back)


EXTENT = Extent(1, (0.1, 0.5), (-1.3, 1.1), 0.03, 2.4, tuple(60.0 * k for k in range(30)), 1800.0, 3.0)


def test_ripples_grid_begins_with_the_gear():
    """Where the recipe has a gear, multiples of it that the bins can show are tried as they are."""
    geared = replace(PENDULUM, joints=(replace(PENDULUM.joints[0], gear_ratio=-30.0), PENDULUM.joints[1]))
    starts = [start["frequency"] for start in catalogue()["ripple"].grid(geared, EXTENT)]
    assert starts[:3] == [30.0, 60.0, 180.0] and max(starts) <= 2.0 * np.pi / EXTENT.finest * (1.0 + 1e-12)


@pytest.mark.parametrize("name", ["friction_step", "payload"])
def test_changes_are_looked_for_in_the_pauses(name):
    """Between any two runs is one instant, after the first has ended even where it takes nearly all the time."""
    effect = catalogue()[name]
    times = np.array([start["time"] for start in effect.grid(PENDULUM, EXTENT)])
    starts = np.array(EXTENT.starts)
    assert len(times) == len(starts) - 1 and (times > starts[:-1] + 0.95 * 60.0).all() and (times < starts[1:]).all()


def test_long_campaigns_try_few_instants():
    """Of 500 runs, 40 instants are tried, from the second run to the last."""
    long = replace(EXTENT, starts=tuple(60.0 * k for k in range(500)))
    times = [start["time"] for start in catalogue()["friction_step"].grid(PENDULUM, long)]
    assert len(times) == 40 and times[0] < 60.0 and times[-1] > 498 * 60.0


def test_prismatic_load_on_a_turning_joint():
    """The mass beyond a slide presses the turning joint before it by its displacement, offset included."""
    # The crane's first axis is level; with both turning joints at 0 the slide points along its link.
    position = np.array([[0.3, 0.2, 0.0], [0.3, 0.5, 0.0]])
    columns = catalogue()["gravity"].columns(CRANE, Samples(1, position, np.zeros((2, 3))), number=2)
    assert columns[1, 0] / columns[0, 0] == pytest.approx((0.5 + 0.1) / (0.2 + 0.1))


#: A turning joint and a slide, both upright: the one feels no weight, the other always the same.
UPRIGHT = Robot("upright", (Joint(1, "turn", "revolute"), Joint(2, "slide", "prismatic")))


@pytest.mark.parametrize(
    ("name", "joint", "word"),
    [
        ("load_friction", 1, "gravity"),
        ("load_friction", 2, "Coulomb"),
        ("delay", 1, "gravity"),
        ("flexibility", 2, "slides"),
        ("counterbalance", 2, "Coulomb"),
        ("zero_offset", 1, "gravity"),
        ("zero_offset", 2, "lever"),
        ("coupling", 1, "before"),
    ],
)
def test_refuses_where_it_cannot_act(name, joint, word):
    assert word in str(catalogue()[name].applies(UPRIGHT, joint))


@pytest.mark.parametrize("name", ["load_friction", "flexibility", "delay", "payload", "side_load_friction"])
def test_acts_where_gravity_does(name):
    assert catalogue()[name].applies(PENDULUM, 1) is None


def test_stribeck_falls_to_an_e_th():
    """At rest all of it, at v_s a share 1/e, whatever the exponent; far above nothing."""
    for d in (0.5, 1.0, 2.0):
        found = [current("stribeck", seen(speed=v), velocity=0.2, exponent=d)[0] for v in (0.0, 0.2, 1000.0)]
        assert found == pytest.approx([1.0, np.exp(-1.0), 0.0], abs=1e-12)


@pytest.mark.parametrize("p", [0.3, 1.7])
def test_a_power_law_is_straight_in_logarithms(p):
    """Ten times the speed is 10^p times the current, and the parameter is the current at unit speed."""
    slow, fast, unit = (current("viscous_power", seen(speed=v), exponent=p)[0] for v in (0.05, 0.5, 1.0))
    assert np.log10(fast / slow) == pytest.approx(p) and unit == pytest.approx(1.0)


def test_time_constants():
    """After one T friction is down to 1/e of what it was at the start, and a drift has 1/e of its way still to go."""
    friction = [current("warmup", seen(time=t), time_constant=300.0)[0] for t in (0.0, 300.0)]
    drift = [current("torque_constant_drift", seen(time=t, drawn=1.0), time_constant=300.0)[0] for t in (0.0, 300.0)]
    assert friction == pytest.approx([1.0, np.exp(-1.0)]) and drift == pytest.approx([0.0, 1.0 - np.exp(-1.0)])


def test_friction_comes_at_its_instant():
    found = current("friction_step", seen(time=np.linspace(0.0, 100.0, COUNT)), 0.3, time=50.0)
    assert np.array_equal(np.unique(found), [0.0, 0.3]) and (found > 0).sum() == COUNT // 2


def test_position_friction_repeats_with_each_part_of_a_turn():
    """Friction of harmonic k is the same after a turn's k-th part, and turns round with the motion."""
    q = np.linspace(-2.0, 2.0, COUNT)
    here, there = (current("position_friction", seen(position=q + w), harmonic=3.0) for w in (0.0, 2.0 * np.pi / 3.0))
    back = current("position_friction", seen(position=q, way=-1.0), harmonic=3.0)
    assert np.allclose(here, there) and np.allclose(here, -back)


def test_saturation_clips():
    """The prediction with the effect of size 1 is the prediction clipped, in both senses."""
    drawn = np.linspace(-4.0, 4.0, COUNT)
    assert np.allclose(drawn + current("saturation", seen(drawn=drawn), limit=2.5), np.clip(drawn, -2.5, 2.5))


def test_droop_is_the_first_term_of_a_saturating_motor():
    """A motor whose torque bends as i - a i^3 needs i + a i^3 for the torque of i, to the first order in a."""
    wanted, a = np.linspace(-2.0, 2.0, COUNT), 1e-4
    needed = wanted.copy()
    for _ in range(20):
        needed = wanted + a * needed**3
    assert np.allclose(wanted + current("torque_droop", seen(drawn=wanted), a), needed, atol=100.0 * a**2)


def test_ripples_grid_loses_little_between_its_frequencies():
    """A ripple of any frequency in the range keeps 94 % of its power at the nearest frequency of the grid."""
    rng, q = np.random.default_rng(0), np.linspace(*EXTENT.position, 400)
    grid = np.array([start["frequency"] for start in catalogue()["ripple"].grid(PENDULUM, EXTENT)])
    kept = []
    for frequency in rng.uniform(grid.min(), grid.max(), 200):
        signal = np.sin(frequency * q + rng.uniform(0.0, 7.0))
        nearest = grid[np.abs(grid - frequency).argmin()]
        basis = np.column_stack([np.cos(nearest * q), np.sin(nearest * q)])
        left = signal - basis @ np.linalg.lstsq(basis, signal, rcond=None)[0]
        kept.append(1.0 - (left @ left) / (signal @ signal))
    assert min(kept) > 0.94


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
        filled["bodies"] = of_body(self.robot, joint, (position.T, 0.0 * position.T, 0.0 * position.T))
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


@pytest.mark.parametrize("share", [0.0, 1.0])
@pytest.mark.parametrize(("name", "joint"), [("puma", 2), ("puma", 3), ("pendulum", 1)])
def test_backlash(name, joint, share):
    """A link that falls through its gap where its weight beats the friction beyond it, and else is pushed along.

    Moved there and back step by step, it draws what the column says, but on the way through the gap.
    """
    world, way, gap = World.of(name), np.linspace(-2.0, 2.0, 1601), 2.0 * SMALL
    q, direction = np.concatenate([way, way[-2::-1]]), np.repeat([1.0, -1.0], [1601, 1600])
    position, side = np.full((len(q), world.robot.n_joints), 0.3), np.sign(world.gains[joint - 1])
    position[:, joint - 1] = q
    load = side * world.currents(position)[:, joint - 1]
    rub = 0.2 * np.abs(load).max()
    link, places = position.copy(), [q[0]]
    for at, pull in zip(q, np.where(np.abs(load) > share * rub, -np.sign(load), 0.0), strict=True):
        places.append(np.clip(at + pull * gap if pull else places[-1], at - gap / 2.0, at + gap / 2.0))
    link[:, joint - 1] = places[1:]
    rests = np.isclose(np.abs(link - position)[:, joint - 1], gap / 2.0, rtol=1e-6)
    velocity = np.where(np.arange(world.robot.n_joints) == joint - 1, direction[:, None], 0.0)
    samples = Samples(joint, position, velocity, direction=direction)
    (model, solution), names = world.fitted(), world.fitted()[0].names
    solution[[names.index(f"coulomb.j{joint}.{sign}") for sign in ("plus", "minus")]] = side * rub, -side * rub
    seen = replace(samples, loads=loads(model, samples, solution=solution, scales=world.scales))
    found = side * gap * columns("backlash", world, seen, shape={"share": share})[:, 0]
    change = (world.currents(link) - world.currents(position))[:, joint - 1]
    assert rests.mean() > 0.99 and np.abs(np.diff(np.sign(link - position)[rests, joint - 1])).sum() > 2.0
    assert_first_order(found[rests], change[rests], world, seen)


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
    """A body added to the last link asks its mass and first moments times the columns, from its instant on."""
    world = World.of(name)
    mass, centre = 1.3, np.array([0.05, -0.11, 0.2])
    old_mass, old_centre = world.bodies[-1]
    both = (old_mass + mass, (old_mass * old_centre + mass * centre) / (old_mass + mass))
    loaded = replace(world, bodies=(*world.bodies[:-1], both))
    seen = world.seen(joint)
    change = (loaded.currents(seen.position) - world.currents(seen.position))[:, joint - 1]
    size = np.array([mass, *(mass * centre)]) * world.gains[joint - 1]
    assert np.allclose(columns("payload", world, seen, number=0, shape={"time": 0.5}) @ size, change, atol=EXACT)
    assert not columns("payload", world, seen, number=0, shape={"time": 1.5}).any()


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


def test_coupling_passes_friction_on_and_drags_the_shaft():
    """What joint 6 rubs, by the drawn robot's own friction, is felt in motor 5; joint 5's speed in motor 6."""
    world, rng = World.of("puma"), np.random.default_rng(5)
    friction, names = draw(world.robot, 3).friction, world.fitted()[0].names
    for on, joint in ((5, 5), (5, 6), (4, 5)):
        samples = world.seen(joint)
        velocity = rng.normal(size=samples.velocity.shape)
        solution = np.zeros(len(names))
        for kind, way in product(("coulomb", "viscous"), ("plus", "minus")):
            solution[names.index(f"{kind}.j6.{way}")] = getattr(friction, f"{kind}_{way}")[5]
        rubs = world.fitted()[0].rubs(solution)
        samples = replace(samples, velocity=velocity, loads=replace(samples.loads, rubs=rubs))
        found = columns("coupling", world, samples, number=6, shape={"on": on})
        wanted = friction.currents(velocity)[:, 5] * (joint == on), velocity[:, on - 1] * (joint == 6)
        assert np.allclose(found[:, 1:], np.column_stack(wanted), atol=EXACT)


def test_drag_counts_the_speed_of_the_joint_that_drags():
    """In A s/m where that joint slides, whatever the other does."""
    effect = catalogue()["coupling"]
    for joint, on, unit in ((4, 3, "A s/m"), (4, 2, "A s/rad"), (3, 2, "A s/rad")):
        *_, drag = EffectTerm(effect, joint, {"on": float(on)}).parts(STANFORD, 0)
        assert (drag.name, drag.unit) == (f"coupling.j{joint}.drag", unit)


def test_unknown_ratio_hides_another_joints_load():
    """Where eta2/eta3 is not known the load of joint 2 is not; joint 3's own is."""
    world = World.of("puma")
    (model, solution), scales = world.fitted(), world.scales
    scales[1, 2:] = np.nan
    found = loads(model, world.seen(3), solution=solution, scales=scales)
    assert np.isnan(found.by_joint[:, 1]).all() and np.isfinite(found.moving).all()


@pytest.mark.parametrize(("name", "joint"), JOINTS)
def test_loads_at_the_bins_of_runs_are_the_loads(name, joint):
    """While one joint moves alone in three runs, five positions of a run say what its load is at all others."""
    world, rng, sizes = World.of(name), np.random.default_rng(joint), np.array([40, 25, 60])
    position = np.repeat(rng.uniform(-2.0, 2.0, (3, world.robot.n_joints)), sizes, axis=0)
    position[:, joint - 1] = rng.uniform(-3.0, 3.0, len(position))
    velocity = rng.uniform(-1.0, 1.0, position.shape)
    samples = Samples(joint, position, velocity, np.zeros(125), np.sign(velocity[:, joint - 1]))
    (model, solution), scales = world.fitted(), world.scales
    scales[0, -1] = np.nan  # an unknown ratio
    bins = JointBins(joint, (), samples, *np.ones((3, 125)), np.cumsum(sizes) - sizes, np.ones(3))
    ours = loads_at(model, bins, solution=solution, scales=scales)
    theirs = loads(model, samples, solution=solution, scales=scales)
    for part in ("moving", "by_joint", "slopes", "tilts", "across", "drawn"):
        np.testing.assert_allclose(getattr(ours, part), getattr(theirs, part), atol=1e-11, err_msg=part)


def test_the_gear_of_a_joint_in_motion_does_not_bear_its_rotor():
    """Of what a block's rigid body asks of joint 3, its load has every column but that of its rotor."""
    model, rng, still = Model(table1.robot(), is_dynamic=True), np.random.default_rng(3), np.zeros((40, 6))
    asked, solution = rng.standard_normal((40, len(model.inertial))), rng.standard_normal(len(model.names))
    samples = Samples(3, still, still, direction=np.ones(40), time=np.arange(40.0), run=np.zeros(40))
    bins = JointBins(3, (), samples, *np.ones((3, 40)), np.zeros(1, dtype=int), np.ones(1), asked)
    turned = np.array(["rotor" in model.names[n] for n in model.inertial])
    assert turned.any()
    found = loads_at(model, bins, solution=solution, scales=np.ones((6, 6)))
    np.testing.assert_allclose(found.moving, asked[:, ~turned] @ solution[model.inertial[~turned]])
