"""An effect from a user's file or package: the whole way by command line, and what is said where it is not known."""

import contextlib
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from command import run

import pumaid.effects
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
KNOWN = "--effects brake.py"


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


def typed(folder: Path, line: str, code: int = 0) -> Result:
    """``pumaid`` in a folder with nothing included before."""
    forget()
    with contextlib.chdir(folder):
        return run(*line.split(), code=code)


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
def plain(tmp_path_factory) -> Path:
    """An experiment whose model lacks the effect of ``brake.py``, and its diagnosis that knows the file."""
    folder = rubbed(tmp_path_factory.mktemp("plain") / "arm")
    typed(folder, "identify logs")
    typed(folder, f"diagnose results/model.json logs {KNOWN}")
    return folder


@pytest.fixture(scope="module")
def braked(plain, tmp_path_factory) -> Path:
    """The experiment after the command that diagnosis told."""
    folder = shutil.copytree(plain, tmp_path_factory.mktemp("braked") / "arm")
    (finding,) = json.loads((folder / "results" / "diagnosis.json").read_text())["findings"]
    assert (finding["effect"], finding["joint"]) == ("brake", 2)
    assert finding["command"] == "pumaid identify logs --effects brake.py --add brake@2"
    typed(folder, finding["command"].removeprefix("pumaid "))
    return folder


@pytest.mark.parametrize(
    "line", ["compare results/model.json logs --json", "diagnose results/model.json logs --apply", "report"]
)
def test_the_file_is_asked_for_again(braked, line):
    """A model with an effect that only a file brings is refused: which effect, which option, and nothing written."""
    before = sorted(braked.rglob("*"))
    told = typed(braked, line, code=3)
    assert told.stdout == "" and told.stderr.startswith("error[unknown-effect]: there is no effect brake")
    assert told.stderr.count("error[") == 1 and "--effects FILE.py" in told.stderr
    assert sorted(braked.rglob("*")) == before


def test_history_needs_no_file(braked, tmp_path):
    """Errors that were kept are told, also where the file is lost."""
    folder = shutil.copytree(braked, tmp_path / "arm")
    told = typed(folder, "history")
    assert "brake@2" in told.stdout


def test_the_file_makes_it_known(braked):
    """With the file named, what was put into the log comes back within four errors; the misfit is the noise floor."""
    told = typed(braked, f"compare results/model.json logs --json {KNOWN}")
    assert "unknown-effect" not in told.stderr
    second = json.loads(told.stdout)["joints"][1]
    assert second["rmse"] < 1.1 * second["noise_floor"]
    rows = json.loads((braked / "results" / "model.json").read_text())["joints"][1]["parameters"]
    (size,) = [row for row in rows if row["name"] == "brake.j2.a"]
    assert abs(size["value"] - SIZE) < 4.0 * size["std_error"]


def test_a_diagnosis_that_names_it_can_be_shown_without_the_file(plain):
    """The model has no brake, only the diagnosis beside it; what was found with the file is not kept without it."""
    typed(plain, "report --format=")
    found = json.loads(typed(plain, "diagnose results/model.json logs -o -").stdout)["findings"]
    assert "brake" not in [finding["effect"] for finding in found]


def test_a_file_that_has_changed_is_refused(braked, tmp_path):
    """Numbers of a parameter that the file no longer has would stand for something else."""
    changed = OWN.replace('"a", "A/', '"b", "A/').replace("s * a *", "s * b *")
    (tmp_path / "brake.py").write_text(changed, encoding="utf-8")
    told = typed(braked, f"report --effects {tmp_path / 'brake.py'}", code=3).stderr
    assert told.startswith("error[effect-changed]: brake is not what it was") and "brake.j2.b" in told
