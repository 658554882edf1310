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
    from pumaid.io.recipe import shipped_recipes

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


def pendulums(fleet: Path) -> Path:
    """The fleet's folder, each robot with a recipe of its own."""
    for one in fleet.iterdir():
        shutil.copy(fleet.parent / "recipe.yaml", one / "recipe.yaml")
    return fleet


def test_logs_of_no_robot_are_told(fleet):
    """A log beside the sub-folders is in no model, and the command says so."""
    log = next((fleet / "arm 1").glob("session_*"))
    shutil.copy(log, pendulums(fleet) / f"loose{log.suffix}")
    done = run("identify", str(fleet))
    assert "note[fleet-loose-logs]" in done.stderr and f"loose{log.suffix}" in done.stderr


def test_a_fleet_with_a_recipe_missing_is_refused(fleet, monkeypatch):
    """With a recipe in the working folder, too: it would make one robot of two."""
    monkeypatch.chdir(fleet.parent)
    (pendulums(fleet) / "arm 2" / "recipe.yaml").unlink()
    done = run("identify", "fleet", code=3)
    assert "error[fleet-unclear]" in done.stderr and "arm 2 has none" in done.stderr
    assert not list(fleet.parent.rglob("model.json"))
    run("identify", "fleet", "--recipe", "recipe.yaml", "--fleet")


def test_a_log_of_two_robots_is_told(fleet):
    """A copying error: what agrees there says nothing."""
    log = next((fleet / "arm 1").glob("session_*"))
    shutil.copy(log, fleet / "arm 2" / f"copy{log.suffix}")
    done = run("identify", str(pendulums(fleet)), "--trust")
    assert "note[fleet-same-logs]: arm 2 has a log of arm 1" in done.stderr


@pytest.mark.parametrize(
    ("change", "is_same"),
    [
        (("a: 0.3", "a: 0.301"), True),
        (("a: 0.3", "a: 0.9"), False),
        (("theta: 0, ", "theta: 90, "), False),
    ],
)
def test_only_robots_of_one_arm_are_compared(fleet, change, is_same):
    """Equal names of parameters are not enough; a calibrated length is no other arm."""
    recipe = pendulums(fleet) / "arm 2" / "recipe.yaml"
    text = recipe.read_text(encoding="utf-8")
    assert change[0] in text
    recipe.write_text(text.replace(*change, 1), encoding="utf-8")
    done = run("identify", str(fleet), "--json")
    assert len(json.loads(done.stdout)["groups"]) == (1 if is_same else 0)
    assert ("note[fleet-mixed]" in done.stderr) is not is_same


def test_effects_with_other_given_shapes_are_not_compared(fleet):
    """Two waves of different frequencies have nothing in common."""
    for one, frequency in zip(sorted(pendulums(fleet).iterdir()), (21, 22), strict=True):
        recipe = one / "recipe.yaml"
        text = recipe.read_text(encoding="utf-8")
        assert "effects:" not in text
        effect = f"effects: [{{effect: ripple, joint: 2, shape: {{frequency: {frequency}}}}}]\n"
        recipe.write_text(f"{text}\n{effect}", encoding="utf-8")
    done = run("identify", str(fleet), "--json")
    assert json.loads(done.stdout)["groups"] == [] and "note[fleet-mixed]" in done.stderr
