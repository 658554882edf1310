"""An effect from a user's file: every command that meets it in a model can be given the file, and says so if not."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from pumaid.cli import group

SAMPLE = Path(__file__).parents[2] / "sample_logs" / "pendulum"
OWN = '''"""Rubbing that grows with the square of the position."""

from pumaid.effects import Effect, Parameter, Trace


class Brake(Effect):
    title = "Rubbing brake"
    equation = "s a q^2"
    source = "the maker's drawing"
    family = "position"
    trace = (Trace.POSITION,)

    def parameters(self, robot, number):
        return (Parameter("a", "A/{unit}2", "rubbing", "a{n}", 0.05),)

    def columns(self, robot, samples, *, number=None, shape={}):
        return (samples.direction * samples.position[:, samples.joint - 1] ** 2)[:, None]
'''


@pytest.fixture(scope="module")
def braked(tmp_path_factory) -> Path:
    """A sample whose model holds an effect of the file ``brake.py``; made in a process of its own, as users do."""
    folder = tmp_path_factory.mktemp("braked") / "arm"
    shutil.copytree(SAMPLE, folder, ignore=shutil.ignore_patterns("results"))
    (folder / "brake.py").write_text(OWN, encoding="utf-8")
    command = [sys.executable, "-m", "pumaid", "identify", "logs", "--add", "brake@2", "--effects", "brake.py"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.parametrize("line", ["compare results/model.json logs", "diagnose results/model.json logs", "report"])
def test_the_file_is_asked_for_again(braked, monkeypatch, line):
    """A model with an effect that only a file brings is refused with the option that names the file."""
    monkeypatch.chdir(braked)
    done = CliRunner().invoke(group, line.split())
    assert done.exit_code == 3
    assert done.stderr.startswith("error[unknown-effect]: the model holds brake,")
    assert "--effects FILE.py" in done.stderr


@pytest.mark.parametrize("line", ["compare results/model.json logs --worst 0", "report --format=", "history"])
def test_the_file_makes_it_known(braked, line):
    """With the file named, the model is used as any other."""
    command = [sys.executable, "-m", "pumaid", *line.split(), "--effects", "brake.py"]
    done = subprocess.run(command, cwd=braked, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
