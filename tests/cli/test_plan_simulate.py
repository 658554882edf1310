"""``pumaid plan`` and ``pumaid simulate`` as a user runs them."""

import json

import pytest
import table1
from command import answer, run
from menus import arm as shipped
from menus import write_short_plan

from pumaid.design import motion
from pumaid.io.plan_file import plan_text, read_plan

#: The least work: a short plan of two joints.
SHORT = ("--minutes", "3")
LINE = " ".join(SHORT)
SIMULATE = ("simulate", "--rate", "20")


@pytest.fixture
def ready(folder):
    """An experiment with a plan of four short runs."""
    write_short_plan(folder / "plan.yaml")
    return folder


def test_plan_writes_beside_the_recipe_and_shows_a_table(folder):
    """The plan's file, what people want to know of it; it stays until --force."""
    done = run("plan", *SHORT)
    assert (folder / "plan.yaml").read_text().splitlines()[3] == "kind: plan"
    assert "Predicted standard errors" in done.stdout and "hip" in done.stdout
    assert "plan written to plan.yaml" in done.stderr
    (folder / "plan.yaml").write_text("mine")
    assert "--force" in run("plan", code=3).stderr
    assert (folder / "plan.yaml").read_text() == "mine"
    run("plan", *SHORT, "--force")
    assert (folder / "plan.yaml").read_text() != "mine"


def test_plan_on_standard_output_is_a_document_or_a_plan(folder):
    """--json prints one document, in rad; -o - a plan in either form, of which YAML can be read again."""
    document = answer(f"plan {LINE} -o p.yaml")
    assert (document["kind"], document["format"], document["units"]) == ("plan", 1, {"angle": "rad"})
    assert set(document["runs"][0]) == {"joint", "hold", "from", "to", "velocity", "purpose"}
    assert {entry["purpose"] for entry in document["runs"]} == {"fit", "heldout"}
    assert max(abs(entry["to"]) for entry in document["runs"]) < 3.0
    (folder / "again.yaml").write_text(run("plan", *SHORT, "-o", "-").stdout)
    rows = run("plan", *SHORT, "-o", "-", "--format", "csv").stdout.splitlines()[1:]
    motions = read_plan(folder / "again.yaml", shipped("pendulum2")).motions
    assert len(motions) == len(document["runs"]) == len(rows)
    assert not (folder / "plan.yaml").exists()
    run("plan", *SHORT, "--format", "ros2")
    assert (folder / "plan.ros2.yaml").stat().st_size > 500


def test_prior_is_a_model_of_this_arm(arm):
    assumed = answer(f"plan --prior results/model.json {LINE} -o next.yaml")["assumptions"]
    assert any("as of the earlier model" in sentence for sentence in assumed)


def test_a_looked_at_plan_is_written_where_asked(folder):
    """--check writes nothing unasked; -o - prints the plan with what it promises, which can be read again."""
    run("plan", "--minutes", "3")
    before = sorted(path.name for path in folder.iterdir())
    assert answer("plan --check plan.yaml")["expected_std_errors"]
    assert sorted(path.name for path in folder.iterdir()) == before
    (folder / "again.yaml").write_text(run("plan", "--check", "plan.yaml", "-o", "-").stdout, encoding="utf-8")
    assert "--force" in run("plan", "--check", "again.yaml", "-o", "plan.yaml", code=3).stderr
    run("plan", "--check", "again.yaml", "-o", "plan.yaml", "--force")
    assert "expected_std_errors" in (folder / "plan.yaml").read_text()


def test_a_motion_is_planned_checked_and_executed(folder, monkeypatch):
    """--motion writes a trajectory beside the recipe, which --check finds nothing wrong with and simulate follows."""
    monkeypatch.setattr(motion, "DRAWN", 8)
    monkeypatch.setattr(motion, "TRIED", 8)
    done = run("plan", "--motion", "picks", "--minutes", "0.6")
    assert "picks trajectory" in done.stdout and "highest acceleration" in done.stdout and "rotor" in done.stdout
    assert "note[plan-compared]: in 0.6 min this picks" in done.stderr
    document = answer("plan --check plan.yaml")
    assert document["runs"] == [] and document["trajectory"]["kind"] == "picks"
    assert "--check looks at a plan" in run("plan", "--motion", "picks", "--check", "plan.yaml", code=2).stderr
    (entry,) = answer("simulate --rate 50")["files"]
    assert entry["end"] == pytest.approx(36.0, abs=0.1)
    second = answer("identify logs")["joints"][1]["parameters"]
    assert {"inertia.l2.zz", "coulomb.j2.plus"} <= {value["name"] for value in second}


def test_the_papers_plan_asks_for_attention(folder):
    """Written out and checked by the PUMA's recipe it leaves with 1 and says what it lacks."""
    (folder / "paper.yaml").write_text(plan_text(table1.experiment(), table1.robot()), encoding="utf-8")
    told = run("plan", "puma560", "--check", "paper.yaml", code=1).stderr
    lacks = " ".join(line for line in told.splitlines() if "plan-lacks" in line)
    assert all(f"joint {number} (" in lacks for number in range(1, 7))


def test_simulate_writes_logs_and_truth(ready):
    """A file for so many runs, and what the robot was; --force replaces simulated logs and never others."""
    files = answer("simulate --seed 3 --rate 20 --runs-per-file 2")["files"]
    assert [entry["file"] for entry in files] == [path.name for path in sorted((ready / "logs").glob("*.parquet"))]
    assert len(files) > 1
    truth = json.loads((ready / "logs" / "truth.json").read_text())
    assert truth["kind"] == "truth"
    assert {"gravity.l1.x", "coulomb.j2.minus", "gain_ratio.1.2"} <= set(truth["parameters"])
    assert "--force" in run(*SIMULATE, code=3).stderr
    run(*SIMULATE, "--force")
    (ready / "logs" / "mine.csv").write_text("t,q1\n")
    assert "mine.csv" in run(*SIMULATE, "--force", code=3).stderr
    assert (ready / "logs" / "mine.csv").exists()


def test_hidden_effects_are_in_the_truth_and_temperatures_in_the_log(ready):
    """--hide changes the logs and is in truth.json; --temperature, or what follows it, adds a column a motor."""
    options = {
        "plain": ["--hide", "stribeck@knee:a=0.3", "--hide", "spring@1"],
        "asked": ["--temperature"],
        "needed": ["--hide", "thermal_friction@1"],
    }
    for name, more in options.items():
        run(*SIMULATE, "--format", "csv", "-o", name, *more)
    hidden = json.loads((ready / "plain" / "truth.json").read_text())["hidden"]
    assert [(entry["effect"], entry["joint"]) for entry in hidden] == [("stribeck", 2), ("spring", 1)]
    assert "did you mean spring?" in run("simulate", "--hide", "sprint", "-o", "other", code=3).stderr
    heads = {name: (ready / name / "session_01.csv").read_text().split("\n")[0] for name in options}
    assert ["temp2" in head for head in heads.values()] == [False, True, True]
