"""Trajectories of all joints: their polynomials, files and programs, and what a virtual arm makes of them."""

import re
from dataclasses import replace

import numpy as np
import pytest
from menus import arm
from scipy.interpolate import BPoly
from test_plan_file import faults, loaded

from pumaid.io.plan_file import plan_text, read_plan, ros2_trajectory, urscript
from pumaid.simulation import draw, simulate
from pumaid.trajectory import REST, Plan, Trajectory, trajectory_parts

PUMA = arm("puma560")
GOOD = """\
kind: plan
format: 1
units: {angle: deg}
trajectory:
  repeats: 2
  knots:
    - {time: 0, position: [0.1, 0]}
    - {time: 2, position: [0.3, 30], velocity: [0, 9], acceleration: [0.05, 0]}
    - {time: 5, position: [0.1, 0]}
"""


def wanted(seed: int = 0) -> Trajectory:
    """Six joints through five random knots, twice."""
    q, v, a = np.random.default_rng(seed).uniform(-0.15, 0.15, (3, 6, 6))
    q[-1], a[-1], v[[0, -1]] = q[0], a[0], 0.0
    return Trajectory(np.array([0.0, 1.0, 2.0, 3.1, 4.2, 5.2]), q, v, a, 2)


def slow() -> np.ndarray:
    """Positions, velocities and accelerations (3, N, J) of `wanted` by scipy's polynomials, N instants a repeat."""
    made = wanted()
    knots = np.stack([made.position, made.velocity, made.acceleration], axis=1)
    spline = BPoly.from_derivatives(made.time, knots)
    return np.array([spline(INSTANTS, nu=nu) for nu in range(3)])


INSTANTS = np.linspace(0.01, 5.19, 301)


def test_polynomials_pass_the_knots():
    """Positions, speeds and accelerations are those of the Bernstein form through the same knots, in every repeat."""
    for turn in range(2):
        found = wanted().at(INSTANTS + 5.2 * turn)
        np.testing.assert_allclose(found, slow(), atol=1e-9)
    before, after = wanted().at(np.array([-1.0, 20.0])), wanted()
    np.testing.assert_allclose(before[0], after.position[[0, -1]])
    assert not before[1].any() and not before[2].any()


@pytest.mark.parametrize("rate", [250.0, 33.0])
def test_parts_join_without_a_step(rate):
    """Sample by sample the parts of a session are the trajectory, rests before and behind."""
    parts = list(trajectory_parts(replace(wanted(), repeats=4), rate))
    found = [part.at(np.arange(round(part.seconds * rate)) / rate - part.lead)[0] for part in parts]
    count = sum(map(len, found))
    time = np.arange(count) / rate - REST
    np.testing.assert_allclose(np.concatenate(found), replace(wanted(), repeats=4).at(time)[0], atol=1e-9)
    assert len(parts) == 4 and 4 * 5.2 + REST <= count / rate - REST <= 4 * 5.2 + REST + 1.0 / rate


def test_round_trip(tmp_path):
    """A trajectory comes back from its file to nine digits, and as CSV with units in the columns' names."""
    (tmp_path / "plan.yaml").write_text(plan_text(Plan("arm", (), trajectory=wanted()), PUMA))
    found = read_plan(tmp_path / "plan.yaml", PUMA).trajectory
    for name in ("time", "position", "velocity", "acceleration"):
        np.testing.assert_allclose(getattr(found, name), getattr(wanted(), name), atol=1e-9)
    assert found.repeats == 2
    head, *rows = plan_text(Plan("arm", (), trajectory=wanted()), PUMA, format="csv").splitlines()
    assert head.split(",")[:2] + head.split(",")[-1:] == ["time_s", "position1_deg", "acceleration6_deg_s2"]
    table = np.array([row.split(",") for row in rows], dtype=float)
    assert len(table) == 11 and table[-1, 0] == pytest.approx(10.4)
    np.testing.assert_allclose(np.radians(table[6, 1:7]), wanted().position[1], atol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "field", "words"),
    [
        ("position: [0.3, 30]", "position: [0.3]", "trajectory.knots[2].position", "1 values; Lift & tip: 2 has 2"),
        ("time: 2", "time: 0", "trajectory.knots[2].time", "rise"),
        ("time: 0", "time: 1", "trajectory.knots[1].time", "begin at 0"),
        ("time: 2", "time: 0.6", "trajectory.knots[1].velocity", "of joint 1 (lift) gets to 0.6"),
        ("[0.3, 30]", "[0.3, 120]", "trajectory.knots[1].position", "joint 2 (tip)"),
        ("[0, 9]", "[0, 90]", "trajectory.knots[1].velocity", "joint 2 (tip) gets to 90.00"),
        ("[0.05, 0]", "[3, 0]", "trajectory.knots[1].acceleration", "joint 1 (lift) gets to"),
        ("5, position: [0.1, 0]", "5, position: [0.2, 0]", "trajectory.knots[3]", "as it begins"),
        ("[0.1, 0]}\n    - {time: 2", "[0.1, 0], velocity: [0.01, 0]}\n    - {time: 2", "trajectory.knots[1]", "rest"),
        ("repeats: 2", "repeats: 0", "trajectory.repeats", "greater than or equal to 1"),
        ("trajectory:", "runs: [{joint: 2, hold: [0, 0], from: 0, to: 1, velocity: 1}]\ntrajectory:", "runs", "one of"),
    ],
)
def test_faults_name_knot_and_joint(tmp_path, old, new, field, words):
    """What passes a limit between knots, too, is told with the knot, the joint and how far it goes."""
    assert GOOD.count(old) >= 1
    told = faults(tmp_path, GOOD.replace(old, new, 1))
    assert field in [fault.where.field for fault in told]
    assert words in " ".join(f"{fault.what} {fault.mend}" for fault in told)


def test_ros2_has_every_knot():
    """Interpolated as the controller does where accelerations are given, the message is the trajectory."""
    points = loaded(ros2_trajectory(Plan("arm", (), trajectory=wanted()), PUMA))["points"]
    time = np.array([p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"] for p in points])
    knots = np.array([[p["positions"], p["velocities"], p["accelerations"]] for p in points])
    spline = BPoly.from_derivatives(time - time[0], knots)
    for turn in range(2):
        np.testing.assert_allclose(spline(INSTANTS + 5.2 * turn), slow()[0], atol=1e-6)


def test_urscript_drives_the_polynomials():
    """Run as Python, which its few words nearly are, the script asks the servos for the trajectory, step by step."""
    lines = urscript(Plan("arm", (), trajectory=wanted()), arm("ur5e")).splitlines()
    body = [line[2:] for line in lines[lines.index("def pumaid_plan():") + 1 : -1] if line.strip() != "end"]
    names = [word[1] for line in body if (word := re.match(r"global (\w+)", line))]
    at = next(k for k, line in enumerate(body) if line.startswith("def pumaid_to"))
    body.insert(at + 1, f"  global {', '.join(names)}")
    source = "\n".join(line if k == at + 1 else re.sub(r"\b(local|global) ", "", line) for k, line in enumerate(body))
    asked, nothing = [], lambda *_, **__: None
    words = dict.fromkeys(("movej", "sleep", "textmsg", "stopj"), nothing)
    words |= {"get_steptime": lambda: 0.002, "servoj": lambda q, **_: asked.append(list(q))}
    exec(source, words)
    assert len(asked) == 5200
    np.testing.assert_allclose(asked, wanted().at(0.002 * np.arange(5200))[0], atol=1e-5)


def test_an_arm_follows_it():
    """In closed loop the encoders of a heavy arm stay within a milliradian of the trajectory, rests included."""
    logs = list(simulate(PUMA, Plan("arm", (), trajectory=wanted(1)), truth=draw(PUMA, 4).with_noise(0.0)))
    time, position = (np.concatenate([getattr(log, name) for log in logs]) for name in ("time", "position"))
    assert np.abs(position - wanted(1).at(time - REST)[0]).max() < 2e-3
