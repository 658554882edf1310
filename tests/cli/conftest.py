"""What several tests of commands begin with."""

from __future__ import annotations

from pathlib import Path

import pytest

from pumaid.io.recipe import shipped_recipes


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """An experiment folder with a pendulum's recipe, as working folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "recipe.yaml").write_bytes(shipped_recipes()["pendulum2"].read_bytes())
    return tmp_path
