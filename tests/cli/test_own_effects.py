"""An effect from a user's file or package: the whole way by command line, and what is said where it is not known."""

from __future__ import annotations

import contextlib
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

import pumaid.effects
from pumaid.cli import group
from pumaid.effects import catalogue

SAMPLE = Path(__file__).parents[2] / "sample_logs" / "pendulum"
OWN = '''"""Rubbing that grows with the square of the position."""

from pumaid.effects import Effect, Family, Parameter, Trace


class Brake(Effect):
    title = "Rubbing brake"
    formula = "s * a * q ** 2"
    source = "the maker's drawing"
    family = Family.POSITION
    trace = (Trace.POSITION,)

    def parameters(self, robot, number):
        return (Parameter("a", "A/{unit}2", "rubbing", "a{n}", 0.05),)
'''


#: A per rad2 that the logs of these tests have more at joint 2 than the sample has.
SIZE = 0.05
KNOWN = ("--effects", "brake.py")


@pytest.fixture(autouse=True)
def catalogue_of_its_own():
    """What a test's files bring is gone after it."""
    forget()
    yield
    forget()


def forget() -> None:
    """The catalogue without files, as a new process has it."""
    pumaid.effects._INCLUDED.clear()
    catalogue.cache_clear()


def typed(folder: Path, *line: str) -> Result:
    """``pumaid`` in a folder with nothing included before."""
    forget()
    with contextlib.chdir(folder):
        return CliRunner().invoke(group, list(line))


def rubbed(folder: Path) -> Path:
    """The sample with the brake's current in its log, and the file ``brake.py``; no model yet."""
    shutil.copytree(SAMPLE, folder, ignore=shutil.ignore_patterns("results"))
    (folder / "brake.py").write_text(OWN, encoding="utf-8")
    (log,) = (folder / "logs").iterdir()
    names = log.read_text(encoding="utf-8").partition("\n")[0]
    rows = np.loadtxt(log, delimiter=",", skiprows=1)
    t, q, i = (rows[:, names.split(",").index(name)] for name in ("t", "q2", "i2"))
    v = np.gradient(q, t)
    i += SIZE * np.where(np.abs(v) > 0.02, np.sign(v), 0.0) * q**2
    np.savetxt(log, rows, delimiter=",", header=names, comments="", fmt="%.8g")
    return folder


@pytest.fixture(scope="module")
def braked(tmp_path_factory) -> Path:
    """An experiment whose model holds the effect of ``brake.py``, added to one without."""
    folder = rubbed(tmp_path_factory.mktemp("braked") / "arm")
    for more in ((), ("--add", "brake@2", *KNOWN)):
        done = typed(folder, "identify", "logs", *more)
        assert done.exit_code == 0, done.stderr
    return folder


@pytest.mark.parametrize(
    "line", ["compare results/model.json logs --json", "diagnose results/model.json logs --apply", "report"]
)
def test_the_file_is_asked_for_again(braked, monkeypatch, line):
    """A model with an effect that only a file brings is refused: which effect, which option, and nothing written."""
    monkeypatch.chdir(braked)
    before = sorted(braked.rglob("*"))
    done = CliRunner().invoke(group, line.split())
    assert done.exit_code == 3 and not done.stdout
    assert done.stderr.startswith("error[unknown-effect]: the model holds brake,")
    assert done.stderr.count("error[") == 1 and "--effects FILE.py" in done.stderr and "Traceback" not in done.stderr
    assert sorted(braked.rglob("*")) == before


def test_history_needs_no_file(braked, tmp_path, monkeypatch):
    """Errors that were kept are told, and a model is restored, also where the file is lost; a note says it is."""
    monkeypatch.chdir(shutil.copytree(braked, tmp_path / "arm"))
    told = CliRunner().invoke(group, ["history"])
    assert told.exit_code == 0 and "brake@2" in told.stdout
    assert told.stderr.startswith("note[unknown-effect]: the model holds brake,") and "--effects FILE.py" in told.stderr
    back = CliRunner().invoke(group, ["history", "--restore", "1"])
    assert back.exit_code == 0 and "note[" not in back.stderr
    assert CliRunner().invoke(group, ["report", "--table", "csv"]).exit_code == 0


@pytest.mark.parametrize("line", ["diagnose results/model.json logs --check", "report --table text"])
def test_the_file_makes_it_known(braked, line):
    """With the file named, the model is used as any other, and nothing is missing from it."""
    done = typed(braked, *line.split(), *KNOWN)
    assert done.exit_code == 0, done.stderr
    assert "error[" not in done.stderr and "unknown-effect" not in done.stderr


def test_its_size_is_what_the_logs_have(braked):
    """What was put into the log comes back within four standard errors, and the error falls to the noise floor."""
    done = typed(braked, "compare", "results/model.json", "logs", "--json", *KNOWN)
    assert done.exit_code == 0 and "unknown-effect" not in done.stderr
    second = json.loads(done.stdout)["joints"][1]
    assert second["rmse"] < 1.1 * second["noise_floor"]
    rows = typed(braked, "report", "--table", "json", *KNOWN).stdout
    (found,) = [one for one in json.loads(rows) if one["name"] == "brake.j2.a"]
    assert abs(found["value"] - SIZE) < 4.0 * found["std_error"]


def test_diagnose_finds_it_and_says_what_to_type(tmp_path):
    """Of a model without it, the command that is told names the file; typed as it stands, it adds the effect."""
    folder = rubbed(tmp_path / "arm")
    typed(folder, "identify", "logs")
    found = json.loads(typed(folder, "diagnose", "results/model.json", "logs", "--json", *KNOWN).stdout)["findings"]
    assert [(one["effect"], one["joint"]) for one in found] == [("brake", 2)]
    assert found[0]["command"] == "pumaid identify logs --effects brake.py --add brake@2"
    # What was found with the file is not kept for a command that does not name it.
    without = json.loads(typed(folder, "diagnose", "results/model.json", "logs", "-o", "-").stdout)["findings"]
    assert "brake" not in [one["effect"] for one in without]
    page = typed(folder, "report", "--format=")  # the model has no brake, only the diagnosis beside it
    assert page.exit_code == 0, page.stderr
    assert typed(folder, *found[0]["command"].split()[1:]).exit_code == 0
    assert "brake@2" in typed(folder, "history").stdout


def test_a_file_that_has_changed_is_refused(braked, tmp_path):
    """Numbers of a parameter that the file no longer has would stand for something else."""
    (tmp_path / "brake.py").write_text(
        OWN.replace('"a", "A/', '"b", "A/').replace("s * a *", "s * b *"), encoding="utf-8"
    )
    done = typed(braked, "report", "--effects", str(tmp_path / "brake.py"))
    assert done.exit_code == 3 and "Traceback" not in done.stderr
    assert done.stderr.startswith("error[effect-changed]: brake is not what it was") and "brake.j2.b" in done.stderr


def test_marks_in_its_title_are_text(tmp_path):
    """What the terminal would take for an end of bold is shown as it is written."""
    (tmp_path / "brake.py").write_text(OWN.replace("Rubbing brake", "Rubbing [/bold] [red]brake"), encoding="utf-8")
    for line in (["effects"], ["effects", "brake"]):
        done = typed(tmp_path, *line, *KNOWN)
        assert done.exit_code == 0 and "[/bold]" in done.stdout, done.stderr
