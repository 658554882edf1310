"""``pumaid identify`` over a folder of robots."""

from __future__ import annotations

import json
import shutil
from contextlib import contextmanager
from pathlib import Path

import pytest
from command import run
from sessions import Eager


@pytest.fixture(scope="module")
def logs(tmp_path_factory) -> Path:
    """Logs of one pendulum by two seeds."""
    from pumaid.files.recipe import shipped_recipes

    folder = tmp_path_factory.mktemp("fleet")
    recipe = folder / "recipe.yaml"
    recipe.write_bytes(shipped_recipes()["pendulum2"].read_bytes())
    run("plan", str(recipe), "--minutes", "3")
    run("simulate", str(recipe), "--seed", "3", "--rate", "40", "-o", str(folder / "a"))
    truth = str(folder / "a" / "truth.json")
    run("simulate", str(recipe), "--seed", "4", "--rate", "40", "--truth", truth, "-o", str(folder / "b"))
    return folder


@pytest.fixture
def fleet(logs, tmp_path) -> Path:
    """A folder with two robots."""
    shutil.copytree(logs / "a", tmp_path / "fleet" / "arm 1")
    shutil.copytree(logs / "b", tmp_path / "fleet" / "arm 2")
    shutil.copy(logs / "recipe.yaml", tmp_path / "recipe.yaml")
    return tmp_path / "fleet"


def test_a_fleet_is_read_on_one_cluster(fleet, monkeypatch):
    """--dask: the cluster is asked for once, and only where something must be read; the models are those without it."""
    begun = []

    @contextmanager
    def connected(address, workers):
        begun.append((address, workers))
        client = Eager()
        client.scheduler_info = lambda: {"workers": {"one": {}}}
        yield client

    monkeypatch.setattr("pumaid.cluster.connect.connected", connected)
    asked = ["identify", str(fleet), "--recipe", str(fleet.parent / "recipe.yaml"), "--fleet"]
    run(*asked, "--results", str(fleet.parent / "near"), "--no-cache")
    assert begun == []
    run(*asked, "--results", str(fleet.parent / "far"), "--dask", "tcp://10.0.0.5:8786")
    run(*asked, "--results", str(fleet.parent / "far"), "--dask", "tcp://10.0.0.5:8786")
    assert begun == [("tcp://10.0.0.5:8786", None)]
    for name in ("arm 1", "arm 2"):
        models = [(fleet.parent / where / name / "model.json").read_bytes() for where in ("near", "far")]
        assert models[0] == models[1]


def test_each_robot_gets_the_model_that_it_gets_alone(fleet):
    """--fleet with a common recipe: two models beside each other, equal to those of single commands."""
    recipe = str(fleet.parent / "recipe.yaml")
    told = run("identify", str(fleet), "--recipe", recipe, "--fleet")
    assert "Where robots differ" in told.stdout
    for name in ("arm 1", "arm 2"):
        alone = run("identify", str(fleet / name), "--recipe", recipe, "-o", "-").stdout
        made = json.loads((fleet / "results" / name / "model.json").read_text())
        assert made["joints"] == json.loads(alone)["joints"]


def test_robots_with_recipes_of_their_own_are_a_fleet(fleet):
    """Without --fleet: a recipe.yaml in each sub-folder says so; results go there; --json is one document."""
    for name in ("arm 1", "arm 2"):
        shutil.copy(fleet.parent / "recipe.yaml", fleet / name)
    found = json.loads(run("identify", str(fleet), "--json").stdout)
    assert (found["kind"], list(found["robots"]), found["refused"]) == ("fleet", ["arm 1", "arm 2"], {})
    assert {one["name"] for one in found["groups"][0]["parameters"]} >= {"coulomb.j1.plus", "gravity.l2.x"}
    assert (fleet / "arm 2" / "results" / "model.json").is_file()


def test_sub_folders_of_one_robot_are_no_fleet(fleet):
    """Without --fleet and with one recipe, sub-folders are days of one robot, as before."""
    found = json.loads(run("identify", str(fleet), "--recipe", str(fleet.parent / "recipe.yaml"), "--json").stdout)
    assert found["kind"] == "model"


def test_a_bad_robot_does_not_cost_the_others(fleet):
    """One robot's log is broken: it is told by name with exit code 3, and the other's model is there."""
    for path in (fleet / "arm 2").glob("*.parquet"):
        path.write_bytes(b"PAR1 but no more")
    failed = run("identify", str(fleet), "--recipe", str(fleet.parent / "recipe.yaml"), "--fleet", code=3)
    assert "arm 2: " in failed.stderr and "Traceback" not in failed.stderr
    assert (fleet / "results" / "arm 1" / "model.json").is_file()
    assert not (fleet / "results" / "arm 2").exists()


@pytest.mark.parametrize("what", ["a file", "one robot"])
def test_what_is_no_fleet_is_refused(fleet, what):
    """--fleet of a log, or of a folder with one robot."""
    if what == "one robot":
        shutil.rmtree(fleet / "arm 2")
    target = fleet if what == "one robot" else next((fleet / "arm 1").glob("*.parquet"))
    failed = run("identify", str(target), "--recipe", str(fleet.parent / "recipe.yaml"), "--fleet", code=3)
    assert "error[no-fleet]" in failed.stderr
