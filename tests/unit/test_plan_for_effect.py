"""Runs that are planned for an effect: do they show it by what they promise, and is what cannot be shown refused?"""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from menus import arm

from pumaid.design.plan import plan
from pumaid.design.prior import prior_robots
from pumaid.diagnosis.discrimination import plan_for_effect, rehearsed, solved_on, usual
from pumaid.diagnosis.score_test import score_at
from pumaid.effect_spec import EffectTerm
from pumaid.effects import catalogue
from pumaid.errors import ModelError
from pumaid.estimation.fit import Projector
from pumaid.robot import EffectChoice, Joint, Robot
from pumaid.simulation import Hidden, draw
from pumaid.trajectory import Plan

#: Its upright first joint feels a tilt of the base.
TURRET = Robot(
    "turret",
    (
        Joint(1, "turn", "revolute"),
        Joint(2, "nod", "revolute", alpha=np.pi / 2),
        Joint(3, "bend", "revolute", a=0.3),
        Joint(4, "tip", "revolute", a=0.25),
    ),
)
ARMS = {"pendulum": arm("pendulum2"), "turret": TURRET}
#: Effects and sizes of the first parameter (SI) that are near the noise of a short experiment, so that both the
#: experiment alone and with the added runs have noise, and not the effect, in what is left.
CASES = [
    ("pendulum", "stribeck", 2, 0.03),
    ("pendulum", "spring", 1, 0.005),
    ("pendulum", "position_friction", 1, 0.006),
    ("turret", "tilt", None, 0.004),
]
#: Ratio of gains of the turret's joints.
WAIST = float(prior_robots(TURRET, seed=3).robots[0].constants.ratio[0])
#: Robots on which a promise is kept; none was looked at while the planner was made.
SEEDS = range(6200, 6206)


@cache
def ground(name: str) -> Plan:
    """A short experiment."""
    return plan(ARMS[name], minutes=1.5 * ARMS[name].n_joints, seed=1)


def sized(name: str, effect: str, joint: int | None, size: float) -> Hidden:
    """An effect whose first parameter is `size`, the rest as usual."""
    return usual(prior_robots(ARMS[name], seed=3).robots[0], EffectChoice(effect, joint), size)


def statistic(name: str, hidden: Hidden, made: Plan, seed: int) -> float:
    """By how much the true effect lowers the square, in units of the noise's, where a robot hides it."""
    robot, law = ARMS[name], catalogue()[hidden.effect]
    usual_one = prior_robots(robot, seed=3).robots[0]
    # How strongly an upright joint feels a tilt is its ratio of gains: the promise is for this robot's.
    drawn = usual_one if hidden.effect == "tilt" else draw(robot, seed)
    truth = replace(drawn, hidden=(hidden,), noise=usual_one.noise)
    system = solved_on(robot, rehearsed(truth, made, seed=seed).runs)
    shapes = [one.name for one in law.shapes(robot, hidden.joint or 0)]
    shape = {shape: WAIST if shape == "waist" else hidden.values[shape] for shape in shapes}
    return score_at(Projector(system), EffectTerm(law, hidden.joint, shape)).statistic / system.scale


def promised(found: Plan) -> float:
    """Standard deviations that the added runs together promise: those of a set times the root of how many."""
    text = found.assumptions[-1]
    often = re.search(r"made (\d+) times", text)
    return float(re.search(r"would show by ([\d.]+) standard", text)[1]) * np.sqrt(int(often[1]) if often else 1)


@pytest.mark.parametrize(("name", "effect", "joint", "size"), CASES)
def test_added_runs_show_what_they_promise(name, effect, joint, size):
    """They follow the experiment, and raise the separation over some experiments by half to twice of their promise."""
    hidden, seeds = sized(name, effect, joint, size), SEEDS[: 12 // ARMS[name].n_joints]
    wanted = EffectChoice(effect, joint, {"waist": WAIST} if effect == "tilt" else {})
    found = plan_for_effect(ARMS[name], wanted, whole=lambda: ground(name), seed=3, size=size)
    base = ground(name)
    assert found.motions[: len(base.motions)] == base.motions and found.duration > base.duration
    assert {motion.joint for motion in found.motions[len(base.motions) :]} == {joint or 1}
    assert found.postures[-1].why.startswith(f"shows {effect}")
    each = np.array([[statistic(name, hidden, made, seed) for made in (base, found)] for seed in seeds])
    raised = np.sqrt(max(np.mean(each[:, 1] - each[:, 0]), 0.0))
    # Of several parameters the promise is for the least visible; all together show more.
    alone = len(catalogue()[effect].parameters(ARMS[name], joint or 0)) == 1
    assert 0.5 < raised / promised(found) < (2.0 if alone else np.inf)


@pytest.mark.parametrize(("first", "second"), [("stribeck", "viscous_power"), ("spring", "position_friction")])
def test_rivals_are_told_apart_by_new_runs(first, second):
    """The rival takes the joint of what it rivals, and the runs promise a separation of either from the other."""
    wanted = EffectChoice(first, 1)
    found = plan_for_effect(
        ARMS["pendulum"], wanted, against=EffectChoice(second, None), whole=lambda: ground("pendulum"), seed=3
    )
    assert f"tells {first}@1 from {second}@1" in found.assumptions[-1]
    apart = [float(one) for one in re.findall(r"by ([\d.]+) (?:standard|if)", found.assumptions[-1])]
    assert min(apart) > 1.0


@pytest.mark.parametrize(("effect", "joint"), [("inertia", 1), ("payload", None), ("friction_step", 2), ("tilt", None)])
def test_what_no_run_shows_is_said(effect, joint):
    """Inertia, what begins at an instant, and a tilt that both level axes absorb: refused with what might help."""
    with pytest.raises(ModelError) as caught:
        plan_for_effect(ARMS["pendulum"], EffectChoice(effect, joint), whole=lambda: ground("pendulum"), seed=3)
    assert caught.value.slug == "plan-undecided"
    assert effect in caught.value.what and caught.value.mend


@pytest.mark.parametrize(
    ("wanted", "rival", "slug", "words"),
    [
        (EffectChoice("load_friction", 1), None, "effect-joint", "direction of gravity"),
        (EffectChoice("stribek", 1), None, "unknown-effect", "did you mean stribeck?"),
        (EffectChoice("stribeck", None), None, "effect-joint", "--for stribeck"),
        (EffectChoice("stribeck", 3), None, "effect-joint", "no joint 3"),
        (EffectChoice("tilt", 1), None, "effect-joint", "whole arm"),
        (EffectChoice("tilt", None), EffectChoice("spring", None), "effect-joint", "--against spring"),
        (EffectChoice("spring", 1), EffectChoice("sprung", 1), "unknown-effect", "did you mean spring?"),
        (EffectChoice("spring", 1), EffectChoice("spring", 1), "plan-undecided", "from spring@1"),
    ],
)
def test_wrong_effects_are_refused(wanted, rival, slug, words):
    """An effect of weight at an upright joint, misspelt names, missing or absent joints, a rival that is itself."""
    robot = TURRET if wanted.effect == "load_friction" else ARMS["pendulum"]
    with pytest.raises(ModelError) as caught:
        plan_for_effect(robot, wanted, against=rival, whole=lambda: ground("pendulum"), seed=3)
    assert caught.value.slug == slug
    assert words in str(caught.value)
