"""``pumaid plan`` and ``pumaid simulate`` as a user runs them."""

from __future__ import annotations

import json

import pytest
from click.testing import Result
from command import run
from menus import arm, write_short_plan

from pumaid.io.plan_file import read_plan


def small(*more: str) -> Result:
    """The shortest plan."""
    return run("plan", "--speeds", "0.5,0.7,0.95", "--postures", "2", "--replicates", "1", *more)


@pytest.fixture
def ready(folder):
    """An experiment with a plan of four short runs."""
    write_short_plan(folder / "plan.yaml")
    return folder


def test_plan_writes_beside_the_recipe_and_shows_a_table(folder):
    """The plan's file, and what people want to know of it; it stays until --force."""
    found = small()
    assert (folder / "plan.yaml").read_text().splitlines()[3] == "kind: plan"
    assert "Predicted standard errors" in found.stdout
    assert "hip" in found.stdout
    assert "plan written to plan.yaml" in found.stderr
    (folder / "plan.yaml").write_text("mine")
    assert "--force" in run("plan", code=3).stderr
    assert (folder / "plan.yaml").read_text() == "mine"
    small("--force")
    assert (folder / "plan.yaml").read_text() != "mine"


def test_plan_on_standard_output_is_a_document_or_a_plan(folder):
    """--json prints one document, in rad; -o - a plan that can be read again, in either form, and writes no file."""
    document = json.loads(small("--json", "-o", "p.yaml").stdout)
    assert (document["kind"], document["format"], document["units"]) == ("plan", 1, {"angle": "rad"})
    assert set(document["runs"][0]) == {"joint", "hold", "from", "to", "velocity", "purpose"}
    assert {run["purpose"] for run in document["runs"]} == {"fit", "heldout"}
    assert max(abs(run["to"]) for run in document["runs"]) < 3.0
    plans = []
    for form in ("yaml", "csv"):
        (folder / f"again.{form}").write_text(small("-o", "-", "--format", form).stdout)
        plans.append(read_plan(folder / f"again.{form}", arm("pendulum2")))
    assert len(plans[0].motions) == len(document["runs"]) and plans[0].motions == plans[1].motions
    assert not (folder / "plan.yaml").exists()


def test_csv_plan_is_executed(ready):
    """A plan in CSV drives the virtual robot as one in YAML does: same seed, same bytes."""
    write_short_plan(ready / "plan.csv")
    for form in ("csv", "yaml"):
        run("simulate", "--plan", f"plan.{form}", "--rate", "20", "--format", "csv", "-o", form)
    assert (ready / "csv" / "session_01.csv").read_bytes() == (ready / "yaml" / "session_01.csv").read_bytes()


def test_simulate_writes_logs_and_truth(ready):
    """A file for so many runs, and what the robot was; --force replaces simulated logs and never others."""
    found = run("simulate", "--seed", "3", "--rate", "20", "--runs-per-file", "2", "--json")
    files = json.loads(found.stdout)["files"]
    assert [one["file"] for one in files] == [path.name for path in sorted((ready / "logs").glob("*.parquet"))]
    assert len(files) > 1
    truth = json.loads((ready / "logs" / "truth.json").read_text())
    assert truth["kind"] == "truth"
    assert {"gravity.l1.x", "coulomb.j2.minus", "gain_ratio.1.2"} <= set(truth["parameters"])
    assert "--force" in run("simulate", "--rate", "20", code=3).stderr
    run("simulate", "--rate", "20", "--force")
    (ready / "logs" / "mine.csv").write_text("t,q1\n")
    assert "mine.csv" in run("simulate", "--rate", "20", "--force", code=3).stderr
    assert (ready / "logs" / "mine.csv").exists()


def test_simulate_streams_to_a_pipe(ready):
    """-o - is one CSV with a header, and no folder."""
    lines = run("simulate", "--rate", "10", "--no-velocity", "-o", "-").stdout.splitlines()
    assert lines[0] == "t,q1,q2,i1,i2"
    assert not (ready / "logs").exists()


@pytest.mark.parametrize(
    ("words", "code", "told"),
    [
        (("simulate",), 3, "plan.yaml"),
        (("plan", "--minutes", "0.1"), 3, "--minutes"),
        (("plan", "--speeds", "fast"), 2, "speeds"),
    ],
)
def test_what_is_missing_or_too_little_is_told(folder, words, code, told):
    """Without a plan the message says which file was looked for, of too short a budget what is enough."""
    assert told in run(*words, code=code).output


def test_a_truth_is_simulated_again(ready):
    """An earlier truth.json, given by --truth, is the same robot: without noise the same logs, whatever the seed."""
    for name, more in (("first", ["--seed", "3"]), ("second", ["--seed", "3", "--truth", "first/truth.json"])):
        run("simulate", "--rate", "20", "--noise", "0", "--format", "csv", "-o", name, *more)
    assert (ready / "first" / "session_01.csv").read_bytes() == (ready / "second" / "session_01.csv").read_bytes()


@pytest.mark.parametrize("text", ["", "[]", '{"kind": "model"}', '{"kind": "truth", "format": 1}', "table1"])
def test_what_is_no_truth_is_refused(ready, text):
    """Nothing, a list, a model, a document without entries, the paper's six joints for a pendulum of two."""
    (ready / "truth.json").write_text(text)
    truth = "table1" if text == "table1" else "truth.json"
    told = run("simulate", "--truth", truth, code=3).stderr
    assert ("is it the truth of another robot?" if text == "table1" else "error[") in told


def test_hidden_effects_are_in_the_truth_and_temperatures_in_the_log(ready):
    """--hide changes the logs and is in truth.json; --temperature, or what follows it, adds a column a motor."""
    options = {
        "plain": ["--hide", "stribeck@knee:a=0.3", "--hide", "spring@1"],
        "asked": ["--temperature"],
        "needed": ["--hide", "thermal_friction@1"],
    }
    for name, more in options.items():
        run("simulate", "--rate", "20", "--format", "csv", "-o", name, *more)
    hidden = json.loads((ready / "plain" / "truth.json").read_text())["hidden"]
    assert [(one["effect"], one["joint"]) for one in hidden] == [("stribeck", 2), ("spring", 1)]
    assert "did you mean spring?" in run("simulate", "--hide", "sprint", "-o", "other", code=3).stderr
    heads = {name: (ready / name / "session_01.csv").read_text().split("\n")[0] for name in options}
    assert ["temp2" in head for head in heads.values()] == [False, True, True]
