"""The contract of ``--json``: one document on standard output, with kind, format, version and the inputs' digests."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

import pumaid
from pumaid.cli import group

SAMPLE = Path(__file__).parents[2] / "sample_logs" / "pendulum"
LINES = {
    "init": "init pendulum2 -o new.yaml --json",
    "plan": "plan recipe.yaml --minutes 5 -o other.yaml --json",
    "simulate": "simulate recipe.yaml -o virtual --json",
    "segment": "segment logs --json",
    "identify": "identify logs --json",
    "compare": "compare model.json logs --json",
    "diagnose": "diagnose model.json logs --json",
    "report": "report model.json logs --format= --json",
    "history": "history --json",
    "export": "export model.json --format c -o arm --json",
    "effects": "effects --json",
    "doctor": "doctor --quick --json",
}
SPEAKERS = [
    name for name in group.list_commands(None) if any(o.name == "as_json" for o in group.get_command(None, name).params)
]


@pytest.fixture(scope="module")
def fitted(tmp_path_factory) -> Path:
    """A copy of the sample with a model in it."""
    folder = tmp_path_factory.mktemp("fitted") / "arm"
    shutil.copytree(SAMPLE, folder, ignore=shutil.ignore_patterns("results"))
    assert CliRunner().invoke(group, ["identify", str(folder / "logs")]).exit_code == 0
    shutil.copy(folder / "results" / "model.json", folder)
    return folder


@pytest.fixture
def arm(fitted, tmp_path, monkeypatch) -> Path:
    """The working folder: a fresh copy of the fitted sample."""
    shutil.copytree(fitted, tmp_path / "arm")
    monkeypatch.chdir(tmp_path / "arm")
    return tmp_path / "arm"


def test_every_command_with_json_is_tried():
    """A new command's document joins this contract."""
    assert sorted(set(SPEAKERS) - set(LINES)) == ["demo"]  # test_demo.py runs it


@pytest.mark.parametrize("name", LINES)
def test_one_document_with_its_head(arm, name):
    """Standard output is one JSON object that names its kind, format and the version that made it."""
    done = CliRunner().invoke(group, LINES[name].split())
    assert done.exit_code == 0, done.stderr
    document = json.loads(done.stdout)
    assert isinstance(document["kind"], str) and document["format"] == 1
    assert document["pumaid"] == pumaid.__version__


@pytest.mark.parametrize("name", [name for name in ("segment", "identify", "compare") if name in SPEAKERS])
def test_inputs_are_named_by_their_digests(arm, name):
    """What was read can be told from any other file: SHA-256 of the recipe and of each log."""
    document = json.loads(CliRunner().invoke(group, LINES[name].split()).stdout)
    assert document["recipe"]["sha256"] == hashlib.sha256((arm / "recipe.yaml").read_bytes()).hexdigest()
    logs = {str(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in Path("logs").iterdir()}
    assert document["logs"] == logs


def test_comparison_follows_interfaces(arm):
    """The entries that other programs read stand where interfaces.md puts them."""
    document = json.loads(CliRunner().invoke(group, LINES["compare"].split()).stdout)
    joint = document["joints"][0]
    assert document["kind"] == "comparison" and isinstance(document["rmse"], float)
    assert {"joint", "rmse", "noise_floor", "bias", "explained", "runs"} <= set(joint)
    assert {"file", "start", "velocity", "posture", "rmse", "bias"} <= set(joint["runs"][0])


def test_model_from_a_pipe(arm):
    """``-`` in the model's place is standard input."""
    text = (arm / "model.json").read_text(encoding="utf-8")
    piped = CliRunner().invoke(group, ["compare", "-", "logs", "--json"], input=text)
    assert json.loads(piped.stdout) == json.loads(CliRunner().invoke(group, LINES["compare"].split()).stdout)
