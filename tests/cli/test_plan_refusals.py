"""``pumaid plan`` and ``pumaid simulate`` with numbers that are none on any arm, and with logs of another arm."""

from __future__ import annotations

import json
import shutil
import warnings
from pathlib import Path

import pytest
from command import run

SAMPLE = Path(__file__).parents[2] / "sample_logs" / "pendulum"


@pytest.mark.parametrize(
    ("words", "slug"),
    [
        ("--minutes 1e-9", "plan-too-short"),
        ("--minutes 1e-9 --criterion worst", "plan-too-short"),
        ("--payload 1,1e308,0,0", "plan-impossible"),
        ("--payload 1e300,1e300,0,0", "plan-impossible"),
        ("--payload 1e6,0,0,0", "plan-impossible"),
        ("--minutes 3 --for stribeck@2 --size 1e308", "plan-impossible"),
        ("--minutes 3 --for stribeck@2 --size 1e-300", "plan-impossible"),
    ],
)
def test_absurd_numbers_are_refused(folder, words, slug):
    """One message, no plan, no failure of ours."""
    told = run("plan", *words.split(), code=3).stderr
    assert f"error[{slug}]" in told and "Traceback" not in told
    assert not (folder / "plan.yaml").exists()


def test_absurd_sizes_are_not_hidden(folder):
    """Neither by --hide nor by an edited truth; what numpy says of them is not shown."""
    run("plan", "--speeds", "0.5,0.7,0.95", "--postures", "2", "--replicates", "1")
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
