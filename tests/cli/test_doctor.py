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


def test_versions_come_quickly():
    """--quick: versions and effects; no check is made."""
    found = json.loads(run("doctor", "--quick", "--json").stdout)
    assert (found["pumaid"], found["self_check"]) == (__version__, None)
    assert found["effects"] == list(catalogue())


def test_settings_are_told(monkeypatch):
    """Processors, encodings and the variables that are set."""
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    found = json.loads(run("doctor", "--quick", "--json").stdout)
    assert found["processors"]["usable"] >= 1 and found["encoding"]["files"]
    assert found["variables"]["OPENBLAS_NUM_THREADS"] == "1"
