"""Effects as users choose them: read, spread over joints, and refused with the nearest right word."""

from dataclasses import replace
from functools import cache

import pytest
import table1
from worlds import PENDULUM, dataset, drawn, experiment

from pumaid.effect_spec import check_parameters, chosen_by, expanded
from pumaid.errors import ModelError
from pumaid.estimate import Estimate
from pumaid.estimation.estimate import identify
from pumaid.robot import EffectChoice, read_choice

PUMA = table1.puma560().robot


def refusal(*, add=(), robot=PUMA) -> ModelError:
    """What a choice is refused with."""
    with pytest.raises(ModelError) as told:
        chosen_by(robot, add=add)
    return told.value


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("stribeck@3", EffectChoice("stribeck", 3)),
        ("stribeck@elbow", EffectChoice("stribeck", 3)),
        ("stribeck", EffectChoice("stribeck", None)),
        ("stribeck@all", EffectChoice("stribeck", None)),
        ("tilt", EffectChoice("tilt", None)),
        ("stribeck@3:velocity=0.12, exponent=1", EffectChoice("stribeck", 3, {"velocity": 0.12, "exponent": 1.0})),
    ],
)
def test_a_choice_is_read_as_it_is_written(text, wanted):
    assert read_choice(text, PUMA, "--add") == wanted


def test_all_is_every_joint_where_the_effect_can_act():
    """Friction that follows the load is nowhere where no load is: not at the PUMA's upright waist."""
    assert [one.joint for one in chosen_by(PUMA, add=["load_friction"])] == [2, 3, 4, 5, 6]
    assert [one.joint for one in chosen_by(PUMA, add=["tilt"])] == [None]


@pytest.mark.parametrize(
    ("text", "slug", "hint"),
    [
        ("stribek@3", "unknown-effect", "did you mean stribeck?"),
        ("stribeck@elbwo", "effect-joint", "did you mean elbow?"),
        ("stribeck@7", "effect-joint", "number from 1"),
        ("tilt@2", "effect-joint", "leave the joint out"),
        ("stribeck@3:velocit=1", "effect-shape", "did you mean velocity?"),
        ("stribeck@3:velocity=fast", "effect-shape", "velocity=NUMBER"),
        ("stribeck@3:velocity=500", "effect-shape", "from 0.0001 to 20"),
        ("stribeck@3:velocity=nan", "effect-shape", "from 0.0001 to 20"),
        ("spring@3:rate=1", "effect-shape", "has no shape"),
        ("flexibility@1", "effect-joint", "leave it out"),
        ("viscous@3", "effect-twice", "leave it out"),
    ],
)
def test_a_wrong_choice_is_told_with_what_is_right(text, slug, hint):
    """Unknown names get the nearest one, wrong values their bounds, and the option is the place."""
    told = refusal(add=[text])
    assert told.slug == slug and hint in str(told)
    assert f"--add {text.partition('@')[0].partition(':')[0]}" in str(told)


def test_what_is_in_the_model_is_not_added_again():
    """Twice the same friction is refused; two ripples are two, unless they are of one frequency."""
    assert refusal(add=["stribeck@3", "stribeck@3"]).slug == "effect-twice"
    assert refusal(add=["ripple@3:frequency=30", "ripple@3:frequency=30"]).slug == "effect-twice"
    assert len(chosen_by(PUMA, add=["ripple@3:frequency=30", "ripple@3:frequency=60"])) == 2


@pytest.mark.parametrize(
    ("wrong", "slug", "hint"),
    [
        (EffectChoice("striebeck", 2), "unknown-effect", "did you mean stribeck?"),
        (EffectChoice("stribeck", 2, {"velocty": 1.0}), "effect-shape", "did you mean velocity?"),
        (EffectChoice("ripple", None, {"frequency": -3.0}), "effect-shape", "write a number from"),
    ],
)
def test_a_wrong_effect_of_the_recipe_is_told_with_its_place(wrong, slug, hint):
    """The recipe's file, line and entry stand in the message, and the nearest name."""
    robot = replace(PENDULUM, effects=(EffectChoice("spring", 1), wrong), origin="recipe.yaml", effect_lines=(8, 9))
    with pytest.raises(ModelError) as refused:
        expanded(robot.effects, robot)
    assert refused.value.slug == slug and hint in str(refused.value)
    assert (refused.value.where.file, refused.value.where.line, refused.value.where.field) == (
        "recipe.yaml",
        9,
        "effects[2]",
    )


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
def test_what_is_not_as_it_was_is_refused(old, new):
    """A parameter, or a shape, that the effect does not have, or did not have then: each is named."""
    names = tuple(new if name == old else name for name in made().names)
    with pytest.raises(ModelError) as told:
        check_parameters(replace(made(), names=names), PENDULUM)
    assert told.value.slug == "effect-changed" and old in told.value.what and new in told.value.what
    bare = EffectChoice("stribeck", 1, {"velocity": 0.1})
    with pytest.raises(ModelError, match="exponent"):
        check_parameters(replace(made(), effects=(*made().effects[:3], bare)), PENDULUM)
