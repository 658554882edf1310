"""The contract of ``--json``: one document on standard output, with kind, format, version and the inputs' digests."""

import hashlib
from pathlib import Path

import pytest
from command import answer

import pumaid
from pumaid.cli import group

LINES = {
    "init": "init pendulum2 -o new.yaml",
    "plan": "plan recipe.yaml --minutes 5 -o other.yaml",
    "simulate": "simulate recipe.yaml -o virtual --rate 20",
    "segment": "segment logs",
    "identify": "identify logs",
    "compare": "compare results/model.json logs",
    "diagnose": "diagnose results/model.json logs",
    "report": "report results/model.json logs --format=",
    "history": "history",
    "export": "export results/model.json --format c -o arm",
    "effects": "effects",
    "doctor": "doctor",
}
SPEAKERS = [
    name for name in group.list_commands(None) if any(o.name == "as_json" for o in group.get_command(None, name).params)
]


def test_every_command_with_json_is_tried():
    """A new command's document joins this contract."""
    assert sorted(set(SPEAKERS) - set(LINES)) == ["demo"]  # test_demo.py runs it


@pytest.mark.parametrize("name", LINES)
def test_one_document_with_its_head(arm, name):
    """Standard output is one JSON object with kind, format, version, and the SHA-256 of recipe and logs if it has any.

    Entries of a comparison that other programs read stand where interfaces.md puts them.
    """
    document = answer(LINES[name])
    assert isinstance(document["kind"], str) and document["format"] == 1
    assert document["pumaid"] == pumaid.__version__
    if name in ("segment", "identify", "compare"):
        logs = {str(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in Path("logs").iterdir()}
        assert document["logs"] == logs
        assert document["recipe"]["sha256"] == hashlib.sha256((arm / "recipe.yaml").read_bytes()).hexdigest()
    if name == "compare":
        joint = document["joints"][0]
        assert isinstance(document["rmse"], float)
        assert {"joint", "rmse", "noise_floor", "bias", "explained", "runs"} <= set(joint)
        assert {"file", "start", "velocity", "posture", "rmse", "bias"} <= set(joint["runs"][0])
        text = (arm / "results" / "model.json").read_text(encoding="utf-8")
        assert answer("compare - logs", input=text) == document  # the model from a pipe
