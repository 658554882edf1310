"""Any motion: the fit takes the full rigid body of an arm, gains unknown, from logs of arms at work."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from free_motion import RATE, TICKS, loaded, picks, reach, recorded, waves

from pumaid.dataset import Log
from pumaid.diagnosis.compare import compare
from pumaid.diagnosis.diagnose import diagnose
from pumaid.errors import PumaidError
from pumaid.estimate import Estimate
from pumaid.estimation.estimate import identify
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.preprocessing.segment import segment
from pumaid.robot import EffectChoice
from pumaid.simulation import Hidden, Truth, draw, gravity_load


@cache
def worked(name: str, way: str, seed: int) -> tuple[Truth, Log]:
    """A drawn arm in closed loop of an independent engine, and the log of a minute of waves or picks."""
    robot = read_recipe(shipped_recipes()[name])
    truth, rng = draw(robot, seed), np.random.default_rng(seed)
    return truth, recorded(truth, {"waves": waves, "picks": picks}[way](rng, 60.0, reach(robot)), rng, counts=2e4)


@cache
def model(name: str, way: str, seed: int) -> Estimate:
    """The model of this log alone, all of whose motion is of several joints."""
    truth, log = worked(name, way, seed)
    dataset = segment([log], truth.robot)
    assert {run.kind for run in dataset.runs} == {"block"}
    return identify(dataset, truth.robot)


def test_intervals_hold_the_truth_of_arms_at_work():
    """95 % intervals of friction, gravity and ratios hold, errors are of the noise."""
    holds, scores = [], []
    for name, way in (("puma560", "waves"), ("ur5e", "picks"), ("stanford", "waves")):
        truth, estimate = worked(name, way, 31)[0], model(name, way, 31)
        exact = truth.parameters()
        for value in estimate.values:
            if value.name in exact and value.std_error is not None:
                holds.append(value.ci95[0] <= exact[value.name] <= value.ci95[1])
                scores.append((value.value - exact[value.name]) / value.std_error)
        for fit, noise in zip(estimate.joints, truth.noise.sample_std, strict=True):
            assert 0.6 * noise < fit.rmse < 2.0 * noise
    # Some 85 intervals, of which 95 % hold: fewer than 86 % are a chance of one in a thousand.
    assert len(holds) >= 75 and np.mean(holds) >= 0.86
    assert np.std(scores) < 1.5


def test_unseen_work_is_predicted_to_the_noise():
    """A model of a minute of waves predicts picks of the same arm."""
    (truth, log), estimate = worked("puma560", "picks", 31), model("puma560", "waves", 31)
    comparison = compare(estimate, segment([log], truth.robot), truth.robot)
    for score, fit in zip(comparison.joints, estimate.joints, strict=True):
        assert score.rmse < 1.5 * fit.rmse and not score.undetermined
    # The waist turns about gravity: what its parameters of weight draw is inertia.
    assert abs(comparison.joints[0].shares.get("gravity", 0.0)) < 1e-6 < 0.3 < comparison.joints[0].shares["inertia"]


@pytest.mark.parametrize("name", ["puma560", "stanford"])
def test_nothing_is_missing_where_waves_repeat(name):
    """What a controller's jerks leave repeats with waves of 10 s: six times, it passed for ripples before."""
    (truth, log), estimate = worked(name, "waves", 31), model(name, "waves", 31)
    diagnosis = diagnose(estimate, segment([log], truth.robot), truth.robot)
    assert diagnosis.findings == () and {joint.verdict for joint in diagnosis.joints} == {"adequate"}


def test_stribeck_friction_is_named_where_waves_repeat():
    """It shows in a few slow parts of the motion, which are too few to be tested beside thousands of waves."""
    robot = read_recipe(shipped_recipes()["panda"])
    truth = draw(robot, 7711).hiding([Hidden("stribeck", 2, {"a": 0.12, "velocity": 0.15, "exponent": 1.0})])
    rng = np.random.default_rng(7712)
    dataset = segment([recorded(truth, waves(rng, 70.0, reach(robot)), rng, counts=2e4)], robot)
    findings = diagnose(identify(dataset, robot), dataset, robot).findings
    assert [(finding.effect, finding.joint) for finding in findings] == [("stribeck", 2)]


def test_a_law_of_the_load_is_named_where_no_motion_tells_the_rotor():
    """Of an inner joint's inertia its gear bears the link's, not the rotor's: a law of position may fit as well."""
    robot = read_recipe(shipped_recipes()["puma560"])
    truth = loaded(draw(robot, 6000), 1.5).hiding([Hidden("load_friction", 2, {"drive": 0.0244, "back": 0.0162})])
    wanted = waves(np.random.default_rng(6000), 60.0, reach(robot))
    dataset = segment([recorded(truth, wanted, np.random.default_rng(6000), counts=2e4)], robot)
    (finding,) = diagnose(identify(dataset, robot), dataset, robot).findings
    assert finding.joint == 2 and "load_friction" in (finding.effect, *finding.rivals)


@pytest.mark.parametrize(("name", "way"), [("ur5e", "picks"), ("puma560", "waves")])
def test_a_payload_taken_up_at_work_is_named_with_its_place(name, way):
    """Nothing else is; mass times gain to a twentieth, place to 10 mm, the instant to a pause between two moves."""
    rng, robot = np.random.default_rng(41), read_recipe(shipped_recipes()[name])
    body = {"mass": 1.7, "x": 0.04, "y": -0.03, "z": 0.12, "time": 33.0}
    truth = draw(robot, 41).hiding([Hidden("payload", None, body)])
    wanted = {"waves": waves, "picks": picks}[way](rng, 60.0, reach(robot))
    dataset = segment([recorded(truth, wanted, rng, counts=2e4)], robot)
    (finding,) = diagnose(identify(dataset, robot), dataset, robot).findings
    assert finding.effect == "payload" and finding.shape["time"] == pytest.approx(33.0, abs=0.7)
    estimate = identify(dataset, robot, effects=[EffectChoice("payload", None, finding.shape)])
    values = {value.name: value.value for value in estimate.values}
    mass, *moments = (values[f"payload.{part}"] for part in ("mass", "x", "y", "z"))
    assert mass == pytest.approx(1.7 * truth.gain[-1], rel=0.05)
    assert np.array(moments) / mass == pytest.approx([body[axis] for axis in "xyz"], abs=0.01)
    for fit, noise in zip(estimate.joints, truth.noise.sample_std, strict=True):
        assert fit.rmse < 2.5 * noise  # with the jolt of the moment itself


def test_a_payload_of_one_recording_is_named_at_its_start():
    """Recordings with clocks of their own follow one another: what the second alone carries came when it began."""
    robot = read_recipe(shipped_recipes()["ur5e"])
    truth, logs = draw(robot, 42), []
    for file, arm in enumerate((truth, loaded(truth, 1.5))):
        rng = np.random.default_rng([42, file])
        log = recorded(arm, picks(rng, 40.0, reach(robot)), rng, counts=2e4)
        logs.append(replace(log, origin=f"{file}.csv", starts_clock=True))
    dataset = segment(logs, robot)
    (finding,) = diagnose(identify(dataset, robot), dataset, robot).findings
    assert finding.effect == "payload" and finding.shape["time"] == pytest.approx(40.0, abs=1.0)


def test_another_setup_is_told_beside_a_spring():
    """The spring of joint 1, which turning joint 2 or the arm leaves as it is, does not speak against that."""
    truth = draw(read_recipe(shipped_recipes()["puma560"]), 43).hiding([Hidden("spring", 1, {"a": 1.0})])
    wanted, signs = picks(np.random.default_rng(43), 60.0, reach(truth.robot)), [1.0, -1.0, 1.0, 1.0, 1.0, 1.0]
    log = recorded(truth, wanted, np.random.default_rng(44), counts=2e4)
    dataset = segment([replace(log, position=log.position * signs, velocity=None)], truth.robot)
    first = identify(dataset, truth.robot).notes[0]
    assert (first.slug, first.where.joint) == ("position-reversed", 2)
    hanging = replace(truth.robot, gravity=(0.0, 0.0, 9.80665))
    assert identify(segment([replace(log, velocity=None)], hanging), hanging).notes[0].slug == "gravity-wrong"


def test_currents_that_lag_are_named_so_at_the_joints_that_show_it():
    """Currents of 4 ms before: no physics is named in their place, and a joint about gravity shows them, too."""
    truth, log = worked("puma560", "picks", 31)
    dataset = segment([replace(log, current=np.roll(log.current, 1, axis=0))], truth.robot)
    findings = diagnose(identify(dataset, truth.robot), dataset, truth.robot).findings
    assert {finding.effect for finding in findings} == {"delay"} and {finding.joint for finding in findings} >= {1, 3}


def test_no_ripple_of_the_load_where_goals_jerk():
    """Goals come fifty times a second: what their jerks leave grows with the load, and passed for its ripple."""
    robot = read_recipe(shipped_recipes()["ur5e"])
    truth, rng = draw(robot, 94), np.random.default_rng(94)
    smooth, time = picks(rng, 90.0, reach(robot)), np.arange(90_000)
    wanted = np.stack([np.interp(time, time[::20], goals[::20]) for goals in smooth.T], axis=1)
    dataset = segment([recorded(truth, wanted, rng, counts=2e4)], robot)
    assert diagnose(identify(dataset, robot), dataset, robot).findings == ()


def test_a_clock_a_zero_or_motors_that_are_off_are_told():
    """Where inertia, weight and friction contradict each other, a note says so; of the sound log there is none."""
    truth, log = worked("puma560", "picks", 31)
    shifted = log.position.copy()
    shifted[:, 1] += 0.2
    assert model("puma560", "picks", 31).notes == ()
    for spoilt in (replace(log, time=1.3 * log.time), replace(log, position=shifted)):
        notes = identify(segment([spoilt], truth.robot), truth.robot).notes
        assert {note.slug for note in notes} == {"model-misses"}
    unpowered = replace(log, current=np.where(log.time[:, None] < 45.0, log.current, 0.0))
    with pytest.raises(PumaidError, match="is exactly 0 for a while"):
        identify(segment([unpowered], truth.robot), truth.robot)


def test_a_length_that_motion_contradicts_is_told_with_what_fits():
    """The upper arm 3 cm too long in the recipe, beside an independent engine; of the right recipe nothing is said."""
    (truth, log), true = worked("puma560", "waves", 31), 0.4318
    assert "length-wrong" not in {note.slug for note in model("puma560", "waves", 31).notes}
    arm = replace(truth.robot.joint(3), a=true + 0.03)
    wrong = replace(truth.robot, joints=tuple(arm if joint.number == 3 else joint for joint in truth.robot.joints))
    note = next(note for note in identify(segment([log], wrong), wrong).notes if note.slug == "length-wrong")
    fits, error = map(float, re.search(r"recipe: (\S+) ± (\S+) m", note.text).groups())
    assert note.where.joint == 3 and "length a of joint 3" in note.text
    assert abs(fits - true) < max(4.0 * error, 0.005) and error < 0.008


def test_columns_of_another_sign_or_joint_are_told_first():
    """The note before all that the model misses says which sign is wrong, or which currents; a clock is none."""
    truth, log = worked("puma560", "picks", 31)
    position = log.position * np.where(np.arange(6) == 2, -1.0, 1.0)
    notes = identify(segment([replace(log, position=position)], truth.robot), truth.robot).notes
    assert notes[0].slug == "position-reversed" and notes[0].where.joint == 3
    assert [note.slug for note in notes].count("position-reversed") == 1
    swapped = replace(log, current=log.current[:, [0, 2, 1, 3, 4, 5]])
    first = identify(segment([swapped], truth.robot), truth.robot).notes[0]
    assert first.slug == "joints-swapped" and "joints 2 and 3" in first.text


@pytest.mark.parametrize("name", ["ur5e", "panda"])
def test_currents_without_friction_are_told(name):
    """Of an arm guided by hand the currents hold the weight alone: the first note says so; of one at work, none."""
    assert "friction-none" not in {note.slug for note in model("ur5e", "picks", 31).notes}
    robot, rng = read_recipe(shipped_recipes()[name]), np.random.default_rng(5)
    truth, q = draw(robot, 5), waves(rng, 60.0, reach(robot))[::TICKS]
    current = truth.gain * gravity_load(robot, truth.links, q)[0] + 0.02 * rng.normal(size=q.shape)
    log = Log("hand.csv", np.arange(len(q)) + 2, np.arange(len(q)) / RATE, q, None, current)
    slugs = [note.slug for note in identify(segment([log], robot), robot).notes]
    assert slugs[0] == "friction-none" and slugs.count("friction-none") == 1


def test_links_that_are_not_felt_are_told_and_no_length():
    """Simulated with the rotors' inertia alone: joint 1 feels nothing of others; no length is to blame."""
    robot, rng = read_recipe(shipped_recipes()["ur5e"]), np.random.default_rng(9)
    truth, q = draw(robot, 9), waves(rng, 60.0, reach(robot))[::TICKS]
    v = np.gradient(q, 1.0 / RATE, axis=0)
    rotors = 0.5 * np.gradient(v, 1.0 / RATE, axis=0)
    drawn = gravity_load(robot, truth.links, q)[0] + rotors + 4.0 * np.sign(v) + 2.0 * v
    current = truth.gain * drawn + 0.08 * rng.normal(size=q.shape)
    log = Log("rotors.csv", np.arange(len(q)) + 2, np.arange(len(q)) / RATE, q, None, current)
    slugs = [note.slug for note in identify(segment([log], robot), robot).notes]
    assert "ratio-none" in slugs and "length-wrong" not in slugs


@pytest.mark.parametrize(("seed", "moving", "is_shown"), [(76, (4, 5), False), (72, (3, 4, 5), True)])
def test_a_ratio_is_told_only_where_the_likelihood_bounds_it(seed, moving, is_shown):
    """Of a wrist that moves alone a linearised fit knew eta4/eta5 as -0.09 ± 0.12; it is 1.27, and any fits as well."""
    robot, rng = read_recipe(shipped_recipes()["puma560"]), np.random.default_rng(seed)
    wanted = waves(rng, 60.0, reach(robot)) * np.isin(np.arange(1, 7), moving)
    truth = draw(robot, seed)
    estimate = identify(segment([recorded(truth, wanted, rng, counts=2e4)], robot), robot)
    value = next(value for value in estimate.values if value.name == "gain_ratio.4.5")
    exact = truth.parameters()[value.name]
    assert (value.std_error is not None) == is_shown
    assert not is_shown or abs(value.value - exact) < 4.0 * value.std_error < abs(exact)
