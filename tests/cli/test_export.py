"""``pumaid export`` as a user types it."""

from __future__ import annotations

import importlib.util
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from pumaid.cli import group

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "export.md").read_text(encoding="utf-8")
#: Fenced blocks of the page that name the file they go to, or are typed into a shell.
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", PAGE, re.DOTALL)


def run(*arguments: str) -> Result:
    """Run ``pumaid`` with these arguments."""
    return CliRunner().invoke(group, list(arguments))


@pytest.fixture(scope="module")
def fitted(tmp_path_factory) -> Path:
    """The sample pendulum with a model in results/."""
    folder = tmp_path_factory.mktemp("fitted") / "arm"
    shutil.copytree(ROOT / "sample_logs" / "pendulum", folder, ignore=shutil.ignore_patterns("results"))
    assert run("identify", str(folder / "logs"), "--add", "stribeck@2:velocity=0.2,exponent=1").exit_code == 0
    return folder


@pytest.fixture
def arm(fitted, tmp_path, monkeypatch) -> Path:
    """A copy of the experiment, which is the working folder."""
    shutil.copytree(fitted, tmp_path / "arm")
    monkeypatch.chdir(tmp_path / "arm")
    return tmp_path / "arm"


SUFFIXES = {
    "c": [".h", ".c"],
    "python": [".py"],
    "json": [".json"],
    "matlab": [".m"],
    "urdf": [".urdf"],
    "mjcf": [".xml"],
}


@pytest.mark.parametrize("form", SUFFIXES)
def test_files_are_named_after_the_robot_and_stand_beside_the_model(arm, form):
    """Without -o; the recipe is found beside the model's folder from anywhere."""
    done = run("export", str(arm / "results" / "model.json"), "--format", form)
    assert done.exit_code == 0, done.stderr
    assert [(arm / "results" / f"two_link_pendulum{suffix}").is_file() for suffix in SUFFIXES[form]]
    assert done.stdout == "" and "two_link_pendulum" in done.stderr


@pytest.mark.parametrize("form", SUFFIXES)
def test_files_say_what_is_not_in_them(arm, form):
    """The document lists files, what is left out and what is not determined; so does the file."""
    done = run("export", "results/model.json", "--format", form, "-o", "out" + SUFFIXES[form][-1], "--json")
    document = json.loads(done.stdout)
    assert document["kind"] == "export" and document["form"] == form
    assert document["files"] == [f"out{suffix}" for suffix in SUFFIXES[form]]
    texts = "".join(Path(name).read_text() for name in document["files"])
    assert all(lack["name"] in texts for lack in document["left_out"] + document["undetermined"])
    assert ("stribeck@2" in [lack["name"] for lack in document["left_out"]]) == (form in ("urdf", "mjcf"))


def test_what_stands_there_is_kept_unless_forced(arm):
    """Neither of two files is written where one is in the way; --force replaces both."""
    Path("p.c").write_text("mine")
    done = run("export", "results/model.json", "--format", "c", "-o", "p")
    assert (done.exit_code, Path("p.h").exists(), Path("p.c").read_text()) == (3, False, "mine")
    assert "error[file-exists]" in done.stderr and "--force" in done.stderr
    assert run("export", "results/model.json", "--format", "c", "-o", "p", "--force").exit_code == 0
    assert "p_gravity" in Path("p.c").read_text() and Path("p.h").is_file()
    before = Path("results/model.json").read_bytes()
    done = run("export", "results/model.json", "--format", "json", "-o", "results/model.json", "--force")
    assert done.exit_code == 3 and Path("results/model.json").read_bytes() == before


def test_one_file_goes_to_standard_output(arm):
    """-o -: the module and nothing else; the rest is on standard error."""
    done = run("export", "results/model.json", "--format", "python", "-o", "-")
    assert done.exit_code == 0 and "def gravity(q)" in done.stdout
    compile(done.stdout, "arm.py", "exec")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--format", "c", "-o", "-"], "Two files"),
        (["--format", "json", "-o", "-", "--json"], "--json"),
        (["--format", "c", "--torque-constants", "1,2"], "ampere"),
        (["--format", "fortran"], "fortran"),
        ([], "--format"),
    ],
)
def test_wrong_usage(arm, arguments, said):
    """Told as usage, exit code 2, nothing written."""
    done = run("export", "results/model.json", *arguments)
    assert done.exit_code == 2 and said in done.stderr
    assert list(arm.glob("two_link*")) == []


def test_bad_input(arm):
    """No model, another recipe, constants for another arm: one message, exit code 3."""
    tries = {
        "file-not-readable": ["none.json", "--format", "c"],
        "model-damaged": ["recipe.yaml", "--format", "c"],
        "model-other-recipe": ["results/model.json", "--format", "c", "--recipe", "ur5e"],
        "torque-constants": ["results/model.json", "--format", "urdf", "--torque-constants", "1,2,3"],
    }
    for slug, arguments in tries.items():
        done = run("export", *arguments)
        assert (done.exit_code, f"error[{slug}]" in done.stderr) == (3, True), done.stderr


def _can(text: str) -> bool:
    """Whether this machine has what a block needs."""
    needs = {"gcc": "gcc", "octave": "octave-cli"}
    has_pinocchio = importlib.util.find_spec("pinocchio") is not None or "masses.py" not in text
    return has_pinocchio and all(shutil.which(program) for word, program in needs.items() if word in text)


def test_the_page_runs_as_printed(arm, monkeypatch):
    """Every block of docs/export.md, in order: files are written where their first line says, lines are typed."""
    (arm / "bin").mkdir()
    (arm / "bin" / "pumaid").write_text(f'#!/bin/sh\nexec {sys.executable} -m pumaid "$@"\n')
    (arm / "bin" / "python").write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    for program in (arm / "bin").iterdir():
        program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{arm / 'bin'}:/usr/local/bin:/usr/bin:/bin")
    ran = []
    for language, text in BLOCKS:
        if found := re.match(r"\W+ (\w+\.\w+)", text):
            Path(found[1]).write_text(text, encoding="utf-8")
        elif language == "sh" and _can(text):
            done = subprocess.run(["bash", "-euc", text], capture_output=True, text=True, check=False)
            assert done.returncode == 0, (text, done.stdout, done.stderr)
            ran.append(done.stdout)
    assert len(ran) >= 4 and all(form in PAGE for form in SUFFIXES)
