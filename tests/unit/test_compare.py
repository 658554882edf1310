"""`compare`: exact scores, honest flags; the oracle works sample by sample."""

from dataclasses import replace

import numpy as np
import pytest
import worlds

import pumaid
from pumaid.dataset import Dataset, FileFacts, Run
from pumaid.diagnosis.compare import compare
from pumaid.estimation.evaluate import UNEXPLAINED, Comparison
from pumaid.robot import EffectChoice, Robot

TURN = np.pi / 2

#: RMS noise of the samples in these tests (A).
NOISE = 0.02
FACTS = (FileFacts("samples", "d1", 1, 0.01, 0.0, 1.0),)


def pendulum_current(joint: int, q: np.ndarray, *, other: float, qd: np.ndarray) -> np.ndarray:
    """Current (A) of the two-link pendulum by trigonometry: both axes level, motor constants 0.5 and 2 A/(N m)."""
    # Angles from the horizontal; first moments 0.2 kg m and 0.08 kg m, the outer link of 0.3 kg a quarter metre out.
    first = 9.80665 * ((0.2 + 0.25 * 0.3) * np.cos(q) + 0.08 * np.cos(q + other))
    second = 9.80665 * 0.08 * np.cos(q + other)
    weight = 0.5 * first if joint == 1 else 2.0 * second
    return weight + np.where(qd > 0, 0.4 + 0.2 * qd, -0.3 + 0.1 * qd)


def runs(postures: tuple[float, ...], speeds: tuple[float, ...], *, seed: int = 1) -> tuple[Run, ...]:
    """Both joints in these postures (rad) of the other, at these speeds (rad/s), both ways, two of each."""
    rng, out = np.random.default_rng(seed), []
    for joint in (1, 2):
        for other in postures:
            for speed in (s * sign for s in speeds for sign in (1, -1) for _ in range(2)):
                course = worlds.course(
                    "constant", -1.5 * np.sign(speed), 1.5 * np.sign(speed), duration=3.0 / abs(speed)
                )
                exact = pendulum_current(joint, course[1], other=other, qd=course[2])
                noisy = exact + rng.normal(0.0, NOISE, len(exact))
                out.append(worlds.run_of(worlds.PENDULUM, joint, [other, other], course=course, current=noisy))
    return tuple(out)


@pytest.fixture(scope="module")
def fitted():
    """Runs in two postures at two speeds, and the model of them."""
    dataset = Dataset(runs((0.0, 1.0), (0.4, 1.0)))
    return dataset, pumaid.identify(dataset, worlds.PENDULUM)


def made(dataset: Dataset, estimate, robot: Robot = worlds.PENDULUM) -> Comparison:
    """`compare`, told which arm."""
    return compare(estimate, dataset, robot)


def test_scores_are_those_of_every_sample(fitted):
    """RMSE and bias of a run, computed from its bins, are those of the samples one by one."""
    course = worlds.course("constant", -1.0, 1.2, duration=2.0, samples=333)
    current = pendulum_current(2, course[1], other=0.5, qd=course[2]) + 0.1 * np.sin(9.0 * course[1])
    run = worlds.run_of(worlds.PENDULUM, 2, [0.5, 0.0], course=course, current=current)
    score = made(Dataset((run,)), fitted[1]).runs[0]
    values = {value.name: value.value for value in fitted[1].values}
    q, lean = course[1], np.array([0.5, 0.0])
    # Link 2 weighs on joint 2 by (z x g) . x and (z x g) . y of its frame: g turned through the sum of both angles.
    up = 9.80665 * np.array([np.cos(q + lean[0]), -np.sin(q + lean[0])])
    weight = values["gravity.l2.x"] * up[0] + values["gravity.l2.y"] * up[1]
    predicted = weight + values["coulomb.j2.plus"] + values["viscous.j2.plus"] * course[2]
    residual = current - predicted
    assert score.rmse == pytest.approx(np.sqrt(np.mean(residual**2)), rel=2e-3)
    assert score.bias == pytest.approx(np.mean(residual), rel=1e-3)


def test_error_is_the_models_and_the_noise(fitted):
    """On fitted runs the error is what identify says, the noise (10 %: some 2000 samples) and the noise floor."""
    comparison = made(*fitted)
    assert [score.rmse for score in comparison.joints] == pytest.approx([fit.rmse for fit in fitted[1].joints])
    for score in comparison.joints:
        assert score.rmse == pytest.approx(NOISE, rel=0.1) and score.noise_floor == pytest.approx(NOISE, rel=0.1)
        assert sum(score.shares.values()) == pytest.approx(1.0, abs=1e-12)
        assert score.shares[UNEXPLAINED] == pytest.approx((score.rmse / score.rms) ** 2, abs=2e-3)
    for run in comparison.runs:
        assert np.allclose(sum(run.parts.values()), run.predicted, atol=1e-12)
    floors = {score.joint: score.noise_floor for score in comparison.joints}
    ranks = [score.rmse / floors[score.run.joint] for score in comparison.worst(99)]
    assert ranks == sorted(ranks, reverse=True)


def test_predicts_a_posture_that_it_never_saw(fitted):
    """Two postures determine all, so a third is predicted to the noise."""
    comparison = made(Dataset(runs((-0.7,), (0.7,), seed=2)), fitted[1])
    assert comparison.rmse == pytest.approx(NOISE, rel=0.15)
    assert not any(score.undetermined for score in comparison.runs)


def test_one_speed_tells_friction_as_a_sum():
    """A model of one speed knows what friction takes, not how much of it is Coulomb's; two speeds tell it."""
    # The share of the sum is the truth's, however the solution splits it.
    for speeds, told in (((0.4, 1.0), {"coulomb", "viscous"}), ((0.4,), {"coulomb+viscous"})):
        dataset = Dataset(runs((0.0, 1.0), speeds))
        comparison = made(dataset, pumaid.identify(dataset, worlds.PENDULUM))
        for score in comparison.joints:
            assert set(score.shares) == told | {"gravity", UNEXPLAINED}
            assert sum(score.shares.values()) == pytest.approx(1.0, abs=1e-12)
        assert all(set(score.parts) == told | {"gravity"} for score in comparison.runs)
    q, friction = np.linspace(-1.5, 1.5, 1000), {1: 0.4 + 0.2 * 0.4, -1: -0.3 - 0.1 * 0.4}
    pairs = [(other, sign) for other in (0.0, 1.0) for sign in friction]
    whole = np.array([pendulum_current(2, q, other=other, qd=np.full(1000, 0.4 * sign)) for other, sign in pairs])
    part = np.array([[friction[sign]] for _, sign in pairs])
    truth = np.mean(whole * part) / np.mean(whole**2)
    assert comparison.joints[1].shares["coulomb+viscous"] == pytest.approx(truth, abs=0.01)


def test_a_short_way_tells_weight_and_friction_as_a_sum():
    """Over a hundredth of a radian in one direction weight is as constant as friction: nothing is told apart."""
    made_runs = []
    for joint in (1, 2):
        course = worlds.course("constant", 0.300, 0.310, duration=1.0)
        current = pendulum_current(joint, course[1], other=0.5, qd=course[2])
        noisy = current + np.random.default_rng(joint).normal(0.0, NOISE, len(current))
        made_runs.append(worlds.run_of(worlds.PENDULUM, joint, [0.5, 0.5], course=course, current=noisy))
    dataset = Dataset(tuple(made_runs))
    for score in made(dataset, pumaid.identify(dataset, worlds.PENDULUM)).joints:
        assert set(score.shares) == {"gravity+coulomb+viscous", UNEXPLAINED}


@pytest.mark.parametrize("seed", range(2))
def test_an_unknown_ratio_does_not_hide_weight(seed):
    """One posture leaves ratios of gains open, but what weighs and what rubs is told apart in every joint."""
    robot = worlds.arm("RRRR", [TURN, 0.4, 0.9, -0.6])
    truth = worlds.drawn(robot, seed)
    dataset = worlds.dataset(truth, worlds.experiment(robot, postures=1, speeds=(0.3, 0.9)), seed=seed)
    for score in made(dataset, pumaid.identify(dataset, robot), robot).joints:
        assert not [name for name in score.shares if "+" in name]


def test_flags_another_speed_or_posture(fitted):
    """A model of one speed does not know what another takes, one of one posture not the weight in another."""
    estimate = pumaid.identify(Dataset(runs((0.0, 1.0), (0.4,))), worlds.PENDULUM)
    flags = {abs(score.run.speed): score for score in made(fitted[0], estimate).runs}
    assert not flags[0.4].undetermined
    assert flags[1.0].undetermined and "viscous.j2" in flags[1.0].reason
    estimate = pumaid.identify(Dataset(runs((0.0,), (0.4, 1.0))), worlds.PENDULUM)
    other = [score for score in made(Dataset(runs((1.3,), (0.4,))), estimate).runs if score.run.joint == 1]
    assert all(score.undetermined for score in other)


def test_a_fitted_log_is_never_flagged():
    """Runs of a log that was fitted are known, whatever is undetermined elsewhere."""
    dataset = Dataset(runs((0.0,), (0.4,)), files=FACTS)
    estimate = pumaid.identify(dataset, worlds.PENDULUM)
    comparison = made(dataset, estimate)
    assert not any(score.undetermined for score in comparison.runs)
    assert "compared-with-fitted" in [note.slug for note in comparison.notes]


def test_flags_a_stroke_whose_inertia_is_unknown(fitted):
    """A stroke compared with a model of constant speeds only is scored, and said to lack its inertia."""
    course = worlds.course("stroke", -1.0, 1.0)
    current = pendulum_current(1, course[1], other=0.0, qd=course[2]) + 0.7 * course[3]
    stroke = worlds.run_of(worlds.PENDULUM, 1, [0.0, 0.0], course=course, current=current)
    score = made(Dataset((stroke,)), fitted[1]).runs[0]
    assert score.undetermined and "inertia is missing" in score.reason
    assert score.rmse == pytest.approx(0.7 * np.sqrt(np.mean(course[3] ** 2)), rel=0.05)


def test_heldout_runs_are_apart(fitted):
    """Held-out runs do not enter the joints' error but have their own, also without others; no runs are no error."""
    spoilt = [replace(run, heldout=True) for run in runs((0.5,), (0.6,), seed=3)]
    comparison = made(Dataset((*fitted[0].runs, *spoilt)), fitted[1])
    assert [score.heldout_runs for score in comparison.joints] == [4, 4]
    assert comparison.rmse == pytest.approx(made(*fitted).rmse, rel=1e-12)
    assert comparison.heldout == pytest.approx(NOISE, rel=0.2)
    assert all(score.rmse is not None for score in made(Dataset(tuple(spoilt)), fitted[1]).joints)
    nothing = made(Dataset(()), fitted[1])
    assert nothing.rmse is None and nothing.joints[0].noise_floor_reason


def warming(run: Run, start: float) -> Run:
    """The run begun at `start` (s), with friction that falls as the joint warms up."""
    time = run.bins.time + start
    current = run.bins.current + 0.2 * run.direction * np.exp(-time / 300.0)
    return replace(run, start=start, bins=replace(run.bins, time=time, current=current))


def test_the_floor_is_that_of_the_model_that_stands():
    """Replicates that a warm-up sets apart are no noise to a model with warm-up: its floor is the noise again."""
    passes = [*runs((0.0, 1.0), (0.4, 1.0)), *runs((0.0, 1.0), (0.4, 1.0), seed=2)]
    dataset = Dataset(tuple(warming(run, 20.0 * n) for n, run in enumerate(passes)))
    without = pumaid.identify(dataset, worlds.PENDULUM)
    assert without.joint(1).noise_floor > 3.0 * NOISE
    warm = tuple(EffectChoice("warmup", joint) for joint in (1, 2))
    estimate = pumaid.identify(dataset, worlds.PENDULUM, effects=warm)
    for score in (*estimate.joints, *made(dataset, estimate).joints):
        assert score.rmse == pytest.approx(NOISE, rel=0.1) and score.noise_floor == pytest.approx(NOISE, rel=0.1)


def test_says_that_other_runs_are_held_out(fitted):
    """Runs that the fit saw and that are held out now, and the other way round, are told; the same choice is not."""
    all_of_them = Dataset(runs((0.0, 1.0), (0.4, 0.8)), files=FACTS)
    some = replace(all_of_them, runs=tuple(replace(run, heldout=n % 2 > 0) for n, run in enumerate(all_of_them.runs)))
    for fitted_to, now in ((all_of_them, some), (some, all_of_them)):
        estimate = pumaid.identify(fitted_to, worlds.PENDULUM)
        told = [note for note in made(now, estimate).notes if note.slug == "held-out-otherwise"]
        assert len(told) == 1 and "joint 1" in told[0].text
        assert "held-out-otherwise" not in [note.slug for note in made(fitted_to, estimate).notes]
        other = replace(now, files=(replace(FACTS[0], digest="d2"),))
        assert "held-out-otherwise" not in [note.slug for note in made(other, estimate).notes]
