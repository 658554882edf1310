"""``pumaid history``: tables, document, undo, and what it says of folders that are not as they should be."""

import json
import re
import shutil
from dataclasses import replace

import pytest
from command import answer, run
from ladders import STRIBECK, experiment, model

from pumaid.results.history import keep


@pytest.fixture
def arm(tmp_path):
    """An experiment with three kept models, which is the working folder."""
    experiment(tmp_path / "results")
    return tmp_path


def test_a_row_for_each_model(arm):
    """What was added, the errors and the floor stand in the order of the models; the current one is marked."""
    done = run("history")
    rows = [line.split() for line in done.stdout.splitlines() if re.match(r"\d", line)]
    assert [row[0] for row in rows[:3]] == ["1", "2", "3"] and rows[2][1] == "*"
    assert "+ stribeck@1" in done.stdout and "+ ripple@2" in done.stdout
    assert "No run was held out" in " ".join(done.stdout.split())


def test_document_tells_the_ladder(arm):
    """``--json`` is one document: models with what they add, their errors, and the path to the current one."""
    told = answer("history")
    assert (told["kind"], told["format"], told["current"]) == ("history", 1, 3)
    (ladder,) = told["ladders"]
    assert ladder["path"] == [1, 2, 3] and ladder["apart"] is None
    assert [one["added"] for one in ladder["models"]][1] == [
        {"effect": "stribeck", "joint": 1, "shape": {"velocity": 0.1}}
    ]
    assert [one["joints"][0]["rmse"] for one in ladder["models"]] == [0.03, 0.02, 0.011]


def test_undo(arm):
    """The second model copied back is the current one, and the ladder ends there."""
    (second,) = (arm / "results" / "models").glob("002-*")
    shutil.copy(second, arm / "results" / "model.json")
    told = answer("history")
    assert told["current"] == 2 and told["ladders"][0]["path"] == [1, 2]
    assert json.loads((arm / "results" / "model.json").read_text())["effects"][0]["effect"] == "stribeck"
    keep(arm / "results" / "model.json", replace(model(STRIBECK, rmse=0.031), method="recursive"))
    assert "fitted again" in run("history").stdout


@pytest.mark.parametrize("arguments", ["..", "../results", "--results ../results"])
def test_folder_may_be_named(arm, monkeypatch, arguments):
    """The experiment's folder, its results, or ``--results`` lead to the same ladder."""
    (arm / "logs").mkdir()
    monkeypatch.chdir(arm / "logs")
    assert answer(f"history {arguments}")["current"] == 3


def test_models_of_other_logs_stand_apart(arm):
    """They are a table of their own that says why it must not be compared."""
    keep(arm / "results" / "model.json", model(STRIBECK, rmse=0.5, logs={"b.csv": "ef" * 32}))
    keep(arm / "results" / "model.json", model())
    assert "Not comparable with the models above: fitted to other logs" in run("history").stdout
