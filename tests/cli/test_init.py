"""``pumaid init`` as a user runs it."""

import hashlib
import os
import pty
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from command import answer, run
from pendulum_sample import ARM as SAMPLE
from urdfs import Stated, serial_text, tree_text

from pumaid.io.recipe import read_recipe, shipped_recipes

ARM = serial_text([Stated(xyz=(0, 0, 0.3)), Stated("fixed"), Stated(rpy=(-np.pi / 2, 0, 0)), Stated(xyz=(0.4, 0, 0))])
PAN = '<link name="eye"/><joint name="pan" type="continuous"><parent link="l1"/><child link="eye"/></joint></robot>'


@pytest.fixture(autouse=True)
def described(working_folder):
    """Nothing but a URDF."""
    Path("arm.urdf").write_text(ARM)


@pytest.mark.parametrize("name", sorted(shipped_recipes()))
def test_a_written_recipe_is_the_shipped_robot(name):
    """What init writes reads back as the shipped robot, with remarks; also where the # of the log block are taken away.

    The columns are then the canonical ones or the controller's.
    """
    assert answer(f"init {name}")["sha256"] == read_recipe(Path("recipe.yaml")).digest
    assert read_recipe(Path("recipe.yaml")).joints == read_recipe(shipped_recipes()[name]).joints
    text = Path("recipe.yaml").read_text(encoding="utf-8")
    assert f"pumaid init {name}" in text
    lines = text.splitlines()
    start = next(place for place, line in enumerate(lines) if line.startswith("# log:"))
    block = [line[2:] if line.startswith("# ") and not line.startswith("# Physics") else line for line in lines[start:]]
    end = next(place for place, line in enumerate(block) if not line.strip() or line.startswith("#"))
    Path("recipe.yaml").write_text("\n".join([*lines[:start], *block[:end]]), encoding="utf-8")
    assert read_recipe(Path("recipe.yaml")).log.current


def test_where_it_goes():
    """To a file, a folder or standard output; what is there stays without --force."""
    run("init", "blank", "--joints", "4", "-o", "arm/recipe.yaml")
    assert read_recipe(Path("arm/recipe.yaml")).n_joints == 4
    assert "--force" in run("init", "ur5e", "-o", "arm", code=3).stderr
    run("init", "ur5e", "-o", "arm", "--force")
    assert read_recipe(Path("arm/recipe.yaml")).n_joints == 6
    assert "name: Franka Emika Panda" in run("init", "panda", "-o", "-").stdout
    assert not Path("recipe.yaml").exists()


def test_list_names_every_robot():
    """--list shows all shipped names, and --json the same as one document."""
    shown = run("init", "--list").stdout
    assert [row["name"] for row in answer("init --list")["recipes"]] == list(shipped_recipes())
    assert all(name in shown for name in shipped_recipes())


def test_a_urdf_becomes_a_recipe():
    """The file is a recipe of the URDF's joints, of which a plan can be made; people get a table and the next step."""
    done = run("init", "--urdf", "arm.urdf")
    assert [joint.name for joint in read_recipe(Path("recipe.yaml")).joints] == ["j1", "j3", "j4"]
    assert [row for row in done.stdout.splitlines() if " j3 " in row and " -90 " in row]
    assert "pumaid plan recipe.yaml" in done.stderr
    run("plan", "recipe.yaml", "--minutes", "5")


def test_the_recipe_says_where_it_is_from():
    """Name, links and digest of the URDF, where the base stands, and what a user may add."""
    text = run("init", "--urdf", "arm.urdf", "-o", "-").stdout
    pieces = (
        hashlib.sha256(ARM.encode()).hexdigest(),
        "pumaid init --urdf arm.urdf --base l0 --tip l4",
        "the base (frame 0) is its link l0",
        "# log:",
        "# effects:",
        "placement: {xyz: [0.0, 0.0, 0.0], rpy: [-1.570796326795, 0.0, 0.0], axis: [0.0, 0.0, 1.0]}",
    )
    assert [piece for piece in pieces if piece not in text] == [] and not Path("recipe.yaml").exists()


def test_json_tells_what_was_done():
    """One document: the file, the links between which the arm lies, and notes on standard error."""
    Path("arm.urdf").write_text(ARM.replace("</robot>", PAN))
    document = answer("init --urdf arm.urdf --tip l4 --force")
    assert document["sha256"] == read_recipe(Path("recipe.yaml")).digest
    assert document["urdf"] == {"file": "arm.urdf", "base": "l0", "tip": "l4"} and document["joints"] == 3
    assert "note[urdf-left-out]" in run("init", "--urdf", "arm.urdf", "--tip", "l4", "--force", "--json").stderr


def test_the_command_that_a_refusal_names_works():
    """The link where one of several chains ends can be typed as it is told."""
    Path("two.urdf").write_text(tree_text(("l1", "base", "a"), ("l2", "a", "b"), ("r1", "base", "c"), ("r2", "c", "d")))
    told = run("init", "--urdf", "two.urdf", code=3).stderr
    run("init", "--urdf", "two.urdf", "--tip", told.split("--tip LINK, of ")[1].split(",")[0])
    assert [joint.name for joint in read_recipe(Path("recipe.yaml")).joints] == ["l1", "l2"]


def test_a_description_stands_where_a_recipe_does():
    """URDF and MJCF files are planned for, simulated and identified; a model belongs to the joints, not to the text."""
    Path("arm.xml").write_text(
        '<mujoco><worldbody><body name="l"><joint name="j" axis="0 1 0" range="-90 90"/><geom size="1"/></body>'
        "</worldbody></mujoco>"
    )
    told = run("plan", "arm.xml", "--minutes", "3").stderr
    assert "note[urdf-incomplete]" in told and "speed of j" in told
    run("simulate", "arm.xml", "--noise", "0.01", "-o", "logs", "--rate", "100")
    document = answer("identify logs --recipe arm.xml")
    assert document["joints"][0]["runs"] > 3
    Path("arm.xml").write_text(Path("arm.xml").read_text().replace("<mujoco>", "<mujoco><!-- another text -->"))
    assert answer("compare results/model.json logs --recipe arm.xml")["rmse"] < 0.02
    Path("two.urdf").write_text(tree_text(("l1", "base", "a"), ("r1", "base", "c")))
    assert "with pumaid init" in run("plan", "two.urdf", code=3).stderr


def conversation(*answers: str, code: int = 0) -> str:
    """What a terminal shows of ``pumaid init``, which ends with `code`, to a person who types these answers."""
    master, terminal = pty.openpty()
    line = [sys.executable, "-m", "pumaid", "init"]
    with subprocess.Popen(line, stdin=terminal, stdout=terminal, stderr=terminal, close_fds=True) as process:
        os.close(terminal)
        os.write(master, "".join(f"{answer}\n" for answer in answers).encode())
        shown = b""
        with suppress(OSError):  # the terminal closes with the program
            while part := os.read(master, 4096):
                shown += part
    os.close(master)
    assert process.returncode == code, shown.decode()
    return shown.decode()


def test_in_a_terminal_it_asks_for_robot_and_logs():
    """Columns that are known by their names are shown and confirmed, and the recipe reads the log."""
    rows = (SAMPLE / "logs" / "session_01.csv").read_text(encoding="utf-8").removeprefix("t,q1,q2,i1,i2")
    Path("log.csv").write_text(f"timestamp,actual_pos_1,actual_pos_2,i1,i2{rows}", encoding="utf-8")
    shown = conversation("pendulum2", "log.csv", "y")
    assert 'position: "actual_pos_{joint}"' in shown
    assert "actual_pos_{joint}" in Path("recipe.yaml").read_text(encoding="utf-8").split("\nlog:\n")[1]
    assert answer("identify log.csv")["joints"][1]["runs"] > 10


def test_in_a_terminal_there_may_be_no_logs_yet():
    conversation("arm.urdf", "")
    assert read_recipe(Path("recipe.yaml")).n_joints == 3


def test_in_a_terminal_a_recipe_that_is_there_is_told_first():
    Path("recipe.yaml").touch()
    shown = conversation(code=3)
    assert "recipe.yaml is there already" in shown and "Robot" not in shown
