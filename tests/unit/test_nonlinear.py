"""Runs from rest to rest among runs at constant speed: what they have beyond noise leads no fit of an effect astray."""

from functools import cache

import numpy as np
import pytest

from pumaid.dataset import Campaign, Dataset
from pumaid.effect_spec import expanded
from pumaid.effects import catalogue
from pumaid.estimation.estimate import identify
from pumaid.estimation.fit import Fit
from pumaid.estimation.nonlinear import fit_effects, search_bounds
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.model import Model
from pumaid.preprocessing.segment import segment
from pumaid.robot import EffectChoice
from pumaid.simulation import draw, simulate
from pumaid.simulation.hidden_effects import parse
from pumaid.trajectory import Motion, Plan

PENDULUM = read_recipe(shipped_recipes()["pendulum2"])
HOLD, SPEEDS, FAST = (0.4, 0.4), (0.05, 0.1, 0.2, 0.5, 1.0, 1.6), 1.6
#: rad/s at which a third of the hidden friction is left.
VELOCITY = 0.15
FREE = EffectChoice("stribeck", 1, {"exponent": 1.0})


def motions(joint: int) -> list[Motion]:
    """Runs both ways at every speed, and five motions there and back too short to hold theirs."""
    ends = [(min(1.2, 5.0 * speed), speed) for speed in SPEEDS] + [(0.15 + 0.03 * k, FAST) for k in range(5)]
    return [Motion(joint, HOLD, -way * end, way * end, speed) for end, speed in ends for way in (1, -1)]


@cache
def logged(seed: int) -> Dataset:
    """What a robot in closed loop logs of the plan, twice over, its joint 1 with Stribeck friction."""
    truth = draw(PENDULUM, seed).hiding((parse(f"stribeck@1:velocity={VELOCITY},exponent=1", PENDULUM),))
    plan = Plan(PENDULUM.name, tuple(2 * (motions(1) + motions(2))))
    return segment(simulate(truth.robot, plan, truth=truth, seed=seed, rate=100.0), PENDULUM)


def fitted(seed: int, kinds: tuple[str, ...]) -> Fit:
    """The fit of runs of some kinds, its friction with the hidden velocity."""
    runs = [run for run in logged(seed).runs if run.kind in kinds]
    wanted = expanded([EffectChoice("stribeck", 1, {"exponent": 1.0, "velocity": VELOCITY})], PENDULUM)
    return fit_effects(Model.of_runs(PENDULUM, runs), runs, wanted, campaign=Campaign.of(runs)).fit


def test_the_hidden_velocity_is_within_its_interval():
    """The Stribeck velocity of a robot in closed loop is found although strokes are among its runs."""
    found = [identify(logged(seed), PENDULUM, effects=[FREE]).value("stribeck.j1.velocity").ci95 for seed in range(2)]
    assert np.median([high / low for low, high in found]) < 2.0
    assert all(low <= VELOCITY <= high for low, high in found)


@pytest.mark.parametrize("seed", range(2))
def test_strokes_do_not_pass_for_noise_of_other_runs(seed):
    """A joint's noise at constant speed is with strokes what it is without them."""
    alone, both = (fitted(seed, kinds) for kinds in (("constant",), ("constant", "stroke")))
    noises = [fit.noises[2].spread[~fit.row(2).bins.accelerates] for fit in (alone, both)]
    # Equations of 24 runs know a variance to some 15 %.
    assert np.mean(noises[1] ** 2) == pytest.approx(np.mean(noises[0] ** 2), rel=0.3)


def test_a_shape_is_not_looked_for_far_beyond_the_runs():
    """A fall of friction is looked for at up to twice the speeds of its grid; beyond, it is a viscous curve."""
    velocity, exponent = catalogue()["stribeck"].shapes(PENDULUM, 1)
    assert search_bounds(velocity, [{"velocity": 0.1}, {"velocity": 1.0}]) == (0.05, 2.0)
    assert search_bounds(exponent, [{"exponent": 1.0}, {"exponent": 2.0}]) == (0.5, 2.0)
