"""``pumaid diagnose`` as a user types it: what it says, writes, adds and refuses."""

import json
import re
import shlex
import shutil
from dataclasses import replace
from itertools import groupby
from pathlib import Path

import click
import diagnoses
import numpy as np
import pandas as pd
import pytest
from click.testing import Result
from command import run

import pumaid
from pumaid.cli import group
from pumaid.cli.additions import with_commands
from pumaid.diagnosis.discrimination import plan_of_findings as deciding
from pumaid.diagnosis.records import Diagnosis, read_diagnosis, write_diagnosis
from pumaid.experiment import Experiment
from pumaid.io.plan_file import plan_text, read_plan
from pumaid.io.recipe import shipped_recipes
from pumaid.io.write import write_log
from pumaid.results.documents import model_digest
from pumaid.robot import EffectChoice
from pumaid.simulation import draw
from pumaid.simulation import hidden_effects as hidden

#: A ripple of 0.08 A on a pendulum whose noise is a third of it: no design could overlook it. Slow enough for the
#: drive: of a faster one a part goes into the speed, and less of it is in the current the faster a run is.
HIDDEN = "ripple@1:cos=0.08,sin=0,frequency=10"


def experiment(folder: Path) -> Path:
    """A pendulum's recipe, plan, logs and model, with a ripple hidden in its motors."""
    shutil.copy(shipped_recipes()["pendulum2"], folder / "recipe.yaml")
    robot = pumaid.read_recipe(folder / "recipe.yaml")
    plan, truth = pumaid.plan(robot, minutes=5, seed=3), draw(robot, 3)
    (folder / "plan.yaml").write_text(plan_text(plan, robot), encoding="utf-8")
    truth = truth.hiding([hidden.parse(HIDDEN, robot)])
    for origin, logs in groupby(pumaid.simulate(robot, plan, truth=truth, seed=3, rate=100.0), key=lambda x: x.origin):
        write_log(folder / "logs" / f"{origin}.csv", logs, robot)
    run("identify", folder / "logs")
    return folder


DIAGNOSE = ("diagnose", "results/model.json", "logs")


@pytest.fixture(scope="module")
def rippled(tmp_path_factory) -> tuple[Path, Result]:
    """An experiment in which a ripple hides, diagnosed and drawn, and what was said of it."""
    folder = experiment(tmp_path_factory.mktemp("rippled"))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        return folder, run(*DIAGNOSE, "--check", "--picture", "missing.png", code=1)


@pytest.fixture
def arm(rippled, tmp_path, monkeypatch) -> Path:
    """A copy of the rippled experiment, which is the working folder."""
    shutil.copytree(rippled[0], tmp_path / "arm")
    monkeypatch.chdir(tmp_path / "arm")
    return tmp_path / "arm"


def test_says_what_is_missing_writes_and_draws_it(arm, rippled):
    """The sentence names effect and joint, ``--check`` leaves with 1, the file has the digests of model and logs."""
    done = rippled[1]
    assert "Joint 1 (hip): ripple is missing" in done.stdout and "Add it with:" in done.stdout
    found = read_diagnosis(Path("results/diagnosis.json"))
    assert [(one.effect, one.joint) for one in found.findings] == [("ripple", 1)]
    assert found.model["sha256"] == model_digest(pumaid.read_model(Path("results/model.json"))) and len(found.logs) >= 1
    assert Path("missing.png").read_bytes().startswith(b"\x89PNG")


def test_its_command_runs_and_the_misfit_is_gone(arm):
    """``-o -`` is the file; its command can be pasted, after it nothing is missing and the old finding is remembered.

    The error, and what repeated runs differ by, is what identify and compare say, not that of a search's coarser bins.
    """
    file = Path("results/diagnosis.json")
    first = json.loads(run(*DIAGNOSE, "-o", "-").stdout)
    assert first == json.loads(file.read_text(encoding="utf-8"))
    assert (first["kind"], first["format"]) == ("diagnosis", 1)
    assert first["findings"][0]["rmse_heldout_after"] < 0.6 * first["findings"][0]["rmse_heldout_before"]
    compared = json.loads(run("compare", "results/model.json", "logs", "--json").stdout)
    errors = [[joint[name] for joint in one["joints"] for name in ("rmse", "noise_floor")] for one in (first, compared)]
    assert errors[0] == pytest.approx(errors[1], rel=0.001)
    words = shlex.split(first["findings"][0]["command"])
    assert words[:2] == ["pumaid", "identify"] and run(*words[1:])
    told = run(*DIAGNOSE, "--check").stdout
    assert "nothing is missing that these data can show" in told
    assert "Joint 1 (hip): ripple was missing and is now in the model" in told


def test_apply_adds_refits_and_keeps_every_step(arm):
    """``--apply`` writes the enlarged model and keeps the first; with ``--json`` the steps go to standard error."""
    done = run(*DIAGNOSE, "--apply", "--json")
    document = json.loads(done.stdout)
    assert document["findings"] == [] and document["applied"][0]["effect"] == "ripple"
    assert "1. Added ripple at joint 1 (hip)." in done.stderr and "+ ripple@1" in run("history").stdout
    before, after = (pumaid.read_model(path) for path in sorted(Path("results/models").glob("*.json")))
    assert [one.effect for one in after.effects] == ["ripple"] and before.effects == ()
    assert after.joint(1).heldout < 0.6 * before.joint(1).heldout


def test_a_clean_arm_is_left_alone(fitted, tmp_path, monkeypatch):
    """Nothing is found, what would have been found is told, there is nothing to draw, to decide or to add."""
    monkeypatch.chdir(shutil.copytree(fitted, tmp_path / "arm"))
    told = run(*DIAGNOSE, "--picture", "missing.png", "--plan", "next.yaml", "--apply", "--check").stdout
    assert told.startswith("two-link pendulum: nothing is missing that these data can show.")
    assert "Detection limits" in told and "stribeck" in told
    assert not Path("missing.png").exists() and not Path("next.yaml").exists()
    assert len(list(Path("results/models").glob("*.json"))) == 1


def test_the_report_tells_it(arm):
    """A report made after a diagnosis holds it, and says so where it is of another model."""
    path = Path("results/diagnosis.json")
    write_diagnosis(path, replace(read_diagnosis(path), model={"sha256": "ab" * 32}))
    run("report", "--format", "")
    page = Path("results/report.html").read_text(encoding="utf-8")
    assert 'id="diagnosis"' in page and "ripple is missing" in page
    assert "of another model" in page and "of other logs" not in page


def test_a_suspected_column_is_found(arm):
    """Current that follows a supply voltage is found under the column's name; nothing adds it.

    With the model of other logs, errors are those of these logs, without what the changed current can be fitted by.
    """
    for path in Path("logs").glob("*.csv"):
        frame = pd.read_csv(path)
        frame["volts"] = 48.0 + np.sin(0.05 * frame["t"])
        frame["i2"] += 0.3 * (frame["volts"] - 48.0)
        frame.to_csv(path, index=False)
    other = json.loads(run(*DIAGNOSE, "--trust", "--json").stdout)
    assert 0.1 < other["joints"][1]["rmse"] < 0.3 * 0.5**0.5
    run("identify", "logs")
    done = run(*DIAGNOSE, "--suspect", "volts", "--json")
    found = next(one for one in json.loads(done.stdout)["findings"] if one["joint"] == 2)
    assert (found["effect"], found["command"]) == ("suspect:volts", "")


def test_runs_that_decide_become_a_plan(tmp_path):
    """The rows of a finding's next run, as often as it takes, make a plan that a robot can run."""
    plan = deciding(diagnoses.rich().findings, diagnoses.PUMA)
    (tmp_path / "next.yaml").write_text(plan_text(plan, diagnoses.PUMA), encoding="utf-8")
    again = read_plan(tmp_path / "next.yaml", diagnoses.PUMA)
    assert [round(motion.start, 6) for motion in again.motions] == [-1.2, 1.2, -1.2, 1.2]
    assert again.motions[0].velocity == pytest.approx(0.05) and again.duration > 4 * 2.4 / 0.05
    assert "tells stribeck from viscous_power" in plan.assumptions[0]
    assert plan.assumptions[0] in (tmp_path / "next.yaml").read_text(encoding="utf-8")


def test_commands_repeat_what_the_model_has(arm):
    """A command names the logs, the recipe and the model's own effects; shapes that were fitted stay open."""
    robot = replace(diagnoses.PUMA, effects=(EffectChoice("spring", 1),))
    held = (EffectChoice("spring", 1), EffectChoice("warmup", 2, {"time_constant": 60.0}))
    held += (EffectChoice("ripple", 4, {"frequency": 58.0}),)
    estimate = replace(pumaid.read_model(Path("results/model.json")), effects=held)
    typed = {"experiment": Experiment(("my logs/",), Path("arm.yaml"), heldout=("day 2.csv",))}
    finding = replace(diagnoses.stribeck(), command="pumaid identify LOGS --add stribeck@3")
    found = Diagnosis(robot.name, (), (finding,))
    diagnosis = with_commands(found, estimate, robot, effects=[Path("brake.py")], **typed)
    found = diagnosis.findings[0].command
    assert found == (
        "pumaid identify 'my logs/' --recipe arm.yaml --heldout 'day 2.csv' --effects brake.py"
        " --add warmup@2 --add ripple@4:frequency=58 --add stribeck@3"
    )


PAGE = (Path(__file__).parents[2] / "docs" / "diagnosis.md").read_text(encoding="utf-8")


def shown_commands() -> list[list[str]]:
    """Commands in the page's shell blocks, as the shell would split them, up to a pipe."""
    lines = [line for block in re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL) for line in block.splitlines()]
    return [shlex.split(line.split(" | ")[0])[1:] for line in lines if line.startswith("pumaid ")]


@pytest.mark.parametrize("words", shown_commands(), ids=" ".join)
def test_the_page_shows_commands_that_exist(words):
    """Each command of docs/diagnosis.md is one that the program understands."""
    context = click.Context(group)
    found = group.get_command(context, words[0])
    assert found is not None
    found.make_context(words[0], words[1:])


def test_the_page_shows_what_the_program_says():
    """The example in docs/diagnosis.md is what a diagnosis looks like, letter by letter."""
    gold = (Path(__file__).parents[1] / "golden" / "gold" / "diagnosis_rich_rad.txt").read_text(encoding="utf-8")
    (block,) = re.findall(r"```text\n(.*?)```", PAGE, re.DOTALL)
    assert block in gold
