"""All frequencies at once are what a cosine and a sine, added to the fit one after the other, would gain."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from searches import LEVER, Din, Lab, design, left, roots

from pumaid.dataset import Run
from pumaid.diagnosis.periodogram import Spectrum, spectrum
from pumaid.estimation.fit import FitRow, loaded
from pumaid.estimation.gls import fit_with_replicates
from pumaid.joint_bins import joint_bins
from pumaid.simulation import Hidden

CELLS = 256


def waves_of(row, **more):
    """The spectrum of what a fit leaves of a joint."""
    return spectrum(row.bins, row.noise, row.residual, **more)


@cache
def lab(amplitude: float = 0.0, frequency: float = 40.0, repeats: int = 2) -> Lab:
    """A lever with fine bins whose motor may have a ripple."""
    plan = design(LEVER, speeds=(0.5, 1.0), repeats=repeats)
    values = {"cos": amplitude, "sin": 0.5 * amplitude, "frequency": frequency}
    return Lab.of(LEVER, plan, *([Hidden("ripple", 1, values)] if amplitude else []), bins=CELLS)


def row_of(some: Lab, seed: int = 2) -> FitRow:
    """One experiment with noise, its fit on all bins."""
    return solved_row(some, some.noisy(seed))


def solved_row(some: Lab, runs: tuple[Run, ...]) -> FitRow:
    """The fit of these runs on all their bins."""
    return loaded(fit_with_replicates(some.model, joint_bins(some.robot, runs, most=CELLS))).row(1)


def dense(row: FitRow, frequency: float) -> tuple[np.ndarray, float]:
    """Scores of cosine and sine, and the fall of the square with both added to the fit, from dense whitening."""
    q = row.bins.samples.position[:, 0]
    waves = np.column_stack([np.cos(frequency * q), np.sin(frequency * q)])
    whole = np.column_stack([row.plain, waves, row.misfit])
    parts = np.split(whole, row.bins.first[1:])
    white = np.vstack([root @ part for root, part in zip(roots(row.bins, row.noise), parts, strict=True)])
    p = row.plain.shape[1]
    fall = left(white[:, :p], white[:, -1]) - left(white[:, :-1], white[:, -1])
    return white[:, p:-1].T @ white[:, -1], fall


def nearest(found: Spectrum, frequency: float) -> int:
    """The place of a frequency."""
    return int(np.abs(found.frequency - frequency).argmin())


@pytest.mark.parametrize("amplitude", [0.0, 0.02])
def test_scores_are_those_of_dense_waves(amplitude):
    """Cosine and sine parts at five frequencies, within 3 % of the scores' own size (the grid's leak)."""
    row = row_of(lab(amplitude))
    found = waves_of(row)
    for place in np.linspace(0, len(found.frequency) - 1, 5).astype(int):
        total, size = found.scores[:, place].sum(), np.sqrt(found.information[place])
        expected = dense(row, float(found.frequency[place]))[0]
        assert abs(complex(*expected) - complex(total.real, total.imag)) < 0.03 * (size + abs(total)) + 0.05 * size


def test_statistics_are_the_fall_of_the_square():
    """At the eight highest, within 6 % (the ends of runs and what the base model absorbs are left out)."""
    row = row_of(lab(0.02))
    found = waves_of(row)
    statistic = found.statistic()
    for place in np.argsort(-statistic)[:8]:
        assert statistic[place] == pytest.approx(dense(row, float(found.frequency[place]))[1], rel=0.06, abs=0.3)


def test_the_peak_is_at_the_ripple():
    """Its frequency within a step, though its amplitude is that of the noise of a bin."""
    found = waves_of(row_of(lab(0.01)))
    step = found.frequency[1] - found.frequency[0]
    assert abs(found.frequency[int(found.statistic().argmax())] - 40.0) <= step
    assert found.statistic().max() > 100.0


def test_frequencies_go_from_three_periods_to_two_cells_a_period():
    """Closer than two fifths of a resolution, so that no peak falls between."""
    row = row_of(lab())
    found, way = waves_of(row), np.ptp(row.bins.samples.position[:, 0])
    width = way / (np.median(row.bins.lengths) - 1)
    assert found.frequency[0] == pytest.approx(3.0 * 2.0 * np.pi / way, rel=0.2)
    assert 0.85 * np.pi / width < found.frequency[-1] < np.pi / width
    assert np.diff(found.frequency).max() <= 2.0 * np.pi / way / 2.5 * 1.001


def test_in_noise_each_frequency_is_chi_square_of_two():
    """Mean 2 and variance 4 over frequencies and experiments: within 5 and 15 %, correlated noise and all."""
    some = lab()
    values = []
    for seed in range(12):
        row = row_of(some, seed)
        values.append(waves_of(row).statistic() / float(row.residual @ row.residual) * len(row.residual))
    values = np.concatenate(values)
    assert values.mean() == pytest.approx(2.0, rel=0.05)
    assert values.var() == pytest.approx(4.0, rel=0.15)


def test_flips_are_of_whole_runs():
    """The highest of all frequencies under given signs is what a loop over runs and frequencies gives."""
    found = waves_of(row_of(lab()))
    rng = np.random.default_rng(0)
    signs = rng.choice([-1.0, 1.0], size=(5, len(found.scores))) * 1.1
    expected = []
    for flip in np.sign(signs):
        total = sum(sign * scores for sign, scores in zip(flip, found.scores, strict=True))
        expected.append(max(abs(t) ** 2 / i for t, i in zip(total, found.information, strict=True)))
    np.testing.assert_allclose(found.highest(signs), expected, rtol=1e-12)


def test_of_few_runs_pieces_are_flipped():
    """Two runs cannot show by whole signs that noise has no ripple; sixteen pieces can, of noise and of ripple."""
    found = []
    for amplitude in (0.0, 0.02):
        some = lab(amplitude, 90.0)
        runs = some.noisy(0, Din(level=0.0))[:2]
        one = waves_of(solved_row(some, runs))
        assert one.is_pieces and len(one.scores) >= 12
        highest = one.highest(np.ones((199, 2)))
        found.append(float(np.mean(highest >= one.statistic().max())))
    assert found[0] > 0.05
    assert found[1] < 0.01


def test_runs_of_few_cells_have_no_frequencies():
    """Four bins a run show nothing that a fit has not taken."""
    some = Lab.of(LEVER, design(LEVER, speeds=(1.0,)), bins=4)
    assert waves_of(some.fitted(some.noisy(0)).row(1)) is None
