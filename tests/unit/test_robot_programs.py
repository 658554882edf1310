"""Programs of a plan: executed by small interpreters written here, and held against the plan."""

import re
from functools import cache

import numpy as np
import pytest
from ruamel.yaml import YAML
from scipy.interpolate import CubicHermiteSpline

from pumaid.design.robot_programs import ros2_trajectory, urscript
from pumaid.errors import ModelError
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.robot import Robot
from pumaid.trajectory import REST, Motion, Plan, highest_speeds

#: s between the instants at which an interpreter tells where the arm is.
STEP = 0.002


def loaded(text: str) -> dict:
    """As ROS 2's tools read it: YAML 1.1."""
    reader = YAML(typ="safe", pure=True)
    reader.version = (1, 1)
    return reader.load(text)


@cache
def robot(name: str) -> Robot:
    return read_recipe(shipped_recipes()[name])


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
    """Any other arm is refused, with the forms that fit it."""
    with pytest.raises(ModelError, match="URScript moves six revolute joints") as caught:
        urscript(plan(name), robot(name))
    assert (caught.value.slug, "ros2" in caught.value.mend) == ("program-other-robot", True)
