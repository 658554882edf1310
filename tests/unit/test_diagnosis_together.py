"""Effects that most arms have at every joint, tried at all joints as one."""

import numpy as np
import pytest
import table1
from scipy.stats import chi2
from searches import Din, Lab, design

from pumaid.diagnosis.diagnose import DiagnosisBuilder
from pumaid.diagnosis.score_test import surprise_together
from pumaid.diagnosis.stepwise import Stepwise
from pumaid.reporting.diagnosis import place, size_sentence
from pumaid.simulation import Hidden

ROBOT, DIN = table1.robot(), Din(spread=0.01, correlation=0.6, level=0.006)
PLAN = design(ROBOT, postures=2, speeds=(0.3, 0.6, 1.2))
#: Friction per load where the motor lifts, by joint: two fifths of what a search for each joint alone sees.
SHARES = {2: 0.0138, 3: 0.0116, 4: 0.0967, 5: 0.147, 6: 0.494}


def test_a_single_joint_does_not_stand_for_all():
    """Of three joints with two parameters each the one that shows most is left out, whatever it shows."""
    chance = chi2.sf(7.0, 4)
    for largest in (5.0, 500.0):
        told = surprise_together([np.array(2.0), np.array(largest), np.array(5.0)], [2, 2, 2])
        assert told == pytest.approx(-np.log10(chance))


@pytest.mark.parametrize("seed", [51, 52])
def test_what_single_joints_do_not_show_all_show_together(seed):
    """Of load friction at five joints a search tells three or more as one, with a command that adds each once."""
    hidden = [Hidden("load_friction", joint, {"drive": share, "back": 0.0}) for joint, share in SHARES.items()]
    lab = Lab.of(ROBOT, PLAN, *hidden, bins=32)
    runs = lab.noisy(seed, DIN)
    search = Stepwise(lab.model, runs)
    search.run()
    findings = DiagnosisBuilder(search, (), runs).findings()
    (shared,) = (item for item in findings if item.joints)
    assert shared.joint is None and shared.effect == "load_friction" and len(shared.joints) >= 3
    assert {one.joint for item in findings for one in item.each()} <= set(SHARES)
    for one in shared.each():
        assert all(abs(size.value - SHARES[one.joint]) < 4.0 * size.std_error for size in one.sizes)
    assert all(shared.command.count(f"--add load_friction@{joint}") == 1 for joint in shared.joints)
    assert "joints" in place(shared, ROBOT) and f"drive + back@{shared.joints[0]} = " in size_sentence(shared, ROBOT)
