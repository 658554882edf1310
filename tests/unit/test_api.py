"""What an engineer types in a notebook."""

import shutil
from pathlib import Path

import pandas as pd
import pytest

import pumaid

SAMPLES = Path(__file__).parents[2] / "sample_logs"


@pytest.fixture(scope="module")
def arm(tmp_path_factory) -> pumaid.Arm:
    """The sample pendulum's folder, without results."""
    folder = tmp_path_factory.mktemp("api") / "arm"
    shutil.copytree(SAMPLES / "pendulum", folder, ignore=shutil.ignore_patterns("results"))
    return pumaid.load(str(folder))


@pytest.fixture(scope="module")
def estimate(arm) -> pumaid.Identified:
    """Its model."""
    return arm.identify()


def test_an_estimate_is_its_table(estimate):
    """repr and HTML are the table of parameters, an item is one of them, a frame has a row each."""
    assert "parameters ± standard error" in repr(estimate) and "<pre>" in estimate._repr_html_()
    value = estimate["coulomb.j2.plus"]
    assert value.std_error > 0.0 and f"{value.value:.4f}" in repr(estimate)
    frame = estimate.to_frame()
    assert isinstance(frame, pd.DataFrame) and set(frame["name"]) == {one.name for one in estimate.values}
    with pytest.raises(KeyError, match=r"coulomb\.j2\.plus"):
        estimate["coulomb.j2.pluss"]


def test_strings_and_paths_alike(arm, estimate):
    """Logs as a text, a path or a list, and the recipe by file: the same numbers."""
    recipe, logs = arm.folder / "recipe.yaml", arm.folder / "logs"
    for given in (str(logs), logs, [str(path) for path in logs.iterdir()]):
        again = pumaid.identify(given, recipe=str(recipe))
        assert again.record.values == estimate.record.values
    assert pumaid.read_recipe(str(recipe)) == pumaid.read_recipe(arm.folder) == arm.robot
    assert pumaid.read_recipe("ur5e").n_joints == 6


def test_segment_takes_files_or_samples(arm, estimate):
    """Runs of files by their recipe; a robot goes with samples alone, and is not passed over beside files."""
    recipe, logs = arm.folder / "recipe.yaml", arm.folder / "logs"
    assert len(pumaid.segment(logs, recipe=recipe).runs) == len(estimate.dataset.runs)
    for asked in (pumaid.segment, pumaid.identify):
        with pytest.raises(TypeError, match="recipe="):
            asked(str(logs), arm.robot)


def test_questions_are_asked_of_the_estimate(estimate, arm):
    """compare, diagnose and plot answer with records that print, and a figure that shows itself."""
    comparison = estimate.compare()
    assert isinstance(comparison.record, pumaid.Comparison)
    assert comparison.rmse == estimate.compare(arm.folder / "logs").rmse
    assert "RMSE" in repr(comparison) or "rmse" in repr(comparison)
    diagnosis = estimate.diagnose()
    assert isinstance(diagnosis.findings, tuple) and "joint" in repr(diagnosis).lower()
    assert estimate.plot("residual")._repr_png_().startswith(b"\x89PNG")
    with pytest.raises(KeyError, match="residual_j2"):
        estimate.plot("nonsense")


def test_a_saved_model_is_the_command_lines(estimate, arm, tmp_path):
    """What is saved is read again, by file or from the folder's results."""
    estimate.save(tmp_path / "model.json")
    assert arm.model(tmp_path / "model.json").record.values == estimate.record.values
    assert "def gravity" in estimate.export("python").files[".py"]


def test_effects_are_added_as_on_the_command_line(arm):
    """``add`` takes the words of --add; a wrong one is refused with the nearest right one."""
    assert "ripple.j2.cos" in {one.name for one in arm.identify(add="ripple@2:frequency=27").values}
    with pytest.raises(pumaid.ModelError, match="stribeck"):
        arm.identify(add=["stribek@2"])
    with pytest.raises(pumaid.PumaidError):
        pumaid.load("nowhere")
