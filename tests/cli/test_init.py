"""``pumaid init`` as a user runs it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from pumaid.cli import group
from pumaid.io.recipe import read_recipe, shipped_recipes


@pytest.fixture
def init(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A function that runs ``pumaid init ...`` in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return lambda *words: CliRunner().invoke(group, ["init", *words], prog_name="pumaid")


def run(result: Result, code: int = 0) -> Result:
    assert result.exit_code == code, result.output
    return result


@pytest.mark.parametrize("name", sorted(shipped_recipes()))
def test_a_written_recipe_is_the_shipped_robot(init, name: str) -> None:
    """What init writes reads back as the shipped robot, with remarks on what to change."""
    run(init(name))
    written = read_recipe(Path("recipe.yaml"))
    assert written.joints == read_recipe(shipped_recipes()[name]).joints
    text = Path("recipe.yaml").read_text(encoding="utf-8")
    assert f"pumaid init {name}" in text
    assert "# log:" in text


@pytest.mark.parametrize("name", sorted(shipped_recipes()))
def test_the_log_block_works_when_uncommented(init, name: str) -> None:
    """Taking away the # of the log block gives a recipe that reads, with canonical columns or the controller's."""
    run(init(name))
    lines = Path("recipe.yaml").read_text(encoding="utf-8").splitlines()
    start = next(place for place, line in enumerate(lines) if line.startswith("# log:"))
    block = [line[2:] if line.startswith("# ") and not line.startswith("# Physics") else line for line in lines[start:]]
    end = next(place for place, line in enumerate(block) if not line.strip() or line.startswith("#"))
    Path("recipe.yaml").write_text("\n".join([*lines[:start], *block[:end]]), encoding="utf-8")
    assert read_recipe(Path("recipe.yaml")).log.current


def test_a_blank_recipe_has_the_joints_asked_for(init) -> None:
    """``blank --joints 4`` is a readable recipe of four joints."""
    run(init("blank", "--joints", "4", "-o", "arm/recipe.yaml"))
    assert read_recipe(Path("arm/recipe.yaml")).n_joints == 4


def test_a_folder_gets_a_recipe_yaml(init) -> None:
    """``-o FOLDER`` writes recipe.yaml into it."""
    Path("arm").mkdir()
    run(init("ur5e", "-o", "arm"))
    assert Path("arm/recipe.yaml").is_file()


def test_an_existing_recipe_is_kept(init) -> None:
    """Nothing is replaced without --force; the message says how."""
    Path("recipe.yaml").write_text("mine\n")
    result = run(init("ur5e"), 3)
    assert "--force" in result.stderr
    assert Path("recipe.yaml").read_text() == "mine\n"
    run(init("ur5e", "--force"))
    assert read_recipe(Path("recipe.yaml")).n_joints == 6


def test_standard_output(init) -> None:
    """``-o -`` prints the recipe and writes nothing."""
    result = run(init("panda", "-o", "-"))
    assert "name: Franka Emika Panda" in result.stdout
    assert not list(Path().iterdir())


def test_list_names_every_robot(init) -> None:
    """--list shows all shipped names, and --json the same as one document."""
    shown = run(init("--list")).stdout
    document = json.loads(run(init("--list", "--json")).stdout)
    assert [row["name"] for row in document["recipes"]] == list(shipped_recipes())
    assert all(name in shown for name in shipped_recipes())


def test_json_says_what_was_written(init) -> None:
    """--json prints one document with the file and its digest, and nothing on standard error but notes."""
    document = json.loads(run(init("puma560", "--json")).stdout)
    assert document["sha256"] == read_recipe(Path(document["file"])).digest


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["puma650"], "puma560"),
        ([], "ur3e"),
        (["ur3e", "--joints", "3"], "--joints"),
        (["blank", "--joints", "0"], "0"),
    ],
)
def test_wrong_usage(init, words: list[str], said: str) -> None:
    """A misspelt or missing name and odd numbers of joints are wrong usage, answered with what would do."""
    assert said in run(init(*words), 2).stderr
