"""What several tests of commands begin with."""

import shutil
from pathlib import Path

import pytest
from command import run

from pumaid.io.recipe import shipped_recipes

SAMPLE = Path(__file__).parents[2] / "sample_logs" / "pendulum"


@pytest.fixture(autouse=True)
def working_folder(tmp_path, monkeypatch) -> None:
    """A folder of the test's own, in which commands run."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def folder(tmp_path) -> Path:
    """An experiment folder with a pendulum's recipe, as working folder."""
    (tmp_path / "recipe.yaml").write_bytes(shipped_recipes()["pendulum2"].read_bytes())
    return tmp_path


@pytest.fixture(scope="session")
def fitted(tmp_path_factory) -> Path:
    """The sample pendulum with the model of its logs."""
    folder = tmp_path_factory.mktemp("fitted") / "arm"
    shutil.copytree(SAMPLE, folder, ignore=shutil.ignore_patterns("results"))
    run("identify", folder / "logs")
    return folder


@pytest.fixture
def arm(fitted, tmp_path, monkeypatch) -> Path:
    """A copy of the fitted sample, which is the working folder."""
    shutil.copytree(fitted, tmp_path / "arm")
    monkeypatch.chdir(tmp_path / "arm")
    return tmp_path / "arm"
