"""Ripple along strokes, whose bins lie at uneven places, in few runs and in places far apart."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from searches import LEVER
from worlds import course, run_of

from pumaid.diagnosis.periodogram import spectrum
from pumaid.estimation.fit import FitRow
from pumaid.estimation.gls import fit_with_replicates
from pumaid.joint_bins import joint_bins
from pumaid.model import Model

#: A wave of 90 periods a turn, and 0.02 A of noise in a bin.
WAVE, NOISE = 90.0, 0.02


def waves_of(row, **more):
    """The spectrum of what a fit leaves of a joint."""
    return spectrum(row.bins, row.noise, row.residual, **more)


@cache
def row(kind: str, runs: int, amplitude: float, seed: int = 0, apart: float = 0.0) -> FitRow:
    """Runs there and back with such a wave and noise, 300 bins each, and what the base model leaves of them.

    Every other pair of runs is made `apart` (rad) from the others.
    """
    rng, made = np.random.default_rng(seed), []
    for number in range(runs):
        start, end = (-1.5, 1.5) if number % 2 else (1.5, -1.5)
        away = apart * (number // 2 % 2)
        path = course(kind, start + away, end + away, duration=3.0, samples=300)
        current = np.sign(path[2]) + amplitude * np.cos(WAVE * path[1] + 0.7) + rng.normal(0.0, NOISE, 300)
        made.append(run_of(LEVER, 1, [0.0], course=path, current=current, bins=300))
    model = Model(LEVER, [(1, (0.0,))] if kind == "stroke" else ())
    return fit_with_replicates(model, joint_bins(LEVER, made, most=300)).row(1)


def by_hand(one: FitRow, frequency: float) -> np.ndarray:
    """(R,) complex: the products of the whitened residual with the whitened wave, run by run."""
    angle = frequency * one.bins.samples.position[:, 0]
    wave = one.noise.whiten(one.bins, np.column_stack([np.cos(angle), np.sin(angle)]))
    return np.asarray(one.bins.sums(wave * one.residual[:, None]) @ [1.0, 1.0j])


def test_scores_of_strokes_are_products_with_the_waves():
    """Every 20th frequency: within 3 % of the largest, what sharing out to the grid costs at its top."""
    one = row("stroke", 12, 0.05)
    found = waves_of(one)
    direct = np.array([by_hand(one, frequency) for frequency in found.frequency[::20]]).T
    assert np.abs(found.scores[:, ::20] - direct).max() < 0.03 * np.abs(found.scores).max()


def test_information_of_strokes_is_half_the_square_of_both_waves():
    """Mean of the squares of whitened cosine and sine, within 3 %."""
    one = row("stroke", 12, 0.05)
    found = waves_of(one)
    for frequency, information in zip(found.frequency[10::40], found.information[10::40], strict=True):
        angle = frequency * one.bins.samples.position[:, 0]
        wave = one.noise.whiten(one.bins, np.column_stack([np.cos(angle), np.sin(angle)]))
        assert information == pytest.approx(0.5 * np.sum(wave**2), rel=0.03)


@pytest.mark.parametrize("kind", ["constant", "stroke"])
@pytest.mark.parametrize("runs", [1, 3, 12])
def test_a_wave_is_found_where_it_is(kind, runs):
    """Within half a resolution, its size within 20 % (7 by the grid, the rest noise), and no flip comes near."""
    found = waves_of(row(kind, runs, 0.05))
    top = int(np.argmax(found.statistic()))
    assert found.frequency[top] == pytest.approx(WAVE, abs=np.pi / 3.0)
    assert np.abs(found.scores.sum(axis=0)[top]) / found.information[top] == pytest.approx(0.05, rel=0.2)
    flips = np.random.default_rng(1).choice([-1.0, 1.0], (199, runs))
    assert np.quantile(found.highest(flips), 0.95) < 0.6 * found.statistic()[top]


def test_runs_in_places_far_apart_are_one_course():
    """Runs of 3 rad at 0 and at 20 rad: found to a tenth of what the whole way resolves, at its full size."""
    found = waves_of(row("constant", 12, 0.05, apart=20.0))
    top = int(np.argmax(found.statistic()))
    assert found.frequency[top] == pytest.approx(WAVE, abs=0.2 * np.pi / 23.0 + 0.5 * np.diff(found.frequency[:2])[0])
    assert np.abs(found.scores.sum(axis=0)[top]) / found.information[top] == pytest.approx(0.05, rel=0.15)


def test_beside_a_wave_that_is_known_there_is_no_other():
    """The highest of what is left lies two resolutions of a run away from it at least."""
    found = waves_of(row("stroke", 12, 0.05), without=[WAVE])
    top = found.frequency[int(np.argmax(found.statistic()))]
    assert abs(top - WAVE) >= 2.0 * 2.0 * np.pi / 3.0
