"""``pumaid plan`` and ``pumaid simulate`` as a user runs them."""

from __future__ import annotations

import json

import pytest
from click.testing import Result
from command import run


def small(*more: str) -> Result:
    """The shortest plan."""
    return run("plan", "--speeds", "0.5,0.7,0.95", "--postures", "2", "--replicates", "1", *more)


def test_plan_writes_beside_the_recipe_and_shows_a_table(folder):
    """The plan's file, and what people want to know of it."""
    found = small()
    assert (folder / "plan.yaml").read_text().splitlines()[3] == "kind: plan"
    assert "Predicted standard errors" in found.stdout
    assert "hip" in found.stdout
    assert "plan written to plan.yaml" in found.stderr


def test_plan_does_not_replace_a_plan(folder):
    """An existing plan stays, until --force."""
    (folder / "plan.yaml").write_text("mine")
    assert "--force" in run("plan", code=3).stderr
    assert (folder / "plan.yaml").read_text() == "mine"
    small("--force")
    assert (folder / "plan.yaml").read_text() != "mine"


def test_plan_as_json_is_one_document(folder):
    """Standard output holds one JSON document, in rad."""
    document = json.loads(small("--json", "-o", "p.yaml").stdout)
    assert (document["kind"], document["format"], document["units"]) == ("plan", 1, {"angle": "rad"})
    assert set(document["runs"][0]) == {"joint", "hold", "from", "to", "velocity", "purpose"}
    assert {run["purpose"] for run in document["runs"]} == {"fit", "heldout"}
    assert max(abs(run["to"]) for run in document["runs"]) < 3.0


def test_plan_to_standard_output_is_a_plan(folder):
    """What -o - prints can be read as a plan, and no file is written."""
    text = small("-o", "-").stdout
    assert not (folder / "plan.yaml").exists()
    (folder / "again.yaml").write_text(text)
    run("simulate", "--plan", "again.yaml", "--rate", "20", "-o", "logs")


def test_csv_plan_is_executed(folder):
    """A plan in CSV drives the virtual robot as one in YAML does: same seed, same bytes."""
    small("--format", "csv", "-o", "plan.csv")
    small("-o", "plan.yaml")
    for form in ("csv", "yaml"):
        run("simulate", "--plan", f"plan.{form}", "--rate", "20", "--format", "csv", "-o", form)
    assert (folder / "csv" / "session_01.csv").read_bytes() == (folder / "yaml" / "session_01.csv").read_bytes()


def test_simulate_writes_logs_and_truth(folder):
    """A file for so many runs, and what the robot was."""
    small()
    found = run("simulate", "--seed", "3", "--rate", "20", "--runs-per-file", "9", "--json")
    files = json.loads(found.stdout)["files"]
    assert [one["file"] for one in files] == [path.name for path in sorted((folder / "logs").glob("*.parquet"))]
    assert len(files) > 1
    truth = json.loads((folder / "logs" / "truth.json").read_text())
    assert truth["kind"] == "truth"
    assert {"gravity.l1.x", "coulomb.j2.minus", "gain_ratio.1.2"} <= set(truth["parameters"])


def test_simulated_logs_do_not_mix_with_others(folder):
    """A folder with logs is refused; --force replaces simulated ones but never others."""
    small()
    run("simulate", "--rate", "20")
    assert "--force" in run("simulate", "--rate", "20", code=3).stderr
    run("simulate", "--rate", "20", "--force")
    (folder / "logs" / "mine.csv").write_text("t,q1\n")
    assert "mine.csv" in run("simulate", "--rate", "20", "--force", code=3).stderr
    assert (folder / "logs" / "mine.csv").exists()


def test_simulate_streams_to_a_pipe(folder):
    """-o - is one CSV with a header, and no folder."""
    small()
    lines = run("simulate", "--rate", "10", "--no-velocity", "-o", "-").stdout.splitlines()
    assert lines[0] == "t,q1,q2,i1,i2"
    assert not (folder / "logs").exists()


def test_missing_plan_is_told(folder):
    """Without a plan the message says which file was looked for."""
    found = run("simulate", code=3)
    assert "plan.yaml" in found.stderr


def test_plan_in_no_time_is_refused(folder):
    """Too short a budget says what is enough."""
    assert "--minutes" in run("plan", "--minutes", "0.1", code=3).stderr


def test_wrong_speeds_are_wrong_usage(folder):
    """A list that is none is exit code 2."""
    assert "speeds" in run("plan", "--speeds", "fast", code=2).output


def test_a_truth_is_simulated_again(folder):
    """An earlier truth.json, given by --truth, is the same robot: without noise the same logs, whatever the seed."""
    small()
    for name, more in (("first", ["--seed", "3"]), ("second", ["--seed", "3", "--truth", "first/truth.json"])):
        run("simulate", "--rate", "20", "--noise", "0", "--format", "csv", "-o", name, *more)
    assert (folder / "first" / "session_01.csv").read_bytes() == (folder / "second" / "session_01.csv").read_bytes()


def test_a_truth_of_another_arm_is_refused(folder):
    """The paper's six joints do not fit a pendulum of two."""
    small()
    assert "is it the truth of another robot?" in run("simulate", "--truth", "table1", code=3).stderr


@pytest.mark.parametrize("text", ["", "[]", '{"kind": "model"}', '{"kind": "truth", "format": 1}'])
def test_what_is_no_truth_is_refused(folder, text):
    """Nothing, a list, a model, a document without entries."""
    small()
    (folder / "truth.json").write_text(text)
    assert "error[" in run("simulate", "--truth", "truth.json", code=3).stderr


def test_hidden_effects_are_in_the_truth(folder):
    """--hide changes the logs and is written to truth.json; a wrong name is told."""
    small()
    run("simulate", "--rate", "20", "--hide", "stribeck@knee:a=0.3", "--hide", "spring@1")
    hidden = json.loads((folder / "logs" / "truth.json").read_text())["hidden"]
    assert [(one["effect"], one["joint"]) for one in hidden] == [("stribeck", 2), ("spring", 1)]
    assert "did you mean spring?" in run("simulate", "--hide", "sprint", "-o", "other", code=3).stderr


def test_temperatures_are_written_where_asked(folder):
    """--temperature adds a column for each motor, and so does an effect that follows it."""
    small()
    options = {"plain": [], "asked": ["--temperature"], "needed": ["--hide", "thermal_friction@1"]}
    for name, more in options.items():
        run("simulate", "--rate", "20", "--format", "csv", "-o", name, *more)
    heads = {name: (folder / name / "session_01.csv").read_text().split("\n")[0] for name in options}
    assert ["temp2" in head for head in heads.values()] == [False, True, True]
