"""When samples were taken, judged on motions whose instants of sampling are known."""

from __future__ import annotations

import numpy as np
import pytest

from pumaid.preprocessing.clock import GROUP, sampling_times


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


@pytest.mark.parametrize("rate", [62.3, 125.3, 137.0, 300.0, 490.0, 700.0])
@pytest.mark.parametrize("seed", [11, 12])
def test_stamps_in_whole_milliseconds_are_freed_of_their_rounding(rate, seed):
    time, position = arm(rate, seed=seed)
    stamps = np.floor(time * 1e3) / 1e3
    out, error = sampling_times(stamps, position)
    assert error == pytest.approx(1e-3 / np.sqrt(12.0), rel=0.2)
    assert off(out, time) < 0.5 * off(stamps, time)
    assert (np.diff(out) > 0).all()


@pytest.mark.parametrize("resolution", [2.0**-10, 2.0**-9, 2.0**-8])
def test_single_precision_seconds_of_a_day_are_freed_of_their_steps(resolution):
    time, position = arm(137.0, seed=3)
    stamps = np.round(time / resolution) * resolution
    out, _ = sampling_times(stamps, position)
    assert off(out, time) < 0.35 * off(stamps, time)


@pytest.mark.parametrize("seed", [21, 22, 23])
def test_stamps_of_arrival_are_freed_of_most_of_their_delays(seed):
    time, position = arm(125.0, seed=seed)
    rng = np.random.default_rng(seed)
    stamps = np.sort(time + rng.exponential(0.001, len(time)))
    out, error = sampling_times(stamps, position)
    assert error > 0.0
    assert off(out, time) < 0.5 * off(stamps, time)


@pytest.mark.parametrize("jitter", [0.05, 0.3, 0.8])
@pytest.mark.parametrize("rate", [100.0, 500.0])
@pytest.mark.parametrize("seed", [31, 32, 33])
def test_true_stamps_of_an_uneven_sampler_stay_to_the_bit(rate, jitter, seed):
    time, position = arm(rate, seed=seed, jitter=jitter)
    out, error = sampling_times(time, position)
    assert error == 0.0
    assert out is time


@pytest.mark.parametrize("seed", [41, 42])
def test_a_sampler_that_is_late_now_and_then_is_believed(seed):
    time, position = arm(1000.0, seed=seed)
    rng = np.random.default_rng(seed)
    late = np.maximum.accumulate(time + (rng.random(len(time)) < 0.02) * rng.exponential(0.002, len(time)))
    late += 1e-7 * np.arange(len(late))
    held = np.column_stack([np.interp(late, time, column) for column in position.T])
    assert sampling_times(late, held)[1] == 0.0


def test_lost_samples_are_counted():
    time, position = arm(137.0, seed=5)
    keep = np.random.default_rng(5).random(len(time)) > 0.02
    time, position = time[keep], position[keep]
    stamps = np.floor(time * 1e3) / 1e3
    out, _ = sampling_times(stamps, position)
    assert off(out, time) < 0.5 * off(stamps, time)


def test_stamps_are_believed_where_nothing_moves_or_little_is_seen():
    time, position = arm(137.0, seed=6)
    stamps = np.floor(time * 1e3) / 1e3
    assert sampling_times(stamps, np.full_like(position, 0.3))[0] is stamps
    few = slice(0, 4 * GROUP)
    assert sampling_times(stamps[few], position[few])[1] == 0.0


def test_even_stamps_are_not_touched():
    time = np.arange(20_000) / 125.0
    assert sampling_times(time, np.sin(time)[:, None])[0] is time
