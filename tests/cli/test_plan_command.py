"""Every option of ``pumaid plan`` as a user gives it, alone and where it does not belong."""

from __future__ import annotations

import json
import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest
from command import run
from menus import write_short_plan
from ruamel.yaml import YAML

from pumaid.io.recipe import read_recipe
from pumaid.simulation import table1

SAMPLE = Path(__file__).parents[2] / "sample_logs" / "pendulum"
#: The least work: a short plan of two joints.
SHORT = ("--minutes", "3")


def document(*words: str, code: int = 0) -> dict:
    """What ``--json`` prints, which is one document and nothing else."""
    return json.loads(run("plan", "--json", *words, code=code).stdout)


def test_prior_is_a_model_of_this_arm(folder):
    """A model identified from simulated logs is planned for; of another arm it is refused with one message."""
    run("plan", *SHORT)
    run("simulate", "--rate", "20", "--seed", "3")
    run("identify", "logs")
    found = document("--prior", "results/model.json", *SHORT, "-o", "next.yaml")
    assert any("as of the earlier model" in one for one in found["assumptions"])
    refused = run("plan", "stanford", "--prior", "results/model.json", "-o", "other.yaml", code=3)
    assert refused.stderr.count("error[") == 1
    assert "error[" in run("plan", "--prior", "recipe.yaml", "-o", "other.yaml", code=3).stderr
    assert not (folder / "other.yaml").exists()


def test_a_tilted_arm_is_rehearsed_by_its_recipe(folder):
    """Beside the plan stands a recipe with gravity turned, not replaced unasked; its session runs from end to end."""
    run("plan", "--tilt", "10,0", *SHORT)
    made = folder / "plan-recipe.yaml"
    turned = 9.80665 * np.sin(np.radians([10.0, 80.0]))
    assert read_recipe(made).gravity == pytest.approx((0.0, *-turned))
    run("simulate", "plan-recipe.yaml", "--plan", "plan.yaml", "--rate", "20")
    (folder / "recipe.yaml").write_bytes(made.read_bytes())
    fits = json.loads(run("identify", "logs", "--json").stdout)["joints"]
    found = {value["name"] for fit in fits for value in fit["parameters"] if value["state"] == "identified"}
    assert {"gravity.l1.x", "gravity.l2.x", "coulomb.j1.plus"} <= found
    (folder / "plan.yaml").unlink()
    made.write_text("mine")
    assert "plan-recipe.yaml" in run("plan", "--tilt", "10,0", *SHORT, code=3).stderr
    assert made.read_text() == "mine" and not (folder / "plan.yaml").exists()


def test_runs_for_an_effect(folder):
    """--for adds runs of that joint to a short experiment; --size, --against and --logs are heard."""
    base, more = document(*SHORT, "-o", "a.yaml"), document("--for", "stribeck@knee", *SHORT, "-o", "b.yaml")
    assert more["runs"][: len(base["runs"])] == base["runs"]
    assert {run["joint"] for run in more["runs"][len(base["runs"]) :]} == {2}
    small = document("--for", "stribeck@2", "--size", "0.03", *SHORT, "-o", "c.yaml")
    assert len(small["runs"]) > len(more["runs"])
    apart = document("--for", "stribeck@2", "--against", "viscous_power", *SHORT, "-o", "d.yaml")
    assert "from viscous_power@2" in apart["assumptions"][-1]
    run("simulate", "--plan", "a.yaml", "--rate", "20")
    found = document("--for", "stribeck@2", "--logs", "logs", "--size", "0.05", "-o", "more.yaml")
    assert {run["joint"] for run in found["runs"]} == {2}


def test_the_papers_plan_asks_for_attention(folder):
    """Written out and checked by the PUMA's recipe it leaves with 1 and says what it lacks."""
    from pumaid.io.plan_file import plan_text

    (folder / "paper.yaml").write_text(plan_text(table1.experiment(), table1.robot()), encoding="utf-8")
    found = run("plan", "puma560", "--check", "paper.yaml", code=1)
    told = " ".join(line for line in found.stderr.splitlines() if "plan-lacks" in line)
    assert all(f"joint {number} (" in told for number in range(1, 7))
    assert "Traceback" not in found.output


def test_a_plan_is_checked_edited_and_refused(folder):
    """--check -o - prints what can be read again and replaces no file unasked; a fault is one message."""
    run("plan", *SHORT)
    path = folder / "plan.yaml"
    text = run("plan", "--check", "plan.yaml", "-o", "-", code=0).stdout
    (folder / "again.yaml").write_text(text, encoding="utf-8")
    assert YAML().load(text)["expected_std_errors"]
    assert "--force" in run("plan", "--check", "again.yaml", "-o", "plan.yaml", code=3).stderr
    run("plan", "--check", "again.yaml", "-o", "plan.yaml", "--force")
    head, _, runs = path.read_text(encoding="utf-8").partition("runs:")
    path.write_text(f"{head}runs:{runs.replace('hold: [', 'hold: [900, ', 1)}", encoding="utf-8")
    refused = run("plan", "--check", "plan.yaml", code=3)
    assert refused.stderr.count("error[") == 1
    assert "error[plan-wrong]" in refused.stderr and "line" in refused.stderr
    assert refused.stdout == ""


@pytest.mark.parametrize(
    "words",
    [
        ("--against", "spring"),
        ("--size", "0.1"),
        ("--logs", "logs"),
        ("--check", "p.yaml", "--for", "spring@1"),
        ("--check", "p.yaml", "--minutes", "5"),
        ("--check", "p.yaml", "--criterion", "worst"),
        ("--for", "spring@1", "--tilt", "10,0"),
        ("--for", "spring@1", "--payload", "1,0,0,0"),
        ("--for", "spring@1", "--logs", "logs", "--minutes", "5"),
        ("--for", "spring@1", "--logs", "logs", "--against", "stribeck", "--size", "1"),
        ("--payload", "a,b,c,d"),
        ("--tilt", "10"),
        ("--criterion", "best"),
        ("--format", "gcode"),
    ],
)
def test_what_does_not_go_together_is_wrong_usage(folder, words):
    """Exit code 2, before anything is read or written."""
    assert "Usage" in run("plan", *words, code=2).output
    assert [path.name for path in folder.iterdir()] == ["recipe.yaml"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--payload=-1,0,0,0",), "-1 kg"),
        (("--payload=1e300,1e300,0,0",), "error[plan-impossible]"),
        (("--tilt=nan,0",), "nan"),
        (("--minutes", "nan"), "nan minutes"),
        (("--minutes", "1e-9", "--criterion", "worst"), "error[plan-too-short]"),
        (("--speeds", "1,1,1"), "1 different speeds"),
        (("--speeds", "0.1,0.2,nan"), "nan is no share"),
        (("--for", "stribeck@2", "--size", "1e308", *SHORT), "error[plan-impossible]"),
        (("--check", "nothing.yaml"), "nothing.yaml"),
        (("--check", "."), "error["),
        (("--for", "stribeck", *SHORT), "write stribeck@3"),
        (("--prior", "nothing.json"), "nothing.json"),
    ],
)
def test_what_cannot_be_planned_is_one_message(folder, words, told):
    """Exit code 3, one error with what, nothing on standard output, and no plan."""
    refused = run("plan", *words, code=3)
    assert refused.stderr.count("error[") == 1 and refused.stdout == ""
    assert told in refused.stderr
    assert not (folder / "plan.yaml").exists()


def test_other_forms_stand_beside_the_recipe(folder):
    """Each form has its ending; one for another kind of arm is refused before the work; --picture draws two figures."""
    assert "error[program-other-robot]" in run("plan", "--format", "urscript", *SHORT, code=3).stderr
    run("plan", "--format", "csv", *SHORT)
    run("plan", "--format", "ros2", *SHORT, "--picture", "postures.png")
    made = ("plan.csv", "plan.ros2.yaml", "postures.png", "postures-timetable.png")
    assert all((folder / name).stat().st_size > 500 for name in made)
    assert run("plan", "--picture", "postures.gif", "-o", "p.yaml", code=2).stdout == ""


def test_absurd_sizes_are_not_hidden(folder):
    """Neither by --hide nor by an edited truth; what numpy says of them is not shown."""
    write_short_plan(folder / "plan.yaml")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert "error[hide-wrong]" in run("simulate", "--hide", "stribeck@2:a=1e308", code=3).stderr
        run("simulate", "--rate", "20", "--hide", "stribeck@2:a=1e6", "-o", "stuck")
        truth = json.loads((folder / "stuck" / "truth.json").read_text())
        truth["mass"][0] = 1e308
        (folder / "edited.json").write_text(json.dumps(truth))
        assert "error[truth-wrong]" in run("simulate", "--truth", "edited.json", code=3).stderr
    assert not (folder / "logs").exists()


def test_logs_are_read_by_the_recipe_that_was_given(folder):
    """Logs of an arm that the recipe is not of are refused as by every command; the recipe beside them is not taken."""
    shutil.copytree(SAMPLE, folder / "other")
    logs, recipe = "other/logs", folder / "recipe.yaml"
    told = run("plan", "puma560", "--for", "stribeck@2", "--logs", logs, code=3).stderr
    assert "error[column-missing]" in told
    recipe.write_text(recipe.read_text() + "log: {time: clock}\n")
    told = run("plan", "--for", "stribeck@2", "--logs", logs, code=3).stderr
    assert "clock" in told
    (folder / "other" / "recipe.yaml").write_text("nonsense")
    run("plan", "pendulum2", "--for", "stribeck@2", "--logs", logs)
