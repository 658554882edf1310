"""URDF files: what is read, what is refused, and which joints are the arm."""

from pathlib import Path

import numpy as np
import pytest
from urdfs import Stated, serial_text, tree_text

from pumaid.errors import PumaidError
from pumaid.io.urdf import UrdfRecipe

PLAIN = [Stated(xyz=(0, 0, 0.3)), Stated(rpy=(-np.pi / 2, 0, 0)), Stated(xyz=(0.4, 0, 0))]


@pytest.fixture
def made(tmp_path: Path):
    """A function that writes a URDF and makes a recipe of it."""

    def make(text: str | bytes, **ends: str) -> UrdfRecipe:
        path = tmp_path / "arm.urdf"
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        return UrdfRecipe(path, **ends)

    return make


def names(joints) -> list[str]:
    return [joint.name for joint in joints if joint.kind != "fixed"]


@pytest.mark.parametrize(
    ("limit", "kind", "limits", "speed", "n_notes"),
    [
        (
            '<limit lower="-2.8973" upper="1.5707963267948966" velocity="2.175" effort="87"/>',
            *("revolute", (-2.8973, 1.570796326795), 2.175, 0),
        ),
        ('<limit velocity="1"/>', "continuous", None, 1.0, 0),
        ('<limit lower="1" upper="-1"/>', "revolute", None, None, 2),
        ('<limit lower="0" upper="0" velocity="0"/>', "revolute", None, None, 2),
        ('<limit lower="-1e16" upper="1e16" velocity="1e16"/>', "prismatic", None, None, 2),
        ('<limit lower="-inf" upper="inf" velocity="inf"/>', "revolute", None, None, 2),
        ('<limit upper="1"/>', "revolute", None, None, 2),
        ("", "revolute", None, None, 2),
    ],
)
def test_limits_and_speeds(made, limit, kind, limits, speed, n_notes) -> None:
    """They are kept digit for digit; equal, swapped, endless and missing ones are told and not taken over."""
    recipe = made(serial_text([Stated(kind, limit=limit)]))
    joint = recipe.robot.joints[0]
    assert (joint.name, joint.limits, joint.max_velocity) == ("j1", limits, speed)
    assert [note.slug for note in recipe.notes] == ["urdf-incomplete"] * bool(n_notes)


@pytest.mark.parametrize(
    ("limit", "kind", "told"),
    [
        (
            'lower="-170" upper="170" velocity="180"',
            "revolute",
            "limits of j1 (-170 to 170, in degrees?); speed of j1 (180",
        ),
        ('lower="-3" upper="3" velocity="180"', "revolute", "speed of j1 (180, in degrees/s?)"),
        (
            'lower="0" upper="500" velocity="900"',
            "prismatic",
            "limits of j1 (0 to 500, in mm?); speed of j1 (900, in mm/s?)",
        ),
        ('lower="1" upper="1" velocity="1"', "revolute", "limits of j1 (1 to 1)"),
        ('lower="-3" upper="3" velocity="0"', "revolute", "speed of j1 (0)"),
        ('lower="-3" upper="3" velocity="1" effort="0.0"', "revolute", "effort (without use here) of j1"),
        ('lower="-6.2832" upper="12.5" velocity="35" effort="1"', "revolute", ""),
        ('lower="0" upper="0" velocity="1"', "continuous", ""),
    ],
)
def test_limits_that_make_no_sense_are_told_as_they_stand(made, limit, kind, told) -> None:
    """Degrees in a file of radians, millimetres, and what bounds nothing; what a fast arm has is kept."""
    recipe = made(serial_text([Stated(kind, limit=f"<limit {limit}/>")]))
    assert [told in note.text for note in recipe.notes] == [True] * bool(told)
    if "limits" in told:
        assert recipe.robot.joints[0].limits is None


def test_axis_and_origin(made) -> None:
    """-z of any length turns the other way; without axis it is x, without origin zero."""
    robot = made(serial_text([Stated(axis=(0, 0, -250.0))])).robot
    assert robot.rotations(np.zeros((1, 1)))[0, 0, :, 2] == pytest.approx([0, 0, -1])
    joint = '<joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint>'
    robot = made(f'<robot><link name="a"/><link name="b"/>{joint}</robot>').robot
    assert np.allclose(robot.placements[0, :3, 2:].T, [[1, 0, 0], [0, 0, 0]])
    assert robot.name == "arm"


def test_gravity_is_of_the_root(made) -> None:
    """Gravity lies level behind a fixed joint of a right angle; behind moving joints it is theirs at zero, told."""
    text = serial_text([Stated("fixed", rpy=(0.0, np.pi / 2, 0.0)), Stated(rpy=(0.3, 0, 0)), Stated(rpy=(1, 0, 0))])
    assert made(text).robot.gravity == pytest.approx((0, 0, -9.80665))
    assert made(text, base="l1").robot.gravity == pytest.approx((9.80665, 0, 0), abs=1e-9)
    slugs = [note.slug for note in made(serial_text([Stated(), *PLAIN]), base="l1").notes]
    assert slugs == ["urdf-left-out"]


@pytest.mark.parametrize("name", ["all", "42", "a@b", "J1", "x,y", "ä ö", "no", 'qu"ote', "back\\slash", "{joint}"])
def test_any_name_gives_a_recipe(made, name: str) -> None:
    """Names that a recipe holds are kept, in any script; others are replaced and told."""
    recipe = made(serial_text(PLAIN).replace('joint name="j2"', f"joint name='{name}'"))
    is_kept = recipe.robot.joints[1].name == name
    assert is_kept != any(note.slug == "urdf-incomplete" for note in recipe.notes)
    assert is_kept == (name not in ("all", "42", "a@b", "J1", "x,y"))


ARM = [("j1", "base", "a"), ("j2", "a", "b"), ("fixed", "b", "hand")]
FINGERS = [("f1", "hand", "x"), ("f2", "hand", "y")]
BESIDE = [("wheel", "base", "w"), ("j1", "base", "a"), ("pan", "a", "p"), ("j2", "a", "b"), ("j3", "b", "c")]
THREE = [("j1", "base", "a"), ("j2", "a", "b"), ("j3", "b", "c")]
TORSO = [("t", "base", "torso"), ("l1", "torso", "a"), ("r1", "torso", "c"), ("f1", "a", "x"), ("f2", "a", "y")]


@pytest.mark.parametrize(
    ("joints", "inside", "ends", "arm", "left_out"),
    [
        ([*ARM, *FINGERS], {}, {}, "j1 j2", "f1 f2"),
        ([*ARM, *FINGERS], {"f2": '<mimic joint="f1"/>'}, {}, "j1 j2", "f1 f2"),
        (
            [*THREE, *((f"f{finger}", "c", finger) for finger in "xyz"), ("f4", "z", "zz")],
            *({}, {}, "j1 j2 j3", "fx fy fz f4"),
        ),
        (BESIDE, {}, {"tip": "c"}, "j1 j2 j3", "wheel pan"),
        (TORSO, {}, {"tip": "x"}, "t l1 f1", "r1 f2"),
        (TORSO, {}, {"base": "torso", "tip": "a"}, "l1", "r1 f1 f2"),
    ],
)
def test_the_arm_in_a_tree(made, joints, inside, ends, arm, left_out) -> None:
    """Grippers and hands of three fingers are cut; with --tip nothing is guessed."""
    recipe = made(tree_text(*joints, inside=inside), **ends)
    assert [" ".join(names(part)) for part in (recipe.path, recipe.left_out)] == [arm, left_out]


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
        ([("j1", "base", "flange")], {}, {"tip": "flnage"}, "did you mean flange?"),
        ([*TORSO[:3], ("l2", "a", "b"), ("r2", "c", "d")], *({}, {}), "--tip LINK, of b, d"),
    ],
)
def test_what_no_recipe_can_state(made, joints, inside, ends, said: str) -> None:
    """Floating and following joints, chains without joints or several: with where to start or end."""
    with pytest.raises(PumaidError) as refused:
        made(tree_text(*joints, inside=inside), **ends)
    assert refused.value.slug == "urdf-which-chain"
    assert said in f"{refused.value.what} {refused.value.mend}"


def test_form_does_not_matter(made) -> None:
    """Order, comments, namespaces, other programs' blocks, a byte-order mark, UTF-16, line ends: the same recipe."""
    plain = serial_text(PLAIN)
    wanted = made(plain).robot.joints
    busy = plain.replace("<robot ", '<robot xmlns:xacro="http://ros.org/xacro" xmlns="urn:x" ').replace(
        "</robot>",
        "<!-- ${not} a macro --><gazebo><joint name='j1'/></gazebo><transmission><joint/></transmission></robot>",
    )
    lines = plain.split("\n")
    joints = [line for line in lines if line.startswith("<joint")]
    for content in (
        busy,
        "\n".join([*lines[:2], *reversed(joints), *(line for line in lines[2:] if line not in joints)]),
        plain.replace("\n", "\r\n").encode("utf-8-sig"),
        plain.replace('"1.0"', '"1.0" encoding="UTF-16"').encode("utf-16"),
    ):
        assert made(content).robot.joints == wanted
