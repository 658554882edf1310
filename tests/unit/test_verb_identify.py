"""Identification of arms whose truth is known, from all of their logs or the oddest parts of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from worlds import (
    CRANE,
    PENDULUM,
    STANFORD,
    course,
    dataset,
    drawn,
    experiment,
    identified,
    only,
    puma,
    run_of,
    true_current,
    truth_in_units,
)

from pumaid.dataset import Dataset, Reject
from pumaid.errors import LogError
from pumaid.estimate import Estimate
from pumaid.estimation.estimate import identify
from pumaid.simulation import Bench, Truth, table1

#: Relative to the value or, where that is smaller, to 0.001 in SI, to 1 for a ratio of gains (the paper's eta_5/eta_6
#: of 2e-6 acts on a load that is itself a thousandth of an ampere).
EXACT = 1e-9
#: The same where strokes are among the runs, whose delay is told from means over bins.
EXACT_IN_CELLS = 2e-5
#: A: the root of what double precision loses of currents squared, times ten.
ROUNDING = 1e-7
PAPER, QUIET = table1.experiment(), puma(noisy=False)
CASES = {"puma": (QUIET, PAPER), "stanford": (drawn(STANFORD, noisy=False), experiment(STANFORD))}


def wrong(estimate: Estimate, truth: Truth, moving) -> dict[str, tuple[float, float]]:
    """Identified values that are not the truth's to `EXACT`, nor within three of their standard errors."""
    known, out = truth_in_units(truth, sorted(moving)), {}
    for value in estimate.values:
        if value.state == "identified":
            near = EXACT * max(abs(known[value.name]), 1e-3) + 3 * value.std_error
            if abs(value.value - known[value.name]) > near:
                out[value.name] = (value.value, known[value.name])
    return out


def misfit(estimate: Estimate) -> float:
    """Largest RMSE of a joint (A)."""
    return max(fit.rmse for fit in estimate.joints if fit.rmse is not None)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("recursive", [False, True])
def test_exact_without_noise(name, recursive):
    """Everything that exists is identified to rounding, by the joint fit and by the recursion alone."""
    truth, plan = CASES[name]
    estimate = identify(dataset(truth, plan), truth.robot, recursive=recursive)
    known = truth.parameters()
    open_ = {value.name for value in estimate.values if value.state != "identified"}
    assert open_ == {"gravity.l1.x", "gravity.l1.y", "gain_ratio.1.2"}
    for values in (estimate.values, estimate.recursive):
        off = {
            v.name: abs(v.value - known[v.name]) / max(abs(known[v.name]), 1.0 if v.name.startswith("gain") else 1e-3)
            for v in values
            if v.state == "identified"
        }
        assert max(off.values()) < EXACT, max(off, key=off.get)


def test_stanford_from_samples():
    """The same from dense samples of every run, made from the truth by this test, strokes among them."""
    truth, plan = CASES["stanford"]
    runs = []
    for number, motion in enumerate(plan.motions):
        kind = "stroke" if number % 3 == 0 else "constant"
        moves = course(kind, motion.start, motion.end, duration=abs(motion.end - motion.start) / motion.velocity)
        _, q, qd, qdd = moves
        position, own = np.tile(motion.hold, (len(q), 1)), motion.joint - 1
        position[:, own] = q
        way = np.where(qd == 0.0, 1e-300 * np.sign(motion.end - motion.start), qd)
        friction = truth.friction.current(motion.joint, way)
        current = truth.gravity_current(position)[:, own] + friction + truth.inertia[own] * qdd
        runs.append(run_of(STANFORD, motion.joint, motion.hold, course=moves, current=current))
    estimate = identify(Dataset(tuple(runs)), STANFORD)
    known, values = truth.parameters(), identified(estimate)
    inertias = {name: value for name, value in values.items() if name.startswith("inertia")}
    assert len(inertias) >= 6 and len(values) - len(inertias) == 37
    for name, value in values.items():
        wanted = truth.inertia[int(name.split(".")[1][1:]) - 1] if name in inertias else known[name]
        assert value == pytest.approx(wanted, rel=EXACT_IN_CELLS, abs=EXACT_IN_CELLS * 1e-3)


def part(name: str, chosen) -> tuple[Truth, Estimate]:
    """The estimate from the motions of a case for which `chosen(motion)` is true."""
    truth, plan = CASES[name]
    return truth, identify(dataset(truth, only(plan, chosen)), truth.robot)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("missing", range(1, 7))
def test_logs_without_a_joint(name, missing):
    """Without one joint the rest is right, the runs are explained, and what waits says for which joint."""
    truth, estimate = part(name, lambda motion: motion.joint != missing)
    assert wrong(estimate, truth, {1, 2, 3, 4, 5, 6} - {missing}) == {}
    assert misfit(estimate) < ROUNDING
    own = [value for value in estimate.values if value.name.startswith((f"coulomb.j{missing}", f"viscous.j{missing}"))]
    assert len(own) == 4 and {value.state for value in own} == {"not_identifiable"}
    assert all("moves alone" in value.reason for value in own)
    if missing > 2:
        assert f"joint {missing} moves alone" in estimate.value(f"gain_ratio.{missing - 1}.{missing}").reason
    assert estimate.joint(missing).noise_floor_reason == f"joint {missing} never moves alone in these logs"


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("joint", range(1, 7))
def test_logs_of_one_joint_alone(name, joint):
    """From one joint its friction is identified and its runs are explained, turning or sliding."""
    truth, estimate = part(name, lambda motion: motion.joint == joint)
    assert wrong(estimate, truth, {joint}) == {} and misfit(estimate) < ROUNDING
    assert {f"coulomb.j{joint}.plus", f"viscous.j{joint}.minus"} <= set(identified(estimate))
    assert not [name for name in identified(estimate) if name.startswith("gain_ratio")]


def test_slides_alone():
    """Logs of the sliding joint alone, in several postures, give its mass."""
    truth, estimate = part("stanford", lambda motion: motion.joint == 3)
    assert identified(estimate)["gravity.l3.mass"] == pytest.approx(truth.parameters()["gravity.l3.mass"], rel=EXACT)


@pytest.mark.parametrize("name", CASES)
def test_one_posture_a_joint(name):
    """In one posture own weight and outer weight are one: no ratio is told, no value is wrong, every load is."""
    truth, plan = CASES[name]
    holds: dict[int, tuple] = {}
    for motion in plan.motions:
        holds.setdefault(motion.joint, motion.hold)
    truth, estimate = part(name, lambda motion: motion.hold == holds[motion.joint])
    assert wrong(estimate, truth, range(1, 7)) == {} and misfit(estimate) < ROUNDING
    told = identified(estimate)
    assert not {"gravity.l2.x", "gain_ratio.2.3", "gain_ratio.4.5"} & set(told)
    at_zero = np.array(holds[2], dtype=float)
    at_zero[1] = 0.0
    load = next(sum_ for sum_ in estimate.combinations if sum_.text == "weight felt by joint 2 at position 0")
    assert load.value == pytest.approx(truth.gravity_current(at_zero[None])[0, 1], rel=1e-6)


def test_one_posture_of_a_slide():
    """A slide's load in one posture cannot be told from Coulomb friction; the reason says what would."""
    _, plan = CASES["stanford"]
    hold = next(motion.hold for motion in plan.motions if motion.joint == 3)
    truth, estimate = part("stanford", lambda motion: motion.joint != 3 or motion.hold == hold)
    assert wrong(estimate, truth, range(1, 7)) == {}
    for name in ("gravity.l3.mass", "coulomb.j3.plus", "coulomb.j3.minus"):
        value = estimate.value(name)
        assert "one angle to gravity" in value.reason and "another angle to gravity" in value.next_run


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("sign", [1, -1])
def test_one_direction(name, sign):
    """Runs one way give gravity and that way's friction; the other way's is said to be missing."""
    truth, estimate = part(name, lambda motion: np.sign(motion.end - motion.start) == sign)
    assert wrong(estimate, truth, range(1, 7)) == {} and misfit(estimate) < ROUNDING
    side, way = ("minus", "backward") if sign > 0 else ("plus", "forward")
    lost = [value for value in estimate.values if value.name.endswith(side)]
    assert {value.state for value in lost} == {"not_identifiable"}
    assert {value.reason for value in lost} == {f"the joint never moves {way} in these logs"}


@pytest.mark.parametrize("name", CASES)
def test_one_speed(name):
    """At one speed only the sum of Coulomb and viscous friction is told, with that speed in words, and gravity."""
    truth, plan = CASES[name]
    slow = {motion.joint: motion.velocity for motion in reversed(plan.motions)}
    truth, estimate = part(name, lambda motion: motion.velocity == slow[motion.joint])
    assert wrong(estimate, truth, range(1, 7)) == {} and misfit(estimate) < ROUNDING
    told = identified(estimate)
    assert not [name for name in told if name.startswith(("coulomb", "viscous"))]
    assert told["gravity.l6.x"] == pytest.approx(truth.parameters()["gravity.l6.x"], rel=1e-6)
    assert "practically one speed" in estimate.value("coulomb.j4.plus").reason
    assert estimate.value("viscous.j4.minus").next_run.startswith("repeat a backward run at")
    for joint in range(1, 7):
        text = f"friction of joint {joint} backward, at the one speed that was run"
        total = next(sum_ for sum_ in estimate.combinations if sum_.text == text)
        assert total.value == pytest.approx(truth.friction.current(joint, np.array([-slow[joint]]))[0], rel=1e-6)


@pytest.mark.parametrize("joint", [1, 2, 3])
def test_a_single_run(joint):
    """One run determines no friction term and no inner weight; it is explained, and a note says that it is alone."""
    plan = experiment(CRANE)
    number = next(n for n, motion in enumerate(plan.motions) if motion.joint == joint)
    truth = drawn(CRANE)
    found = dataset(truth, replace(plan, motions=(plan.motions[number],)))
    estimate = identify(found, CRANE)
    assert [name for name in identified(estimate) if not name.startswith("gravity.l3")] == []
    assert all(value.reason for value in estimate.values if value.state != "identified")
    assert [note.slug for note in estimate.notes] == ["few-runs"]
    assert misfit(estimate) < 2.0 * truth.noise.std[joint - 1]


def test_tiny_spans():
    """Joints that hardly travel identify nothing wrong; what friction hides of weight is said."""
    truth, runs = drawn(PENDULUM, noisy=False), []
    for joint, hold in ((1, (0.0, 0.2)), (1, (0.0, 1.4)), (2, (0.3, 0.0)), (2, (-0.9, 0.0))):
        for speed in (0.004, -0.004, 0.012, -0.012):
            moves = course("constant", 0.5 - speed, 0.5 + speed)
            position = np.tile(hold, (200, 1))
            position[:, joint - 1] = moves[1]
            current = truth.gravity_current(position)[:, joint - 1] + truth.friction.current(joint, moves[2])
            noise = 0.02 * np.random.default_rng(len(runs)).normal(size=200)
            runs.append(run_of(PENDULUM, joint, hold, course=moves, current=current + noise))
    estimate = identify(Dataset(tuple(runs)), PENDULUM)
    known = truth.parameters()
    far = [v.name for v in estimate.values if v.value is not None and abs(v.value - known[v.name]) > 5 * v.std_error]
    assert far == [] and misfit(estimate) < 0.03
    assert estimate.value("gravity.l1.x").state == "not_identifiable"
    assert estimate.value("gravity.l1.x").next_run


def test_a_joint_that_draws_nothing():
    """Currents of zero, from a dead sensor say, are fitted by zeros and divide nothing."""
    robot, runs = PENDULUM, []
    for joint in (1, 2):
        for start in (-1.0, 1.0):
            moves = course("constant", start, -start)
            runs.append(run_of(robot, joint, (0.2, 0.4), course=moves, current=np.zeros(200)))
    estimate = identify(Dataset(tuple(runs)), robot)
    assert misfit(estimate) == 0.0
    assert all(np.isfinite(value.value) for value in estimate.values if value.value is not None)


def test_held_out_runs_are_left_out():
    """What is kept for judging moves nothing, however wrong it is."""
    truth, plan = drawn(CRANE), experiment(CRANE)
    runs = dataset(truth, plan).runs
    spoilt = [replace(run, heldout=True, bins=replace_current(run)) for run in runs[::4]]
    estimate = identify(Dataset((*runs, *spoilt)), CRANE)
    assert estimate.values == identify(Dataset(runs), CRANE).values
    assert sum(fit.runs for fit in estimate.joints) == len(runs)


def replace_current(run):
    """The run's bins with ten times its current."""
    return replace(run.bins, current=10.0 * run.bins.current)


def test_nothing_but_held_out_runs():
    """With every run held out there is nothing to fit, and the refusal says how many there were."""
    runs = tuple(replace(run, heldout=True) for run in dataset(drawn(PENDULUM), experiment(PENDULUM)).runs)
    with pytest.raises(LogError, match=f"{len(runs)} runs, all held out") as caught:
        identify(Dataset(runs), PENDULUM)
    assert caught.value.slug == "no-runs"


def test_nothing_but_rejects():
    """Logs in which no run was found are refused with the number of stretches left out."""
    reject = Reject("a.csv", 2, 9, 0.0, 1.0, (1,), "ramp", "it speeds up", 8)
    with pytest.raises(LogError, match="1 stretch left out"):
        identify(Dataset((), (reject,)), PENDULUM)


def test_repeats_narrow_the_intervals():
    """Four times the runs halve the standard errors, about."""
    truth = drawn(CRANE)
    once, four = (identify(dataset(truth, experiment(CRANE, repeats=repeats), seed=2), CRANE) for repeats in (1, 4))
    ratio = [
        four.value(v.name).std_error / v.std_error
        for v in once.values
        if v.state == "identified" and not v.name.startswith("gain")
    ]
    assert np.median(ratio) == pytest.approx(0.5, abs=0.15)


def test_predictions_follow_noisy_runs():
    """With noise the model passes through every run's bins within the noise of their means and levels."""
    truth = drawn(STANFORD)
    found = dataset(truth, experiment(STANFORD))
    estimate = identify(found, STANFORD)
    for run in found.runs:
        error = run.bins.current - true_current(truth, run)
        assert np.sqrt(np.mean(error**2)) < 5 * truth.noise.std[run.joint - 1]
    for fit in estimate.joints:
        assert fit.rmse == pytest.approx(truth.noise.std[fit.joint - 1], rel=0.35)


def test_recursion_stands_beside_the_joint_fit():
    """Both estimates are told, over the same names; --recursive tells the recursion as the result."""
    truth = puma()
    runs = Dataset(Bench(truth, PAPER, rate=50.0).runs(np.random.default_rng(4)))
    both, alone = identify(runs, truth.robot), identify(runs, truth.robot, recursive=True)
    assert (both.method, alone.method) == ("joint", "recursive")
    assert both.recursive == alone.values == alone.recursive
    assert [value.name for value in both.values] == [value.name for value in alone.values]
    # Row 5's data say more of link 5 once link 6's ratio is no longer free: the joint error is the smaller one.
    assert both.value("gravity.l5.x").std_error < alone.value("gravity.l5.x").std_error


@pytest.mark.parametrize("recursive", [False, True])
def test_intervals_are_numbers_even_with_few_runs(recursive):
    """Two runs a joint, in one posture: no interval is infinite or not a number, whichever estimate it is of."""
    plan = only(experiment(CRANE, postures=1, speeds=(0.3, 0.6)), lambda motion: True)
    estimate = identify(dataset(drawn(CRANE), plan), CRANE, recursive=recursive)
    told = [value for value in (*estimate.values, *estimate.recursive) if value.state == "identified"]
    assert told and np.all(np.isfinite([[*value.ci95, value.std_error, value.dof] for value in told]))
    assert all(value.ci95[0] <= value.value <= value.ci95[1] for value in told)


def test_progress_tells_the_joint_at_work():
    """Rows are announced from the last joint to the first, then all together."""
    said: list[tuple[int, str]] = []
    identify(dataset(drawn(CRANE), experiment(CRANE)), CRANE, progress=lambda joint, text: said.append((joint, text)))
    assert [joint for joint, _ in said] == [3, 2, 1, 0] and all(text for _, text in said)


def test_load_that_hides_in_coulomb_is_noted():
    """The constant load of an upright lift is part of its Coulomb terms, which is said."""
    lift = replace(PENDULUM, joints=(replace(PENDULUM.joints[0], kind="prismatic", alpha=0.3), PENDULUM.joints[1]))
    truth = drawn(lift, noisy=False)
    estimate = identify(dataset(truth, experiment(lift)), lift)
    known, load = truth.parameters(), truth.gravity_current(np.zeros((1, 2)))[0, 0]
    assert [note.slug for note in estimate.notes] == ["load-in-coulomb"]
    assert identified(estimate)["coulomb.j1.plus"] == pytest.approx(known["coulomb.j1.plus"] + load, rel=1e-9)
    assert identified(estimate)["coulomb.j1.minus"] == pytest.approx(known["coulomb.j1.minus"] + load, rel=1e-9)


@pytest.mark.parametrize("both_ways", [True, False])
def test_friction_that_falls_with_speed_is_noted(both_ways):
    """A viscous term that drives the motion is told, also from one direction alone; one that opposes it is not."""
    truth = drawn(PENDULUM, noisy=True)
    against = replace(truth.friction, viscous_plus=-truth.friction.viscous_plus)
    plan = only(experiment(PENDULUM), lambda motion: both_ways or motion.end > motion.start)
    for friction, expected in ((truth.friction, set()), (against, {1, 2})):
        found = identify(dataset(replace(truth, friction=friction), plan), PENDULUM)
        assert {note.where.joint for note in found.notes if note.slug == "friction-falls-with-speed"} == expected
