"""Effects beyond the paper's model, hidden in a virtual arm of other code, are found again with all the rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from worlds import CRANE, PENDULUM, course, drawn, experiment, run_of

from pumaid.dataset import Campaign, Dataset
from pumaid.diagnosis.compare import compare
from pumaid.effect_spec import terms_of
from pumaid.errors import Where
from pumaid.estimation.estimate import identify
from pumaid.model import Model
from pumaid.robot import EffectChoice
from pumaid.simulation import Bench
from pumaid.simulation.hidden_effects import parse
from pumaid.trajectory import Plan

JOINT = 2
SPEEDS = (0.05, 0.1, 0.2, 0.4, 0.7, 1.0)


def hiding(text, *, robot=PENDULUM, noise=1.0, speeds=SPEEDS, seed=1) -> tuple[dict[str, float], Dataset]:
    """True values of a hidden effect, and what the logs of an arm with it leave; its noise scaled by `noise`.

    The motions come in random order, so that time does not go with speed or posture.
    """
    truth = drawn(robot).hiding((parse(text, robot),))
    truth = replace(truth, noise=replace(truth.noise, std=noise * truth.noise.std))
    plan = experiment(robot, postures=4, speeds=speeds, repeats=2)
    order = np.random.default_rng(0).permutation(len(plan.motions))
    plan = Plan(plan.robot, tuple(plan.motions[k] for k in order))
    runs = Bench(truth, plan, rate=50.0, bins=120).runs(np.random.default_rng(seed))
    return dict(truth.hidden[0].values), Dataset(runs)


def found(estimate, effect) -> dict[str, float]:
    """Values of an effect's parameters and shapes by their last word."""
    own = [value for value in estimate.values if value.name.startswith(f"{effect}.")]
    return {value.name.rsplit(".", 1)[1]: value.value for value in own}


#: Effect -> share to which its values are found without noise: to the width of bins, and to loads that are fitted too.
#: Of presliding the bench leaves out the ramps, in which it begins.
EXACT = {
    "spring": 1e-4,
    "position_friction": 1e-3,
    "ripple": 1e-3,
    "stribeck": 1e-2,
    "viscous_power": 1e-2,
    "warmup": 2e-3,
    "torque_droop": 2e-3,
    "torque_constant_drift": 2e-3,
    "saturation": 1e-3,
    "delay": 1e-2,
    # It lives where the speed still settles, which is left out: only its tail is seen.
    "presliding": 0.15,
}


@pytest.mark.parametrize("effect", EXACT)
def test_a_hidden_effect_is_found_again(effect):
    """With next to no noise the law's own numbers come back, nonlinear ones too, and nothing is left of the misfit."""
    truth, dataset = hiding(f"{effect}@{JOINT}", noise=1e-3)
    before = identify(dataset, PENDULUM)
    after = identify(dataset, PENDULUM, effects=[EffectChoice(effect, JOINT)])
    values = found(after, effect)
    for name, value in truth.items():
        assert values[name] == pytest.approx(value, rel=EXACT[effect], abs=EXACT[effect] * 0.1), name
    assert after.joint(JOINT).rmse < 0.125 * before.joint(JOINT).rmse or effect == "presliding"


def test_an_instant_lies_between_two_runs():
    """Of the time at which friction changed the interval holds the truth, as fine as the runs are."""
    truth, dataset = hiding(f"friction_step@{JOINT}")
    estimate = identify(dataset, PENDULUM, effects=[EffectChoice("friction_step", JOINT)])
    begun = Campaign.of(dataset.runs).begun[JOINT, 0]
    low, high = estimate.value("friction_step.j2.time").ci95
    assert low - 1.0 <= truth["time"] - begun + 1.0 and truth["time"] - begun <= high + 1.0
    starts = sorted(run.start - begun for run in dataset.runs if run.joint == JOINT)
    assert sum(low < start < high for start in starts) <= 1
    assert found(estimate, "friction_step")["a"] == pytest.approx(truth["a"], rel=0.1)


def test_given_shapes_are_kept():
    """What the user gives is not fitted: it stands in the model as given, with no interval."""
    _, dataset = hiding(f"stribeck@{JOINT}")
    choice = EffectChoice("stribeck", JOINT, {"velocity": 0.25, "exponent": 1.0})
    estimate = identify(dataset, PENDULUM, effects=[choice])
    value = estimate.value("stribeck.j2.velocity")
    assert (value.value, value.state, value.std_error) == (0.25, "given", None)
    assert estimate.effects == (choice,) and "stribeck.j2.velocity" not in estimate.names


def test_fitted_shapes_widen_the_other_intervals():
    """Stribeck friction of unknown speed is less well known than at a given one, and so is the Coulomb friction."""
    _, dataset = hiding(f"stribeck@{JOINT}")
    given = EffectChoice("stribeck", JOINT, {"velocity": 0.3, "exponent": 1.0})
    errors = []
    for choice in (given, EffectChoice("stribeck", JOINT, {"exponent": 1.0})):
        estimate = identify(dataset, PENDULUM, effects=[choice])
        errors.append([estimate.value(name).std_error for name in ("stribeck.j2.a", "coulomb.j2.plus")])
    assert all(free > 1.2 * held for held, free in zip(*errors, strict=True))


def test_a_shape_that_the_data_do_not_show_is_told_so():
    """Six speeds and this noise do not tell how sudden the fall of friction is: no number, and the run that would."""
    _, dataset = hiding(f"stribeck@{JOINT}")
    value = identify(dataset, PENDULUM, effects=[EffectChoice("stribeck", JOINT)]).value("stribeck.j2.exponent")
    assert (value.value, value.state) == (None, "not_identifiable")
    assert "any value" in value.reason and "speeds" in value.next_run


def test_an_effect_that_is_not_there_leaves_the_rest_its_word():
    """Friction and gravity keep their values when Stribeck friction is added to an arm without; it is about zero."""
    truth, plan = drawn(PENDULUM), experiment(PENDULUM, postures=4, speeds=SPEEDS)
    dataset = Dataset(Bench(truth, plan, rate=50.0).runs(np.random.default_rng(5)))
    plain = identify(dataset, PENDULUM)
    added = identify(dataset, PENDULUM, effects=[EffectChoice("stribeck", 2, {"velocity": 0.1, "exponent": 1.0})])
    low, high = added.value("stribeck.j2.a").ci95
    assert low < 0.0 < high
    for name in plain.names:
        before, after = plain.value(name), added.value(name)
        assert abs(after.value - before.value) < 3.0 * after.std_error


def test_what_passes_for_gravity_is_not_identifiable():
    """Friction that follows the load in equal measure both ways is told from gravity; what differs is told of neither.

    The sum is given with its error; gravity's size, with which half the difference passes, has no number, as it has no
    right one: before, none of twelve intervals held the truth.
    """
    truth, dataset = hiding(f"load_friction@{JOINT}")
    estimate = identify(dataset, PENDULUM, effects=[EffectChoice("load_friction", JOINT)])
    for name in ("load_friction.j2.drive", "load_friction.j2.back", "gravity.l2.x", "gravity.l2.y"):
        assert estimate.value(name).state == "not_identifiable"
    assert "load_friction.j2.drive" in estimate.value("gravity.l2.x").reason
    assert "gravity.l2.x" in estimate.value("load_friction.j2.drive").reason
    (told,) = [one for one in estimate.combinations if "load_friction.j2.drive" in one.terms]
    # Half the difference passes for gravity, which makes the load larger by as much.
    mean, off = 0.5 * (truth["drive"] + truth["back"]), 0.5 * (truth["drive"] - truth["back"])
    assert told.value == pytest.approx(mean / (1.0 + off), abs=4.0 * told.std_error)


def test_two_effects_at_two_joints_are_found_together():
    """A ripple at the hip and a warming knee, each with its own numbers."""
    robot = PENDULUM
    truth = drawn(robot).hiding((parse("ripple@1", robot), parse("warmup@2", robot)))
    plan = experiment(robot, postures=4, speeds=(0.2, 0.5, 1.0), repeats=2)
    order = np.random.default_rng(0).permutation(len(plan.motions))
    plan = Plan(plan.robot, tuple(plan.motions[k] for k in order))
    dataset = Dataset(Bench(truth, plan, rate=50.0, bins=200).runs(np.random.default_rng(2)))
    estimate = identify(dataset, robot, effects=[EffectChoice("ripple", 1), EffectChoice("warmup", 2)])
    frequency, time = estimate.value("ripple.j1.frequency"), estimate.value("warmup.j2.time_constant")
    # Four standard errors, and what the width of bins shifts it by: some ten-thousandths.
    near = 4 * frequency.std_error + 3e-4 * frequency.value
    assert frequency.value == pytest.approx(truth.hidden[0].values["frequency"], abs=near)
    assert time.value == pytest.approx(truth.hidden[1].values["time_constant"], abs=4 * time.std_error)
    assert frequency.std_error < 0.02 and time.std_error < 0.3 * time.value


def test_compare_says_what_identify_said():
    """An estimate is all that is needed to predict with its effects: errors agree joint by joint.

    To a thousandth where an effect is made from loads: those of the estimate are one step further than the fit's.
    """
    _, dataset = hiding("torque_droop@1")
    choices = [EffectChoice("torque_droop", 1), EffectChoice("ripple", 2, {"frequency": 12.0})]
    estimate = identify(dataset, PENDULUM, effects=choices)
    comparison = compare(estimate, dataset, PENDULUM)
    assert Model.of_estimate(PENDULUM, estimate).names == estimate.names
    for joint in (1, 2):
        assert comparison.joints[joint - 1].rmse == pytest.approx(estimate.joint(joint).rmse, rel=1e-3)
    score = comparison.of_joint(1)[0]
    assert np.sqrt(np.mean(score.residual**2)) == pytest.approx(estimate.joint(1).rmse, rel=0.7)


def test_held_out_runs_are_judged_and_not_fitted():
    """Their error is told for each joint and for all, and is what compare says."""
    _, dataset = hiding("spring@1")
    marked = tuple(replace(run, heldout=number % 5 == 0) for number, run in enumerate(dataset.runs))
    held = Dataset(marked)
    estimate = identify(held, PENDULUM, effects=[EffectChoice("spring", 1)])
    comparison = compare(estimate, held, PENDULUM)
    assert estimate.heldout == pytest.approx(comparison.heldout, rel=1e-9)
    for joint in (1, 2):
        ours, theirs = estimate.joint(joint), comparison.joints[joint - 1]
        assert ours.heldout_runs == theirs.heldout_runs > 0
        assert ours.heldout == pytest.approx(theirs.heldout, rel=1e-9)
    without = identify(held, PENDULUM)
    assert estimate.joint(1).heldout < 0.5 * without.joint(1).heldout


def test_inertia_of_strokes_is_not_added_twice():
    """Runs from rest to rest bring their inertia with them; adding it changes nothing."""
    runs = []
    for sign in (1, -1, 1, -1):
        moves = course("stroke", -1.0 * sign, 1.2 * sign, duration=2.0 + 0.3 * sign)
        current = np.cos(moves[1]) + 0.3 * sign + 0.05 * moves[3]
        runs.append(run_of(CRANE, 1, (0.0, 0.1, 0.2), course=moves, current=current))
    estimate = identify(Dataset(tuple(runs)), CRANE, effects=[EffectChoice("inertia", 1)])
    assert estimate.effects == () and estimate.names.count("inertia.j1.J") == 1


def test_effects_of_time_over_several_clocks_are_told():
    """Each recording starts its own time, and the user hears of it."""
    _, dataset = hiding(f"warmup@{JOINT}", speeds=(0.2, 0.5, 1.0))
    half = len(dataset.runs) // 2
    runs = tuple(replace(run, clock=int(number >= half)) for number, run in enumerate(dataset.runs))
    choice = EffectChoice("warmup", JOINT, {"time_constant": 600.0})
    notes = {note.slug: note for note in identify(Dataset(runs), PENDULUM, effects=[choice]).notes}
    assert notes["several-clocks"].where == Where()
    assert "2 clocks" in notes["several-clocks"].text


def test_recipe_effects_are_in_unless_others_are_asked_for():
    """Without word on effects the recipe's are fitted; an empty choice is the paper's model."""
    _, dataset = hiding("spring@2")
    robot = replace(PENDULUM, effects=(EffectChoice("spring"),))
    assert [one.joint for one in identify(dataset, robot).effects] == [1, 2]
    assert identify(dataset, robot, effects=()).effects == ()


def test_a_chosen_effect_knows_its_joints():
    """A joint's own touches only it; a whole arm's touches all."""
    assert [terms_of([EffectChoice("spring", 2)])[0].touches(joint) for joint in (1, 2, 3)] == [False, True, False]
    assert all(terms_of([EffectChoice("tilt")])[0].touches(joint) for joint in (1, 2, 3))
