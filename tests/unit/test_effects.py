"""What every effect owes the rest of the program, over the whole catalogue."""

import numpy as np
import pytest
from worlds import CRANE, PENDULUM

from pumaid.effects import catalogue
from pumaid.robot import Joint, Robot
from pumaid.samples import Samples


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
    """An effect says why it cannot act at a joint."""
    assert word in str(catalogue()[name].applies(UPRIGHT, joint))


@pytest.mark.parametrize("name", ["load_friction", "flexibility", "delay", "payload", "side_load_friction"])
def test_acts_where_gravity_does(name):
    """Effects of the load act on a joint whose axis is level."""
    assert catalogue()[name].applies(PENDULUM, 1) is None
