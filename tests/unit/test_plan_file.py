"""Plans on disk: what is written is read back, what is wrong is told; programs for robots by their makers' rules."""

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from menus import arm as robot
from ruamel.yaml import YAML
from scipy.interpolate import CubicHermiteSpline

from pumaid.errors import Faults, ModelError, PumaidError
from pumaid.io.plan_file import find_plan, plan_text, read_plan, ros2_trajectory, urscript
from pumaid.robot import Joint, Robot
from pumaid.trajectory import REST, Motion, Plan, Posture, highest_speeds

ROBOT = Robot(
    "Lift & tip: 2",
    (
        Joint(1, "lift", "prismatic", limits=(0.0, 0.5), max_velocity=0.2),
        Joint(2, "tip", "revolute", alpha=1.5, limits=(-2.0, 2.0), max_velocity=1.0),
    ),
)
GOOD = """\
kind: plan
format: 1
robot: "Lift & tip: 2"
units: {angle: deg}
runs:
  - {joint: 1, hold: [0, 30], from: 0.1, to: 0.4, velocity: 0.1, purpose: fit}
  - {joint: 2, hold: [0.2, 0], from: 60, to: -60, velocity: 30, purpose: heldout}
  - {joint: 2, hold: [0.2, 0], from: -60, to: 60, velocity: 30}
"""
RADIANS = """\
kind: plan
format: 1
units: {angle: rad}
runs: [{joint: 2, hold: [0.2, 0], from: 1, to: -1, velocity: 0.5}]
"""


@cache
def full() -> Plan:
    """A plan with everything that a plan can have."""
    return Plan(
        robot=ROBOT.name,
        motions=(
            Motion(1, (0.0, 0.5), 0.1, 0.4, 0.1),
            Motion(2, (0.2, 0.0), np.radians(60), np.radians(-60), np.radians(33), "heldout"),
        ),
        postures=(Posture(1, (0.0, 0.5), ("gravity.l1.mass",), "a reason: with 'quotes', a # and ütf-8"),),
        expected={"coulomb.j1.plus": 0.0123, "gravity.l2.x": 4.5e-05},
        unseen={"gravity.l1.mass": "yes"},
        duration=12.5,
        seed=9,
        assumptions=("No: collisions are checked.", "true"),
    )


def read(folder: Path, text: str, name: str = "plan.yaml") -> Plan:
    """The plan of a text."""
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return read_plan(path, ROBOT)


def faults(folder: Path, text: str, name: str = "plan.yaml") -> list[PumaidError]:
    """What is wrong with a text."""
    with pytest.raises(PumaidError) as caught:
        read(folder, text, name)
    return list(caught.value.faults) if isinstance(caught.value, Faults) else [caught.value]


def test_yaml_round_trip(tmp_path):
    """All that a plan holds comes back, positions to ten digits."""
    (tmp_path / "plan.yaml").write_text(plan_text(full(), ROBOT), encoding="utf-8")
    found = read_plan(tmp_path / "plan.yaml", ROBOT)
    for one, other in zip(found.motions, full().motions, strict=True):
        numbers = [(*m.hold, m.start, m.end, m.velocity) for m in (one, other)]
        assert numbers[0] == pytest.approx(numbers[1], rel=1e-9)
        assert (one.joint, one.purpose) == (other.joint, other.purpose)
    assert (found.robot, found.duration, found.seed) == (ROBOT.name, 12.5, 9)
    assert found.postures[0].why == full().postures[0].why


def test_csv_form():
    """The CSV form holds the same runs, units in its columns' names."""
    text = plan_text(full(), ROBOT, format="csv")
    assert text.splitlines()[0] == "run,joint,hold1_m,hold2_deg,from,to,velocity,unit,purpose"
    assert text.splitlines()[2] == "2,2,0.2,0,60,-60,33,deg,heldout"


def test_hand_written_plan_is_read(tmp_path):
    """A plan of the contract's keys alone is enough; purpose is fit where it is not said; another robot's is noted."""
    found = read(tmp_path, GOOD)
    assert [motion.purpose for motion in found.motions] == ["fit", "heldout", "fit"]
    assert found.motions[1].velocity == pytest.approx(np.radians(30))
    assert found.motions[0].hold == pytest.approx((0.0, np.radians(30)))
    assert found.notes == ()
    (run,) = read(tmp_path, RADIANS).motions
    assert (run.start, run.end) == (1.0, -1.0)
    (note,) = read(tmp_path, GOOD.replace("Lift & tip: 2", "Other")).notes
    assert note.slug == "plan-other-robot"


@pytest.mark.parametrize(
    ("old", "new", "field", "line", "words"),
    [
        ("velocity: 0.1", "velocty: 0.1", "runs[1].velocty", 6, "did you mean velocity?"),
        ("kind: plan", "kind: model", "kind", 1, "be 'plan'"),
        ("format: 1", "format: 2", "format", 2, "format is 2: it should be 1"),
        ("angle: deg", "angle: grad", "units.angle", 4, "did you mean rad?"),
        ("joint: 1", "joint: 3", "runs[1]", 6, "from 1 to 2"),
        ("joint: 1", "joint: true", "runs[1].joint", 6, "valid integer"),
        ("[0, 30]", "[0, 30, 0]", "runs[1]", 6, "3 held positions; Lift & tip: 2 has 2 joints"),
        ("[0, 30]", "[0, up]", "runs[1].hold[2]", 6, "'up': it should be a valid number"),
        ("[0, 30]", "[0, 120]", "runs[1].hold", 6, "not within joint 2's"),
        ("to: 0.4", "to: 0.6", "runs[1].to", 6, "0.6 is not within joint 1's 0..0.5000 m"),
        ("to: -60", "to: 60", "runs[2].to", 7, "to the same place"),
        ("velocity: 0.1", "velocity: -0.1", "runs[1].velocity", 6, "greater than 0"),
        ("velocity: 30, purpose", "velocity: 90, purpose", "runs[2].velocity", 7, "0..57.30 deg/s"),
        ("from: 60", "from: .nan", "runs[2].from", 7, "finite number"),
        ("purpose: heldout", "purpose: held-out", "runs[2].purpose", 7, "did you mean heldout?"),
        ("robot:", "robots:", "robots", 3, "did you mean robot?"),
        ("velocity: 0.1, ", "", "runs[1].velocity", 6, "velocity is missing"),
    ],
)
def test_fault_is_told_with_line_and_path(tmp_path, old, new, field, line, words):
    """Each kind of fault names its place and what would be right."""
    assert GOOD.count(old) >= 1
    (fault,) = faults(tmp_path, GOOD.replace(old, new, 1))
    assert (fault.slug, fault.where.field, fault.where.line) == ("plan-wrong", field, line)
    assert words in f"{fault.what} {fault.mend}"


def test_faults_are_told_together_and_counted(tmp_path):
    """A plan with many faults tells the first twenty, in order, and how many more there are."""
    text = GOOD + "  - {joint: 9, hold: [0, 0], from: 0, to: 1, velocity: 1}\n" * 28
    found = faults(tmp_path, text)
    assert len(found) == 20
    assert "and 8 more faults" in found[-1].what
    assert [fault.where.line for fault in found] == sorted(fault.where.line or 0 for fault in found)


@pytest.mark.parametrize("text", ["", "- 1\n", "kind: plan\nformat: 1\nruns: []\n", "kind: plan\nformat: 1\nruns: 3\n"])
def test_no_plan_at_all_is_refused(tmp_path, text):
    assert all(isinstance(fault, ModelError) for fault in faults(tmp_path, text))
    assert text or "pumaid plan" in faults(tmp_path, text)[0].mend


def test_plan_is_found_in_the_first_folder_that_has_one(tmp_path):
    for name in ("b", "c"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "plan.yaml").write_text(GOOD)
    assert find_plan([tmp_path / "a", tmp_path / "b", tmp_path / "c"]) == tmp_path / "b" / "plan.yaml"
    assert find_plan([tmp_path / "a"]) is None


#: s between the instants at which an interpreter tells where the arm is.
STEP = 0.002


def loaded(text: str) -> dict:
    """As ROS 2's tools read it: YAML 1.1."""
    reader = YAML(typ="safe", pure=True)
    reader.version = (1, 1)
    return reader.load(text)


def plan(name: str, count: int = 12) -> Plan:
    """Runs of all joints in turn, each from a posture of its own, forth and back, drawn within limits and speeds."""
    arm, rng = robot(name), np.random.default_rng(7)
    low, high = np.array([joint.limits or (-2.5, 2.5) for joint in arm.joints]).T
    motions = []
    for number in range(count // 2):
        j = number % arm.n_joints
        hold, (start, end) = rng.uniform(low, high), low[j] + (high[j] - low[j]) * np.array([0.2, 0.8])
        speed = float(rng.uniform(0.1, 1.0) * highest_speeds(arm)[j])
        there = Motion(j + 1, tuple(hold), float(start), float(end), speed, "heldout" if number == 2 else "fit")
        motions += [there, Motion(j + 1, tuple(hold), float(end), float(start), speed)]
    return Plan(arm.name, tuple(motions))


def driven_urscript(text: str, begin: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[int], list[int]]:
    """Positions (N, J) and velocities every `STEP`, numbers announced and the samples at which they were."""
    # movej goes straight in the joints' space by a trapezoid whose speed and acceleration are the leading axis's: of
    # the joint that goes farthest.
    here, positions, velocities, numbers, marks = begin, [], [], [], []
    for line in text.splitlines():
        words = line.strip()
        if found := re.fullmatch(r"movej\(\[(.*)\], a=(.*), v=(.*)\)", words):
            target = np.array([float(value) for value in found[1].split(",")])
            way, a, v = target - here, float(found[2]), float(found[3])
            far, speed, gone = np.abs(way).max(), 0.0, 0.0
            while gone < far - 1e-12:  # integrate: speed up until braking just suffices
                speed = min(v, speed + a * STEP, np.sqrt(max(2 * a * (far - gone), 0)))
                gone = min(far, gone + max(speed, a * STEP / 2) * STEP)
                positions.append(here + gone / far * way)
                velocities.append(speed / far * way)
            here = target
        elif found := re.fullmatch(r"sleep\((.*)\)", words):
            many = round(float(found[1]) / STEP)
            positions += [here] * many
            velocities += [0 * here] * many
        elif found := re.fullmatch(r'textmsg\("pumaid run ", (\d+)\)', words):
            numbers.append(int(found[1]))
            marks.append(len(positions))
        else:
            assert re.match(r"#|def pumaid_plan\(\):|end|textmsg|$", words), words
    return np.array(positions), np.array(velocities), numbers, marks


def driven_ros2(text: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, positions and velocities as a controller interpolates positions and velocities: by cubics."""
    points = loaded(text)["points"]
    times = np.array([p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"] for p in points])
    position, velocity = (np.array([p[key] for p in points]) for key in ("positions", "velocities"))
    spline, at = CubicHermiteSpline(times, position, velocity), np.arange(times[0], times[-1], STEP)
    return at, spline(at), spline(at, 1)


def pieces(velocity: np.ndarray) -> list[tuple[int, int]]:
    """From the last sample at rest before each motion to behind the first one after it."""
    moving = np.abs(velocity).max(axis=1) > 1e-7
    edges = np.flatnonzero(np.diff(moving.astype(int)))
    return [(first, last + 2) for first, last in edges.reshape(-1, 2)]


def check_run(motion: Motion, positions: np.ndarray, velocities: np.ndarray) -> None:
    """One joint moves over the run's span, most of the way at exactly its speed, the others hold still."""
    j = motion.joint - 1
    others = [k for k in range(positions.shape[1]) if k != j]
    assert np.abs(positions[:, others] - np.array(motion.hold)[others]).max() < 1e-6
    assert (positions[0, j], positions[-1, j]) == pytest.approx((motion.start, motion.end), abs=2e-3 * motion.velocity)
    speed = velocities[:, j] * np.sign(motion.end - motion.start)
    assert speed.max() < motion.velocity * (1 + 1e-5)
    ramps = motion.velocity * 0.4 + 0.02 * abs(motion.end - motion.start)  # two ramps of 0.4 s, each half as long
    steady = np.abs(speed / motion.velocity - 1) < 1e-5
    assert np.ptp(positions[steady, j]) > abs(motion.end - motion.start) - ramps


@pytest.mark.parametrize("name", ["ur5e", "puma560"])
def test_urscript_executes_every_run(name):
    """Driven by an interpreter of its few words, the script makes every run at its speed, in order, within limits."""
    made = plan(name)
    text = urscript(made, robot(name))
    positions, velocities, numbers, marks = driven_urscript(text, np.zeros(6))
    assert numbers == list(range(1, 13))
    highest = highest_speeds(robot(name))
    assert (np.abs(velocities).max(axis=0) <= highest * (1 + 1e-5)).all()
    assert (np.abs(np.diff(positions, axis=0)) <= highest * STEP * 1.001).all()
    for motion, mark in zip(made.motions, marks, strict=True):
        moving = np.abs(velocities[mark:]).max(axis=1) > 0
        stop = np.flatnonzero(~moving)[0]
        assert stop > 10
        check_run(motion, positions[mark : mark + stop], velocities[mark : mark + stop])
        assert not moving[stop : stop + round(REST / STEP)].any()
        assert (velocities[mark - round(REST / STEP) : mark] == 0).all()


@pytest.mark.parametrize("name", ["panda", "stanford", "puma560"])
def test_ros2_executes_every_run(name):
    """Interpolated as the controller does, every run is made at its speed and every joint keeps within its own."""
    made, arm = plan(name), robot(name)
    time, position, velocity = driven_ros2(ros2_trajectory(made, arm))
    assert (np.diff(time) > 1e-9).all()
    assert (np.abs(velocity).max(axis=0) <= highest_speeds(arm) * (1 + 1e-6)).all()
    assert (np.abs(np.diff(position, axis=0)) <= highest_speeds(arm) * STEP * 1.001).all()
    stretches = iter(pieces(velocity))
    for motion in made.motions:
        begin = np.array(motion.hold)
        begin[motion.joint - 1] = motion.start
        first, end = next(one for one in stretches if np.abs(position[one[0]] - begin).max() < 1e-6)
        check_run(motion, position[first:end], velocity[first:end])


def test_ros2_is_the_message():
    """Plain YAML with the message's fields and types: floats, texts, whole seconds and nanoseconds that grow."""
    arm = robot("panda")
    # YAML 1.1 reads 1e-07 as text and 1 as an integer.
    small = Motion(1, (0.0, 1e-7, *[0.5] * 5), 0.0, 1.0, 0.5 + 1e-6)
    document = loaded(ros2_trajectory(Plan(arm.name, (*plan("panda").motions, small)), arm))
    assert set(document) == {"header", "joint_names", "points"}
    assert document["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    assert document["joint_names"] == [joint.name for joint in robot("panda").joints]
    before = 0.0
    for point in document["points"]:
        assert set(point) == {"positions", "velocities", "accelerations", "time_from_start"}
        for key in ("positions", "velocities", "accelerations"):
            assert [type(value) for value in point[key]] == [float] * 7
        since = point["time_from_start"]
        assert (type(since["sec"]), type(since["nanosec"]), 0 <= since["nanosec"] < 10**9) == (int, int, True)
        assert since["sec"] + 1e-9 * since["nanosec"] > before
        before = since["sec"] + 1e-9 * since["nanosec"]


@pytest.mark.parametrize("name", ["panda", "stanford", "pendulum2"])
def test_urscript_is_for_six_turning_joints(name):
    with pytest.raises(ModelError, match="URScript moves six revolute joints") as caught:
        urscript(plan(name), robot(name))
    assert (caught.value.slug, "ros2" in caught.value.mend) == ("program-other-robot", True)
