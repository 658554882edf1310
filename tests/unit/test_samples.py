"""The shipped samples are what their index says."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from types import ModuleType

import pytest

from pumaid.io.log_reader import LogReader
from pumaid.io.paths import expand
from pumaid.io.recipe import read_recipe, shipped_recipes

ROOT = Path(__file__).parents[2]
SAMPLES = ROOT / "sample_logs"


def tool() -> ModuleType:
    """tools/make_samples.py as a module."""
    spec = importlib.util.spec_from_file_location("make_samples", ROOT / "tools" / "make_samples.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


TOOL = tool()
every_sample = pytest.mark.parametrize("sample", TOOL.index(), ids=lambda sample: sample["folder"])


def test_a_sample_is_made_alike_twice(tmp_path):
    """Recipe, seed and commands decide every file of a sample."""
    sample = {
        "folder": "small",
        "recipe": "pendulum2",
        "commands": [
            "pumaid plan --minutes 2 --seed 4",
            "pumaid simulate --seed 4 --rate 25 --runs-per-file 1000",
        ],
        "as_csv": ["session_01"],
    }
    first, again = (TOOL.contents(TOOL.make(sample, tmp_path / name)) for name in ("first", "again"))
    assert set(first) == {"recipe.yaml", "plan.yaml", "truth.json", "logs/session_01.csv"}
    assert first == again


@every_sample
def test_sample_is_small_and_readable(sample):
    """A sample is at most a megabyte, and its logs are read without a note."""
    folder = SAMPLES / sample["folder"]
    assert sum((folder / name).stat().st_size for name in TOOL.contents(folder)) < 1_000_000
    reader = LogReader(expand([folder / "logs"]), read_recipe(folder / "recipe.yaml"))
    assert sum(len(log) for log in reader) > 5000
    assert reader.notes == ()


def test_samples_use_shipped_recipes():
    """The recipe of a sample is the shipped one, and its truth is of that robot."""
    for sample in TOOL.index():
        folder = SAMPLES / sample["folder"]
        assert (folder / "recipe.yaml").read_bytes() == shipped_recipes()[sample["recipe"]].read_bytes()
        robot = read_recipe(folder / "recipe.yaml")
        assert json.loads((folder / "truth.json").read_text())["recipe"]["sha256"] == robot.digest
