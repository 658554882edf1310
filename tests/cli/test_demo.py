"""The demo: its story on a small arm, its honesty, and whose folders it touches."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from pumaid.cli import group
from pumaid.cli.commands import demo
from pumaid.cli.commands.demo import run
from pumaid.errors import ResultError


@pytest.fixture
def small(monkeypatch, tmp_path):
    """An empty working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def invoke(*words: str, code: int = 0):
    """The command line in this process."""
    done = CliRunner().invoke(group, list(words), prog_name="pumaid")
    assert done.exit_code == code, done.output
    return done


def test_story_ends_in_the_report_and_the_truth(small):
    """Every step is a line that can be typed; the page is there; the end says what was hidden, and judges."""
    answer = json.loads(invoke("demo", "tale", "--robot", "pendulum2", "--seed", "2", "--json").stdout)
    assert (answer["kind"], answer["format"]) == ("demo", 1)
    lines = [step["command"].split()[1] for step in answer["steps"]]
    assert lines[:6] == ["init", "plan", "simulate", "identify", "compare", "diagnose"]
    assert lines[-2:] == ["history", "report"] and all(step["told"] for step in answer["steps"])
    assert (small / "tale" / "results" / "report.html").stat().st_size > 10_000
    assert [hidden["effect"] for hidden in answer["hidden"]] == ["friction_step"]
    assert answer["outcome"] in ("named", "in the set", "wrong", "missed")
    assert answer | {"pumaid": ""} == json.loads((small / "tale" / "demo.json").read_text()) | {"pumaid": ""}


def test_a_folder_with_anything_in_it_is_left_alone(small):
    """A demo writes into a folder of its own and nowhere else."""
    (small / "tale").mkdir()
    (small / "tale" / "notes.txt").write_text("mine")
    assert "error[demo-in-the-way]" in invoke("demo", "tale", code=3).stderr
    assert [path.name for path in (small / "tale").iterdir()] == ["notes.txt"]


def test_ctrl_c_ends_a_demo_as_any_command(small, monkeypatch):
    """Code 130 and the usual line."""

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("pumaid.io.write.write_session", interrupted)
    err = invoke("demo", "tale", "--robot", "pendulum2", code=130).stderr
    assert err.strip().splitlines() == ["stopped; files that were being written are as they were before"]


def test_failing_step_is_told(small):
    """A step that fails ends the demo with the line that failed and what it said."""
    with pytest.raises(ResultError) as caught:
        run("identify", "nowhere")
    assert caught.value.slug == "step-failed"
    assert "'pumaid identify nowhere' left with exit code 3: error[" in caught.value.what


def finding(effect: str, joint: int | None, *rivals: str) -> dict[str, object]:
    """A finding as diagnose's document has it."""
    return {"effect": effect, "joint": joint, "rivals": list(rivals), "verdict": "add", "p_value": 0.01}


HIDDEN = {"effect": "stribeck", "joint": 3, "values": {}}


@pytest.mark.parametrize(
    ("found", "joint_verdict", "word", "told"),
    [
        ([finding("stribeck", 3)], "missing", "named", "Right: diagnosis named stribeck@3."),
        ([finding("stribeck", 3), finding("spring", 1)], "missing", "named", "spring@1 as well"),
        (
            [finding("viscous_power", 3, "stribeck")],
            "missing",
            "in the set",
            "do not separate viscous_power@3 from stribeck@3",
        ),
        ([finding("viscous_power", 2, "stribeck")], "missing", "wrong", "it is stribeck@3"),
        ([finding("stribeck", 2)], "missing", "wrong", "it is stribeck@3"),
        ([], "unexplained", "missed", "no known effect explains"),
        ([finding("stribeck", 3) | {"verdict": "doubtful"}], "adequate", "missed", "Nothing is missing"),
    ],
)
def test_verdict_is_honest(found, joint_verdict, word, told):
    """Named, in the set, wrong or missed: by effect and joint, false company told."""
    answer = {"findings": found, "joints": [{"joint": 3, "verdict": joint_verdict}]}
    outcome, sentence = demo.verdict(HIDDEN, answer)
    assert outcome == word and told in sentence


def test_additions_are_the_findings_own():
    """What is added is what the findings' commands add."""
    typed = finding("friction_step", 1) | {"command": "pumaid identify logs --add friction_step@1:time=569"}
    assert demo.additions({"findings": [typed]}) == ["friction_step@1:time=569"]
