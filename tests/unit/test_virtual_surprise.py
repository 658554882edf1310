"""A hidden effect by chance: the same by seed, and one that shows."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from pumaid.design.plan import plan
from pumaid.errors import ModelError
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.simulation import Bench, draw, table1
from pumaid.simulation.hidden import LAWS
from pumaid.simulation.surprise import surprise
from pumaid.trajectory import Plan

ROBOT = read_recipe(shipped_recipes()["puma560"])


@cache
def planned() -> Plan:
    """A plan of some size."""
    return plan(ROBOT, minutes=12, seed=1)


def test_seed_decides():
    """The same seed hides the same; twelve seeds hide at least six kinds."""
    found = [surprise(draw(ROBOT, seed), planned(), seed) for seed in range(12)]
    assert found[3] == surprise(draw(ROBOT, 3), planned(), 3)
    assert len({one.effect for one in found}) >= 6


@pytest.mark.parametrize("seed", range(6))
def test_it_shows_and_does_not_rule(seed):
    """What friction and a free sinusoid a posture cannot take up is felt above the noise and stays below an ampere."""
    truth = draw(ROBOT, seed)
    hidden = replace(truth, hidden=(surprise(truth, planned(), seed),))
    quiet = [Bench(one.with_noise(0.0), planned(), rate=20.0).runs(np.random.default_rng(0)) for one in (truth, hidden)]
    sizes = np.zeros(7)
    for plain, other in zip(*quiet, strict=True):
        j = plain.joint - 1
        change = other.bins.current - plain.bins.current
        sizes[plain.joint] = max(sizes[plain.joint], float(np.sqrt(np.mean(change**2))) / truth.noise.std[j])
    # At least half the noise is left by definition; the whole effect is larger, and never a multiple of the motor.
    assert 0.5 < np.max(sizes) < 60.0


def test_a_kind_can_be_asked_for():
    """The kind is the user's where named; times fall inside the session."""
    one = surprise(draw(ROBOT, 1), planned(), 1, effect="friction_step")
    assert one.effect == "friction_step"
    assert 0.2 * planned().duration < one["time"] < 0.7 * planned().duration


@pytest.mark.parametrize("effect", ["inertia", "stribek"])
def test_what_would_not_show_is_refused(effect):
    """Runs at constant speed show no inertia; a wrong name is told."""
    with pytest.raises(ModelError) as caught:
        surprise(draw(ROBOT, 1), planned(), 1, effect=effect)
    assert caught.value.slug == "hide-wrong"


def test_robots_without_masses_get_what_needs_none():
    """The paper's robot, known by constants alone, hides something too, never what needs masses."""
    truth = table1.puma560()
    kinds = {surprise(truth, table1.experiment(), seed).effect for seed in range(10)}
    assert kinds
    assert not any(LAWS[kind].needs_masses for kind in kinds)
