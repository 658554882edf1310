"""Where straight lines of position end, and where ringing has died down."""

from __future__ import annotations

import numpy as np
import pytest

from pumaid.preprocessing.constant_velocity import departure, settled


@pytest.mark.parametrize(("power", "strength"), [(1, 0.3), (2, 1.0), (3, 6.0)])
def test_an_edge_is_found_and_not_passed(power, strength):
    """Over many noises the edge is never late by more than the noise can hide, and early by little."""
    time = np.arange(400) / 1000.0
    course = 0.5 * time + strength * np.maximum(0.0, time - 0.3) ** power
    errors = []
    for seed in range(40):
        noise = 1e-4 * np.random.default_rng(seed).standard_normal(len(time))
        errors.append(departure(time, course + noise, sure=200) - 0.3)
    # Where the departure reaches two standard deviations of one sample it cannot hide any more.
    visible = (2e-4 / strength) ** (1 / power)
    assert max(errors) < visible
    assert np.median(errors) > -0.03


def test_a_line_that_goes_on_has_no_edge():
    """Noise alone is no departure."""
    time = np.arange(300) / 1000.0
    noises = [np.random.default_rng(seed).standard_normal(300) for seed in range(40)]
    ends = [departure(time, 0.4 * time + 1e-4 * noise, sure=150) for noise in noises]
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
