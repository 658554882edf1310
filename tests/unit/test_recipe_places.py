"""Where a recipe is looked for, and what is said when it is not there."""

from pathlib import Path

import pytest

from pumaid.errors import RecipeError
from pumaid.io.recipe import find_recipe, shipped_recipes


@pytest.fixture
def arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An experiment's folder with a log, the working folder elsewhere."""
    (tmp_path / "my_arm" / "logs").mkdir(parents=True)
    (tmp_path / "my_arm" / "logs" / "run.csv").write_text("t,q1,i1\n")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    return tmp_path / "my_arm"


def put(folder: Path, text: str = "name: x\n") -> Path:
    path = folder / "recipe.yaml"
    path.write_text(text)
    return path


def test_order_of_places(arm: Path) -> None:
    """The working folder, overruled by beside the logs, overruled by the logs' folder, overruled by what is named."""
    logs, named = [arm / "logs" / "run.csv"], arm / "other.yaml"
    named.write_text("name: y\n")
    here = put(Path())
    assert find_recipe(None, logs) == here
    beside = put(arm)
    assert find_recipe(None, logs).resolve() == beside
    inside = put(arm / "logs")
    assert find_recipe(None, logs) == inside
    assert find_recipe(named, logs) == named


@pytest.mark.parametrize("given", ["logs", "logs/run.csv", "logs/*.csv", "logs/**/*.csv", "lo*/run.csv"])
def test_folders_files_and_globs_lead_to_the_same_recipe(arm: Path, given: str) -> None:
    """A folder, a file in it or a glob over it find the recipe beside the folder."""
    beside = put(arm)
    assert find_recipe(None, [arm / given]).resolve() == beside


def test_a_miss_lists_the_places(arm: Path) -> None:
    """The message of a miss names every path that was tried, and a recipe under another name nearby."""
    (arm / "recipe.yml").write_text("name: x\n")
    with pytest.raises(RecipeError) as caught:
        find_recipe(None, [arm / "logs"])
    for place in (arm / "logs" / "recipe.yaml", arm / "recipe.yaml"):
        assert str(place) in caught.value.what
    assert "recipe.yml" in caught.value.mend


def test_two_robots_at_once_are_refused(arm: Path) -> None:
    """Logs whose folders hold different recipes are not mixed; equal copies are fine."""
    second = arm / "logs2"
    second.mkdir()
    first = put(arm / "logs")
    put(second)
    assert find_recipe(None, [arm / "logs", second]) == first
    put(second, "name: y\n")
    with pytest.raises(RecipeError, match="different recipes"):
        find_recipe(None, [arm / "logs", second])


def test_a_shipped_recipe_goes_by_its_name(arm: Path) -> None:
    """``--recipe puma560`` is the shipped one, unless a file of that name stands here."""
    assert find_recipe(Path("puma560"), []) == shipped_recipes()["puma560"]
    Path("puma560").write_text("name: mine\n")
    assert find_recipe(Path("puma560"), []) == Path("puma560")


def test_a_misspelt_name_is_answered_with_the_nearest(arm: Path) -> None:
    """A named recipe that is not there is answered with the nearest shipped name."""
    with pytest.raises(RecipeError) as caught:
        find_recipe(Path("puma650"), [])
    assert "puma560" in caught.value.mend
