"""Acceleration read from positions: against the motion that made them, through jitter and quantisation."""

from __future__ import annotations

import numpy as np
import pytest

from pumaid.maths.slope import acceleration


def wavering(size: float, *, step: float = 0.0, seed: int = 3) -> tuple:
    """Times that jitter by whole milliseconds, positions quantised by `step`, and the true acceleration."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.integers(9, 12, size=500) * 1e-3)
    q = 0.5 * t + size / (2 * np.pi * 3.0) ** 2 * np.sin(2 * np.pi * 3.0 * t)
    read = step * np.round(q / step) if step else q
    return t, read, -size * np.sin(2 * np.pi * 3.0 * t)


@pytest.mark.parametrize("step", [0.0, 2e-5])
def test_waves_of_the_speed_are_seen(step):
    """3 waves a second on a steady speed, at uneven steps of time: 95 % of the acceleration's square is told."""
    t, q, truth = wavering(1.0, step=step)
    left = acceleration(t, q) - truth
    assert np.mean(left[10:-10] ** 2) < 0.05 * np.mean(truth**2)


@pytest.mark.parametrize("seed", range(20))
def test_a_steady_speed_has_none(seed):
    """Steps of time that differ, and a sensor's noise, are no acceleration."""
    t, q, _ = wavering(0.0, step=2e-5, seed=seed)
    assert not acceleration(t, q).any()
    noise = np.random.default_rng(seed).normal(0.0, 1e-4, len(q))
    assert not acceleration(t, q + noise).any()


def test_waves_below_the_sensors_noise_are_none():
    """A twentieth of the smallest acceleration that one sample of noise would make is not told."""
    t, q, _ = wavering(0.01)
    noise = np.random.default_rng(0).normal(0.0, 1e-3, len(q))
    assert not acceleration(t, q + noise).any()


@pytest.mark.parametrize("count", [0, 1, 5, 8])
def test_too_few_samples_tell_nothing(count):
    """Nothing, and no error, for runs of fewer samples than a polynomial needs."""
    assert acceleration(np.arange(float(count)), np.arange(float(count)) ** 2).tolist() == [0.0] * count
