"""``pumaid doctor``: what a bug report needs, and whether the installation works."""

from __future__ import annotations

import json

import pytest
from command import run

from pumaid import __version__
from pumaid.cli.commands import demo
from pumaid.effects import catalogue


@pytest.mark.slow
def test_a_good_installation_passes():
    """The self-check finds what its robot hides."""
    answer = json.loads(run("doctor", "--json").stdout)
    assert answer["self_check"] == {"passed": True, "text": "the hidden ripple@2 is found"}


def test_what_fails_is_told(monkeypatch):
    """Where a step of the self-check fails it is told, with exit code 1."""
    monkeypatch.setattr(demo, "RATE", -1)
    lines = run("doctor", code=1).stdout.splitlines()
    assert lines[-1].startswith("self-check FAILED: 'pumaid simulate") and "--rate -1" in lines[-1]


def test_versions_come_quickly():
    """--quick: versions and effects; no check is made."""
    answer = json.loads(run("doctor", "--quick", "--json").stdout)
    assert (answer["pumaid"], answer["self_check"]) == (__version__, None)
    assert answer["effects"] == list(catalogue()) and answer["encoding"]["files"]
