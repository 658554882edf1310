"""Speed, edges and settling from position alone, against courses known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from pumaid.dataset import Bins
from pumaid.preprocessing.edge import Window, leaving
from pumaid.preprocessing.reduce import coarser
from pumaid.preprocessing.settle import settled
from pumaid.preprocessing.speed import Ticks, at_least, derivatives, slopes, usual_step, whole


def test_slopes_of_a_jittered_line_are_exact():
    """Irregular time does not bend a constant speed."""
    rng = np.random.default_rng(0)
    time = np.sort(rng.uniform(0.0, 2.0, 300))
    np.testing.assert_allclose(slopes(time, 3.0 - 0.7 * time, 4), -0.7, rtol=1e-6)


def test_derivatives_pass_a_parabola_unbent():
    """Velocity and acceleration of constant acceleration are exact."""
    time = np.arange(500) / 250.0
    velocity, acceleration = derivatives(time, 1.0 + 0.5 * time + 0.8 * time**2, 0.2)
    np.testing.assert_allclose(velocity, 0.5 + 1.6 * time, atol=1e-8)
    np.testing.assert_allclose(acceleration, 1.6, atol=1e-6)


def test_derivatives_of_a_handful_do_not_fail():
    """Five samples still have a slope."""
    velocity, acceleration = derivatives(np.arange(5) / 10.0, 0.3 * np.arange(5), 0.2)
    np.testing.assert_allclose(velocity, 3.0)
    np.testing.assert_array_equal(acceleration, 0.0)


@pytest.mark.parametrize("rate", [50.0, 1000.0, 4000.0])
def test_tick_noise_is_that_of_a_mean(rate):
    """A tick's noise is the sample noise over the root of its samples, whatever moves."""
    rng = np.random.default_rng(1)
    time = np.arange(round(20 * rate)) / rate
    position = np.sin(0.5 * time) + 1e-3 * rng.standard_normal(len(time))
    ticks = Ticks.of(time, position[:, None], step=usual_step(time))
    size = ticks.edges[1] - ticks.edges[0]
    assert ticks.noise[0] == pytest.approx(1e-3 / np.sqrt(size), rel=0.15)


def test_a_coarse_encoder_asks_for_a_longer_line():
    """The fit lengthens until the encoder's step cannot pass for a speed."""
    time = np.arange(4000) / 1000.0
    position = np.round(0.02 * time / 1e-3) * 1e-3
    step = usual_step(time)
    coarse = Ticks.of(time, position[:, None], step=step)
    fine = Ticks.of(time, 0.02 * time[:, None], step=step)
    assert coarse.quantum[0] == pytest.approx(1e-3)
    assert coarse.half_width(1, 1e-3) > fine.half_width(1, 1e-3)


@pytest.mark.parametrize(("power", "strength"), [(1, 0.3), (2, 1.0), (3, 6.0)])
def test_an_edge_is_found_and_not_passed(power, strength):
    """Over many noises the edge is never late by more than the noise can hide, and early by little."""
    time = np.arange(400) / 1000.0
    course = 0.5 * time + strength * np.maximum(0.0, time - 0.3) ** power
    errors = []
    for seed in range(40):
        noise = 1e-4 * np.random.default_rng(seed).standard_normal(len(time))
        errors.append(leaving([Window(time, course + noise, 200)])[0] - 0.3)
    # Where the departure reaches two standard deviations of one sample it cannot hide any more.
    visible = (2e-4 / strength) ** (1 / power)
    assert max(errors) < visible
    assert np.median(errors) > -0.03


def test_a_line_that_goes_on_has_no_edge():
    """Noise alone is no departure."""
    time = np.arange(300) / 1000.0
    noises = [np.random.default_rng(seed).standard_normal(300) for seed in range(40)]
    ends = leaving([Window(time, 0.4 * time + 1e-4 * noise, 150) for noise in noises])
    assert sum(end < time[-1] for end in ends) <= 1


def test_ringing_is_dropped_and_calm_kept():
    """The first 10 % of ringing decays with 50 ms; what stays rings by less than 2 % and little calm is lost."""
    time = np.arange(2000) / 1000.0
    rng = np.random.default_rng(3)
    ring = 0.1 * np.exp(-time / 0.05) * np.sin(2 * np.pi * 12 * time)
    calm = 0.5 * time + 2e-5 * rng.standard_normal(2000)
    start, stop = settled(time, calm + 0.5 * np.cumsum(ring) / 1000)
    assert 0.08 < time[start] < 0.3
    assert stop > 1950
    assert settled(time, calm) == (0, 2000)


def test_coarser_cells_keep_sums_and_spread():
    """Joining bins keeps count, means and the variance of all samples about the new means."""
    rng = np.random.default_rng(5)
    current = rng.standard_normal(600).cumsum()
    single = np.ones(600, dtype=np.int64)
    zero = np.zeros(600)
    time = np.arange(600) / 100.0
    fine = Bins(single, time, np.zeros((600, 2)), zero, zero, current, zero, np.full(600, 30.0))
    joined = coarser([fine], 10)
    assert joined.count.sum() == 600
    np.testing.assert_allclose(np.average(joined.current, weights=joined.count), current.mean())
    blocks = np.array_split(current, np.cumsum(joined.count)[:-1])
    np.testing.assert_allclose(joined.variance, [block.var() for block in blocks])
    np.testing.assert_allclose(joined.temperature, 30.0)


@pytest.mark.parametrize("rate", [25.0, 125.0, 500.0])
def test_a_step_is_the_clock_s_however_its_stamps_are_rounded(rate):
    """Seconds since 1970, microseconds, float32 and a gap: the same step, and the same number of samples in a tick."""
    time = np.arange(2000) / rate
    found = [
        usual_step(stamps)
        for stamps in (
            time,
            time + 1.7e9,
            np.round(time + 0.3333337, 6),
            (time + 500.0).astype(np.float32).astype(float),
            np.delete(time, slice(700, 900)),
        )
    ]
    assert found == pytest.approx([1.0 / rate] * 5, rel=1e-4)
    assert len({whole(0.02 / step) for step in found}) == 1


def test_counts_are_whole_whatever_the_last_digits_say():
    """Half a sample more or less in the last digits is the same count."""
    assert {whole(2.5 + d) for d in (-1e-12, 0.0, 1e-12, 3e-5, -3e-5)} == {3} and whole(3.5) == 4 and whole(2.6) == 3
    assert at_least(4.0 + 1e-12) == 4 and at_least(4.01) == 5
