"""What a virtual robot's log holds, the runs that it would leave, and the truth as a document."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
import table1
from monte_carlo import Bench

from pumaid.errors import ModelError
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.joint_bins import joint_bins
from pumaid.results.truth_file import as_json
from pumaid.simulation import Noise, draw
from pumaid.simulation.hidden_effects import parse
from pumaid.simulation.session import CONTROL, simulate
from pumaid.trajectory import Motion, Plan, cruise, trapezoids

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
    names = ["time", "position", "velocity", "current"] + ["temperature"] * (logs[0].temperature is not None)
    return {name: np.concatenate([getattr(log, name) for log in logs]) for name in names}


@cache
def quiet() -> dict[str, np.ndarray]:
    """The same without noise at the drives' own rate, each motion in a file; a slower log leaves periods out."""
    return session(PUMA.with_noise(0.0), rate=CONTROL, runs_per_file=1)


def test_speed_is_the_planned_one():
    """The controller keeps the run's speed within one percent over the part that `cruise` promises, up to its lag."""
    (begin, end), seconds = cruise(PUMA.robot, SHORT.motions[0])
    q, v = quiet()["position"][:, 1], quiet()["velocity"][:, 1]
    # Where the load changes, a joint runs ahead or behind by some 0.02 rad.
    inside = (q > begin + 0.02) & (q < end - 0.02) & (quiet()["time"] < 5.0)
    assert v[inside] == pytest.approx(0.5, rel=0.01)
    assert np.count_nonzero(inside) / CONTROL == pytest.approx(seconds, abs=0.1)


def test_robots_end_every_movement_at_rest():
    """The planned rests suffice: a movement ends within two milliradians, at rest, and the next begins there."""
    truth = draw(table1.robot(), 3)
    truth = replace(truth, noise=replace(truth.noise, std=np.zeros(6)))
    plan = replace(table1.experiment(), motions=table1.experiment().motions[::14])
    logs = list(simulate(truth.robot, plan, truth=truth, seed=1, rate=RATE))
    for movement, log in zip(trapezoids(truth.robot, plan), logs, strict=True):
        assert np.max(np.abs(log.velocity[-1])) < 1e-3
        assert np.max(np.abs(log.position[-1] - movement.end)) < 2.5e-3
    for before, after in pairwise(logs):
        assert np.max(np.abs(after.position[0] - before.position[-1]) * truth.noise.counts) < 1.01


def test_held_joint_is_carried_by_gravity_and_stiction():
    """A joint that rests keeps its place; what its motor lacks of the load is within what friction holds."""
    first = quiet()["time"] < 4.0
    position, current = quiet()["position"][first], quiet()["current"][first, 2]
    q, lack = position[:, 2], current - PUMA.gravity_current(position)[:, 2]
    held = np.abs(np.diff(q, prepend=q[0])) < 1e-6
    assert np.max(np.abs(lack[held])) < 1.02 * PUMA.breakaway[2] * PUMA.coulomb[2] * 1.15  # uneven by direction
    assert np.max(np.abs(q - q[0])) < 2.5e-3
    assert np.mean(held) > 0.4


def test_noise_has_the_promised_size():
    """Noise of one run is level plus correlated noise, each of the size that the truth states."""
    truth = replace(PUMA, noise=Noise(np.full(6, 0.1), level_share=0.5))
    plan = replace(SHORT, motions=(replace(SHORT.motions[0], end=-0.8), replace(SHORT.motions[1], end=0.8)) * 8)
    logs = [list(simulate(arm.robot, plan, truth=arm, seed=1, rate=RATE)) for arm in (truth, PUMA.with_noise(0.0))]
    noise = [(noisy.current - quiet.current)[:, 5] for noisy, quiet in zip(*logs, strict=True)]
    # 31 levels know their variance to 25 % (one sigma); three sigmas are allowed. The noise knows its own to 5 %.
    assert np.var([run.mean() for run in noise]) == pytest.approx(0.1**2 * 0.5, rel=0.75)
    assert np.mean([run.var() for run in noise]) == pytest.approx(0.1**2 * 0.5, rel=0.15)


def test_noise_is_correlated_in_time():
    """Noise at two instants one correlation time apart is correlated by 1/e, whatever the rate."""
    truth = replace(PUMA, noise=Noise(np.full(6, 0.1), level_share=0.0, correlation_time=0.05))
    noise = (session(truth, rate=CONTROL)["current"] - quiet()["current"])[:, [0, 3, 4, 5]]
    lag = round(0.05 * CONTROL)
    # Four series of some 100 correlation times each: a standard error of about 0.05.
    assert np.mean(noise[lag:] * noise[:-lag]) / np.mean(noise**2) == pytest.approx(np.exp(-1.0), abs=0.15)


def test_encoder_and_sensor_have_steps():
    """Positions and currents are whole multiples of the encoder's and the sensor's step."""
    truth = draw(table1.robot(), 3)
    log = session(truth)
    for steps in (log["position"] * truth.noise.counts, log["current"] / truth.noise.current_step):
        assert np.max(np.abs(steps - np.round(steps))) < 1e-6


def test_files_share_one_clock():
    """Only the first batch starts a clock; rows begin at 2 in every file; absent velocities are none, not zeros."""
    logs = list(simulate(PUMA.robot, SHORT, truth=PUMA, seed=1, rate=RATE, runs_per_file=1, has_velocity=False))
    assert [log.origin for log in logs] == ["session_01", "session_02", "session_02"]
    assert [log.starts_clock for log in logs] == [True, False, False]
    assert [int(log.rows[0]) for log in logs] == [2, 2, 2 + len(logs[1])]
    assert all(log.velocity is None for log in logs)


@pytest.mark.parametrize(
    ("plan", "rate", "slug"),
    [
        (replace(SHORT, motions=(Motion(1, (0.0, 0.0), 0.0, 1.0, 0.5),)), RATE, "plan-misfit"),
        (SHORT, 1e9, "rate-impossible"),
        (SHORT, float("nan"), "rate-impossible"),
    ],
)
def test_nonsense_is_refused(plan, rate, slug):
    with pytest.raises(ModelError, match=slug):
        simulate(PUMA.robot, plan, rate=rate)


@pytest.mark.parametrize(
    ("arm", "motions"),
    [
        # Axes that stand nearly in line: a joint feels half of its inertia while the next ones are free to give way.
        (
            "kinova_gen3",
            [((0, 60, 0, 15, -15, -105, -120), 3, -135, 135, 80), ((-90, -60, -105, 15, 30, -75, 0), 7, 0, 45, 21)],
        ),
        # A boom that passes its middle, where the arm is far lighter than at either end of the way.
        ("stanford", [((0, -45, 1.0237, 45, -45, -15), 1, -53, 0, 25), ((-75, 105, 1.26, 0, -30, 0), 6, 0, 135, 66)]),
    ],
)
def test_an_arm_that_gets_lighter_is_held(arm, motions):
    """Both ran away on their way from the one posture to the other."""
    robot, turns = read_recipe(shipped_recipes()[arm]), []
    for hold, joint, *way in motions:
        at = tuple(np.where(robot.is_revolute, np.deg2rad(hold), hold).tolist())
        turns.append(Motion(joint, at, *np.deg2rad(way)))
    speeds = [log.velocity for log in simulate(robot, Plan(robot.name, tuple(turns)), seed=9)]
    assert max(np.abs(speed).max() for speed in speeds) < 10.0


def test_an_arm_out_of_control_is_no_log():
    """Gears that turn one motor a million times as fast as another throw the arm away, which is an error and no log."""
    joints = tuple(replace(joint, gear_ratio=1.0) for joint in PUMA.robot.joints)
    wild = replace(PUMA.robot, joints=joints, coupling={(2, 1): 1e6})
    with pytest.raises(ModelError, match="simulation-diverged"):
        list(simulate(wild, SHORT, rate=RATE))


@pytest.mark.parametrize("text", ["stribeck@1:a=nan", "delay@1:dt=-1", "delay@1:dt=1e9"])
def test_hidden_values_that_nothing_has_are_refused(text):
    """No number, and a current that is logged before it flows or an age later, are told as what they are."""
    with pytest.raises(ModelError) as caught:
        hidden = parse(text, PUMA.robot)
        list(simulate(PUMA.robot, SHORT, truth=draw(PUMA.robot, 1).hiding([hidden]), rate=RATE))
    assert caught.value.slug == "hide-wrong" and "weight" not in str(caught.value)


PAPER = table1.experiment()


def test_noise_free_bins_hold_the_truth():
    """Bins have all samples of a run, and are fitted by the cosine, sine and constant of the truth's current."""
    truth = PUMA.with_noise(0.0)
    for run in Bench(truth, PAPER).runs(np.random.default_rng(0))[::7]:
        assert run.bins.count.sum() == run.samples
        (bins,) = joint_bins(truth.robot, [run])
        columns = np.column_stack([bins.harmonic, np.ones(len(bins))])
        fitted = np.linalg.lstsq(columns, bins.current, rcond=None)[0]
        q = np.linspace(*run.span, 1000)
        position = np.tile(np.nan_to_num(run.posture), (1000, 1))
        position[:, run.joint - 1] = q
        current = truth.gravity_current(position)[:, run.joint - 1]
        current += truth.friction.currents(np.full(6, run.speed))[run.joint - 1]
        assert np.max(np.abs(np.column_stack([np.cos(q), np.sin(q), np.ones(1000)]) @ fitted - current)) < 1e-8


def test_held_out_runs_are_marked():
    motions = (Motion(2, (0.0,) * 6, -1.0, 1.0, 0.5), Motion(2, (0.0,) * 6, 1.0, -1.0, 0.5, "heldout"))
    runs = Bench(PUMA, Plan("PUMA 560", motions)).runs(np.random.default_rng(0))
    assert [(run.heldout, run.direction) for run in runs] == [(False, 1), (True, -1)]


def test_levels_differ_between_runs_and_experiments():
    """Two experiments on one bench differ, by the noise that the truth states."""
    bench, rng = Bench(PUMA, PAPER), np.random.default_rng(8)
    first, second = bench.runs(rng), bench.runs(rng)
    means = np.array(
        [[run.bins.current.mean() for run in experiment if run.joint == 2] for experiment in (first, second)]
    )
    # 20 differences of two levels, each of variance 2 x 0.2 x std^2, know their size to 16 %; three sigmas.
    assert np.std(means[0] - means[1]) == pytest.approx(np.sqrt(0.4) * PUMA.noise.std[1], rel=0.5)


def test_the_truth_tells_what_currents_show_of_a_slide():
    """What a lift carries is part of its Coulomb terms in `parameters`, as identify finds it, and not in `friction`."""
    robot = read_recipe(shipped_recipes()["pendulum2"])
    lift = replace(robot, joints=(replace(robot.joints[0], kind="prismatic", alpha=0.0), robot.joints[1]))
    truth = draw(lift, 1)
    document, load = as_json(truth), truth.gravity_current(np.zeros((1, 2)))[0, 0]
    assert abs(load) > 0.1
    for side in ("plus", "minus"):
        friction = document["friction"][f"coulomb_{side}"][0]
        assert document["parameters"][f"coulomb.j1.{side}"] == pytest.approx(friction + load, rel=1e-8)
