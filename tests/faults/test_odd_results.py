"""Pipes and devices among the results, names that are no text, a damaged model in the way of a new one."""

import os
import sys

import pytest
from faulty import invoke, unclear

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no pipes with names")


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
    """identify needs nothing of it; other commands refuse it."""
    path = arm / "results" / "model.json"
    path.write_text(path.read_text().replace('"robot": "', r'"robot": "\ud800', 1))
    found = invoke("compare", str(path), str(arm / "logs"))
    assert found.exit_code == 3 and unclear(found.stderr) == []
    assert invoke("identify", str(arm / "logs")).exit_code == 0
    assert invoke("compare", str(path), str(arm / "logs")).exit_code == 0


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such names")
def test_a_log_whose_name_is_no_text(arm):
    """Its model is written, read and compared."""
    (arm / "logs" / "log_1.csv").rename(arm / "logs" / os.fsdecode(b"\xff\xfe bad.csv"))
    path = arm / "results" / "model.json"
    assert invoke("identify", str(arm / "logs")).exit_code == 0
    assert r"\\udcff\\udcfe bad.csv" in path.read_text()
    assert invoke("compare", str(path), str(arm / "logs"), "--json").exit_code == 0


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such names")
def test_a_folder_whose_name_is_no_text(arm):
    """Parquet logs are opened by the bytes of their path."""
    import pandas as pd

    folder = arm / os.fsdecode(b"logs \xff")
    folder.mkdir()
    for path in (arm / "logs").glob("*.csv"):
        pd.read_csv(path).to_parquet(path.with_suffix(".parquet"))
        path.with_suffix(".parquet").rename(folder / f"{path.stem}.parquet")
    assert invoke("identify", str(folder), "--recipe", str(arm / "recipe.yaml")).exit_code == 0
