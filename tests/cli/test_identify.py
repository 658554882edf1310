"""``pumaid identify`` on a small experiment: what it prints, writes and refuses."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from itertools import groupby
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

import pumaid
from pumaid.cli import group
from pumaid.io.recipe import shipped_recipes
from pumaid.io.write import write_log
from pumaid.simulation.random_robot import draw
from pumaid.trajectory import Plan


@pytest.fixture(scope="module")
def experiment(tmp_path_factory) -> Path:
    """A two-link pendulum's recipe and logs, as a user would have them; the plan is simulated with seed 3."""
    folder = tmp_path_factory.mktemp("arm")
    shutil.copy(shipped_recipes()["pendulum2"], folder / "recipe.yaml")
    robot = pumaid.read_recipe(folder / "recipe.yaml")
    plan: Plan = pumaid.plan(robot, minutes=5, seed=3)
    for origin, logs in groupby(pumaid.simulate(robot, plan, seed=3, rate=100.0), key=lambda log: log.origin):
        write_log(folder / "logs" / f"{origin}.csv", logs, robot)
    return folder


@pytest.fixture
def arm(experiment, tmp_path, monkeypatch) -> Path:
    """A copy of the experiment, which is the working folder."""
    shutil.copytree(experiment, tmp_path / "arm")
    monkeypatch.chdir(tmp_path / "arm")
    return tmp_path / "arm"


def identify(*arguments: str, **keywords: object) -> Result:
    """Run ``pumaid identify``."""
    return CliRunner().invoke(group, ["identify", *arguments], **keywords)


def test_prints_the_table_and_writes_the_model(arm):
    """The table is on standard output, the library's model beside the recipe, where it went on standard error."""
    done = identify("logs")
    assert done.exit_code == 0, done.stderr
    assert "two-link pendulum" in done.stdout and "±" in done.stdout
    assert done.stderr.splitlines()[-1] == "model written to results/model.json"
    assert pumaid.read_model(Path("results/model.json")).values == pumaid.load(arm).identify().values
    assert json.loads(identify("logs", "--json").stdout) == json.loads(Path("results/model.json").read_text())


def test_truth_is_inside_the_intervals(arm):
    """Identified values agree with the virtual arm's own within five standard errors: none is grossly off."""
    identify("logs")
    estimate = pumaid.read_model(arm / "results" / "model.json")
    robot = pumaid.read_recipe(arm / "recipe.yaml")
    truth = draw(robot, 3).parameters()
    told = [value for value in estimate.values if value.name in truth]
    assert len(told) >= 10
    assert [v.name for v in told if abs(v.value - truth[v.name]) > 5 * v.std_error] == []


def test_standard_input_and_output(arm):
    """A log from a pipe becomes a model in a pipe; no file is written."""
    text = (arm / "logs" / "session_01.csv").read_text(encoding="utf-8")
    done = identify("-", "-o", "-", input=text)
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["kind"] == "model"
    assert not (arm / "results").exists()


def test_the_recipe_may_come_from_standard_input(arm):
    """It is read once; the model has the recipe's digest and the same parameters."""
    known = json.loads(identify("logs", "--json").stdout)
    told = identify("logs", "--recipe", "-", "--json", input=(arm / "recipe.yaml").read_bytes())
    assert told.exit_code == 0, told.stderr
    found = json.loads(told.stdout)
    assert found["recipe"]["sha256"] == known["recipe"]["sha256"] and found["joints"] == known["joints"]
    twice = identify("-", "--recipe", "-", input=(arm / "recipe.yaml").read_bytes())
    assert twice.exit_code == 3 and twice.stderr.count("error[") == 1


@pytest.mark.parametrize(
    ("options", "path"),
    [(("-o", "first.json"), "first.json"), (("--results", "out"), "out/model.json"), ((), "results/model.json")],
)
def test_model_goes_where_it_is_told(arm, options, path):
    """``-o`` names the file, ``--results`` the folder, else it is results/ beside the recipe, where all are kept."""
    identify("logs", *options)
    kept = [] if path == "first.json" else [path.replace("model.json", "models/001-base.json")]
    assert sorted(str(found.relative_to(arm)) for found in arm.rglob("*.json")) == [path, *kept]


def test_recursive_stops_before_the_refinement(arm):
    """``--recursive`` keeps the recursion's values, and the file says so."""
    document = json.loads(identify("logs", "--recursive", "--json").stdout)
    assert document["method"] == "recursive"
    values = {one["name"]: one["value"] for fit in document["joints"] for one in fit["parameters"]}
    before = {one["name"]: one["value"] for one in document["recursive"]}
    assert {name: before[name] for name in values} == values


def test_degrees_in_the_header(arm):
    """``--units deg`` changes the table's unit and its numbers, not the file's."""
    assert "A s/deg" in identify("logs", "--units", "deg").stdout
    units = {value.unit for value in pumaid.read_model(arm / "results" / "model.json").values}
    assert "A s/rad" in units and not any("deg" in unit for unit in units)


def test_held_out_runs_are_not_fitted(arm):
    """Runs that plan.yaml keeps for judging are left out of the fit."""
    from pumaid.io.plan_file import write_plan

    robot = pumaid.read_recipe(arm / "recipe.yaml")
    plan = pumaid.plan(robot, minutes=5, seed=3)
    counts = []
    for chosen in (plan, replace(plan, motions=tuple(replace(motion, purpose="fit") for motion in plan.motions))):
        write_plan(arm / "plan.yaml", chosen, robot)
        counts.append([joint["runs"] for joint in json.loads(identify("logs", "--json").stdout)["joints"]])
    assert all(fewer < all_of_them for fewer, all_of_them in zip(*counts, strict=True))


@pytest.mark.parametrize(
    ("arguments", "slug"),
    [
        (("nowhere",), "no-such-log"),
        (("logs", "--recipe", "nothing.yaml"), "recipe-not-found"),
        (("logs", "--recipe", "puma560"), "column-missing"),
        (("logs", "-o", "/proc/model.json"), "cannot-write"),
        (("logs", "--add", "ripple@"), "effect-joint"),
        (("logs", "--add", "@2"), "unknown-effect"),
        (("logs", "--add", "stribek@2"), "did you mean stribeck?"),
        (("logs", "--heldout", "session_99.csv"), "heldout-nothing"),
        (("logs", "--add", "stribeck@2:velocity=1,velocity=2"), "effect-shape"),
    ],
)
def test_bad_input_leaves_with_3(arm, arguments, slug):
    """What cannot be used is refused in pumaid's words, with nothing on standard output."""
    done = identify(*arguments)
    assert (done.exit_code, done.stdout) == (3, ""), done.stderr
    assert slug in done.stderr and not (arm / "results" / "model.json").exists()


def test_suspicious_logs_are_refused_unless_trusted(arm):
    """Angles in degrees under a recipe of radians are refused; ``--trust`` turns that into a note."""
    import pandas as pd

    for path in (arm / "logs").iterdir():
        log = pd.read_csv(path)
        angles = [column for column in log if column.startswith("q")]
        log[angles] = log[angles] * 57.29578
        log.to_csv(path, index=False)
    done = identify("logs")
    assert done.exit_code == 3 and "error[looks-like-degrees]" in done.stderr
    assert "note[looks-like-degrees]" in identify("logs", "--trust").stderr


def test_heldout_files_are_not_fitted(arm):
    """Runs of a file that is held out are missing from the fit, and standard error says how many."""
    names = sorted(path.name for path in (arm / "logs").iterdir())
    whole, part = (json.loads(identify("logs", *more, "--json").stdout) for more in ((), ("--heldout", names[-1])))
    done = identify("logs", "--heldout", names[-1])
    assert f"of logs/{names[-1]}; " in next(line for line in done.stderr.splitlines() if "note[held-out]" in line)
    assert sum(one["runs"] for one in part["joints"]) < sum(one["runs"] for one in whole["joints"])


@pytest.mark.parametrize("options", [[], ["--recursive"]])
def test_an_effect_of_several_joints_can_be_read_back(arm, options):
    """The recursion cannot solve what acts on several joints: the model says so, and other commands can read it."""
    done = identify("logs", "--add", "flexibility@2", *options)
    assert done.exit_code == 0, done.stderr
    found = pumaid.read_model(arm / "results" / "model.json")
    alone = next(value for value in found.recursive if value.name == "flexibility.j2.c")
    assert alone.value is None and "without --recursive" in alone.reason
    assert (found.value("flexibility.j2.c").value is None) == bool(options)


def test_add_fits_an_effect_with_all_the_rest(arm):
    """``--add`` prints the effect's rows and writes its parameters and shape; the next command predicts with it."""
    done = identify("logs", "--add", "stribeck@knee:exponent=1", "--json")
    assert done.exit_code == 0, done.stderr
    document = json.loads(done.stdout)
    (effect,) = document["effects"]
    assert (effect["effect"], effect["joint"], effect["shape"]["exponent"]) == ("stribeck", 2, 1.0)
    assert 1e-4 <= effect["shape"]["velocity"] <= 20.0
    states = {value["name"]: value["state"] for value in document["joints"][1]["parameters"]}
    assert states["stribeck.j2.exponent"] == "given" and {"stribeck.j2.a", "stribeck.j2.velocity"} <= set(states)
    compared = CliRunner().invoke(group, ["compare", "results/model.json", "logs", "--json"])
    assert compared.exit_code == 0, compared.stderr
    rmse = [joint["rmse"] for joint in json.loads(compared.stdout)["joints"]]
    # identify knows the shape's own change by its slope at the end of the search, compare at its value.
    assert rmse == pytest.approx([joint["rmse"] for joint in document["joints"]], rel=1e-5)


def test_recipe_effects_can_be_left_out(arm):
    """``--remove`` takes out what the recipe switches on; the recipe, and so the model's recipe, is the same."""
    with (arm / "recipe.yaml").open("a", encoding="utf-8") as recipe:
        recipe.write("\neffects:\n  - {effect: spring, joint: knee}\n")
    kept, left = (json.loads(identify("logs", *more, "--json").stdout) for more in ((), ("--remove", "spring@2")))
    assert [one["effect"] for one in kept["effects"]] == ["spring"] and left["effects"] == []
    assert kept["recipe"] == left["recipe"]


@pytest.mark.parametrize(
    ("line", "slug", "hint"),
    [
        ("- {effect: sprig, joint: knee}", "unknown-effect", "did you mean spring?"),
        ("- {effect: stribeck, joint: 2, shape: {velocty: 1}}", "effect-shape", "did you mean velocity?"),
        ("- {effect: stribeck, joint: kne}", "recipe-bad-value", "did you mean knee?"),
        ("- {effect: stribeck, jiont: 2}", "recipe-bad-key", "did you mean joint?"),
        ("- {effect: ripple, shape: {frequency: -3}}", "effect-shape", "write a number from"),
    ],
)
def test_wrong_effects_of_a_recipe_are_told_with_their_line(arm, line, slug, hint):
    """File, line, entry and the nearest right word, before any log is read."""
    recipe = arm / "recipe.yaml"
    text = recipe.read_text(encoding="utf-8")
    recipe.write_text(f"{text}\neffects:\n  {line}\n", encoding="utf-8")
    done = identify("logs")
    number = len(text.splitlines()) + 3
    assert done.exit_code == 3 and f"error[{slug}]" in done.stderr and hint in done.stderr
    assert "recipe.yaml" in done.stderr and f"line {number}" in done.stderr and "effects[1]" in done.stderr


def test_a_second_command_does_not_read_the_logs(arm, monkeypatch):
    """The same model is made of the dataset that the first command wrote; without that file the logs are read."""
    assert "dataset written to results/dataset.npz" in identify("logs", "-o", "first.json").stderr

    def refuse(self):
        raise OSError("read again")
        yield

    monkeypatch.setattr("pumaid.io.log_reader.LogReader.__iter__", refuse)
    assert identify("logs", "-o", "second.json", "--add", "stribeck@1").exit_code == 0
    assert "dataset.npz" not in identify("logs", "-o", "third.json").stderr
    assert Path("third.json").read_bytes() == Path("first.json").read_bytes()
    Path("results/dataset.npz").unlink()
    assert identify("logs").exit_code != 0
