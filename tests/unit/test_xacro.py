"""xacro files: expanded with arguments and packages, the recipe is the URDF's; what is told where they cannot be."""

import sys
from pathlib import Path

import pytest
from urdfs import Stated, serial_text

from pumaid.errors import PumaidError
from pumaid.io.urdf import UrdfRecipe

HEAD = '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">'
PLAIN = serial_text([Stated(xyz=(0, 0, 0.3)), Stated(xyz=(0.4, 0, 0), rpy=(0.5, 0, 0))])
MACRO = '<xacro:property name="lift" value="${0.1 * 3}"/>' + PLAIN.partition(">\n")[2].partition(">\n")[2].replace(
    'xyz="0.0 0.0 0.3"', 'xyz="0 0 ${lift}"'
).replace('xyz="0.4 0.0 0.0"', 'xyz="$(arg reach) 0 0"').removesuffix("</robot>\n")
#: Of the package `arms`, whose macros are in the package `parts` beside it.
FILE = f'{HEAD}<xacro:arg name="reach" default="0.4"/><xacro:include filename="$(find parts)/arm.xacro"/></robot>'


@pytest.fixture
def described(tmp_path: Path) -> Path:
    """Two packages side by side, and the file of the first."""
    for name, file, text in (("arms", "urdf/arm.urdf.xacro", FILE), ("parts", "arm.xacro", f"{HEAD}{MACRO}</robot>")):
        path = tmp_path / name / file
        path.parent.mkdir(parents=True)
        path.write_text(text)
        (tmp_path / name / "package.xml").write_text(f"<package><name>{name}</name></package>")
    return tmp_path / "arms/urdf/arm.urdf.xacro"


def test_a_missing_package_is_told_with_the_command_that_installs_it(described, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "xacrodoc", None)
    with pytest.raises(PumaidError) as refused:
        UrdfRecipe(described)
    assert refused.value.slug == "urdf-refused" and "pip install 'pumaid[xacro]'" in refused.value.mend


def test_a_xacro_file_gives_the_recipe_of_its_urdf(described, tmp_path) -> None:
    """Expressions, arguments and macros of the package beside; another argument is another arm."""
    pytest.importorskip("xacrodoc", reason="xacro needs the package xacrodoc (pip install pumaid[xacro])")
    (tmp_path / "plain.urdf").write_text(PLAIN)
    assert UrdfRecipe(described).robot.joints == UrdfRecipe(tmp_path / "plain.urdf").robot.joints
    long = UrdfRecipe(described, arguments={"reach": "0.7"}).robot
    assert long.placements[1, 0, 3] == pytest.approx(0.7)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("$(find parts)", "$(find lost)"), "Package not found: lost"),
        (('<xacro:arg name="reach" default="0.4"/>', ""), "reach"),
        (("/arm.xacro", "/none.xacro"), "none.xacro"),
        (("<xacro:include", "<xacro:unknown/><xacro:include"), "unknown"),
        (("<xacro:include", "<link name='${1/0}'/><xacro:include"), "division by zero"),
    ],
)
def test_what_xacro_cannot_expand_is_told_in_its_words(described, change, said: str) -> None:
    """A package, argument, file or macro that is not there, an expression that fails: with how to give it."""
    pytest.importorskip("xacrodoc", reason="xacro needs the package xacrodoc (pip install pumaid[xacro])")
    described.write_text(FILE.replace(*change))
    with pytest.raises(PumaidError) as refused:
        UrdfRecipe(described)
    assert refused.value.slug == "urdf-refused" and said in refused.value.what
    assert "--arg NAME VALUE" in refused.value.mend and "ROS_PACKAGE_PATH" in refused.value.mend
