"""``pumaid compare`` as a user types it."""

from __future__ import annotations

import json
import re
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


def run(*arguments: str) -> Result:
    """Run ``pumaid`` with these arguments."""
    return CliRunner().invoke(group, list(arguments))


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """A pendulum's experiment: recipe, plan with held-out runs, logs, model."""
    folder = tmp_path_factory.mktemp("pendulum")
    shutil.copy(shipped_recipes()["pendulum2"], folder / "recipe.yaml")
    robot = pumaid.read_recipe(folder / "recipe.yaml")
    plan = pumaid.plan(robot, minutes=6, seed=3)
    for origin, logs in groupby(pumaid.simulate(robot, plan, seed=3, rate=100.0), key=lambda log: log.origin):
        write_log(folder / "logs" / f"{origin}.csv", logs, robot)
    done = run("identify", str(folder / "logs"))
    assert done.exit_code == 0, done.stderr
    return folder


@pytest.fixture
def arm(made, tmp_path, monkeypatch) -> Path:
    """A copy of the experiment, which is the working folder."""
    shutil.copytree(made, tmp_path / "arm")
    monkeypatch.chdir(tmp_path / "arm")
    return tmp_path / "arm"


def test_prints_error_by_joint_and_the_worst_runs(arm):
    """Tables of joints, of where the error lives, of what lies outside runs and of the worst runs; and a picture."""
    done = run("compare", "results/model.json", "logs", "--worst", "2", "--figure", "misfit.png", "--check")
    assert done.exit_code == 0, done.stderr
    assert "noise floor" in done.stdout and "outside runs" in done.stdout
    assert "noise" in done.stdout.split("Residual budget")[1]
    worst = done.stdout.split("Runs with the largest error")[1].split("Sorted by")[0]
    rows = re.findall(r"^ ?(\d)  ", worst, re.MULTILINE)  # a table wider than the terminal goes on below itself
    assert rows in (["1", "2"], ["1", "2"] * 2)
    assert Path("misfit.png").read_bytes().startswith(b"\x89PNG")
    assert run("compare", "results/model.json", "logs", "--picture", "misfit.gif").exit_code == 2


def test_json_is_one_document(arm):
    """``--json`` prints the comparison alone; each joint's parts of the budget add up to its squared error."""
    document = json.loads(run("compare", "results/model.json", "logs", "--json").stdout)
    assert document["kind"] == "comparison" and document["format"] == 1
    assert document["recipe"]["sha256"] and list(document["logs"].values())
    assert document["joints"][1]["rmse"] == pytest.approx(document["joints"][1]["noise_floor"], rel=0.3)
    for joint in document["joints"]:
        parts = joint["budget"]["parts"]
        assert sum(part["mean_square"] for part in parts) == pytest.approx(joint["rmse"] ** 2, rel=1e-9)


def test_a_hidden_ripple_is_told(arm):
    """Logs of the arm with a ripple at joint 2: JSON says where, of what kind, in words, and which effect."""
    assert run("plan", "recipe.yaml", "--minutes", "3", "--seed", "3").exit_code == 0
    hidden = ("--hide", "ripple@2:frequency=25", "-o", "rippled")
    assert run("simulate", "recipe.yaml", "--seed", "3", "--rate", "100", *hidden).exit_code == 0
    document = json.loads(run("compare", "results/model.json", "rippled", "--json").stdout)
    (part,) = [part for part in document["joints"][1]["budget"]["parts"] if part["name"] == "fast"]
    assert part["more_than_noise"] and part["p_value"] <= 0.05 and part["points_to"] == ["ripple"]
    assert part["cycles"][0] == pytest.approx(25.0, abs=0.1) and part["cycles_per"] == "turn"
    cycles = re.search(r"is ripple over position: ([\d.]+) cycles per turn", part["text"])
    assert cycles and float(cycles[1]) == pytest.approx(25.0, abs=0.1)


def test_logs_without_runs_still_have_their_tables(arm):
    """Where no run is found, table and JSON come all the same; that there is nothing to draw is a note."""
    lines = sorted(Path("logs").glob("*.csv"))[0].read_text(encoding="utf-8").splitlines()
    Path("rest.csv").write_text("\n".join([lines[0], *lines[1:20]]) + "\n", encoding="utf-8")
    done = run("compare", "results/model.json", "rest.csv", "--picture", "misfit.png")
    assert done.exit_code == 0, done.stderr
    assert "Model against measurement" in done.stdout and "Runs with the largest error" not in done.stdout
    assert "no misfit to draw" in done.stderr and not Path("misfit.png").exists()
    done = run("compare", "results/model.json", "rest.csv", "--picture", "misfit.png", "--json")
    assert json.loads(done.stdout)["rmse"] is None


def test_check_asks_for_attention(arm):
    """``--check`` leaves with 1 where the error is above the noise floor."""
    robot = pumaid.read_recipe(Path("recipe.yaml"))
    plan, another = pumaid.plan(robot, minutes=6, seed=3), draw(robot, 99)
    some_runs = replace(plan, motions=plan.motions[:24])
    write_log(Path("other.csv"), list(pumaid.simulate(robot, some_runs, truth=another, seed=3, rate=100.0)), robot)
    assert run("compare", "results/model.json", "other.csv", "--check", "--trust").exit_code == 1


def test_refuses_another_recipe(arm):
    """A recipe that was changed after the model was made is refused, with both digests."""
    text = Path("recipe.yaml").read_text(encoding="utf-8")
    Path("recipe.yaml").write_text(text + "\n# changed\n", encoding="utf-8")
    done = run("compare", "results/model.json", "logs")
    assert done.exit_code == 3 and "error[model-other-recipe]" in done.stderr


def test_report_writes_page_tables_and_figures(arm, tmp_path, monkeypatch):
    """Named by its model only, the report takes the logs beside that model's folder and writes there."""
    monkeypatch.chdir(tmp_path)
    done = run("report", "arm/results/model.json", "--format", "png")
    assert done.exit_code == 0, done.stderr
    assert Path("arm/results/report.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert Path("arm/results/figures/spent.png").read_bytes().startswith(b"\x89PNG")
    assert Path("arm/results/tables/parameters.parquet").is_file()


def test_report_goes_where_it_is_told(arm):
    """Page, figures and results can each go elsewhere, and JSON lists what was written; it needs no arguments."""
    where = ["-o", "page.html", "--figures", "pictures", "--results", "out", "--format", "svg", "--units", "deg"]
    done = run("report", *where, "--json")
    files = json.loads(done.stdout)["files"]
    assert all(Path(name).is_file() for name in files)
    assert "page.html" in files and "pictures/spent.svg" in files and "out/tables/runs.csv" in files


@pytest.mark.parametrize(
    ("form", "start"),
    [
        ("text", "two-link pendulum"),
        ("csv", "name,symbol"),
        ("latex", "% needs"),
        ("markdown", "**two-link"),
        ("json", "["),
    ],
)
def test_table_goes_to_standard_output(arm, form, start):
    """``--table`` prints the parameter table in any form and writes nothing."""
    done = run("report", "--table", form)
    assert done.exit_code == 0 and done.stdout.startswith(start)
    assert not Path("results/report.html").exists()


def test_a_failure_leaves_the_old_report(arm):
    """A report that cannot be made leaves the one that stood there."""
    Path("results/report.html").write_text("old", encoding="utf-8")
    assert run("report", "results/model.json", "no_such_logs").exit_code == 3
    assert Path("results/report.html").read_text(encoding="utf-8") == "old"


def test_wrong_figure_form_is_misuse(arm):
    """An unknown form is told with the known ones."""
    done = run("report", "--format", "gif")
    assert done.exit_code == 2 and "png, svg, pdf" in done.stderr
