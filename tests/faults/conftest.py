"""The good experiment with its results, made once, and a copy of it for each test."""

import shutil
from pathlib import Path

import pytest
from faulty import invoke, make


@pytest.fixture(scope="session")
def experiment(tmp_path_factory) -> Path:
    """The good experiment with its results; not to be changed."""
    folder = make(tmp_path_factory.mktemp("good") / "arm")
    assert invoke("identify", str(folder / "logs")).exit_code == 0
    return folder


@pytest.fixture
def arm(experiment, tmp_path) -> Path:
    """A copy of the good experiment."""
    return Path(shutil.copytree(experiment, tmp_path / "arm"))
