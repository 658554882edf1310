"""Speed and acceleration from positions alone, against courses known in closed form."""

import numpy as np
import pytest

from pumaid.preprocessing.differentiate import acceleration, round_half_up, slopes, usual_step, velocity


@pytest.mark.parametrize("half", [1, 4])
def test_slopes_are_straight_lines_through_neighbours(half):
    """As least squares give them, at uneven times and at the ends."""
    random = np.random.default_rng(half)
    time, values = np.cumsum(random.uniform(0.5, 1.5, 40)), random.normal(size=40)
    near = [slice(max(0, k - half), k + half + 1) for k in range(40)]
    wanted = [np.polyfit(time[part] - time[part].mean(), values[part], 1)[0] for part in near]
    np.testing.assert_allclose(slopes(time, values, half), wanted, rtol=1e-9, atol=1e-9)


def test_velocity_passes_a_parabola_unbent():
    time = np.arange(500) / 250.0
    np.testing.assert_allclose(velocity(time, 1.0 + 0.5 * time + 0.8 * time**2, 0.2), 0.5 + 1.6 * time, atol=1e-8)


@pytest.mark.parametrize("rate", [25.0, 125.0, 500.0])
def test_a_step_is_the_clock_s_however_its_stamps_are_rounded(rate):
    """Seconds since 1970, microseconds, float32 and a gap: the same step, and the same number of samples in a tick."""
    time = np.arange(2000) / rate
    rounded = (np.round(time + 0.3333337, 6), (time + 500.0).astype(np.float32).astype(float))
    found = [usual_step(stamps) for stamps in (time, time + 1.7e9, *rounded, np.delete(time, slice(700, 900)))]
    assert found == pytest.approx([1.0 / rate] * 5, rel=1e-4)
    assert len({round_half_up(0.02 / step) for step in found}) == 1


def wavering(size: float, *, step: float = 0.0, seed: int = 3) -> tuple:
    """Times that jitter by whole milliseconds, positions quantised by `step`, and the true acceleration."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.integers(9, 12, size=500) * 1e-3)
    q = 0.5 * t + size / (2 * np.pi * 3.0) ** 2 * np.sin(2 * np.pi * 3.0 * t)
    return t, step * np.round(q / step) if step else q, -size * np.sin(2 * np.pi * 3.0 * t)


@pytest.mark.parametrize("step", [0.0, 2e-5])
def test_waves_of_the_speed_are_seen(step):
    """3 waves a second on a steady speed, at uneven time steps: 95 % of the acceleration's square is found."""
    t, q, truth = wavering(1.0, step=step)
    rest = acceleration(t, q) - truth
    assert np.mean(rest[10:-10] ** 2) < 0.05 * np.mean(truth**2)


@pytest.mark.parametrize("seed", range(5))
def test_a_steady_speed_has_no_acceleration(seed):
    """Time steps that differ, and a sensor's noise, are no acceleration; neither are waves below the noise."""
    t, q, _ = wavering(0.0, step=2e-5, seed=seed)
    noise = np.random.default_rng(seed).normal(0.0, 1e-4, len(q))
    assert not acceleration(t, q).any()
    assert not acceleration(t, q + noise).any()
    assert not acceleration(t, wavering(0.01, seed=seed)[1] + 10.0 * noise).any()


@pytest.mark.parametrize("count", [0, 1, 5, 8])
def test_too_few_samples_have_no_acceleration(count):
    """Zeros, and no error, for runs of fewer samples than a cubic needs."""
    assert acceleration(np.arange(float(count)), np.arange(float(count)) ** 2).tolist() == [0.0] * count
