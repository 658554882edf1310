"""When samples were taken, judged on motions whose instants of sampling are known."""

import numpy as np
import pytest

from pumaid.dataset import Log
from pumaid.io.log_reader import LogReader
from pumaid.preprocessing.clock import GROUP, sampling_times
from pumaid.robot import Joint, Robot


def arm(rate, *, seed=0, jitter=0.0, seconds=60.0, encoder=1e-5, speed=1.2):
    """True instants (s) and positions (rad) of a joint that swings, beside one that is held."""
    rng = np.random.default_rng(seed)
    size = round(seconds * rate)
    time = (np.arange(size) + 1.0 + jitter * rng.uniform(-0.5, 0.5, size)) / rate
    phase = rng.uniform(0.0, 6.0)
    swing = speed * np.sin(0.8 * time + phase) + 0.2 * np.sin(2.3 * time)
    return time, np.round(np.column_stack([swing, np.full(size, 0.4)]) / encoder) * encoder


def off(time, truth):
    """RMS (s) by which times are not the true ones, a constant apart."""
    return float(np.std(time - truth))


#: What becomes of true instants, with random numbers at hand; single precision is of the seconds of a day.
STAMPS = {
    "whole milliseconds": lambda time, rng: np.floor(time * 1e3) / 1e3,
    "single precision": lambda time, rng: np.round(time / 2.0**-9) * 2.0**-9,
    "arrival": lambda time, rng: np.sort(time + rng.exponential(0.001, len(time))),
}


@pytest.mark.parametrize("seed", [11, 12])
@pytest.mark.parametrize(
    ("stamps", "rate", "lost"),
    [
        *(("whole milliseconds", rate, 0.0) for rate in (62.3, 137.0, 300.0, 700.0)),
        ("whole milliseconds", 137.0, 0.02),
        ("single precision", 137.0, 0.0),
        ("arrival", 125.0, 0.0),
    ],
)
def test_stamps_are_freed_of_most_of_their_errors(stamps, rate, seed, lost):
    """Rounded, or written when a message arrives, with or without lost samples; the note's figure is the error."""
    rng = np.random.default_rng(seed)
    time, position = arm(rate, seed=seed)
    logged = rng.random(len(time)) >= lost
    time, position = time[logged], position[logged]
    wrong = STAMPS[stamps](time, rng)
    out, error = sampling_times(wrong, position)
    assert off(out, time) < 0.5 * off(wrong, time) and (np.diff(out) > 0).all()
    assert error == pytest.approx(off(wrong, time), rel=0.25)


@pytest.mark.parametrize(("rate", "jitter"), [(100.0, 0.05), (500.0, 0.3), (100.0, 0.8)])
@pytest.mark.parametrize("seed", [31, 32])
def test_true_stamps_of_an_uneven_sampler_stay_to_the_bit(rate, jitter, seed):
    time, position = arm(rate, seed=seed, jitter=jitter)
    out, error = sampling_times(time, position)
    assert error == 0.0
    assert out is time


def test_a_sampler_that_is_late_now_and_then_is_believed():
    time, position = arm(1000.0, seed=41)
    rng = np.random.default_rng(41)
    late = np.maximum.accumulate(time + (rng.random(len(time)) < 0.02) * rng.exponential(0.002, len(time)))
    late += 1e-7 * np.arange(len(late))
    held = np.column_stack([np.interp(late, time, column) for column in position.T])
    assert sampling_times(late, held)[1] == 0.0


def test_stamps_are_believed_where_nothing_moves_or_little_is_seen():
    time, position = arm(137.0, seed=6)
    stamps, few = np.floor(time * 1e3) / 1e3, slice(0, 4 * GROUP)
    assert sampling_times(stamps, np.full_like(position, 0.3))[0] is stamps
    assert sampling_times(stamps[few], position[few])[1] == 0.0
    even = np.arange(20_000) / 125.0
    assert sampling_times(even, np.sin(even)[:, None])[0] is even


@pytest.mark.parametrize(("rate", "polled"), [(125.0, 500.0), (125.0, 130.0), (29.4, 30.0), (50.0, 500.0)])
def test_a_log_written_more_often_than_it_is_measured_is_read_as_measured(tmp_path, rate, polled):
    """Rows that repeat the row before in motion are left out, and the others are as even as they were measured."""
    measured, position = arm(rate)
    stamps = np.arange(measured[0], measured[-1], 1.0 / polled)
    latest = np.searchsorted(measured, stamps, side="right") - 1
    table = np.column_stack([stamps, position[latest], np.sin(7.0 * latest), np.cos(5.0 * latest)])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="t,q1,q2,i1,i2", comments="")
    reader = LogReader(str(tmp_path / "log.csv"), Robot("arm", tuple(Joint(k, f"j{k}", "revolute") for k in (1, 2))))
    log = Log.joined(list(reader))
    out, _ = sampling_times(log.time, log.position, log.repeats)
    assert [note.slug for note in reader.notes][:1] == ["bad-samples"]
    assert len(log) == pytest.approx(len(measured), rel=0.02)
    assert off(out, measured[latest[log.rows - 2]]) < 0.04 / rate
