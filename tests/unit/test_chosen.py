"""A model's effects are what they were when it was made, or the model is refused."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest
from worlds import PENDULUM, dataset, drawn, experiment

from pumaid.effect_spec import check_parameters
from pumaid.errors import ModelError
from pumaid.estimate import Estimate
from pumaid.estimation.estimate import identify
from pumaid.robot import EffectChoice

#: Twice the same effect at one joint, one of the whole arm, one with shapes that are fitted.
SEVERAL = (
    EffectChoice("ripple", 2, {"frequency": 11.0}),
    EffectChoice("ripple", 2, {"frequency": 23.0}),
    EffectChoice("tilt"),
    EffectChoice("stribeck", 1),
)


@cache
def made() -> Estimate:
    """A model that holds them."""
    runs = dataset(drawn(PENDULUM, 5), experiment(PENDULUM, speeds=(0.1, 0.3, 0.6, 1.0)))
    return identify(runs, PENDULUM, effects=SEVERAL)


def test_effects_as_they_are_pass():
    """Neither marks of a second time, nor the whole arm's names, nor fitted shapes are taken for a change."""
    assert {"ripple.j2.cos", "ripple.j2.cos_2", "tilt.x", "stribeck.j1.a"} <= set(made().names)
    check_parameters(made(), PENDULUM)


@pytest.mark.parametrize(
    ("old", "new"), [("stribeck.j1.a", "stribeck.j1.b"), ("ripple.j2.cos_2", "ripple.j2.cos_3"), ("tilt.x", "tilt.z")]
)
def test_another_parameter_is_refused(old, new):
    """The model has a number of what the effect does not have, and none of what it has; both are named."""
    names = tuple(new if name == old else name for name in made().names)
    with pytest.raises(ModelError) as told:
        check_parameters(replace(made(), names=names), PENDULUM)
    assert told.value.slug == "effect-changed" and old in told.value.what and new in told.value.what


def test_another_shape_is_refused():
    """A shape that the effect did not have then is named."""
    bare = EffectChoice("stribeck", 1, {"velocity": 0.1})
    with pytest.raises(ModelError, match="exponent"):
        check_parameters(replace(made(), effects=(*made().effects[:3], bare)), PENDULUM)
