"""Sentences: why a parameter is open, and the run that would close it."""

import numpy as np
import pytest
from worlds import CRANE, STANFORD, course, run_of

from pumaid.estimation.identifiability import JointCoverage, of_column, of_ratio
from pumaid.model import Model

MODEL = Model(CRANE)


def run(joint: int, hold, speed: float, *, kind: str = "constant"):
    """A run of a second at this speed."""
    moves = course(kind, 0.0, speed, duration=1.0)
    return run_of(CRANE, joint, hold, course=moves, current=np.ones(200))


def coverage(*runs) -> dict[int, JointCoverage]:
    return {joint: JointCoverage.of(joint, runs) for joint in (1, 2, 3)}


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
    found = of_ratio(Model(STANFORD), 1, 2, coverage={j: JointCoverage.of(j, ()) for j in range(1, 7)})
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
