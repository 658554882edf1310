"""``pumaid doctor``: what a bug report needs, and whether the installation works."""

from __future__ import annotations

import json

import pytest
from command import run

from pumaid import __version__
from pumaid.cli import selfcheck
from pumaid.effects import catalogue


@pytest.mark.slow
def test_a_good_installation_passes():
    """Every check of the self-check passes, and says what it saw."""
    found = json.loads(run("doctor", "--json").stdout)
    assert [one["passed"] for one in found["self_check"]] == [True] * 5
    assert "within" in found["self_check"][2]["text"] and "is found" in found["self_check"][3]["text"]


@pytest.mark.slow
def test_a_wrong_number_fails(monkeypatch):
    """Where a parameter is too far from the truth the check fails by name, with exit code 1, and no more are made."""
    monkeypatch.setattr(selfcheck, "FAR", 0.01)
    told = run("doctor", code=1).stdout.splitlines()
    assert "FAILED: identify: Wrong: " in told[-1] and "standard errors from the truth" in told[-1]


def test_versions_and_places_come_quickly(tmp_path, monkeypatch):
    """--quick: versions, effects, and how much the cache holds; no check is made."""
    monkeypatch.setenv("PUMAID_CACHE", str(tmp_path))
    found = json.loads(run("doctor", "--quick", "--json").stdout)
    assert (found["pumaid"], found["self_check"]) == (__version__, None)
    assert found["effects"] == list(catalogue())
    assert found["cache"]["folder"].startswith(str(tmp_path)) and found["cache"]["MiB"] == 0.0


def test_settings_are_told(tmp_path, monkeypatch):
    """Processors, encodings and the variables that are set."""
    monkeypatch.setenv("PUMAID_CACHE", str(tmp_path))
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    found = json.loads(run("doctor", "--quick", "--json").stdout)
    assert found["processors"]["usable"] >= 1 and found["encoding"]["files"]
    assert found["variables"]["PUMAID_CACHE"] == str(tmp_path) and found["variables"]["OPENBLAS_NUM_THREADS"] == "1"


@pytest.mark.parametrize("place", ["file", "link"])
def test_a_cache_that_keeps_nothing_is_told(tmp_path, monkeypatch, place):
    """A file in its place, or a link to nowhere: no size, but why."""
    (tmp_path / "file").write_text("mine")
    (tmp_path / "link").symlink_to("nowhere")
    monkeypatch.setenv("PUMAID_CACHE", str(tmp_path / place))
    found = json.loads(run("doctor", "--quick", "--json").stdout)["cache"]
    assert found["MiB"] is None and "nothing is kept" in found["fault"]


def test_no_home_is_told(monkeypatch):
    """A user without a home folder has no cache, and a doctor all the same."""
    monkeypatch.setattr("pumaid.io.kept.cache_folder", lambda: None)
    found = json.loads(run("doctor", "--quick", "--json").stdout)["cache"]
    assert found["folder"] is None and "no home folder" in found["fault"]
