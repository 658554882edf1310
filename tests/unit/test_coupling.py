"""Gears that couple joints: the recipe's key, and the speeds at which motors turn."""

from dataclasses import replace

import numpy as np
import pytest

from pumaid.errors import Faults, RecipeError
from pumaid.files.recipe import read_recipe
from pumaid.records import Joint, Robot

GEARS = (-62.6, 107.8, -53.7, 76.0, 71.9, 76.7)
RATIOS = {(5, 4): 0.0139, (6, 4): -0.013, (6, 5): 0.18}
ARM = Robot(
    "six", tuple(Joint(n, f"j{n}", "revolute", gear_ratio=gear) for n, gear in enumerate(GEARS, 1)), coupling=RATIOS
)

JOINT = "  - {type: revolute, theta: 0, alpha: 0, a: 0, d: 0}\n"
GEARED = "  - {type: revolute, theta: 0, alpha: 0, a: 0, d: 0, gear_ratio: 50}\n"


def recipe(folder, coupling, joints=GEARED * 6):
    """The path of a recipe with the line `coupling`."""
    path = folder / "recipe.yaml"
    path.write_text(f"name: six\ngravity: [0, 0, -9.8]\ncoupling: {coupling}\njoints:\n{joints}")
    return path


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


def test_without_coupling_motors_turn_with_their_joints():
    """The velocities come back as they are, whatever the gears."""
    bare = replace(ARM, coupling={})
    qd = np.random.default_rng(4).normal(size=(5, 6))
    assert np.array_equal(bare.shaft_velocity(qd), qd)
    assert np.array_equal(bare.shaft_speeds, np.eye(6))


def test_a_recipe_states_the_coupling(tmp_path):
    """Names of one digit run together, longer ones are parted by a bar."""
    robot = read_recipe(recipe(tmp_path, "{r54: 0.0139, r65: -0.18, r12_9: 0.5}", GEARED * 12))
    assert robot.coupling == {(5, 4): 0.0139, (6, 5): -0.18, (12, 9): 0.5}
    assert read_recipe(recipe(tmp_path, "")).coupling == {}


@pytest.mark.parametrize(
    ("coupling", "slug", "words"),
    [
        ("{r45: 0.1}", "recipe-bad-value", "not nearer to the base"),
        ("{r55: 0.1}", "recipe-bad-value", "not nearer to the base"),
        ("{r74: 0.1}", "recipe-bad-value", "no joint 7"),
        ("{wrist: 0.1}", "recipe-unknown-key", "does not name two joints"),
        ("{r1210: 0.1}", "recipe-unknown-key", "does not name two joints"),
        ("{r54: 0.1, r5_4: 0.1}", "recipe-duplicate", "r54 and r5_4"),
        ("{r54: fast}", "recipe-wrong-type", "not a number"),
    ],
)
def test_a_coupling_that_cannot_be_is_refused_with_its_line(tmp_path, coupling, slug, words):
    """Each fault names the key and the line."""
    with pytest.raises(RecipeError) as caught:
        read_recipe(recipe(tmp_path, coupling))
    assert caught.value.slug == slug
    assert words in str(caught.value)
    assert caught.value.where.line == 3


def test_joints_that_take_part_need_their_gear_ratios(tmp_path):
    """The fault is at the joint that lacks it."""
    with pytest.raises(Faults) as caught:
        read_recipe(recipe(tmp_path, "{r65: 0.1}", GEARED * 4 + JOINT * 2))
    assert [fault.where.field for fault in caught.value.faults] == ["joints[5].gear_ratio", "joints[6].gear_ratio"]
    assert [fault.where.line for fault in caught.value.faults] == [9, 10]
