"""``pumaid init --urdf`` as a user runs it."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from urdfs import Stated, serial_text, tree_text

from pumaid.cli import group
from pumaid.io.recipe import read_recipe

ARM = serial_text([Stated(xyz=(0, 0, 0.3)), Stated("fixed"), Stated(rpy=(-np.pi / 2, 0, 0)), Stated(xyz=(0.4, 0, 0))])


@pytest.fixture
def init(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A function that runs ``pumaid init ...`` beside arm.urdf."""
    monkeypatch.chdir(tmp_path)
    Path("arm.urdf").write_text(ARM)
    return lambda *words, **more: CliRunner().invoke(group, ["init", *words], prog_name="pumaid", **more)


def run(result: Result, code: int = 0) -> Result:
    assert result.exit_code == code, result.output
    return result


def test_a_recipe_is_written_and_shown(init) -> None:
    """The file is a recipe of the URDF's joints; people get a table joint by joint and the next step."""
    result = run(init("--urdf", "arm.urdf"))
    robot = read_recipe(Path("recipe.yaml"))
    assert [joint.name for joint in robot.joints] == ["j1", "j3", "j4"]
    assert [row for row in result.stdout.splitlines() if " j3 " in row and " -90 " in row]
    assert "pumaid plan recipe.yaml" in result.stderr


def test_the_recipe_says_where_it_is_from(init) -> None:
    """Name, links and digest of the URDF, where the base stands, and what a user may add."""
    run(init("--urdf", "arm.urdf", "-o", "-"))
    text = run(init("--urdf", "arm.urdf", "-o", "-")).stdout
    assert hashlib.sha256(ARM.encode()).hexdigest() in text
    for piece in (
        "pumaid init --urdf arm.urdf --base l0 --tip l4",
        "the base (frame 0) is its link l0",
        "# log:",
        "# effects:",
    ):
        assert piece in text
    assert "placement: {xyz: [0.0, 0.0, 0.0], rpy: [-pi/2, 0, 0], axis: [0.0, 0.0, 1.0]}" in text
    assert not Path("recipe.yaml").exists()


def test_json_tells_what_was_done(init) -> None:
    """One document: the file, each joint, what was folded in and left out."""
    Path("arm.urdf").write_text(ARM.replace("</robot>", '<link name="eye"/>' + _pan("l1", "eye") + "</robot>"))
    document = json.loads(run(init("--urdf", "arm.urdf", "--json")).stdout)
    made = document["urdf"]
    assert document["sha256"] == read_recipe(Path("recipe.yaml")).digest
    assert [joint["name"] for joint in made["joints"]] == ["j1", "j3", "j4"]
    assert (made["base"], made["tip"], made["folded"]) == ("l0", "l4", ["j2"])
    assert made["left_out"] == {"carried": ["pan"], "elsewhere": []}
    assert np.shape(made["joints"][0]["placement"]) == (4, 4)
    assert [note["note"] for note in made["notes"]] == ["urdf-left-out"]


def _pan(parent: str, child: str) -> str:
    return f'<joint name="pan" type="continuous"><parent link="{parent}"/><child link="{child}"/></joint>'


def test_the_command_that_a_refusal_names_works(init) -> None:
    """The options for one of several chains can be typed as they are told."""
    Path("two.urdf").write_text(tree_text(("l1", "base", "a"), ("l2", "a", "b"), ("r1", "base", "c"), ("r2", "c", "d")))
    words = run(init("--urdf", "two.urdf"), 3).stderr.split("say which one: ")[1].split(" (")[0].split()
    run(init("--urdf", "two.urdf", *words))
    assert [joint.name for joint in read_recipe(Path("recipe.yaml")).joints] == ["l1", "l2"]


def test_a_plan_can_be_made_of_it(init) -> None:
    """What was derived is all that the next step needs."""
    run(init("--urdf", "arm.urdf"))
    done = CliRunner().invoke(group, ["plan", "recipe.yaml", "--minutes", "5"])
    assert done.exit_code == 0, done.output


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["ur5e", "--urdf", "arm.urdf"], "two recipes"),
        (["--urdf", "arm.urdf", "--joints", "3"], "two recipes"),
        (["ur5e", "--tip", "tool0"], "--urdf"),
        (["--base", "l1"], "--urdf"),
        ([], "--urdf FILE"),
    ],
)
def test_wrong_usage(init, words: list[str], said: str) -> None:
    """A robot's name beside a URDF, and links without one, are wrong usage."""
    assert said in " ".join(run(init(*words), 2).stderr.split())
