"""``pumaid export`` as a user types it."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from command import answer, run

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "export.md").read_text(encoding="utf-8")
#: Fenced blocks of the page that name the file they go to, or are typed into a shell.
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", PAGE, re.DOTALL)


SUFFIXES = {"c": ".h .c _example.c", "python": ".py", "json": ".json", "matlab": ".m", "urdf": ".urdf", "mjcf": ".xml"}
ADDED = ("--add", "stribeck@2:velocity=0.2,exponent=1")
EXPORT = ("export", "results/model.json", "--format")


@pytest.fixture(scope="module")
def fitted(fitted, tmp_path_factory) -> Path:
    """The sample with a model that has Stribeck friction."""
    folder = tmp_path_factory.mktemp("rubbed") / "arm"
    shutil.copytree(fitted, folder)
    run("identify", folder / "logs", *ADDED)
    return folder


@pytest.mark.parametrize("form", SUFFIXES)
def test_files_say_what_is_not_in_them(arm, form):
    """Beside the model, or named with -o, they list what is left out and not determined; so does the document."""
    suffixes = SUFFIXES[form].split()
    told = answer(f"export results/model.json --format {form} -o Out.1{suffixes[0]}")
    assert (told["kind"], told["form"]) == ("export", form)
    assert told["files"] == [f"Out.1{suffix}" for suffix in suffixes]
    texts = "".join(Path(name).read_text() for name in told["files"])
    assert all(Path(name).is_file() for name in re.findall('#include "(.*)"', texts))
    assert all(lack["name"] in texts for lack in told["left_out"] + told["undetermined"])
    assert ("stribeck@2" in [lack["name"] for lack in told["left_out"]]) == (form in ("urdf", "mjcf"))
    done = run(*EXPORT, form)
    assert all((arm / "results" / f"two_link_pendulum{suffix}").is_file() for suffix in suffixes)
    assert done.stdout == "" and "two_link_pendulum" in done.stderr


def test_friction_goes_into_a_copy_of_the_users_file(arm):
    """Beside it, named after it; never over it unless forced; one of both options, and a file that is there."""
    run(*EXPORT, "mjcf", "-o", "Arm v1.xml")
    before = Path("Arm v1.xml").read_bytes()
    into = ("export", "results/model.json", "--into", "Arm v1.xml", "--torque-constants", "1=8")
    told = run(*into).stderr
    after = Path("Arm v1_identified.xml").read_bytes()
    assert "joint 1 (hip): frictionloss" in told and "stribeck@2" in told and Path("Arm v1.xml").read_bytes() == before
    assert after != before and len(after.split(b"\n")) == len(before.split(b"\n"))
    assert "--force" in run(*into, code=3).stderr and "--force" in run(*into, "-o", "Arm v1.xml", code=3).stderr
    run(*into, "-o", "Arm v1.xml", "--force")
    assert Path("Arm v1.xml").read_bytes() == after
    run(*into, "--format", "mjcf", code=2)
    whole = before.decode()
    begin, end = whole.index("<worldbody>") + len("<worldbody>"), whole.index("</worldbody>")
    Path("parts").mkdir()
    Path("parts/arm.xml").write_text(f"<?xml version='1.0'?>\n<mujocoinclude>{whole[begin:end]}</mujocoinclude>\n")
    Path("parts/all.xml").write_text('<mujocoinclude><include file="arm.xml"/></mujocoinclude>')
    Path("scene.xml").write_text(f'{whole[:begin]}<include file="parts/all.xml"/>{whole[end:]}')
    run(*into[:3], "scene.xml", *into[4:])
    assert Path("scene_identified.xml").read_bytes() == after
    run("export", "results/model.json", code=2)
    run("export", "results/model.json", "--into", "none.xml", code=2)
    Path("empty.xml").write_bytes(b"")
    told = run("export", "results/model.json", "--into", "empty.xml", "--torque-constants", "1=8", code=3).stderr
    assert "error[into-refused]" in told and "hip, knee" in told


def test_what_stands_there_is_kept_unless_forced(arm):
    """Neither of two files is written where one is in the way; --force replaces both; -o - prints one."""
    Path("p.c").write_text("mine")
    told = run(*EXPORT, "c", "-o", "p", code=3).stderr
    assert (Path("p.h").exists(), Path("p.c").read_text()) == (False, "mine")
    assert "error[file-exists]" in told and "--force" in told
    run(*EXPORT, "c", "-o", "p", "--force")
    assert "p_gravity" in Path("p.c").read_text() and Path("p.h").is_file()
    compile(run(*EXPORT, "python", "-o", "-").stdout, "arm.py", "exec")


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
        elif language == "sh" and all(shutil.which(name) for name in ("gcc", "octave-cli") if name in text):
            done = subprocess.run(["bash", "-euc", text], capture_output=True, text=True, check=False)
            assert done.returncode == 0, (text, done.stdout, done.stderr)
            ran.append(done.stdout)
    assert len(ran) >= 4 and all(form in PAGE for form in SUFFIXES)
