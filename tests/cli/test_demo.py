"""The demo: its story on a moving arm, and whose folders it touches."""

import pytest
from command import answer, run

from pumaid.cli.commands import experiments
from pumaid.errors import ResultError


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
