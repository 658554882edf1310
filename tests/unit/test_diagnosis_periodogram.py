"""All frequencies at once are what a cosine and a sine, added to the fit one after the other, would gain."""

from functools import cache

import numpy as np
import pytest
from searches import LEVER, Din, Lab, design, left, whitened
from worlds import course, run_of

from pumaid.dataset import Run
from pumaid.diagnosis.candidates import Spectrum, spectrum
from pumaid.estimation.fit import FitRow, loaded
from pumaid.estimation.gls import fit_with_replicates
from pumaid.joint_bins import joint_bins
from pumaid.model import Model
from pumaid.simulation import Hidden

BINS = 256
#: A wave of 90 periods a turn along runs of 3 rad, and 0.02 A of noise in a bin.
WAVE, NOISE = 90.0, 0.02


def waves_of(row: FitRow, **more) -> Spectrum | None:
    """The spectrum of what a fit leaves of a joint."""
    return spectrum(("ripple", row.bins.joint), row.bins, row.noise, white=row.residual, **more)


@cache
def lab(amplitude: float = 0.0, frequency: float = 40.0) -> Lab:
    """A lever with fine bins whose motor may have a ripple."""
    values = {"cos": amplitude, "sin": 0.5 * amplitude, "frequency": frequency}
    hidden = [Hidden("ripple", 1, values)] if amplitude else []
    return Lab.of(LEVER, design(LEVER, speeds=(0.5, 1.0)), *hidden, bins=BINS)


def solved_row(some: Lab, runs: tuple[Run, ...]) -> FitRow:
    """The fit of these runs on all their bins."""
    return loaded(fit_with_replicates(some.model, joint_bins(some.robot, runs, most=BINS))).row(1)


@cache
def along(kind: str, runs: int, apart: float = 0.0) -> FitRow:
    """Runs there and back with the wave and noise, 300 bins each, and what the base model leaves of them."""
    # Every other pair of runs is made `apart` (rad) from the others.
    rng, made = np.random.default_rng(0), []
    for number in range(runs):
        start, end = (-1.5, 1.5) if number % 2 else (1.5, -1.5)
        away = apart * (number // 2 % 2)
        path = course(kind, start + away, end + away, duration=3.0, samples=300)
        current = np.sign(path[2]) + 0.05 * np.cos(WAVE * path[1] + 0.7) + rng.normal(0.0, NOISE, 300)
        made.append(run_of(LEVER, 1, [0.0], course=path, current=current, bins=300))
    return fit_with_replicates(Model.of_runs(LEVER, made), joint_bins(LEVER, made, most=300)).row(1)


def dense(row: FitRow, frequency: float) -> tuple[np.ndarray, float]:
    """Scores of cosine and sine, and the fall of the square with both added to the fit, from dense whitening."""
    q = row.bins.samples.position[:, 0]
    waves = np.column_stack([np.cos(frequency * q), np.sin(frequency * q)])
    whole = np.column_stack([row.bare, waves, row.misfit])
    white = whitened(row.bins, row.noise, whole)
    p = row.bare.shape[1]
    fall = left(white[:, :p], white[:, -1]) - left(white[:, :-1], white[:, -1])
    return white[:, p:-1].T @ white[:, -1], fall


@pytest.mark.parametrize("amplitude", [0.0, 0.02])
def test_scores_are_those_of_dense_waves(amplitude):
    """Cosine and sine parts at five frequencies, within 3 % of the scores' own size (the grid's leak)."""
    row = solved_row(lab(amplitude), lab(amplitude).noisy(2))
    found = waves_of(row)
    for place in np.linspace(0, len(found.frequency) - 1, 5).astype(int):
        total, size = found.scores[:, place].sum(), np.sqrt(found.information[place])
        expected = dense(row, float(found.frequency[place]))[0]
        assert abs(complex(*expected) - complex(total.real, total.imag)) < 0.03 * (size + abs(total)) + 0.05 * size


def test_statistics_are_the_fall_of_the_square():
    """At the eight highest, within 6 % (the ends of runs and what the base model absorbs are left out)."""
    row = solved_row(lab(0.02), lab(0.02).noisy(2))
    found = waves_of(row)
    statistic = found.statistic()
    for place in np.argsort(-statistic)[:8]:
        assert statistic[place] == pytest.approx(dense(row, float(found.frequency[place]))[1], rel=0.06, abs=0.3)


@pytest.mark.parametrize("kind", ["constant", "stroke"])
@pytest.mark.parametrize("runs", [1, 3, 12])
def test_a_wave_is_found_where_it_is(kind, runs):
    """Within half a resolution, its size within 20 % (7 by the grid, the rest noise), and no flip comes near."""
    found = waves_of(along(kind, runs))
    top = int(np.argmax(found.statistic()))
    assert found.frequency[top] == pytest.approx(WAVE, abs=np.pi / 3.0)
    assert np.abs(found.scores.sum(axis=0)[top]) / found.information[top] == pytest.approx(0.05, rel=0.2)
    flips = np.random.default_rng(1).choice([-1.0, 1.0], (199, runs))
    assert np.quantile(found.highest(flips), 0.95) < 0.6 * found.statistic()[top]


def test_beside_a_wave_that_is_known_there_is_no_other():
    """The highest of what is left lies two resolutions of a run away from it at least."""
    found = waves_of(along("stroke", 12), without=[WAVE])
    top = found.frequency[int(np.argmax(found.statistic()))]
    assert abs(top - WAVE) >= 2.0 * 2.0 * np.pi / 3.0


def test_in_noise_each_frequency_is_chi_square_of_two():
    """Mean 2 and variance 4 over frequencies and experiments: within 5 and 15 %, correlated noise and all."""
    values = []
    for seed in range(12):
        row = solved_row(lab(), lab().noisy(seed))
        values.append(waves_of(row).statistic() / float(row.residual @ row.residual) * len(row.residual))
    values = np.concatenate(values)
    assert values.mean() == pytest.approx(2.0, rel=0.05)
    assert values.var() == pytest.approx(4.0, rel=0.15)


def test_flips_are_of_whole_runs():
    """The highest of all frequencies under given signs is what a loop over runs and frequencies gives."""
    found = waves_of(solved_row(lab(), lab().noisy(2)))
    signs = np.random.default_rng(0).choice([-1.0, 1.0], size=(5, len(found.scores)))
    expected = []
    for flip in signs:
        total = sum(sign * scores for sign, scores in zip(flip, found.scores, strict=True))
        expected.append(max(abs(t) ** 2 / i for t, i in zip(total, found.information, strict=True)))
    np.testing.assert_allclose(found.highest(1.1 * signs), expected, rtol=1e-5)


@pytest.mark.parametrize(("amplitude", "is_found"), [(0.0, False), (0.02, True)])
def test_of_few_runs_pieces_are_flipped(amplitude, is_found):
    """Two runs cannot show by whole signs that noise has no ripple; sixteen pieces can, of noise and of ripple."""
    some = lab(amplitude, WAVE)
    found = waves_of(solved_row(some, some.noisy(0, Din(level=0.0))[:2]))
    assert found.is_pieces and len(found.scores) >= 12
    chance = float(np.mean(found.highest(np.ones((199, 2))) >= found.statistic().max()))
    assert chance < 0.01 if is_found else chance > 0.05
