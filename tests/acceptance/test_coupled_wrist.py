"""A wrist whose gears couple it, from logs: what the key `coupling` covers and what the effect of that name adds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pumaid
from pumaid.io.recipe import shipped_recipes
from pumaid.simulation import draw, table1

GEARS = (-62.6, 107.8, -53.7, 76.0, 71.9, 76.7)
WRIST = replace(
    table1.robot(),
    joints=tuple(replace(one, gear_ratio=gear) for one, gear in zip(table1.robot().joints, GEARS, strict=True)),
    coupling={(5, 4): 0.0139, (6, 4): 0.013, (6, 5): 0.18},
)


@pytest.fixture(scope="module")
def truth():
    """An arm with hands' weight in its wrist, drawn from a seed."""
    return draw(WRIST, 3)


@pytest.fixture(scope="module")
def dataset(truth):
    """The paper's runs of the wrist, as that arm makes them."""
    plan = table1.experiment()
    plan = replace(plan, motions=tuple(motion for motion in plan.motions if motion.joint >= 4))
    return pumaid.segment(pumaid.simulate(WRIST, plan, truth=truth, seed=1, rate=100.0), WRIST)


def off(truth, dataset, kind, effects=()):
    """How many standard errors the wrist's parameters of this kind are off the truth."""
    found = pumaid.identify(dataset, WRIST, effects=list(effects)).values
    known = truth.parameters()
    told = [value for value in found if value.name in known and value.value is not None and value.std_error]
    return [(value.value - known[value.name]) / value.std_error for value in told if value.name.startswith(kind)]


def test_friction_is_found_whatever_the_gears(truth, dataset):
    """Friction of a motor that its own joint turns is what it is."""
    assert np.max(np.abs(off(truth, dataset, ("coulomb", "viscous")))) < 4.0


def test_loads_that_gears_pass_on_are_the_effects(truth, dataset):
    """Without the effect, gravity takes up what motors carry of joints beyond, many standard errors; with it, not."""
    assert np.max(np.abs(off(truth, dataset, ("gravity", "gain_ratio")))) > 5.0
    passed = [pumaid.EffectChoice("coupling", 6, {"on": 5.0}), pumaid.EffectChoice("coupling", 5, {"on": 4.0})]
    assert np.max(np.abs(off(truth, dataset, ("gravity", "gain_ratio"), passed))) < 3.0


def test_the_effects_size_is_that_of_the_gears(truth, dataset):
    """Motor 5 carries -r65 r6/r5 of joint 6's load, in the currents of both motors."""
    choices = [pumaid.EffectChoice("coupling", 6, {"on": 5.0}), pumaid.EffectChoice("coupling", 5, {"on": 4.0})]
    values = {value.name: value for value in pumaid.identify(dataset, WRIST, effects=choices).values}
    for beyond, on, ratio in ((6, 5, 0.18), (5, 4, 0.0139)):
        share = -ratio * GEARS[on - 1] / GEARS[beyond - 1] * truth.gain[on - 1] / truth.gain[beyond - 1]
        found = values[f"coupling.j{beyond}.c"]
        assert abs(found.value - share) < 3.0 * found.std_error


def told(estimate) -> str:
    """The note on loads that gears pass on."""
    return "".join(note.text for note in estimate.notes if note.slug == "load-through-gears")


def test_loads_that_gears_pass_on_are_told(truth, dataset):
    """The note names each pair and what adds it; what the model has is not named, and nothing without gears."""
    note = told(pumaid.identify(dataset, WRIST))
    assert all(f"--add coupling@{pair}" in note for pair in ("5:on=4", "6:on=4", "6:on=5"))
    assert f"motor 5 carries {-0.18 * GEARS[4] / GEARS[5]:.2g}" in note and "parallel" not in note
    assert "@6:on=5" not in told(
        pumaid.identify(dataset, WRIST, effects=[pumaid.EffectChoice("coupling", 6, {"on": 5.0})])
    )
    assert not told(pumaid.identify(dataset, replace(WRIST, coupling={})))


def test_on_parallel_axes_the_ratio_is_off_as_the_note_says():
    """Gears between two parallel axes: the ratio that is found is the motors' times one less the share."""
    plain = pumaid.read_recipe(shipped_recipes()["ur5e"])
    geared = tuple(
        replace(one, gear_ratio=gear) for one, gear in zip(plain.joints, (80, 100, -90, 70, 70, 60), strict=True)
    )
    robot = replace(plain, joints=geared, coupling={(3, 2): 0.3})
    truth = draw(robot, 11)
    logs = pumaid.simulate(robot, pumaid.plan(robot, minutes=10.0, seed=0), truth=truth, seed=5, rate=100.0)
    estimate = pumaid.identify(pumaid.segment(logs, robot), robot)
    found = next(value for value in estimate.values if value.name == "gain_ratio.2.3")
    factor = 1.0 - 0.3 * 100 / -90
    assert abs(found.value / truth.parameters()["gain_ratio.2.3"] - factor) < 0.02 * factor
    assert "motor 2 carries 0.33 of joint 3's load" in told(estimate) and f"{factor:.3g} times" in told(estimate)
