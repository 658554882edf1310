"""The demo: its story on a small arm, its honesty, and whose folders it touches."""

import pytest
from command import answer, run

from pumaid.cli.commands import experiments
from pumaid.errors import ResultError


@pytest.fixture(scope="module")
def tale(tmp_path_factory):
    """The folder of a demo, and what it said."""
    folder = tmp_path_factory.mktemp("demo") / "tale"
    return folder, answer(f"demo {folder} --robot pendulum2 --seed 1")


@pytest.mark.slow
def test_story_ends_in_the_report_and_the_truth(tale):
    """Every step is a line that can be typed; the page is there; the end says what was hidden and named."""
    folder, told = tale
    assert (told["kind"], told["format"]) == ("demo", 1)
    lines = [step["command"].split()[1] for step in told["steps"]]
    assert lines == ["init", "plan", "simulate", "identify", "compare", "diagnose", "report"]
    assert all(step["told"] for step in told["steps"])
    assert (folder / "results" / "report.html").stat().st_size > 10_000
    assert (told["hidden"], told["named"]) == ("ripple@2", ["ripple@2"])


@pytest.mark.slow
def test_story_on_a_motion(tmp_path):
    """With all joints moving the hidden effect is named, too, of a trajectory that the robot followed."""
    told = answer(f"demo {tmp_path / 'tale'} --robot pendulum2 --motion --seed 1")
    assert (told["hidden"], told["named"]) == ("ripple@2", ["ripple@2"])
    assert "--motion fourier --minutes 2" in told["steps"][1]["command"]


def test_a_folder_with_anything_in_it_is_left_alone(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    assert "error[file-exists]" in run("demo", ".", code=3).stderr
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


def test_failing_step_is_told():
    """A step that fails ends the demo with the line that failed and what it said."""
    with pytest.raises(ResultError) as caught:
        experiments.run("identify", "nowhere")
    assert caught.value.slug == "step-failed"
    assert "'pumaid identify nowhere' left with exit code 3: error[" in caught.value.what
