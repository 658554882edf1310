"""Good experiments that were broken in one place: refused in one message, flagged, or identified as the good one."""

import pytest
from faulty import Fault, contents, invoke, outcome, slugs_of
from faulty_logs import all_logs
from faulty_recipes import all_recipes


def titled(faults: list[Fault]) -> list:
    """Mutations as parameters of a test, named by class and what they are."""
    return [pytest.param(fault, id=f"{fault.kind}: {fault.name}") for fault in faults]


def test_the_good_experiment_is_good(arm):
    """Without a fault nothing is said, and the parameters are those that the logs were made with."""
    found = invoke("identify", str(arm / "logs"), "--json")
    assert slugs_of(found.stderr) == set()
    assert outcome(found, arm, {}) == "agrees"


@pytest.mark.parametrize("fault", titled(all_logs() + all_recipes()))
def test_a_fault_is_never_silent(arm, fault):
    """No traceback; old results whole and one message with a mend, or the good log's numbers, or a warning."""
    before = contents(arm / "results")
    fault.change(arm)
    found = invoke("identify", str(arm / "logs"), "--json")
    assert outcome(found, arm, before) in ("refused", "flagged", "agrees")
