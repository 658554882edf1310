"""Faults of folders, disks, pipes and names: links, rights, full disks, odd names, very many files."""

import errno
import os
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from faulty import contents, csv, good, invoke, outcome, unclear


def judged(arm: Path, before: dict[str, bytes], *words: str) -> str:
    """What came of identifying the logs of an experiment."""
    return outcome(invoke("identify", *(words or (str(arm / "logs"),)), "--json"), arm, before)


def test_links_to_logs_and_folders_are_followed(arm):
    """Logs that are links, a folder that is one, and one that leads back to itself: each file is read once."""
    kept = arm / "kept"
    (arm / "logs").rename(kept)
    (arm / "logs").mkdir()
    (arm / "logs" / "log_1.csv").symlink_to(kept / "log_1.csv")
    (arm / "logs" / "again.csv").symlink_to(kept / "log_1.csv")
    (arm / "logs" / "more").symlink_to(kept, target_is_directory=True)
    (kept / "circle").symlink_to(arm / "logs", target_is_directory=True)
    assert judged(arm, {}) == "agrees"


@pytest.mark.parametrize("target", ["nowhere.csv", "log.csv"])
def test_links_that_lead_nowhere_are_told(arm, target):
    """A link to no file, and one to itself, are refused where they are named."""
    link = arm / "logs" / "log.csv"
    link.symlink_to(arm / "logs" / target)
    assert judged(arm, contents(arm / "results"), str(link)) == "refused"


@pytest.mark.parametrize("name", ["logs/log_2.csv", "recipe.yaml"])
def test_an_unreadable_file_is_told(arm, monkeypatch, name):
    """A log or a recipe without the right to read it; patched, since root may read all."""
    opened, before = Path.open, contents(arm / "results")

    def refusing(path, *mode, **more):
        if path == arm / name:
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return opened(path, *mode, **more)

    monkeypatch.setattr(Path, "open", refusing)
    assert judged(arm, before) == "refused"


@pytest.mark.parametrize("name", ["logs/log_2.csv", "logs", "recipe.yaml"])
def test_a_folder_or_a_pipe_in_place_of_a_file(arm, name):
    """A folder named as a log is one of logs; as a recipe it is none."""
    before = contents(arm / "results")
    path = arm / name
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    path.mkdir()
    assert judged(arm, before) in ("refused", "agrees")


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS, errno.EDQUOT, errno.EIO, errno.EACCES])
@pytest.mark.parametrize("step", ["write_bytes", "replace"])
def test_a_disk_that_refuses_leaves_the_old_model(arm, monkeypatch, number, step):
    """Full, read-only, over quota, broken or forbidden, at the writing or at the renaming: old results stand whole."""
    before = contents(arm / "results")

    def refusing(path, *given):
        raise OSError(number, os.strerror(number))

    with monkeypatch.context() as patched:
        patched.setattr(Path, step, refusing)
        found = invoke("identify", str(arm / "logs" / "log_1.csv"), "--json")
    assert found.exit_code == 3 and unclear(found.stderr) == []
    assert contents(arm / "results") == before


def test_a_file_in_place_of_the_results_folder(arm):
    shutil.rmtree(arm / "results")
    (arm / "results").write_text("mine")
    found = invoke("identify", str(arm / "logs"))
    assert found.exit_code == 3 and unclear(found.stderr) == [] and (arm / "results").read_text() == "mine"


ODD = (
    "a b (1).csv",
    "Prüfstand Ω 🤖.csv",
    "-o.csv",
    "#1%20.csv",
    "'quoted\".csv",
    "new\nline.csv",
    "[0-9]*.csv",
    "x" * 200 + ".csv",
)


@pytest.mark.parametrize("name", ODD)
def test_odd_names_of_logs_change_nothing(arm, name):
    """Blanks, letters of any script, quotes, line ends and what a shell or a glob takes for a command."""
    (arm / "logs" / "log_1.csv").rename(arm / "logs" / name)
    assert judged(arm, {}) == "agrees"


def test_a_recording_in_many_files_is_one_log(arm):
    """Cut into ten files: runs end where a file ends, notes do not come tenfold."""
    for number, table in enumerate(good(), start=1):
        (arm / "logs" / f"log_{number}.csv").unlink()
        for k, rows in enumerate(np.array_split(np.arange(len(table)), 5)):
            (arm / "logs" / f"log_{number}_{k}.csv").write_text(csv(table.iloc[rows]), encoding="utf-8")
    found = invoke("identify", str(arm / "logs"), "--json")
    before = {"model.json": (arm / "results" / "model.json").read_bytes()}
    assert outcome(found, arm, before) == "agrees" and len(found.stderr.splitlines()) < 20


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no pipes with names")
@pytest.mark.parametrize("words", [("history", ""), ("identify", "logs")])
def test_pipes_among_the_models_are_passed_over(arm, words):
    """Nobody writes to them: who opened one would wait for ever. Each is named."""
    os.mkfifo(arm / "results" / "models" / "003-f.json")
    (arm / "results" / "models" / "004-z.json").symlink_to("/dev/zero")
    found = invoke(words[0], str(arm / words[1]))
    assert found.exit_code == 0
    if words[0] == "history":
        assert "003-f.json is passed over" in found.stderr and "004-z.json is passed over" in found.stderr


def test_half_letters_in_the_old_model_do_not_block_a_new_one(arm):
    path = arm / "results" / "model.json"
    path.write_text(path.read_text().replace('"robot": "', r'"robot": "\ud800', 1))
    found = invoke("compare", str(path), str(arm / "logs"))
    assert found.exit_code == 3 and unclear(found.stderr) == []
    assert invoke("identify", str(arm / "logs")).exit_code == 0
    assert invoke("compare", str(path), str(arm / "logs")).exit_code == 0


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such names")
def test_a_log_whose_name_is_no_text(arm):
    (arm / "logs" / "log_1.csv").rename(arm / "logs" / os.fsdecode(b"\xff\xfe bad.csv"))
    path = arm / "results" / "model.json"
    assert invoke("identify", str(arm / "logs")).exit_code == 0
    assert r"\\udcff\\udcfe bad.csv" in path.read_text()
    assert invoke("compare", str(path), str(arm / "logs"), "--json").exit_code == 0


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such names")
def test_a_folder_whose_name_is_no_text(arm):
    import pandas as pd

    folder = arm / os.fsdecode(b"logs \xff")
    folder.mkdir()
    for path in (arm / "logs").glob("*.csv"):
        pd.read_csv(path).to_parquet(path.with_suffix(".parquet"))
        path.with_suffix(".parquet").rename(folder / f"{path.stem}.parquet")
    assert invoke("identify", str(folder), "--recipe", str(arm / "recipe.yaml")).exit_code == 0
