"""`compare`: exact scores, honest flags, where the rest lives; the oracle works sample by sample."""

from dataclasses import replace

import budgets
import numpy as np
import pytest
import worlds
from budgets import campaign, found, shares, split

import pumaid
from pumaid.dataset import Dataset, FileFacts, Run
from pumaid.diagnosis.compare import budget, compare
from pumaid.estimation.evaluate import UNEXPLAINED, Comparison
from pumaid.joint_bins import joint_bins
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


#: What is left by each kind of physics, A; the part and variable that it must be told as.
KINDS = {
    ("smooth", "position"): lambda q, qd, since, clock, other: 0.03 * np.sin(2.0 * q),
    ("smooth", "direction"): lambda q, qd, since, clock, other: 0.03 * np.sign(qd) * np.sin(2.0 * q),
    ("smooth", "posture"): lambda q, qd, since, clock, other: 0.06 * (other - 0.5) * np.sin(q),
    ("fast", "position"): lambda q, qd, since, clock, other: 0.03 * np.cos(37.3 * q + 0.5),
    ("start", "travel"): lambda q, qd, since, clock, other: -0.1 * np.sign(qd) * np.exp(-since * np.abs(qd) / 0.1),
    ("odd", "speed"): lambda q, qd, since, clock, other: 0.1 * np.sign(qd) * np.exp(-((np.abs(qd) / 0.3) ** 2)),
    ("odd", "direction"): lambda q, qd, since, clock, other: 0.03 * np.sign(qd),
    ("odd", "posture"): lambda q, qd, since, clock, other: 0.06 * np.sign(qd) * (other - 0.5),
    ("even", "direction"): lambda q, qd, since, clock, other: np.full(len(q), 0.03),
    ("even", "posture"): lambda q, qd, since, clock, other: np.full(len(q), 0.06 * (other - 0.5)),
    ("time", "time"): lambda q, qd, since, clock, other: 0.06 * np.sign(qd) * ((clock > 960.0) - 0.5),
    ("time", "even"): lambda q, qd, since, clock, other: 0.06 * (clock / 960.0 - 1.0),
}


@pytest.mark.parametrize("kind", KINDS, ids="/".join)
def test_each_dependence_lands_in_its_part(kind):
    """What was put in is the largest part and its variable is named; others are a tenth at most, and all add up."""
    told = split(campaign(KINDS[kind], seed=11))
    values = [part.mean_square for part in told.parts]
    assert sum(values) == pytest.approx(told.mean_square, rel=1e-12) and min(values) >= 0.0
    parts = sorted((part for part in told.parts if part.is_more), key=lambda part: -part.mean_square)
    assert parts[0].name == kind[0] and kind[1] in parts[0].against
    assert sum(part.mean_square for part in parts[1:]) < 0.1 * parts[0].mean_square


@pytest.mark.parametrize("kind", [("smooth", "position"), ("odd", "speed"), ("time", "even")])
def test_share_is_that_of_what_was_put_in(kind):
    """Over 8 experiments a part's mean is the mean square that was put in: chance is not counted to it."""
    seen, true = [], []
    for seed in range(40, 48):
        told = split(campaign(KINDS[kind], seed=seed))
        bare = joint_bins(worlds.PENDULUM, campaign(KINDS[kind], seed=seed, noise=0.0), is_settled=False)[0]
        seen.append(told.part(kind[0]).mean_square)
        true.append(bare.mean_square)
    error = np.std(np.array(seen) - true, ddof=1) / np.sqrt(len(seen))
    assert abs(np.mean(seen) - np.mean(true)) < 3.0 * error + 0.05 * np.mean(true)


def test_noise_is_split_into_levels_and_the_rest():
    """Of noise alone, what runs share is the variance of their levels, the rest that inside runs: means of 10."""
    told = [split(campaign(seed=seed)) for seed in range(60, 70)]
    shared = np.mean([one.part("noise_shared").mean_square for one in told])
    inside = np.mean([one.part("noise_inside").mean_square for one in told])
    assert shared == pytest.approx(budgets.LEVEL**2, rel=0.25)
    assert inside == pytest.approx(budgets.NOISE**2, rel=0.1)


def test_what_has_no_name_is_unassigned():
    """A current that repeats with posture and speed together is no single dependence: it stays unassigned."""

    def odd_one(q, qd, since, clock, other):
        key = int(10.0 * abs(qd[0])) + 100 * int(other) + (qd[0] > 0)
        return np.full(len(q), 0.05 * np.random.default_rng(key).standard_normal())

    told = split(campaign(odd_one, seed=2, speeds=(0.2, 0.4, 0.6, 0.8, 1.0, 1.2), others=(0.0, 0.7, 1.4, 2.1)))
    assert told.part("unassigned").is_more
    assert told.part("unassigned").mean_square > 0.3 * (told.mean_square - told.noise)


@pytest.mark.parametrize(
    ("joint", "per", "cycles", "gearing"),
    [({"gear_ratio": 18.65}, "turn", 37.3, (2.0,)), ({"kind": "prismatic"}, "m", 37.3 / (2.0 * np.pi), ())],
)
def test_a_ripple_has_its_frequency_and_gearing(joint, per, cycles, gearing):
    """37.3 rad a rad are as many cycles a turn, two of the motor's; of a slide 37.3 rad a metre are 5.94 a metre."""
    laid = joint_bins(worlds.PENDULUM, campaign(KINDS["fast", "position"], seed=1), is_settled=False)[0]
    part = budget(laid, laid.current, replace(worlds.PENDULUM.joint(2), **joint), is_fitted=False).part("fast")
    assert part.per == per and part.cycles[0] == pytest.approx(cycles, abs=0.1)
    assert part.gearing == pytest.approx(gearing, abs=0.01)


def test_load_is_told_from_position():
    """Friction that grows with the load is told as that where postures change the load, and only if it is known."""

    def load(q, other):
        return np.cos(q + other)

    runs = campaign(
        lambda q, qd, since, clock, other: 0.08 * np.sign(qd) * np.abs(load(q, other)), seed=9, others=(0.0, 1.2, 2.4)
    )
    laid = joint_bins(worlds.PENDULUM, runs, is_settled=False)[0]
    known = np.concatenate([load(run.bins.position[:, 1], run.posture[0]) for run in runs])
    told = budget(laid, laid.current, worlds.PENDULUM.joint(2), load=known)
    assert found(told)["odd"][0] == "load" and "no-load" not in told.limits
    assert "no-load" in budget(laid, laid.current, worlds.PENDULUM.joint(2)).limits


def test_without_repeats_levels_stay_open():
    """Where no run is repeated, what differs from run to run is unassigned, untested, and said to be so."""
    told = split(campaign(seed=12, repeats=1))
    assert "no-replicates" in told.limits and told.replicates == 0 and told.floor is None
    assert told.part("noise_shared").mean_square == 0.0
    assert told.part("unassigned").mean_square == pytest.approx(budgets.LEVEL**2, rel=0.8)
    assert not told.part("unassigned").is_more


@pytest.mark.parametrize(
    ("design", "slug"),
    [
        ({"ways": (1,)}, "one-direction"),
        ({"others": (0.0,)}, "one-posture"),
        ({"speeds": (0.5,)}, "one-speed"),
        ({"speeds": (0.4, 0.8)}, "two-speeds"),
        ({"kind": "stroke"}, "strokes"),
        ({"others": (0.0,), "speeds": (0.5,)}, "few-runs"),
    ],
)
def test_thin_data_say_what_they_cannot_split(design, slug):
    """Each lack is named; the parts still add up, and noise is not called physics."""
    told = split(campaign(seed=21, **design))
    assert slug in told.limits and found(told) == {}
    assert sum(part.mean_square for part in told.parts) == pytest.approx(told.mean_square, rel=1e-12)


def test_few_runs_show_a_ripple_and_claim_no_more():
    """Two runs show a ripple; what is slow in them is left open, since it may be noise."""
    left = KINDS["fast", "position"]
    runs = campaign(
        lambda *at: left(*at) + 0.1 * np.sin(at[0]), seed=2, others=(0.0,), speeds=(0.5,), ways=(1,), repeats=2
    )
    told = split(runs)
    assert set(found(told)) == {"fast"} and told.part("fast").cycles[0] == pytest.approx(37.3, abs=0.3)
    assert shares(told)["unassigned"] > 0.5 and not told.part("unassigned").is_more


def test_recordings_with_own_clocks_are_compared_within_each():
    """A level that differs between two recordings is no drift: nothing is told of time."""
    runs = campaign(seed=13)
    shifted = [replace(run, clock=1, bins=replace(run.bins, current=run.bins.current + 0.1)) for run in runs[::2]]
    told = split([*shifted, *runs[1::2]])
    assert "several-clocks" in told.limits and "time" not in found(told)


def test_an_exact_model_leaves_nothing_to_tell():
    """Rounding is no physics: every cause is nothing, and no number is lost."""
    told = split(campaign(noise=0.0))
    assert told.mean_square == 0.0 and {part.mean_square for part in told.parts} == {0.0}
    tiny = split(campaign(lambda q, *_: 1e-9 * np.sin(q), noise=0.0))
    assert found(tiny) == {}
