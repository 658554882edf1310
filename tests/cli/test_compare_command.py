"""``pumaid compare`` and ``pumaid report`` as a user types them."""

import json
import re
from pathlib import Path

import pytest
from command import answer, run
from diagnoses import rich

from pumaid.diagnosis.records import write_diagnosis

COMPARE = ("compare", "results/model.json")


def test_prints_error_by_joint_and_the_worst_runs(arm):
    """Tables of joints, of where the error lives and of the worst runs."""
    told = run(*COMPARE, "logs", "--worst", "2", "--check").stdout
    assert "noise floor" in told
    assert "noise" in told.split("Residual budget")[1]
    worst = told.split("Runs with the largest error")[1].split("Sorted by")[0]
    rows = re.findall(r"^ ?(\d)  ", worst, re.MULTILINE)  # a table wider than the terminal goes on below itself
    assert rows in (["1", "2"], ["1", "2"] * 2)


def test_a_hidden_ripple_is_told(arm):
    """Logs of the arm with a ripple at joint 2: JSON says where, of what kind, in words, and which effect."""
    # Each joint's parts of the budget add up to its squared error; ``--check`` leaves with 1.
    hidden = ("--hide", "ripple@2:frequency=25", "-o", "rippled")
    run("simulate", "recipe.yaml", "--seed", "4", "--rate", "50", *hidden)
    joints = json.loads(run(*COMPARE, "rippled", "--json", "--check", code=1).stdout)["joints"]
    for joint in joints:
        parts = joint["budget"]["parts"]
        assert sum(part["mean_square"] for part in parts) == pytest.approx(joint["rmse"] ** 2, rel=1e-9)
    (part,) = [part for part in joints[1]["budget"]["parts"] if part["name"] == "fast"]
    assert part["more_than_noise"] and part["p_value"] <= 0.05 and part["points_to"] == ["ripple"]
    assert part["cycles"][0] == pytest.approx(25.0, abs=0.1) and part["cycles_per"] == "turn"
    cycles = re.search(r"is ripple over position: ([\d.]+) cycles per turn", part["text"])
    assert cycles and float(cycles[1]) == pytest.approx(25.0, abs=0.1)


def test_logs_without_runs_still_have_their_tables(arm):
    lines = Path("logs/session_01.csv").read_text(encoding="utf-8").splitlines()
    Path("rest.csv").write_text("\n".join(lines[:20]) + "\n", encoding="utf-8")
    done = run(*COMPARE, "rest.csv")
    assert "Model against measurement" in done.stdout and "Runs with the largest error" not in done.stdout
    assert answer("compare results/model.json rest.csv")["rmse"] is None


def test_report_takes_the_logs_beside_its_model(arm, tmp_path, monkeypatch):
    """Page, tables and figures are written there, whole: of a report that cannot be made nothing is replaced."""
    monkeypatch.chdir(tmp_path)
    page = arm / "results" / "report.html"
    page.write_text("old", encoding="utf-8")
    run("report", "arm/results/model.json", "no_such_logs", code=3)
    assert page.read_text(encoding="utf-8") == "old"
    write_diagnosis(arm / "results" / "diagnosis.json", rich())  # of another arm
    assert "note[file-damaged]" in run("report", "arm/results/model.json", "--format", "png").stderr
    text = page.read_text(encoding="utf-8")
    assert text.startswith("<!DOCTYPE html>") and 'id="missing"' not in text
    assert (arm / "results" / "figures" / "spent.png").read_bytes().startswith(b"\x89PNG")
    assert (arm / "results" / "tables" / "parameters.csv").is_file()


def test_report_goes_where_it_is_told(arm):
    """The page and the results can each go elsewhere, and JSON lists what was written; it needs no arguments."""
    files = answer("report -o page.html --results out --format svg --units deg")["files"]
    assert all(Path(name).is_file() for name in files)
    assert "page.html" in files and "out/figures/spent.svg" in files and "out/tables/runs.csv" in files
