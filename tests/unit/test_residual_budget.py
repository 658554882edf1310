"""The residual budget on runs whose contents are known: parts, shares, what is refused."""

from dataclasses import replace

import budgets
import numpy as np
import pytest
import worlds
from budgets import campaign, found, shares, split

from pumaid.diagnosis.compare import budget
from pumaid.joint_bins import joint_bins

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
