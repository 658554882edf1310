"""Kept diagnoses: found for the very same question only, whole or not at all, and nobody else's files are touched."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import diagnoses
import pytest
import stories
import worlds
from test_diagnosis_file import same

from pumaid.io import diagnosis_cache
from pumaid.io.diagnosis import model_digest
from pumaid.io.diagnosis_cache import DiagnosisCache, diagnosis_shelf
from pumaid.records import Evidence, FileFacts
from pumaid.robot import EffectChoice

STORY = stories.story()
ESTIMATE, ROBOT = STORY.estimate, worlds.PENDULUM
RUNS = Evidence(STORY.evidence.runs, files=(FileFacts("a.csv", "cd" * 32, 9, 0.01, 0.0, 1.0),))
TOLD = replace(diagnoses.rich(), model=model_digest(ESTIMATE), logs={"a.csv": "cd" * 32})


@pytest.fixture
def folder(tmp_path) -> Path:
    """Where things are kept, with one diagnosis."""
    DiagnosisCache(ESTIMATE, RUNS, ROBOT, folder=tmp_path / "cache").put(TOLD)
    return tmp_path / "cache"


def test_what_was_kept_comes_back(folder):
    """Every number, sentence and curve is that of the diagnosis that was put."""
    assert same(DiagnosisCache(ESTIMATE, RUNS, ROBOT, folder=folder).get(), TOLD)


def other_current(evidence: Evidence) -> Evidence:
    """One mean of one cell is another number in its last place."""
    run = evidence.runs[3]
    current = run.cells.current.copy()
    current[-1] *= 1.0 + 2.0**-52
    moved = replace(run, cells=replace(run.cells, current=current))
    return replace(evidence, runs=(*evidence.runs[:3], moved, *evidence.runs[4:]))


def test_any_other_question_is_another(folder):
    """Another model, recipe, number, held-out run, log or suspect finds nothing."""
    value = ESTIMATE.values[0]
    other_model = replace(ESTIMATE, values=(replace(value, value=1e-9), *ESTIMATE.values[1:]))
    held = replace(RUNS, runs=(replace(RUNS.runs[0], heldout=True), *RUNS.runs[1:]))
    renamed = replace(RUNS, files=(replace(RUNS.files[0], digest="ab" * 32),))
    for asked in (
        DiagnosisCache(other_model, RUNS, ROBOT, folder=folder),
        DiagnosisCache(ESTIMATE, other_current(RUNS), ROBOT, folder=folder),
        DiagnosisCache(ESTIMATE, held, ROBOT, folder=folder),
        DiagnosisCache(ESTIMATE, renamed, ROBOT, folder=folder),
        DiagnosisCache(ESTIMATE, replace(RUNS, runs=RUNS.runs[::-1]), ROBOT, folder=folder),
        DiagnosisCache(ESTIMATE, RUNS, replace(ROBOT, gravity=(0.0, 0.0, -9.81)), folder=folder),
        DiagnosisCache(ESTIMATE, RUNS, replace(ROBOT, effects=(EffectChoice("ripple", 1),)), folder=folder),
        DiagnosisCache(ESTIMATE, RUNS, ROBOT, suspects=["supply_voltage"], folder=folder),
    ):
        assert asked.get() is None


@pytest.mark.parametrize("share", [0.0, 0.001, 0.01, 0.3, 0.9, 0.9999])
@pytest.mark.parametrize("fault", ["cut", "flipped", "under another name"])
def test_damage_is_seen(folder, share, fault):
    """A file that was cut, altered or renamed is as good as none."""
    (path,) = folder.iterdir()
    data = bytearray(path.read_bytes())
    at = int(share * len(data))
    if fault == "under another name":
        DiagnosisCache(ESTIMATE, other_current(RUNS), ROBOT, folder=folder).put(TOLD)
        (another,) = set(folder.iterdir()) - {path}
        path.write_bytes(another.read_bytes())
    else:
        path.write_bytes(data[:at] if fault == "cut" else data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :])
    assert DiagnosisCache(ESTIMATE, RUNS, ROBOT, folder=folder).get() is None


def test_only_own_files_are_removed_oldest_first(folder, monkeypatch):
    """Beyond the bound the one longest unused goes; others' files stay, whatever they are called."""
    (first,) = folder.iterdir()
    os.utime(first, (1.0, 1.0))
    strange = folder / f"{'0' * 16}-{'1' * 32}.json"
    strange.write_text('{"mine": true}')
    monkeypatch.setattr(diagnosis_cache, "MOST_BYTES", first.stat().st_size + 10)
    DiagnosisCache(ESTIMATE, other_current(RUNS), ROBOT, folder=folder).put(TOLD)
    assert not first.exists() and strange.exists() and len(list(folder.iterdir())) == 2
    assert diagnosis_shelf(folder).size() == sum(p.stat().st_size for p in folder.iterdir() if p != strange)


def test_a_folder_that_refuses_is_no_error(tmp_path):
    """Where nothing can be kept, nothing is."""
    (tmp_path / "file").write_text("in the way")
    DiagnosisCache(ESTIMATE, RUNS, ROBOT, folder=tmp_path / "file").put(TOLD)
    assert DiagnosisCache(ESTIMATE, RUNS, ROBOT, folder=tmp_path / "file").get() is None


def test_every_room_that_makes_a_diagnosis_counts():
    """A change of any module that a diagnosis loads makes what was kept void."""
    code = "import sys, pumaid.verbs.diagnose; print(*(name for name in sys.modules if name.startswith('pumaid.')))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    rooms = {name.split(".")[1] for name in done.stdout.split() if name.count(".") > 1}
    assert rooms and rooms <= set(diagnosis_cache._ROOMS)
