"""The demo: its story on a small arm, its honesty, and whose folders it touches."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from pumaid.cli import demo, group
from pumaid.cli.rehearsal import run
from pumaid.errors import ResultError

#: Files opened while `watching` holds anything; an audit hook cannot be taken off again.
OPENED: list[str] = []
WATCHING: list[bool] = []
sys.addaudithook(lambda event, facts: OPENED.append(str(facts[0])) if event == "open" and WATCHING else None)


@pytest.fixture
def small(monkeypatch, tmp_path):
    """An empty working folder, for demos on an arm of two joints."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def invoke(*words: str, code: int = 0):
    """The command line in this process."""
    done = CliRunner().invoke(group, list(words), prog_name="pumaid")
    assert done.exit_code == code, done.output
    return done


def test_story_ends_in_the_report_and_the_truth(small):
    """Every step is a line that can be typed; the page is there; the end opens the secret and judges."""
    told = invoke("demo", "tale", "--robot", "pendulum2", "--effect", "friction_step", "--seed", "1").stdout
    lines = [line.removeprefix("$ pumaid ").split()[0] for line in told.splitlines() if line.startswith("$ ")]
    assert lines[:6] == ["init", "plan", "simulate", "identify", "compare", "diagnose"]
    assert lines[-2:] == ["history", "report"]
    assert (small / "tale" / "results" / "report.html").stat().st_size > 10_000
    assert "What was hidden: friction_step@" in told
    assert told.strip().splitlines()[-1].split()[0] in ("Right:", "In", "Wrong:", "Missed:")


def test_document_says_the_same(small):
    """With --json one document comes: steps, what was hidden, what was found, and the outcome."""
    found = json.loads(invoke("demo", "tale", "--robot", "pendulum2", "--clean", "--json").stdout)
    assert found["hidden"] == []
    assert found["outcome"] in ("left alone", "wrong")
    assert [step["command"].split()[1] for step in found["steps"]][:3] == ["init", "plan", "simulate"]
    assert "--surprise" not in found["steps"][2]["command"]
    assert found | {"pumaid": ""} == json.loads((small / "tale" / "demo.json").read_text()) | {"pumaid": ""}


def test_truth_stays_sealed(small):
    """No command of the story reads truth.json: only simulate opens its folder's new file, to write it."""
    demo.make_room(Path("tale"))
    steps = demo.story(Path("tale"), robot="pendulum2", seed=1, surprise="any")
    for told in steps:
        name = told.step.line.split()[1]
        assert name in ("init", "plan", "simulate") or not [path for path in OPENED if path.endswith("truth.json")]
        if name == "simulate":
            WATCHING.append(True)
    WATCHING.clear()
    assert [path for path in OPENED if path.endswith("session_01.parquet")]
    OPENED.clear()


def test_earlier_demo_is_replaced_and_nothing_else(small):
    """A demo takes the place of a demo; a folder of another's making is left as it is, and told."""
    demo.make_room(Path("tale"))
    (small / "tale" / "results").mkdir()
    demo.make_room(Path("tale"))
    assert [path.name for path in (small / "tale").iterdir()] == ["demo.json"]
    (small / "tale" / "notes.txt").write_text("mine")
    error = invoke("demo", "tale", code=3).stderr
    assert "error[demo-in-the-way]" in error
    assert "notes.txt" in error
    assert (small / "tale" / "notes.txt").read_text() == "mine"


@pytest.fixture
def earlier(small):
    """An earlier demo with a few of its files."""
    demo.make_room(Path("tale"))
    for name in ("recipe.yaml", "logs/session_01.parquet", "logs/truth.json", "results/model.json"):
        (small / "tale" / name).parent.mkdir(exist_ok=True)
        (small / "tale" / name).write_text("the demo's")
    demo.mark(Path("tale"))
    return small / "tale"


def names(folder: Path) -> list[str]:
    """Everything below a folder."""
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*"))


@pytest.mark.parametrize("more", [["--robot", "nope"], ["--effect", "nope"], ["--effect", "coupling@9"]])
def test_what_cannot_be_told_destroys_nothing(earlier, more):
    """Wrong options are refused before an earlier demo is touched."""
    before = names(earlier)
    assert "error[" in invoke("demo", "tale", *more, code=3).stderr
    assert names(earlier) == before


@pytest.mark.parametrize("name", ["logs/session_02.csv", "results/mine.txt", "results/own/mine.txt"])
def test_users_files_in_a_demos_folders_stay(earlier, name):
    """A file that no demo made is named, and nothing at all is removed."""
    (earlier / name).parent.mkdir(exist_ok=True)
    (earlier / name).write_text("mine")
    before = names(earlier)
    told = invoke("demo", "tale", "--robot", "pendulum2", code=3).stderr
    assert "error[demo-in-the-way]" in told and name in told
    assert names(earlier) == before


@pytest.mark.parametrize("name", ["logs", "results/model.json", "demo.json"])
def test_links_in_a_demos_folder_are_refused(earlier, name):
    """A link in place of what the demo made leads to somebody's own: nothing is removed there or here."""
    (earlier / name).rename(earlier.parent / "elsewhere")
    (earlier / name).symlink_to(earlier.parent / "elsewhere")
    before = names(earlier.parent)
    assert "error[demo-in-the-way]" in invoke("demo", "tale", "--robot", "pendulum2", code=3).stderr
    assert names(earlier.parent) == before


def test_a_whole_demo_makes_room(earlier):
    """All that a demo made goes."""
    demo.make_room(Path("tale"))
    assert names(earlier) == ["demo.json"]


def test_ctrl_c_ends_a_demo_as_any_command(small, monkeypatch):
    """Code 130 and the usual line; what was made till then is known as the demo's."""

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("pumaid.verbs.simulate.simulate", interrupted)
    told = invoke("demo", "tale", "--robot", "pendulum2", code=130).stderr
    assert told.strip().splitlines() == ["stopped; files that were being written are as they were before"]
    demo.make_room(Path("tale"))
    assert names(small / "tale") == ["demo.json"]


@pytest.mark.parametrize("name", ["recipe.yaml", "logs"])
def test_experiment_is_no_demo(small, name):
    """A folder that looks like an experiment and has no demo's mark is a user's own."""
    (small / "arm" / name).mkdir(parents=True)
    assert f"it holds {name}" in invoke("demo", "arm", code=3).stderr


def test_failing_step_is_told(small):
    """A step that fails ends the demo with the line that failed and what it said."""
    with pytest.raises(ResultError) as caught:
        run(["identify", "nowhere"])
    assert caught.value.slug == "step-failed"
    assert "'pumaid identify nowhere' left with exit code 3" in caught.value.what
    with pytest.raises(ResultError, match="was not understood"):
        run(["plan", "--nonsense"])


def test_effect_and_clean_exclude_each_other(small):
    """Nothing and something cannot be hidden at once."""
    assert "give one of them" in invoke("demo", "--clean", "--effect", "spring", code=2).stderr


def finding(effect: str, joint: int | None, *rivals: str) -> dict[str, object]:
    """A finding as diagnose's document has it."""
    return {"effect": effect, "joint": joint, "rivals": list(rivals), "verdict": "add", "p_value": 0.01}


HIDDEN = [{"effect": "stribeck", "joint": 3, "values": {}}]
TILT = [{"effect": "tilt", "joint": None, "values": {}}]


@pytest.mark.parametrize(
    ("hidden", "found", "joint_verdict", "word", "told"),
    [
        (HIDDEN, [finding("stribeck", 3)], "missing", "named", "Right: diagnosis named stribeck@3."),
        (HIDDEN, [finding("stribeck", 3), finding("spring", 1)], "missing", "named", "spring@1 as well"),
        (HIDDEN, [finding("viscous_power", 3, "stribeck")], "missing", "in the set", "cannot tell it from stribeck"),
        (HIDDEN, [finding("viscous_power", 2, "stribeck")], "missing", "wrong", "named viscous_power@2"),
        (HIDDEN, [finding("stribeck", 2)], "missing", "wrong", "it is stribeck@3"),
        (HIDDEN, [], "unexplained", "missed", "could not name stribeck@3"),
        (HIDDEN, [finding("stribeck", 3) | {"verdict": "doubtful"}], "adequate", "missed", "found nothing"),
        (TILT, [finding("tilt", None)], "missing", "named", "named tilt."),
        (TILT, [finding("zero_offset", 2, "tilt")], "missing", "in the set", "cannot tell it from tilt"),
        ([], [], "adequate", "left alone", "nothing was found"),
        ([], [finding("spring", 1)], "missing", "wrong", "named spring@1"),
    ],
)
def test_verdict_is_honest(hidden, found, joint_verdict, word, told):
    """Named, in the set, wrong or missed: by effect and joint, false company told."""
    answer = {"findings": found, "joints": [{"joint": 3, "verdict": joint_verdict}]}
    said, sentence = demo.verdict(hidden, answer)
    assert said == word
    assert told in sentence


def test_additions_are_the_findings_own():
    """What is added is what the finding's command adds, else the effect at its joint."""
    typed = finding("friction_step", 1) | {"command": "pumaid identify logs --add friction_step@1:time=569"}
    assert demo.additions({"findings": [typed, finding("tilt", None)]}) == ["friction_step@1:time=569", "tilt"]
