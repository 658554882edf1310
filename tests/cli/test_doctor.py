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
