"""Plans on disk: what is written is read back, what is wrong is told with line and path."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from pumaid.errors import Faults, ModelError, PumaidError
from pumaid.io.plan_file import find_plan, plan_text, read_plan
from pumaid.robot import Joint, Robot
from pumaid.trajectory import Motion, Plan, Posture

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
    """Nothing, a list, no runs, runs that are none."""
    assert all(isinstance(fault, ModelError) for fault in faults(tmp_path, text))
    assert text or "pumaid plan" in faults(tmp_path, text)[0].mend


def test_plan_is_found_in_the_first_folder_that_has_one(tmp_path):
    """The recipe's folder comes before the logs'."""
    for name in ("b", "c"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "plan.yaml").write_text(GOOD)
    assert find_plan([tmp_path / "a", tmp_path / "b", tmp_path / "c"]) == tmp_path / "b" / "plan.yaml"
    assert find_plan([tmp_path / "a"]) is None
