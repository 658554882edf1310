"""Sentences: why a parameter is open, and the run that would close it."""

from __future__ import annotations

import numpy as np
import pytest
from worlds import CRANE, STANFORD, course, run_of

from pumaid.estimation import reasons
from pumaid.estimation.reasons import JointCoverage
from pumaid.model import Model

MODEL = Model(CRANE)


def run(joint: int, hold, speed: float, *, kind: str = "constant"):
    """A run of a second at this speed."""
    moves = course(kind, 0.0, speed, duration=1.0)
    return run_of(CRANE, joint, hold, course=moves, current=np.ones(200))


def facts(*runs) -> dict[int, JointCoverage]:
    return {joint: JointCoverage.of(joint, runs) for joint in (1, 2, 3)}


def reason(name: str, *runs, partners=()):
    column = MODEL.columns[MODEL.names.index(name)]
    return reasons.of_column(MODEL, column, coverage=facts(*runs), partners=partners)


def test_facts_of_runs():
    """Speeds each way in order, outer postures counted once, strokes apart."""
    runs = [
        run(1, (0.0, 0.1, 0.2), 0.5),
        run(1, (0.9, 0.1, 0.2), 0.3),
        run(1, (0.0, 0.1, 0.9), -0.4),
        run(1, (0.0, 0.1, 0.2), 0.2, kind="stroke"),
        run(3, (0.0, 0.1, 0.2), 0.2),
    ]
    own = facts(*runs)[1]
    assert (own.runs, own.postures, own.strokes) == (4, 2, 1)
    assert own.speeds[1] == pytest.approx((0.2, 0.3, 0.5), rel=0.01)
    assert own.speeds[-1] == pytest.approx((0.4,))


@pytest.mark.parametrize(("speeds", "one"), [((0.5, 0.505), True), ((0.5, 0.52), False), ((0.5,), True), ((), False)])
def test_one_speed_is_within_two_percent(speeds, one):
    """Speeds within 2 % are one; no run at all is none."""
    assert facts(*[run(1, (0, 0, 0), speed) for speed in speeds])[1].has_one_speed(1) is one


def test_a_joint_that_never_moves():
    """Its parameters wait for logs in which it moves alone."""
    told = reason("gravity.l3.x", run(1, (0, 0, 0), 0.5))
    assert "waits for logs in which its joint moves alone" in told.text and "move the joint alone" in told.next_run


def test_a_direction_never_run():
    """Friction of a direction that is not in the logs names the direction and asks for it."""
    told = reason("viscous.j3.minus", run(3, (0, 0, 0), 0.5))
    assert told == reasons.Reason("the joint never moves backward in these logs", "repeat its forward runs backward")


def test_one_speed_names_it_in_the_joints_unit():
    """The one speed is told, and a third of it asked for; a slide's in m/s."""
    told = reason("coulomb.j2.plus", run(2, (0, 0, 0), 0.12), partners=["viscous.j2.plus"])
    assert "practically one speed, 0.12 m/s" in told.text and told.next_run == "repeat a forward run at 0.040 m/s"
    turning = reason("viscous.j1.plus", run(1, (0, 0, 0), 0.3), partners=["coulomb.j1.plus"])
    assert "0.30 rad/s" in turning.text


def test_friction_of_the_other_direction_is_no_partner_in_speed():
    """Tied to its weight, a turning joint's friction asks for more travel and does not speak of speeds."""
    told = reason("coulomb.j1.plus", run(1, (0, 0, 0), 0.3), partners=["coulomb.j1.minus", "gravity.l1.x"])
    assert "cannot be told from its weight" in told.text and "travel further" in told.next_run


@pytest.mark.parametrize("name", ["gravity.l2.mass", "coulomb.j2.plus"])
def test_a_slide_at_one_angle(name):
    """A slide's load and Coulomb friction are told apart by another angle to gravity."""
    partners = ["coulomb.j2.minus", "gravity.l2.mass" if name.startswith("c") else "coulomb.j2.plus"]
    told = reason(name, run(2, (0, 0, 0), 0.1), run(2, (0, 0, 0), 0.2), partners=partners)
    assert told == reasons.reason("one load")


def test_one_outer_posture():
    """A weight tied to links outward, held in one posture only, asks for another one."""
    told = reason("gravity.l1.x", run(1, (0, 0, 0), 0.3), partners=["gravity.l3.x", "gain_ratio.1.3"])
    assert "held in one posture only" in told.text and "held elsewhere" in told.next_run


def test_many_partners_are_counted():
    """Of more than three the first three are named and the rest counted."""
    runs = [run(1, (0, 0, 0), 0.3), run(1, (0, 0, 1), 0.3)]
    told = reason("gravity.l1.x", *runs, partners=[f"gravity.l{n}.x" for n in (2, 3, 4, 5, 6)])
    assert told.text.endswith("gravity.l2.x, gravity.l3.x, gravity.l4.x and 2 more")


def test_redundant_ratio_has_no_run():
    """A ratio that the geometry hides is said to be hidden, and no run is promised."""
    told = reasons.of_ratio(Model(STANFORD), 1, 2, coverage={j: JointCoverage.of(j, ()) for j in range(1, 7)})
    assert "in any posture" in told.text and told.next_run is None


@pytest.mark.parametrize(("still", "moved"), [(1, 3), (3, 1)])
def test_ratio_waits_for_either_joint(still, moved):
    """The joint without runs is named, be it the inner or the outer one."""
    told = reasons.of_ratio(MODEL, 1, 3, coverage=facts(run(moved, (0, 0, 0), 0.3)))
    assert told.text == f"waits for logs in which joint {still} moves alone"


def moved_all():
    return facts(*[run(joint, (0, 0, outer), 0.3) for joint in (1, 2, 3) for outer in (0, 1)])


def test_a_link_too_light_to_be_felt():
    """A load of little more than its own error is told in amperes, and a payload asked for."""
    told = reasons.of_ratio(MODEL, 2, 3, coverage=moved_all(), load=(0.0004, 0.0011))
    assert "link 3 is too light to be felt by joint 2" in told.text and "0.00040 A, known to 0.0011 A" in told.text
    assert "payload" in told.next_run


def test_a_ratio_from_one_outer_posture():
    """With the outer joints held in one posture only that is the reason, however light the load."""
    one = facts(*[run(joint, (0, 0, 0), 0.3) for joint in (1, 2, 3)])
    told = reasons.of_ratio(MODEL, 2, 3, coverage=one, load=(0.0004, 0.0011))
    assert "held in one posture only" in told.text and "two or more positions" in told.next_run
