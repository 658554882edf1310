"""URDF files: what is read, what is refused, and which joints are the arm."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from urdfs import Stated, serial_text, tree_text

from pumaid.errors import PumaidError
from pumaid.io.urdf import ArmChain, UrdfRecipe, arm_chain, read_urdf, recipe_from_urdf

PLAIN = [Stated(xyz=(0, 0, 0.3)), Stated(rpy=(-np.pi / 2, 0, 0)), Stated(xyz=(0.4, 0, 0))]


@pytest.fixture
def made(tmp_path: Path):
    """A function that writes a URDF and makes a recipe of it."""

    def make(text: str, **ends: str) -> UrdfRecipe:
        path = tmp_path / "arm.urdf"
        path.write_text(text, encoding="utf-8")
        return recipe_from_urdf(path, **ends)

    return make


@pytest.fixture
def refusal(made):
    """A function that makes a recipe of a URDF that must be refused, and gives the error."""

    def refuse(text: str, **ends: str) -> PumaidError:
        with pytest.raises(PumaidError) as refused:
            made(text, **ends)
        return refused.value

    return refuse


@pytest.fixture
def chosen(tmp_path: Path):
    """A function that gives the arm in a tree of (joint, parent, child)."""

    def choose(*joints: tuple[str, str, str], inside: dict[str, str] | None = None, **ends: str) -> ArmChain:
        path = tmp_path / "tree.urdf"
        path.write_text(tree_text(*joints, inside=inside))
        return arm_chain(read_urdf(path), **ends)

    return choose


def names(joints) -> list[str]:
    return [joint.name for joint in joints]


def test_names_limits_and_speeds_are_kept(made) -> None:
    """What the URDF says of a joint stands in the recipe, digit for digit."""
    limit = '<limit lower="-2.8973" upper="1.5707963267948966" velocity="2.175" effort="87"/>'
    joint = made(serial_text([Stated(limit=limit)])).robot.joints[0]
    assert (joint.name, joint.limits, joint.max_velocity) == ("j1", (-2.8973, 1.570796326795), 2.175)


def test_continuous_joints_have_no_limits(made) -> None:
    """A joint without end gets none, without a note; a revolute one without any is told."""
    found = made(serial_text([Stated("continuous"), Stated(limit='<limit effort="1"/>', rpy=(1, 0, 0))]))
    assert [joint.limits for joint in found.robot.joints] == [None, None]
    assert [note.slug for note in found.notes] == ["urdf-incomplete"] * 2
    assert all("of j2:" in note.text for note in found.notes)


@pytest.mark.parametrize(
    "limit",
    [
        '<limit lower="1" upper="-1"/>',
        '<limit lower="0" upper="0" velocity="0"/>',
        '<limit lower="-1e16" upper="1e16" velocity="1e16"/>',
        '<limit lower="-inf" upper="inf" velocity="inf"/>',
        '<limit upper="1"/>',
        "",
    ],
)
def test_limits_that_cannot_be_meant_are_left_out(made, limit: str) -> None:
    """Equal, swapped, endless and missing limits and speeds are told and not taken over."""
    found = made(serial_text([Stated(limit=limit)]))
    assert (found.robot.joints[0].limits, found.robot.joints[0].max_velocity) == (None, None)
    assert [note.slug for note in found.notes] == ["urdf-incomplete"] * 2


def test_fixed_joints_are_folded_in(made) -> None:
    """A flange between two joints changes the numbers and not the number of joints."""
    plain = made(serial_text([PLAIN[0], Stated(xyz=(0.3, 0.1, 0.2), rpy=(0.5, 0, 0))]))
    folded = made(serial_text([PLAIN[0], Stated("fixed", xyz=(0.3, 0.1, 0.2)), Stated(rpy=(0.5, 0, 0))]))
    assert folded.robot.n_joints == 2
    assert folded.robot.placements == pytest.approx(plain.robot.placements, abs=1e-12)


def test_axis_may_be_negative_and_of_any_length(made) -> None:
    """-z of any length turns the other way, and no sign of a position changes."""
    robot = made(serial_text([Stated(axis=(0, 0, -250.0))])).robot
    assert robot.rotations(np.zeros((1, 1)))[0, 0, :, 2] == pytest.approx([0, 0, -1])


def test_axis_and_origin_have_the_urdfs_defaults(made) -> None:
    """Without axis it is x, without origin zero."""
    text = (
        '<robot><link name="a"/><link name="b"/><joint name="j" type="continuous"><parent link="a"/><child link="b"/>'
    )
    found = made(f"{text}</joint></robot>")
    assert pytest.approx(np.array([[1, 0, 0], [0, 0, 0]])) == found.robot.placements[0, :3, 2:].T
    assert found.robot.name == "arm"


def test_gravity_is_of_the_root(made) -> None:
    """With a base that a fixed joint tilts by a right angle, gravity lies level in the recipe."""
    text = serial_text([Stated("fixed", rpy=(0.0, np.pi / 2, 0.0)), Stated(rpy=(0.3, 0, 0)), Stated(rpy=(1, 0, 0))])
    assert made(text).robot.gravity == pytest.approx((0, 0, -9.80665))
    assert made(text, base="l1").robot.gravity == pytest.approx((9.80665, 0, 0), abs=1e-9)


def test_a_base_behind_moving_joints_is_told(made) -> None:
    """Gravity of an arm on a torso is that of the torso at zero, and the note says so."""
    slugs = [note.slug for note in made(serial_text([Stated(), *PLAIN]), base="l1").notes]
    assert slugs == ["urdf-left-out", "urdf-base-moves"]


@pytest.mark.parametrize("name", ["all", "42", "a@b", "J1", "x,y", "ä ö", "no", 'qu"ote', "back\\slash", "{joint}"])
def test_any_name_gives_a_recipe(made, name: str) -> None:
    """Names that a recipe holds are kept, in any script; others are replaced and told."""
    text = serial_text(PLAIN).replace('joint name="j2"', f"joint name='{name}'")
    found = made(text)
    kept = found.robot.joints[1].name == name
    assert kept != any(note.slug == "urdf-incomplete" for note in found.notes)
    assert kept == (name not in ("all", "42", "a@b", "J1", "x,y"))


def test_a_gripper_of_two_fingers_is_cut(chosen) -> None:
    """Branches alike and shorter than the arm are a gripper, also where one finger follows the other."""
    arm = [("j1", "base", "a"), ("j2", "a", "b"), ("fixed", "b", "hand"), ("f1", "hand", "x"), ("f2", "hand", "y")]
    for inside in ({}, {"f2": '<mimic joint="f1"/>'}):
        found = chosen(*arm, inside=inside)
        assert names(found.moving) == ["j1", "j2"]
        assert names(found.carried) == ["f1", "f2"]


def test_a_hand_of_three_fingers_is_cut(chosen) -> None:
    """Three branches are a hand, alike or not, while they are shorter than the arm."""
    arm = [("j1", "base", "a"), ("j2", "a", "b"), ("j3", "b", "c")]
    fingers = [("f1", "c", "x"), ("f2", "c", "y"), ("f3", "c", "z"), ("f4", "z", "zz")]
    assert names(chosen(*arm, *fingers).moving) == ["j1", "j2", "j3"]


def test_a_camera_beside_the_arm_is_left_out(chosen) -> None:
    """The one longer branch is the arm; what it carries besides and what it does not is told apart."""
    found = chosen(("wheel", "base", "w"), ("j1", "base", "a"), ("pan", "a", "p"), ("j2", "a", "b"), ("j3", "b", "c"))
    assert names(found.moving) == ["j1", "j2", "j3"]
    assert (names(found.carried), names(found.elsewhere)) == (["pan"], ["wheel"])


def test_two_arms_are_asked_for(chosen) -> None:
    """Chains as long as one another are refused, each with the links that would take it."""
    with pytest.raises(PumaidError) as refused:
        chosen(("t", "base", "torso"), ("l1", "torso", "a"), ("l2", "a", "b"), ("r1", "torso", "c"), ("r2", "c", "d"))
    assert refused.value.slug == "urdf-which-chain"
    assert "--base torso --tip b (2 joints); --base torso --tip d (2 joints); --base base --tip torso (1 joint)" in (
        refused.value.mend
    )


def test_a_tip_takes_all_that_leads_to_it(chosen) -> None:
    """With --tip nothing is guessed: torso, arm and the one finger."""
    tree = [("t", "base", "torso"), ("l1", "torso", "a"), ("r1", "torso", "c"), ("f1", "a", "x"), ("f2", "a", "y")]
    assert names(chosen(*tree, tip="x").moving) == ["t", "l1", "f1"]
    assert names(chosen(*tree, base="torso", tip="a").moving) == ["l1"]


@pytest.mark.parametrize(
    ("joints", "inside", "ends", "said"),
    [
        ([("floating", "world", "base"), ("j1", "base", "a"), ("j2", "a", "b")], {}, {}, "--base base"),
        ([("planar", "world", "base"), ("j1", "base", "a")], {}, {}, "--base base"),
        ([("j1", "base", "a"), ("j2", "a", "b")], {"j2": '<mimic joint="j1"/>'}, {"tip": "b"}, "--tip a"),
        ([("j1", "base", "a")], {"j1": '<mimic joint="j1"/>'}, {}, "follows"),
        ([("fixed", "base", "a")], {}, {}, "no joints move"),
        ([("j1", "base", "a"), ("j2", "base", "b")], {}, {"base": "a", "tip": "b"}, "outward from a to b"),
        ([("j1", "base", "a")], {}, {"tip": "base"}, "no joints move"),
        ([(f"j{n}", f"l{n}", f"l{n + 1}") for n in range(51)], {}, {}, "51 joints"),
    ],
)
def test_what_no_recipe_can_state(chosen, joints, inside, ends, said: str) -> None:
    """Floating and following joints, and chains without joints, are refused with where to start or end."""
    with pytest.raises(PumaidError) as refused:
        chosen(*joints, inside=inside, **ends)
    assert refused.value.slug == "urdf-which-chain"
    assert said in f"{refused.value.what} {refused.value.mend}"


def test_a_misspelt_link_is_told_the_nearest(refusal) -> None:
    """--tip with a slip of the pen names the link that was meant."""
    error = refusal(serial_text(PLAIN).replace("l3", "flange"), tip="flnage")
    assert (error.slug, error.mend) == ("urdf-which-chain", "did you mean flange?")


def test_joints_may_stand_in_any_order(made) -> None:
    """A file whose joints are listed from the tip down gives the same joints."""
    lines = serial_text(PLAIN).split("\n")
    joints = [line for line in lines if line.startswith("<joint")]
    shuffled = "\n".join([*lines[:2], *reversed(joints), *(line for line in lines[2:] if line not in joints)])
    assert made(shuffled).robot.joints == made(serial_text(PLAIN)).robot.joints


def test_form_does_not_matter(tmp_path: Path, made) -> None:
    """Comments, namespaces, other programs' blocks, a byte-order mark, UTF-16, line ends: the same recipe."""
    plain = serial_text(PLAIN)
    wanted = made(plain).robot.joints
    busy = plain.replace("<robot ", '<robot xmlns:xacro="http://ros.org/xacro" xmlns="urn:x" ').replace(
        "</robot>",
        "<!-- ${not} a macro --><gazebo><joint name='j1'/></gazebo><transmission><joint/></transmission></robot>",
    )
    assert made(busy).robot.joints == wanted
    for content in (
        plain.replace("\n", "\r\n").encode("utf-8-sig"),
        plain.replace('"1.0"', '"1.0" encoding="UTF-16"').encode("utf-16"),
    ):
        (tmp_path / "other.urdf").write_bytes(content)
        assert recipe_from_urdf(tmp_path / "other.urdf").robot.joints == wanted


def test_faults_of_the_structure_are_told_together(refusal) -> None:
    """All that is wrong with links and joints comes at once, in the order of the lines, twenty at most."""
    text = serial_text(PLAIN)
    error = refusal(text.replace('<parent link="l1"/>', "").replace('<child link="l3"/>', '<child link="l9"/>'))
    assert [fault.slug for fault in error.faults] == ["urdf-refused"] * 2
    assert [fault.what.split()[1] for fault in error.faults] == ["j2", "j3"]
    many = serial_text([Stated()] * 40).replace('<child link="l', '<child link="m')
    assert len(refusal(many).faults) == 20
