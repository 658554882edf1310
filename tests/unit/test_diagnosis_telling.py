"""What a finding says of itself: sizes that are known, rivals by name and joint."""

from __future__ import annotations

import pytest
from searches import LEVER, Din, Lab, design

from pumaid.diagnosis.diagnose import rival_name, sizes
from pumaid.diagnosis.stepwise import Stepwise
from pumaid.simulation import Hidden


def found(hidden: Hidden):
    """What one search adds first."""
    lab = Lab.of(LEVER, design(LEVER, postures=3), hidden)
    search = Stepwise(lab.model, lab.noisy(2, Din(spread=0.004, level=0.002)))
    search.run()
    return search.accepted[0]


def test_of_gear_losses_the_weight_leaves_only_the_sum():
    """The weight takes half the difference of the losses and is fitted a tenth too large: of it they are 0.4 / 1.1.

    The drawn motor counts its current against the motion, so friction is negative.
    """
    (only,) = sizes(found(Hidden("load_friction", 1, {"drive": 0.3, "back": 0.1})))
    assert only.name == "drive + back" and only.unit == "1"
    assert only.value == pytest.approx(-0.4 / 1.1, abs=3.0 * only.std_error) and only.std_error < 0.02


def test_a_ripples_two_sizes_are_told_apart():
    """Cosine and sine."""
    told = sizes(found(Hidden("ripple", 1, {"cos": 0.02, "sin": -0.01, "frequency": 23.0})))
    assert [one.name for one in told] == ["cos", "sin"]


def test_a_rival_elsewhere_is_told_with_its_joint():
    """And without it where it is at the same joint, or the whole arm's."""
    names = [rival_name(key, 3) for key in (("spring", 3), ("spring", 2), ("tilt", None))]
    assert names == ["spring", "spring@2", "tilt"]
