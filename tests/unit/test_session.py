"""What a virtual robot's log holds, sample by sample."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from pumaid.errors import ModelError
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.simulation import Noise, draw, table1
from pumaid.simulation import truth_file as record
from pumaid.simulation.hidden_effects import parse
from pumaid.simulation.session import CONTROL, simulate
from pumaid.trajectory import Motion, Plan, cruise, run_trapezoid, trapezoids

RATE = 200.0
PUMA = table1.puma560()
#: Two motions with a move between them.
SHORT = Plan(
    robot="PUMA 560",
    motions=(
        Motion(2, (0.0, 0.0, 1.0, 0.0, 0.0, 0.0), -1.0, 1.0, 0.5),
        Motion(3, (0.0, -0.5, 0.0, 0.3, 0.0, 0.0), 1.0, -1.0, 0.8),
    ),
)


def session(truth=PUMA, plan=SHORT, seed=1, rate=RATE, **options) -> dict[str, np.ndarray]:
    """A whole session's arrays."""
    logs = list(simulate(truth.robot, plan, truth=truth, seed=seed, rate=rate, **options))
    names = ("time", "position", "velocity", "current")
    return {name: np.concatenate([getattr(log, name) for log in logs]) for name in names}


def test_speed_is_the_planned_one():
    """The controller keeps the run's speed within one percent over the part that `cruise` promises, up to its lag."""
    found = session(PUMA.with_noise(0.0))
    (begin, end), seconds = cruise(PUMA.robot, SHORT.motions[0])
    q, v = found["position"][:, 1], found["velocity"][:, 1]
    # Where the load changes, a joint runs ahead or behind by some 0.02 rad.
    kept = (q > begin + 0.02) & (q < end - 0.02) & (found["time"] < 5.0)
    assert v[kept] == pytest.approx(0.5, rel=0.01)
    assert np.count_nonzero(kept) / RATE == pytest.approx(seconds, abs=0.1)


def test_robots_end_every_movement_at_rest():
    """The planned rests suffice: a movement ends within two milliradians, at rest, and the next begins there."""
    truth = draw(table1.robot(), 3)
    truth = replace(truth, noise=replace(truth.noise, std=np.zeros(6)))
    plan = replace(table1.experiment(), motions=table1.experiment().motions[::7])
    logs = list(simulate(truth.robot, plan, truth=truth, seed=1, rate=RATE))
    for movement, log in zip(trapezoids(truth.robot, plan), logs, strict=True):
        assert np.max(np.abs(log.velocity[-1])) < 1e-3
        assert np.max(np.abs(log.position[-1] - movement.end)) < 2.5e-3
    for before, after in pairwise(logs):
        assert np.max(np.abs(after.position[0] - before.position[-1]) * truth.noise.counts) < 1.01


def test_held_joint_is_carried_by_gravity_and_stiction():
    """A joint that rests keeps its place; what its motor lacks of the load is within what friction holds."""
    found = session(PUMA.with_noise(0.0))
    first = found["time"] < 4.0
    q, i = found["position"][first, 2], found["current"][first, 2]
    lack = i - PUMA.gravity_current(found["position"][first])[:, 2]
    held = np.abs(np.diff(q, prepend=q[0])) < 1e-6
    assert np.max(np.abs(lack[held])) < 1.02 * PUMA.breakaway[2] * PUMA.coulomb[2] * 1.15  # uneven by direction
    assert np.max(np.abs(q - q[0])) < 2.5e-3
    assert np.mean(held) > 0.4


def test_position_is_the_sum_of_velocity():
    """Positions follow from velocities without a jump, also from file to file and between postures."""
    # A log at the drive's own rate holds each of its periods; a slower log leaves some out.
    found = session(PUMA.with_noise(0.0), rate=CONTROL, runs_per_file=1)
    step = np.diff(found["position"], axis=0) - found["velocity"][1:] / CONTROL
    assert np.max(np.abs(step)) < 1e-8
    assert np.diff(found["time"]) == pytest.approx(1.0 / CONTROL, abs=1e-9)


def test_short_way_never_reaches_the_speed():
    """On a way too short for the ramp the joint turns to braking before it has the speed, and is there in time."""
    plan = Plan("PUMA 560", (replace(SHORT.motions[0], end=-0.95, velocity=5.0),))
    run = run_trapezoid(PUMA.robot, plan.motions[0])
    assert run.peak < 1.0 and run.cruise[0] == run.cruise[1]
    found = session(PUMA.with_noise(0.0), plan)
    assert found["position"][-1, 1] == pytest.approx(-0.95, abs=2e-3)
    assert np.max(found["velocity"][:, 1]) < 1.2 * run.peak


def test_noise_has_the_promised_size():
    """Noise of one run is level plus correlated noise, each of the size that the truth states."""
    truth, plan = (
        replace(PUMA, noise=Noise(np.full(6, 0.1), level_share=0.5)),
        replace(SHORT, motions=SHORT.motions * 10),
    )
    logs = [list(simulate(one.robot, plan, truth=one, seed=1, rate=RATE)) for one in (truth, PUMA.with_noise(0.0))]
    noise = [(noisy.current - quiet.current)[:, 5] for noisy, quiet in zip(*logs, strict=True)]
    levels, sizes = [one.mean() for one in noise], [one.var() for one in noise]
    # 39 levels know their variance to 23 % (one sigma); three sigmas are allowed. The noise knows its own to 3 %.
    assert np.var(levels) == pytest.approx(0.1**2 * 0.5, rel=0.7)
    assert np.mean(sizes) == pytest.approx(0.1**2 * 0.5, rel=0.1)


def test_noise_is_correlated_in_time():
    """Noise at two instants one correlation time apart is correlated by 1/e, whatever the rate."""
    truth = replace(PUMA, noise=Noise(np.full(6, 0.1), level_share=0.0, correlation_time=0.05))
    noise = session(truth)["current"] - session(PUMA.with_noise(0.0))["current"]
    quiet = noise[:, [0, 3, 4, 5]]
    lag = round(0.05 * RATE)
    found = np.mean(quiet[lag:] * quiet[:-lag]) / np.mean(quiet**2)
    # Four series of some 100 correlation times each: a standard error of about 0.05.
    assert found == pytest.approx(np.exp(-1.0), abs=0.15)


def test_encoder_and_sensor_have_steps():
    """Positions and currents are whole multiples of the encoder's and the sensor's step."""
    truth = draw(table1.robot(), 3)
    found = session(truth)
    counts = found["position"] * truth.noise.counts
    assert np.max(np.abs(counts - np.round(counts))) < 1e-6
    steps = found["current"] / truth.noise.current_step
    assert np.max(np.abs(steps - np.round(steps))) < 1e-6


def test_same_seed_same_log():
    """The seed decides everything."""
    first, again, other = (session(draw(table1.robot(), 3), seed=seed)["current"] for seed in (7, 7, 8))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_files_share_one_clock():
    """Only the first batch starts a clock; rows begin at 2 in every file."""
    logs = list(simulate(PUMA.robot, SHORT, truth=PUMA, seed=1, rate=RATE, runs_per_file=1))
    assert [log.origin for log in logs] == ["session_01", "session_02", "session_02"]
    assert [log.starts_clock for log in logs] == [True, False, False]
    assert [int(log.rows[0]) for log in logs] == [2, 2, 2 + len(logs[1])]


def test_velocity_can_be_absent():
    """A log without velocities has none, not zeros."""
    logs = simulate(PUMA.robot, SHORT, truth=PUMA, seed=1, rate=RATE, has_velocity=False)
    assert all(log.velocity is None for log in logs)


def test_a_truth_of_an_earlier_version_breaks_away_as_usual():
    """A document without break-away levels gets the usual ones; one with them keeps them."""
    truth = draw(table1.robot(), 3)
    document = record.as_json(truth)
    assert np.array_equal(record.from_json(document, truth.robot).breakaway, truth.breakaway)
    del document["breakaway"]
    assert np.all(record.from_json(document, truth.robot).breakaway == 1.1)


@pytest.mark.parametrize(
    ("plan", "rate", "slug"),
    [
        (replace(SHORT, motions=(Motion(1, (0.0, 0.0), 0.0, 1.0, 0.5),)), RATE, "plan-misfit"),
        (replace(SHORT, motions=(Motion(7, (0.0,) * 6, 0.0, 1.0, 0.5),)), RATE, "plan-misfit"),
        (replace(SHORT, motions=(replace(SHORT.motions[0], velocity=0.0),)), RATE, "plan-misfit"),
        (SHORT, 0.0, "rate-impossible"),
        (SHORT, 0.1, "rate-impossible"),
        (SHORT, 1e9, "rate-impossible"),
        (SHORT, float("nan"), "rate-impossible"),
    ],
)
def test_nonsense_is_refused(plan, rate, slug):
    """Another arm's plan, a joint that is not there, a rate that is none."""
    with pytest.raises(ModelError) as caught:
        simulate(PUMA.robot, plan, rate=rate)
    assert caught.value.slug == slug


def test_an_arm_out_of_control_is_no_log():
    """Gears that turn one motor a million times as fast as another throw the arm away, which is an error and no log."""
    joints = tuple(replace(joint, gear_ratio=1.0) for joint in PUMA.robot.joints)
    wild = replace(PUMA.robot, joints=joints, coupling={(2, 1): 1e6})
    with pytest.raises(ModelError) as caught:
        list(simulate(wild, SHORT, rate=RATE))
    assert caught.value.slug == "simulation-diverged"


def test_the_truth_tells_what_currents_show_of_a_slide():
    """What a lift carries is part of its Coulomb terms in `parameters`, as identify finds it, and not in `friction`."""
    robot = read_recipe(shipped_recipes()["pendulum2"])
    lift = replace(robot, joints=(replace(robot.joints[0], kind="prismatic", alpha=0.0), robot.joints[1]))
    truth = draw(lift, 1)
    document, load = record.as_json(truth), truth.gravity_current(np.zeros((1, 2)))[0, 0]
    assert abs(load) > 0.1
    for side in ("plus", "minus"):
        own = document["friction"][f"coulomb_{side}"][0]
        assert document["parameters"][f"coulomb.j1.{side}"] == pytest.approx(own + load, rel=1e-8)


@pytest.mark.parametrize("text", ["stribeck@1:a=nan", "delay@1:dt=-1", "delay@1:dt=1e9"])
def test_hidden_values_that_nothing_has_are_refused(text):
    """No number, and a current that is logged before it flows or an age later, are told as what they are."""
    with pytest.raises(ModelError) as caught:
        hidden = parse(text, PUMA.robot)
        list(simulate(PUMA.robot, SHORT, truth=draw(PUMA.robot, 1).hiding([hidden]), rate=RATE))
    assert caught.value.slug == "hide-wrong" and "weight" not in str(caught.value)
