"""Any motion: the fit takes the full rigid body of an arm, gains unknown, and logs of arms at work.

Ten inertial parameters a link, by pinocchio's regressor; the base parameters of each link are found by pivoting, inner
links first, which keeps the form: row i has no column of a link before i.
"""

import re
from dataclasses import replace

import numpy as np
import pytest
from free_motion import fourier, picks, reach, recorded, true_values, waves

from pumaid.diagnosis.compare import compare
from pumaid.estimation.estimate import identify
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.maths import Bilinear, Recursion, fit_bilinear, independent
from pumaid.preprocessing.segment import segment
from pumaid.simulation import draw

#: s of simultaneous Fourier motion, cells a second, A of noise, A s/rad and A of friction.
SECONDS, RATE, SIGMA = 60.0, 50.0, 0.02
#: Gains whose ratios are to be found, A/(N m); the last ratios are hardly felt by this bare arm.
GAINS = np.array([0.10, -0.085, 0.11, -0.15, 0.19, -0.17])


def test_the_rigid_body_of_any_motion_is_the_same_call():
    """From 60 s of all joints moving at once: friction within 2 %, ratios within 3 %, and what is left is the noise."""
    pin, engines = pytest.importorskip("pinocchio"), pytest.importorskip("engines")
    rng, n = np.random.default_rng(4), 6
    q, v, a = (part.T for part in fourier(rng, n, SECONDS, RATE)[1])
    # Masses falling outward, centres within a span of the link, inertias that go with them.
    bodies = [
        pin.Inertia(mass, rng.uniform(-0.1, 0.1, 3), np.diag(rng.uniform(0.5, 1.0, 3) * 0.02 * mass))
        for mass in (4.0, 8.0, 3.0, 1.5, 1.2, 0.6)
    ]
    model = engines.pinocchio_model(read_recipe(shipped_recipes()["ur5e"]), bodies)
    data, true = model.createData(), np.concatenate([body.toDynamicParameters() for body in bodies])
    full = np.array([pin.computeJointTorqueRegressor(model, data, *row) for row in zip(q, v, a, strict=True)])
    friction = rng.uniform(0.5, 1.0, (n, 2))
    torque = full @ true
    drive = np.stack([np.sign(v), v], axis=2)
    current = GAINS * torque + np.einsum("tjk,jk->tj", drive, friction) + SIGMA * rng.normal(size=torque.shape)
    # Base parameters: a column is kept where it adds to those of links further in.
    stacked, kept = full.reshape(-1, 10 * n), []
    for column in range(10 * n):
        if independent(stacked[:, [*kept, column]], first=len(kept))[-1]:
            kept.append(column)
    owners = np.concatenate([np.array(kept) // 10, np.repeat(np.arange(n), 2)])
    blocks = []
    for row in range(n):
        own = np.zeros((len(q), 2 * n))
        own[:, 2 * row : 2 * row + 2] = drive[:, row]
        blocks.append(np.hstack([np.where(owners[: len(kept)] >= row, full[:, row, kept], 0.0), own]) / SIGMA)
    start = Recursion(owners, n)
    for row in reversed(range(n)):
        start.take(row, blocks[row], current[:, row] / SIGMA)
    number = np.repeat(np.arange(n), len(q))
    whole = Bilinear(number, np.vstack(blocks), current.T.ravel() / SIGMA, owners)
    found = fit_bilinear(whole, start.values, start.gains)
    assert float(np.mean(found.residual**2)) == pytest.approx(1.0, abs=0.02)
    np.testing.assert_allclose(found.values[len(kept) :].reshape(n, 2), friction, rtol=0.02)
    for inner in range(3):
        assert found.gains.ratio(inner, inner + 1) == pytest.approx(GAINS[inner] / GAINS[inner + 1], rel=0.03)


@pytest.mark.parametrize(
    ("name", "way", "seconds"), [("puma560", waves, 60.0), ("ur5e", picks, 120.0), ("stanford", waves, 60.0)]
)
def test_intervals_hold_the_truth_of_arms_at_work(name, way, seconds):
    """Closed loop of an independent engine: 95 % intervals of friction and ratios hold, errors are of the noise."""
    robot = read_recipe(shipped_recipes()[name])
    holds, scores = [], []
    for seed in (31, 32):
        truth, rng = draw(robot, seed), np.random.default_rng(seed)
        log = recorded(truth, way(rng, seconds, reach(robot)), rng, counts=2e4)
        dataset = segment([log], robot)
        assert {run.kind for run in dataset.runs} == {"block"}
        estimate = identify(dataset, robot)
        exact = true_values(truth)
        for value in estimate.values:
            if value.name in exact and value.std_error is not None:
                holds.append(value.ci95[0] <= exact[value.name] <= value.ci95[1])
                scores.append((value.value - exact[value.name]) / value.std_error)
        for fit, noise in zip(estimate.joints, truth.noise.sample_std, strict=True):
            assert 0.6 * noise < fit.rmse < 2.0 * noise
    # 55 to 58 intervals, of which 95 % hold: fewer than 85 % are a chance of one in a thousand.
    assert len(holds) >= 50 and np.mean(holds) >= 0.85
    assert np.std(scores) < 1.5


def test_unseen_work_is_predicted_to_the_noise():
    """A model of a minute of waves predicts picks of the same arm."""
    robot = read_recipe(shipped_recipes()["puma560"])
    truth, rng = draw(robot, 41), np.random.default_rng(41)
    fitted = segment([recorded(truth, waves(rng, 60.0, reach(robot)), rng, counts=2e4)], robot)
    unseen = segment([recorded(truth, picks(rng, 40.0, reach(robot)), rng, counts=2e4)], robot)
    estimate = identify(fitted, robot)
    comparison = compare(estimate, unseen, robot)
    for score, fit in zip(comparison.joints, estimate.joints, strict=True):
        assert score.rmse < 1.5 * fit.rmse and not score.undetermined


def test_a_clock_or_a_zero_that_is_off_is_told():
    """Where inertia, weight and friction contradict each other, a note says so; of the sound log there is none."""
    robot = read_recipe(shipped_recipes()["puma560"])
    truth, rng = draw(robot, 302), np.random.default_rng(302)
    log = recorded(truth, picks(rng, 60.0, reach(robot)), rng, counts=2e4)
    slow, shifted = replace(log, time=1.3 * log.time), log.position.copy()
    shifted[:, 1] += 0.2
    spoilt = [log, slow, replace(log, position=shifted)]
    slugs = [{note.slug for note in identify(segment([item], robot), robot).notes} for item in spoilt]
    assert slugs == [set(), {"model-misses"}, {"model-misses"}]


@pytest.mark.parametrize(("name", "true"), [("puma560", 0.4318), ("ur5e", -0.425)])
def test_a_length_that_motion_contradicts_is_told_with_what_fits(name, true):
    """The upper arm 3 cm too long in the recipe, beside an independent engine; of the right recipe nothing is said."""
    robot = read_recipe(shipped_recipes()[name])
    truth, rng = draw(robot, 91), np.random.default_rng(91)
    log = recorded(truth, waves(rng, 60.0, reach(robot)), rng, counts=2e4)
    assert "length-wrong" not in {note.slug for note in identify(segment([log], robot), robot).notes}
    arm = replace(robot.joint(3), a=true + 0.03)
    wrong = replace(robot, joints=tuple(arm if joint.number == 3 else joint for joint in robot.joints))
    note = next(note for note in identify(segment([log], wrong), wrong).notes if note.slug == "length-wrong")
    fits, error = map(float, re.search(r"recipe: (\S+) ± (\S+) m", note.text).groups())
    assert note.where.joint == 3 and "length a of joint 3" in note.text
    assert abs(fits - true) < max(4.0 * error, 0.005) and error < 0.008
