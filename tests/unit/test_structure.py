"""The minimal parameters, derived by rank, against the case rules of Theorem 3 and Corollary 4; coupled gears.

The rules speak of axes that are parallel or perpendicular to gravity or to each other in every posture; those facts are
looked up here in random postures by plain products of rotations, since special twists align axes by accident."""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pytest
import worlds
from scipy.spatial.transform import Rotation
from worlds import CRANE, GEARS, STANFORD, TURN, arm, course, run_of, wrist

from pumaid.effects import Samples, catalogue
from pumaid.estimation.identifiability import of_column, of_ratio
from pumaid.model import Model, Structure, minimal
from pumaid.robot import Robot

#: Cosines and sines below this are rounding of right angles.
ALIGNED = 1e-9
STRINGS = ["".join(kinds) for n in range(1, 7) for kinds in product("RP", repeat=n)]


@dataclass
class Facts:
    """Of each joint (from 0): turning, upright or level in every posture, its angle to gravity constant; and (J, J)
    whether two axes are always parallel."""

    turning: list[bool]
    upright: list[bool]
    level: list[bool]
    constant: list[bool]
    parallel: np.ndarray


def facts(robot: Robot) -> Facts:
    """By eight random postures."""
    rng, axes = np.random.default_rng(99), []
    for _ in range(8):
        turn, z = Rotation.identity(), []
        for joint in robot.joints:
            angle = joint.theta + (rng.uniform(-3, 3) if joint.is_revolute else 0.0)
            turn = turn * Rotation.from_euler("x", joint.alpha) * Rotation.from_euler("z", angle)
            z.append(turn.apply([0.0, 0.0, 1.0]))
        axes.append(z)
    found, down = np.array(axes), np.array(robot.gravity) / np.linalg.norm(robot.gravity)
    along = found @ down
    crossed = np.linalg.norm(np.cross(found[:, :, None], found[:, None]), axis=-1).max(axis=0)
    return Facts(
        turning=[joint.is_revolute for joint in robot.joints],
        upright=(np.abs(along).min(axis=0) > 1 - ALIGNED).tolist(),
        level=(np.abs(along).max(axis=0) < ALIGNED).tolist(),
        constant=(np.ptp(along, axis=0) < ALIGNED).tolist(),
        parallel=crossed < 1e-6,
    )


def by_the_rules(robot: Robot) -> tuple[set[str], set[int], set[tuple[int, int]]]:
    """Absent parameters, prismatic joints whose load hides in Coulomb terms, redundant ratios (joints from 1)."""
    known, n = facts(robot), robot.n_joints
    r = known.turning.index(True) if any(known.turning) else n
    s = next((k for k in range(r + 1, n) if known.turning[k] and not known.parallel[r, k]), n)
    is_upright = r < n and known.upright[r]
    absent, embodied = set(), set()
    for i in range(n):
        if known.turning[i] and is_upright and r <= i < s:
            absent |= {f"gravity.l{i + 1}.x", f"gravity.l{i + 1}.y"}
        if not known.turning[i] and known.constant[i]:
            absent.add(f"gravity.l{i + 1}.mass")
            embodied |= set() if known.level[i] else {i + 1}
    redundant = {j for j in range(n - 1) if j < r or (is_upright and j < s)}
    # A slide that never carries anything draws no current for weight, so its own gain is in no equation: of its two
    # ratios only the product can be known.
    idle = {j for j in range(n) if not known.turning[j] and known.level[j]}
    redundant |= {j for j in range(n - 1) if j in idle or j + 1 in idle}
    return absent, embodied, {(j + 1, j + 2) for j in redundant}


def found(structure: Structure) -> tuple[set[str], set[int], set[tuple[int, int]]]:
    return set(structure.absent), set(structure.embodied), set(structure.redundant)


def special(kinds: str, rng: np.random.Generator, *, is_upright: bool) -> Robot:
    """Twists and offsets of right angles, the first axis upright (either way up) or level."""
    first = rng.choice([0.0, np.pi] if is_upright else [TURN, -TURN])
    robot = arm(kinds, [first, *rng.choice([0.0, TURN, -TURN, np.pi], len(kinds) - 1)])
    turned = [replace(joint, theta=float(rng.choice([0.0, TURN, -TURN, np.pi]))) for joint in robot.joints]
    return replace(robot, joints=tuple(turned))


@pytest.mark.parametrize("twists", ["random", "upright", "level"])
@pytest.mark.parametrize("length", range(1, 7))
def test_arms_by_the_rules(length, twists):
    """Every string of joints with random twists, and with right angles, the first axis upright or level."""
    rng, wrong = np.random.default_rng(10 * length), []
    for kinds in (kinds for kinds in STRINGS if len(kinds) == length):
        robot = arm(kinds, rng.uniform(-3.0, 3.0, length), gravity=tuple(rng.normal(size=3) * 5.0))
        robot = robot if twists == "random" else special(kinds, rng, is_upright=twists == "upright")
        if found(minimal(robot)) != by_the_rules(robot):
            wrong.append((kinds, [joint.alpha for joint in robot.joints], [joint.theta for joint in robot.joints]))
    assert not wrong


def test_neither_postures_nor_the_unit_of_gravity_matter():
    """Other random postures, and gravity in another unit, leave the parameters that exist the same."""
    for kinds, alphas in (("RRPRRR", [0, -TURN, TURN, 0, -TURN, TURN]), ("PRPR", [0.3, 0, TURN, 0.4])):
        robot = arm(kinds, alphas)
        assert found(minimal(robot, seed=1)) == found(minimal(robot))
        for unit in (1e-6, 1e6):
            scaled = replace(robot, gravity=tuple(unit * g for g in robot.gravity))
            assert found(minimal(scaled)) == found(minimal(robot))


def test_without_gravity_nothing_has_weight():
    structure = minimal(arm("RPR", [0.3, 0.4, 0.5], gravity=(0.0, 0.0, 0.0)))
    assert len(structure.absent) == 5 and set(structure.redundant) == {(1, 2), (2, 3)}


def test_reasons_name_the_joint_and_its_case():
    """Each case has its own sentence, with the joint's number and name."""
    lift = minimal(arm("PR", [0.0, 0.0]))
    assert "joint 1 (joint 1) and gravity never changes" in lift.absent["gravity.l1.mass"]
    assert "coulomb.j1.plus" in lift.absent["gravity.l1.mass"]
    assert "turns about the direction of gravity" in lift.absent["gravity.l2.x"]
    level = minimal(arm("PR", [TURN, 0.0]))
    assert "perpendicular to gravity" in level.absent["gravity.l1.mass"]
    assert "joint 1 (joint 1) does not feel the weight that joint 2" in level.redundant[(1, 2)]


MODEL = Model(CRANE)


def run(joint: int, hold, speed: float, *, kind: str = "constant"):
    """A run of a second at this speed."""
    moves = course(kind, 0.0, speed, duration=1.0)
    return run_of(CRANE, joint, hold, course=moves, current=np.ones(200))


def coverage(*runs) -> dict:
    return {joint: [run for run in runs if run.joint == joint] for joint in (1, 2, 3)}


FIRST, SECOND, THIRD = run(1, (0, 0, 0), 0.3), run(2, (0, 0, 0), 0.12), run(3, (0, 0, 0), 0.5)
#: Parameter, runs, partners -> what the reason says, and the next run.
CASES = {
    "a joint that never moves": ("gravity.l3.x", [FIRST], [], "waits for logs in which its joint moves alone", "alone"),
    "a direction never run": ("viscous.j3.minus", [THIRD], [], "never moves backward", "forward runs backward"),
    "one speed of a slide": (
        *("coulomb.j2.plus", [SECOND], ["viscous.j2.plus"]),
        *("practically one speed, 0.12 m/s", "repeat a forward run at 0.040 m/s"),
    ),
    "one speed of a turning joint": ("viscous.j1.plus", [FIRST], ["coulomb.j1.plus"], "0.30 rad/s", "forward run"),
    "friction and weight": (
        *("coulomb.j1.plus", [FIRST], ["coulomb.j1.minus", "gravity.l1.x"]),
        *("cannot be told from its weight", "travel further"),
    ),
    "a slide's load": ("gravity.l2.mass", [SECOND], ["coulomb.j2.plus"], "one angle to gravity", "another angle"),
    "a slide's friction": ("coulomb.j2.plus", [SECOND], ["gravity.l2.mass"], "one angle to gravity", "another angle"),
    "one outer posture": ("gravity.l1.x", [FIRST], ["gravity.l3.x"], "held in one posture only", "held elsewhere"),
    "many partners": (
        *("gravity.l1.x", [FIRST, run(1, (0, 0, 1), 0.3)], [f"gravity.l{n}.x" for n in (2, 3, 4, 5, 6)]),
        *("gravity.l2.x, gravity.l3.x, gravity.l4.x ... (5 in all)", "other postures"),
    ),
    "a weight never felt": ("gravity.l1.x", [FIRST], [], "next to nothing", "lies level"),
}


@pytest.mark.parametrize("case", CASES)
def test_each_reason_names_its_run(case):
    """What keeps a parameter from being identified, and the run that would show it."""
    name, runs, partners, text, next_run = CASES[case]
    column = MODEL.columns[MODEL.names.index(name)]
    found = of_column(MODEL, column, coverage=coverage(*runs), partners=partners)
    assert text in found["reason"] and next_run in found["next_run"]


def test_redundant_ratio_has_no_run():
    """A ratio that the geometry hides is said to be hidden, and no run is promised."""
    found = of_ratio(Model(STANFORD), 1, 2, coverage=dict.fromkeys(range(1, 7), ()))
    assert "in any posture" in found["reason"] and found["next_run"] is None


@pytest.mark.parametrize(
    ("runs", "text", "next_run"),
    [
        ([run(3, (0, 0, 0), 0.3)], "waits for logs in which joint 2 moves alone", "alone"),
        ([SECOND], "waits for logs in which joint 3 moves alone", "alone"),
        ([SECOND, THIRD], "held in one posture only", "two or more positions"),
        (
            [run(joint, (0, 0, outer), 0.3) for joint in (2, 3) for outer in (0, 1)],
            "link 3 is too light to be felt by joint 2: its weight moves that current by about 0.00040 A, known to"
            " 0.0011 A",
            "payload",
        ),
    ],
)
def test_why_a_ratio_is_open(runs, text, next_run):
    """Either joint without runs, one outer posture, or a load of little more than its own error, in amperes."""
    found = of_ratio(MODEL, 2, 3, coverage=coverage(*runs), load=(0.0004, 0.0011))
    assert text in found["reason"] and next_run in found["next_run"]


ARM = wrist({(5, 4): 0.0139, (6, 4): -0.013, (6, 5): 0.18})


def motor_turns(qd):
    """Eq. (38)-(40) of the paper as they stand: motor speeds of joints 4, 5, 6 from joint speeds."""
    r = [1.0 / gear for gear in GEARS]
    four = qd[3] / r[3]
    five = qd[4] / r[4] + 0.0139 * four
    six = qd[5] / r[5] - 0.013 * four + 0.18 * five
    return np.array([r[3] * four, r[4] * five, r[5] * six])


def test_a_coupled_wrist_turns_its_motors_as_the_paper_writes():
    """Friction of joints 4, 5, 6 is driven by r_i qdS_i of eq. (38)-(40), that of joints 1 to 3 by their own speed."""
    qd = np.random.default_rng(3).uniform(-2.0, 2.0, (20, 6))
    seen = ARM.shaft_velocity(qd)
    np.testing.assert_allclose(seen[:, :3], qd[:, :3], rtol=0, atol=0)
    np.testing.assert_allclose(seen[:, 3:], [motor_turns(row) for row in qd], rtol=1e-13)


def test_a_joint_that_moves_alone_drives_its_own_friction_at_its_own_speed():
    """In the runs that identification uses, coupling changes nothing in the moving joint."""
    for joint in range(6):
        qd = np.zeros((1, 6))
        qd[0, joint] = 0.7
        assert ARM.shaft_velocity(qd)[0, joint] == 0.7
        assert np.all(ARM.shaft_velocity(qd)[0, :joint] == 0.0)


#: The pendulum with its second motor turned by the first: the motors' own speeds, by hand, are qd2 + 0.9 * 50/90 qd1.
GEARED_PENDULUM = replace(
    worlds.PENDULUM,
    joints=(replace(worlds.PENDULUM.joint(1), gear_ratio=50.0), replace(worlds.PENDULUM.joint(2), gear_ratio=90.0)),
    coupling={(2, 1): 0.9},
)


def friction(v):
    """A of either joint of the pendulum at the speed of its motor, rad/s of the joint."""
    return np.where(v > 0, 0.4 + 0.2 * v, -0.3 + 0.1 * v)


def seen(joint, qd):
    """Instants at these velocities (N, 2)."""
    q = np.zeros_like(qd)
    return Samples(joint, q, qd, direction=np.sign(GEARED_PENDULUM.shaft_velocity(qd)[:, joint - 1]))


@pytest.mark.parametrize(
    ("name", "shape", "law"),
    [
        ("stribeck", {"velocity": 0.2, "exponent": 1.0}, lambda v: np.sign(v) * np.exp(-np.abs(v) / 0.2)),
        ("viscous_power", {"exponent": 0.5}, lambda v: np.sign(v) * np.sqrt(np.abs(v))),
    ],
)
def test_effects_of_speed_follow_the_motor(name, shape, law):
    """Friction that hangs on speed is that of the motor's shaft, which joint 1 turns as well."""
    qd = np.random.default_rng(5).uniform(-1.0, 1.0, (30, 2))
    for joint, driving in ((1, qd[:, 0]), (2, qd[:, 1] + qd[:, 0] * 0.9 * 50.0 / 90.0)):
        columns = catalogue()[name].columns(GEARED_PENDULUM, seen(joint, qd), shape=shape)
        np.testing.assert_allclose(columns[:, 0], law(driving), rtol=1e-12)


def test_held_joints_that_tremble_drive_no_friction():
    """What the encoder of a held joint shows during a run is no speed of its motor."""
    course = worlds.course("constant", -1.0, 1.0, duration=2.0)
    run = worlds.run_of(GEARED_PENDULUM, 2, [0.3, 0.3], course=course, current=friction(course[2]))
    rough = run.bins.position + np.array([0.005, 0.0]) * np.sin(np.arange(len(run.bins)))[:, None]
    rough_run = replace(run, bins=replace(run.bins, position=rough))
    assert np.array_equal(rough_run.velocity[:, 0], np.zeros(len(run.bins)))
    assert np.array_equal(rough_run.velocity[:, 1], run.bins.velocity)
