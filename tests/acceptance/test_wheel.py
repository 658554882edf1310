"""A wheel works where there is no checkout: recipes, presets, templates and scripts are in it."""

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

pytest.importorskip("hatchling", reason="it builds the wheel (pip install pumaid[test])")
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """An empty folder beside the unpacked wheel."""
    folder = tmp_path_factory.mktemp("wheel")
    line = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(line, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    zipfile.ZipFile(wheel).extractall(folder / "site")
    (folder / "empty").mkdir()
    return folder / "empty"


def printed(folder: Path, *words: str) -> str:
    """What Python prints there, in the folder, with the wheel's modules before all others."""
    environment = {**os.environ, "PYTHONPATH": str(folder.parent / "site")}
    line = [sys.executable, *words]
    done = subprocess.run(line, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_a_wheel_tells_the_whole_story_in_an_empty_folder(installed):
    """The demo makes a recipe, plans, simulates, identifies, diagnoses and reports; an export and a preset follow."""
    assert str(installed.parent) in printed(installed, "-c", "import pumaid; print(pumaid.__file__)")
    words = ("demo", "tale", "--robot", "pendulum2", "--seed", "1", "--json")
    told = json.loads(printed(installed, "-m", "pumaid", *words))
    lines = [step["command"].split()[1] for step in told["steps"]]
    assert lines == ["init", "plan", "simulate", "identify", "compare", "diagnose", "report"]
    assert (told["kind"], told["hidden"], told["named"]) == ("demo", "ripple@2", ["ripple@2"])
    assert (installed / "tale" / "results" / "report.html").stat().st_size > 100_000
    printed(installed, "-m", "pumaid", "export", "tale/results/model.json", "--format", "c", "-o", "tale/model.c")
    assert "preset: feetech-sts" in printed(
        installed, "-m", "pumaid", "init", "ur5e", "--preset", "feetech-sts", "-o", "-"
    )
