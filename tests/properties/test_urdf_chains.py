"""Random serial URDFs of every kind of geometry, and URDFs broken in every way."""

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from urdfs import Engine, Stated, serial_text

from pumaid.cli import group
from pumaid.io.urdf import UrdfRecipe

pytest.importorskip("pinocchio", reason="the independent reader is pinocchio (pip install pumaid[test])")

QUARTER = np.pi / 2
#: Farthest that an axis may be off (rad, m).
TOLERANCE = 3e-8
#: Angles and lengths that make axes parallel, meeting and coincident, and others that make them skew.
ANGLES = st.one_of(
    st.sampled_from([0.0, 0.0, QUARTER, -QUARTER, np.pi, np.pi / 4, np.pi / 3, 1.5707963, 0.1]),
    st.floats(-3.2, 3.2).map(lambda value: round(value, 3)),
)
LENGTHS = st.one_of(
    st.sampled_from([0.0, 0.0, 0.0, 0.4, -0.3]), st.floats(-0.9, 0.9).map(lambda value: round(value, 4))
)
AXES = st.one_of(
    st.sampled_from([(0, 0, 1), (0, 0, -1), (1, 0, 0), (0, -1, 0), (0, 3.0, 0), (0.6, 0, 0.8)]),
    st.tuples(*[st.floats(-1.0, 1.0).map(lambda value: round(value, 2))] * 3).filter(
        lambda axis: np.linalg.norm(axis) > 0.1
    ),
)
JOINTS = st.builds(
    Stated,
    kind=st.sampled_from(["revolute", "revolute", "continuous", "prismatic", "fixed"]),
    xyz=st.tuples(LENGTHS, LENGTHS, LENGTHS),
    rpy=st.tuples(ANGLES, ANGLES, ANGLES),
    axis=AXES,
    limit=st.just(Stated().limit),
)
CHAINS = st.lists(JOINTS, min_size=1, max_size=9).filter(lambda chain: any(joint.kind != "fixed" for joint in chain))


@settings(max_examples=50, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(joints=CHAINS, seed=st.integers(0, 1000))
def test_any_serial_chain_gives_its_own_axes(tmp_path: Path, joints: list[Stated], seed: int) -> None:
    """Every axis lies where pinocchio has it, and gravity, turned back into the root link, is along its -z."""
    path = tmp_path / "arm.urdf"
    path.write_text(serial_text([Stated("fixed", rpy=(0.4, -0.9, 2.0)), *joints]))
    made = UrdfRecipe(path, base="l1")
    engine = Engine(path, made)
    rng = np.random.default_rng(seed)
    assert np.max([engine.off(rng.uniform(-3, 3, made.robot.n_joints)) for _ in range(5)]) < TOLERANCE
    base = engine.data.oMf[engine.model.getFrameId("l1")].rotation
    assert base @ made.robot.gravity == pytest.approx([0.0, 0.0, -9.80665], abs=1e-9)


GOOD = serial_text(
    [Stated(xyz=(0, 0, 0.3)), Stated("fixed"), Stated(rpy=(-1.5, 0, 0)), Stated("prismatic", xyz=(0.4, 0, 0))]
)


def swapped(old: str, new: str, count: int = -1) -> str:
    assert old in GOOD
    return GOOD.replace(old, new, count)


AXIS, ORIGIN = '<axis xyz="0.0 0.0 1.0"/>', 'xyz="0.0 0.0 0.3"'
#: What is wrong -> the file's content; every one must be refused.
BROKEN: dict[str, str | bytes] = {
    "empty": "",
    "text": "hello",
    "binary": bytes(range(256)) * 20,
    "latin-1": GOOD.replace('name="arm"', 'name="\xe4rm"').encode("latin-1"),
    "unknown encoding": GOOD.replace('"1.0"', '"1.0" encoding="klingon"'),
    "json": '{"robot": {}}',
    "sdf": "<sdf><model name='x'/></sdf>",
    "not closed": GOOD.replace("</robot>", ""),
    "bad tag": swapped("</joint>", "</jiont>", 1),
    "attribute twice": swapped('type="revolute"', 'type="revolute" type="fixed"', 1),
    "entity bomb": '<!DOCTYPE robot [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;">]>\n<robot name="&b;"/>',
    "entity of a file": '<!DOCTYPE robot [<!ENTITY f SYSTEM "file:///etc/passwd">]><robot name="&f;"/>',
    "deep": "<robot>" + "<a>" * 5000 + "</a>" * 5000 + "</robot>",
    "no joint": '<robot name="x"><link name="a"/></robot>',
    "no link": '<robot name="x"/>',
    "only fixed": GOOD.replace('type="revolute"', 'type="fixed"').replace('type="prismatic"', 'type="fixed"'),
    "xacro element": swapped("</robot>", '<xacro:include filename="x"/></robot>'),
    "xacro expression": swapped(ORIGIN, 'xyz="0 0 ${height}"'),
    "axis of zero": swapped(AXIS, '<axis xyz="0 0 0"/>'),
    "axis of nearly zero": swapped(AXIS, '<axis xyz="0 0 1e-300"/>'),
    "axis of infinity": swapped(AXIS, '<axis xyz="0 0 inf"/>'),
    "axis beyond numbers": swapped(AXIS, '<axis xyz="1.7e308 1.7e308 1.7e308"/>'),
    "axis of two numbers": swapped(AXIS, '<axis xyz="0 1"/>'),
    "axis with commas": swapped(AXIS, '<axis xyz="0, 0, 1"/>'),
    "origin of nan": swapped(ORIGIN, 'xyz="0 0 nan"'),
    "origin beyond numbers": swapped(ORIGIN, 'xyz="0 0 1e400"'),
    "origin in millimetres": swapped(ORIGIN, 'xyz="0 0 300"'),
    "origin with underscores": swapped(ORIGIN, 'xyz="0 0 0_3"'),
    "turned by degrees": swapped('rpy="-1.5 0.0 0.0"', 'rpy="-90 0 0"'),
    "limit of words": swapped('upper="2"', 'upper="two"'),
    "speed of nan": swapped('velocity="1"', 'velocity="nan"'),
    "joint without a name": swapped('<joint name="j1"', "<joint"),
    "joint without a type": swapped('name="j1" type="revolute"', 'name="j1"'),
    "joint of an odd type": swapped('type="prismatic"', 'type="prismatc"'),
    "joint without a parent": swapped('<parent link="l0"/>', ""),
    "joint without a child": swapped('<child link="l1"/>', ""),
    "child that is not there": swapped('<child link="l1"/>', '<child link="nowhere"/>'),
    "parent that is not there": swapped('<parent link="l0"/>', '<parent link="nowhere"/>'),
    "link without a name": swapped('<link name="l2">', "<link>"),
    "link twice": swapped('<link name="l2">', '<link name="l1"/><link name="l2">'),
    "joint twice": swapped('name="j3"', 'name="j1"'),
    "child of two": swapped('<child link="l4"/>', '<child link="l1"/>'),
    "circle": swapped('<parent link="l0"/>', '<parent link="l4"/>'),
    "two trees": swapped("</robot>", '<link name="alone"/></robot>'),
    "floating": swapped('name="j1" type="revolute"', 'name="j1" type="floating"'),
    "mimic": swapped('name="j1" type="revolute">', 'name="j1" type="revolute"><mimic joint="j3"/>'),
}


def refused(content: str | bytes, tmp_path: Path) -> str:
    """The message of a file that must be refused: one error (or all of one kind of fault), no traceback, no recipe."""
    path, target = tmp_path / "arm.urdf", tmp_path / "recipe.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    result = CliRunner().invoke(group, ["init", "--urdf", str(path), "-o", str(target)])
    assert result.exit_code == 3, result.output
    assert not target.exists()
    assert re.match(r"error\[(urdf-[a-z-]+|file-not-readable)\]: \S", result.stderr), result.stderr
    assert "Traceback" not in result.stderr
    return result.stderr


@pytest.mark.parametrize("what", BROKEN)
def test_broken_files_are_refused(what: str, tmp_path: Path) -> None:
    """Each gets an error with its place and a way to mend it, exit code 3, and no recipe."""
    message = refused(BROKEN[what], tmp_path)
    assert message.count("error[") == message.count("  fix: ") == message.count("  at: ")
    assert len(message) < 2000 and "did you mean nowhere" not in message
