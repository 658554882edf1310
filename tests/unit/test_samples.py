"""The shipped samples are what their index says."""

import json
import sys
from pathlib import Path

import pytest

from pumaid.io.log_reader import LogReader
from pumaid.io.paths import expand
from pumaid.io.recipe import read_recipe, shipped_recipes

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

import make_samples

ROOT = Path(__file__).parents[2]
SAMPLES = ROOT / "sample_logs"

every_sample = pytest.mark.parametrize("sample", make_samples.index(), ids=lambda sample: sample["folder"])


def test_a_sample_is_made_alike_twice(tmp_path):
    sample = {
        "folder": "small",
        "recipe": "pendulum2",
        "commands": ["pumaid plan --minutes 2 --seed 4", "pumaid simulate --seed 4 --rate 25 --runs-per-file 1000"],
        "as_csv": ["session_01"],
    }
    first, again = (make_samples.contents(make_samples.make(sample, tmp_path / name)) for name in ("first", "again"))
    assert set(first) == {"recipe.yaml", "plan.yaml", "truth.json", "logs/session_01.csv"}
    assert first == again


@every_sample
def test_sample_is_small_and_readable(sample):
    """A sample is at most a megabyte, and its logs are read without a note."""
    folder = SAMPLES / sample["folder"]
    assert sum((folder / name).stat().st_size for name in make_samples.contents(folder)) < 1_000_000
    robot = read_recipe(folder / "recipe.yaml")
    readers = [LogReader(path, robot) for path in expand([folder / "logs"])]
    assert sum(len(log) for reader in readers for log in reader) > 5000
    assert [reader.notes for reader in readers if reader.notes] == []


def test_samples_use_shipped_recipes():
    """The recipe of a sample is the shipped one, and its truth is of that robot."""
    for sample in make_samples.index():
        folder = SAMPLES / sample["folder"]
        assert (folder / "recipe.yaml").read_bytes() == shipped_recipes()[sample["recipe"]].read_bytes()
        robot = read_recipe(folder / "recipe.yaml")
        assert json.loads((folder / "truth.json").read_text())["recipe"]["sha256"] == robot.digest
