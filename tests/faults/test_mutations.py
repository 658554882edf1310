"""Good experiments that were broken in one place: refused in one message, flagged, or identified as the good one."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from faulty import Fault, contents, invoke, make, outcome, slugs_of
from faulty_logs import all_logs
from faulty_recipes import all_recipes


@pytest.fixture(scope="session")
def experiment(tmp_path_factory) -> Path:
    """The good experiment with its results."""
    folder = make(tmp_path_factory.mktemp("good") / "arm")
    assert invoke("identify", str(folder / "logs")).exit_code == 0
    return folder


def titled(faults: list[Fault]) -> list:
    """Mutations as parameters of a test, named by class and what they are."""
    return [pytest.param(fault, id=f"{fault.kind}: {fault.name}") for fault in faults]


def test_the_good_experiment_is_good(experiment):
    """Without a fault nothing is said, and the parameters are those that the logs were made with."""
    found = invoke("identify", str(experiment / "logs"), "--json")
    assert slugs_of(found.stderr) == set()
    assert outcome(found, experiment, {}) == "agrees"


@pytest.mark.parametrize("fault", titled(all_logs() + all_recipes()))
def test_a_fault_is_never_silent(experiment, tmp_path, fault):
    """No traceback; old results whole and one message with a mend, or the good log's numbers, or a warning."""
    folder = tmp_path / "arm"
    shutil.copytree(experiment, folder)
    fault.change(folder)
    found = invoke("identify", str(folder / "logs"), "--json")
    assert outcome(found, folder, contents(experiment / "results")) in ("refused", "flagged", "agrees")
