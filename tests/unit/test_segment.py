"""The one pass: what it keeps of a run, and what it does with what it cannot use."""

from dataclasses import replace

import numpy as np
import pytest

from pumaid.dataset import Log
from pumaid.preprocessing.binning import SegmentOptions
from pumaid.preprocessing.segment import segment
from pumaid.robot import Joint, Robot

ARM = Robot("arm", (Joint(1, "base", "revolute"), Joint(2, "arm", "revolute"), Joint(3, "slide", "prismatic")))


def log(*, joint=2, speed=0.5, ramp=0.1, hold=2.0, rate=500.0, origin="a.csv", start=0.0, noise=0.0, **more):
    """Rest, ramp, constant speed, ramp, rest of one joint; current 1 + 2 cos q + 3 sin q + noise."""
    fine = np.concatenate([np.zeros(200), np.ones(round(ramp * 1000)) * speed / ramp, np.zeros(round(hold * 1000))])
    rate_of_speed = np.concatenate([fine, -np.ones(round(ramp * 1000)) * speed / ramp, np.zeros(400)])
    way = np.cumsum(np.cumsum(rate_of_speed)) * 1e-6
    time = np.arange(0.0, len(way) / 1000 - 0.001, 1 / rate)
    position = np.tile([0.3, -0.2, 0.1], (len(time), 1))
    position[:, joint - 1] += np.interp(time, np.arange(len(way)) / 1000, way)
    q = position[:, [joint - 1]]
    rng = np.random.default_rng(0)
    current = 1 + 2 * np.cos(q) + 3 * np.sin(q) + noise * rng.standard_normal((len(time), 3))
    rows = np.arange(len(time)) + 2
    return Log(origin, rows, time + start, position, None, current, starts_clock=start == 0.0, **more)


def reasons(dataset):
    """Reasons of the rejects in order."""
    return [reject.reason for reject in dataset.rejects]


def changed(column, values, rows=slice(None), joint=slice(None), **course):
    """A log with other values in a column, or a function of its old ones and of time."""
    one = log(**course)
    table = getattr(one, column).copy()
    table[rows, joint] = values(table[rows, joint], one.time[rows]) if callable(values) else values
    return replace(one, **{column: table})


def test_one_trapezoid_is_one_run():
    """Joint, kind, speed, span, posture and what is left out are those of the command."""
    dataset = segment([log()], ARM)
    (run,) = dataset.runs
    assert (run.joint, run.kind, run.direction) == (2, "constant", 1)
    assert run.speed == pytest.approx(0.5, rel=1e-6)
    assert run.span == pytest.approx((-0.175, 0.825), abs=0.05)
    np.testing.assert_allclose(run.posture, [0.3, np.nan, 0.1], atol=1e-9)
    assert reasons(dataset) == ["rest", "ramp", "ramp", "rest"]


def test_cells_are_the_samples_means():
    """Count-weighted means of the bins are the means over the run's samples, their spread included."""
    one = log(rate=1000.0, noise=0.2)
    one = replace(one, temperature=np.tile([20.0, 31.0, 40.0], (len(one), 1)))
    (run,) = segment([one], ARM, options=SegmentOptions(max_bins=40)).runs
    part = slice(run.first_row - 2, run.last_row - 1)
    weights = run.bins.count
    np.testing.assert_allclose(np.average(run.bins.current, weights=weights), one.current[part, 1].mean())
    np.testing.assert_allclose(np.average(run.bins.time, weights=weights), one.time[part].mean())
    assert len(run.bins) == 40 and run.temperature == pytest.approx(31.0) and run.samples == weights.sum()
    assert np.average(run.bins.variance, weights=weights) == pytest.approx(0.04, rel=0.1)
    np.testing.assert_allclose(run.bins.velocity, 0.5, atol=1e-6)


def test_runs_of_many_turns_keep_a_fast_ripple():
    """Of a run of ten turns, means over 256 bins a turn still hold three quarters of a ripple of 100 waves a turn."""
    one = log(speed=10.0, hold=6.3, rate=5000.0)
    current = np.cos(100.0 * one.position)
    (run,) = segment([replace(one, current=current)], ARM).runs
    own = run.bins.position[:, 1]
    assert len(run.bins) == pytest.approx(256 * np.ptp(own) / (2.0 * np.pi), rel=0.02)
    assert 2.0 * np.mean(run.bins.current * np.cos(100.0 * own)) == pytest.approx(np.sinc(100 / 256), rel=0.03)


@pytest.mark.parametrize(("ramp", "hold", "kind"), [(1.0, 0.0, "stroke"), (0.1, 2.0, "constant")])
def test_a_triangle_of_speed_is_a_stroke(ramp, hold, kind):
    """A movement without constant speed becomes one stroke whose acceleration is the command's."""
    (run,) = segment([log(ramp=ramp, hold=hold)], ARM).runs
    assert run.kind == kind
    if kind == "stroke":
        quarter = len(run.bins) // 4
        np.testing.assert_allclose(run.bins.acceleration[quarter // 2 : quarter], 0.5, rtol=0.02)


def test_a_run_ends_with_its_file():
    """Files that share a clock: the border cuts a run in two, which hold all its samples; a new clock is counted."""
    one = log()
    half = 400
    first = replace(one.part(slice(half)), starts_clock=True)
    second = replace(one.part(slice(half, None)), origin="b.csv", rows=np.arange(len(one) - half) + 2)
    runs = segment([first, second], ARM).runs
    assert [(run.origin, run.clock) for run in runs] == [("a.csv", 0), ("b.csv", 0)]
    assert sum(run.samples for run in runs) == pytest.approx(segment([one], ARM).runs[0].samples, abs=5)
    assert [run.clock for run in segment([one, log(origin="b.csv")], ARM).runs] == [0, 1]


@pytest.mark.parametrize(
    ("spoilt", "reason", "samples"),
    [
        (changed("current", np.nan, slice(300, 310), 1), "no-current", 10),
        (changed("current", np.nan), "no-current", 0),
        (changed("position", [[np.inf], [1e298]], slice(500, 502), slice(0, 1)), "not-a-number", 2),
        (changed("position", lambda q, t: q + 0.0085 * t, joint=0, hold=2.9), "drift-of-held-joint", 0),
    ],
    ids=["current lost", "no current", "garbage", "drift"],
)
def test_what_cannot_be_used_is_left_out_by_name(spoilt, reason, samples):
    """Currents that are missing, absurd positions, a creep that adds up; a run goes on around single samples."""
    dataset = segment([spoilt], ARM)
    counts = {reject.reason: reject.samples for reject in dataset.rejects}
    assert counts[reason] == (samples or counts[reason]) and len(dataset.runs) == bool(samples)
    assert all(np.isfinite(run.bins.current).all() for run in dataset.runs)


@pytest.mark.parametrize(("lost", "is_bridged"), [(40, True), (60, False)])
def test_positions_that_are_missing_for_a_moment_are_bridged(lost, is_bridged):
    """Up to a tenth of a second a stroke goes on as it was, without currents there; beyond, it is cut."""
    whole, part = log(ramp=1.0, hold=0.0), slice(560, 560 + lost)
    spoilt = changed("position", np.nan, part, 1, ramp=1.0, hold=0.0)
    runs = segment([spoilt], ARM).runs
    assert [run.kind for run in runs] == ["stroke"] * is_bridged
    for run, sound in zip(runs, segment([whole], ARM).runs, strict=is_bridged):
        assert run.span == pytest.approx(sound.span, abs=1e-6) and run.samples == sound.samples - lost
        course = np.interp(run.bins.time, sound.bins.time, sound.bins.position[:, 1])
        np.testing.assert_allclose(run.bins.position[:, 1], course, atol=2e-3)


def test_a_little_drift_of_a_held_joint_is_borne_and_motion_of_two_is_not():
    """A creep is borne until it adds up; where both joints move, both are named."""
    assert len(segment([changed("position", lambda q, t: q + 0.003 * t, joint=0, hold=4.0)], ARM).runs) == 1
    one = log()
    both = replace(one, position=one.position[:, [1, 1, 2]])
    (reject,) = (reject for reject in segment([both], ARM).rejects if reject.joints)
    assert (reject.reason, set(reject.joints)) == ("several-joints", {1, 2})


@pytest.mark.parametrize("count", [0, 1, 5, 7])
def test_a_handful_of_samples_is_no_error(count):
    dataset = segment([log().part(slice(count))], ARM)
    assert dataset.runs == ()
    assert sum(reject.samples for reject in dataset.rejects) == count


def test_another_arms_logs_are_refused():
    with pytest.raises(ValueError, match="3 joints, the robot has 1"):
        segment([log()], Robot("one", ARM.joints[:1]))
