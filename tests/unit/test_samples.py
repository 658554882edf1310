"""The shipped samples are what their index says."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from types import ModuleType

import pyarrow.parquet as pq
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


@every_sample
def test_sample_is_made_again_byte_for_byte(sample, tmp_path):
    """Recipe, seed and commands of the index give the files that are shipped."""
    made = TOOL.contents(TOOL.make(sample, tmp_path))
    shipped = TOOL.contents(SAMPLES / sample["folder"])
    assert set(made) == set(shipped)
    differing = [name for name in made if made[name] != shipped[name]]
    for name in [name for name in differing if name.endswith(".parquet")]:
        # Another release of the Parquet writer may lay the same numbers out in other bytes.
        files = [pq.ParquetFile(folder / name) for folder in (tmp_path / sample["folder"], SAMPLES / sample["folder"])]
        assert files[0].metadata.created_by != files[1].metadata.created_by
        assert files[0].read().equals(files[1].read())
    assert [name for name in differing if not name.endswith(".parquet")] == []


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
