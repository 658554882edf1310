"""A fleet of virtual arms: which one has another friction, and nothing where all are alike."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import worlds

from pumaid.records import Estimate, Evidence
from pumaid.reporting.fleet import differences_grid, robots_grid
from pumaid.simulation import Bench
from pumaid.verbs.fleet import fleet
from pumaid.verbs.identify import identify

#: Not used in development.
SEEDS = range(7700, 7705)


@cache
def model(seed: int, *, stiffer: float = 0.0) -> Estimate:
    """One arm of the kind, its Coulomb friction at joint 2 raised by `stiffer` (A)."""
    truth = worlds.drawn(worlds.PENDULUM)
    sign = np.sign(truth.friction.coulomb_plus[1])
    plus = truth.friction.coulomb_plus + np.array([0.0, stiffer * sign])
    truth = replace(truth, friction=replace(truth.friction, coulomb_plus=plus))
    runs = Bench(truth, worlds.experiment(worlds.PENDULUM, postures=3, speeds=(0.2, 0.4, 0.8), repeats=2), rate=50.0)
    return identify(Evidence(runs.runs(np.random.default_rng(seed))), worlds.PENDULUM)


def test_the_stiff_one_stands_out_and_by_how_much():
    """Of five arms one has 0.1 A more friction one way: that parameter differs, in that arm, by 0.1 A to 3 errors."""
    robots = {f"arm_{seed}": model(seed, stiffer=0.1 if seed == SEEDS[3] else 0.0) for seed in SEEDS}
    found = fleet(robots)
    (one,) = [shared for shared in found.shared if shared.differs]
    (member,) = [member for member in one.members if member.stands_out]
    assert (one.name, member.robot) == ("coulomb.j2.plus", f"arm_{SEEDS[3]}")
    assert abs(member.off) == pytest.approx(0.1, abs=3.0 * np.hypot(member.std_error, one.std_error))
    assert len(differences_grid(found).rows) == 1
    assert [row[-1].text for row in robots_grid(found).rows] == ["-", "-", "-", "1", "-"]


def test_equal_arms_are_told_equal():
    """Five arms that differ in their noise only: no parameter differs and none stands out."""
    found = fleet({str(seed): model(seed) for seed in SEEDS})
    assert not [one.name for one in found.shared if one.differs or any(member.stands_out for member in one.members)]


def test_one_robot_is_no_fleet():
    """There is nothing to compare."""
    with pytest.raises(ValueError, match="two robots"):
        fleet({"alone": model(SEEDS[0])})
