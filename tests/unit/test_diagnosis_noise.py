"""Noise of bins: whitening is an inverse root of the stated covariance, and what is stated is what the bins have."""

from functools import cache

import numpy as np
import pytest
from scipy.linalg import block_diag
from searches import LEVER, Din, Lab, covariances, design, lever
from worlds import course, run_of

from pumaid.dataset import Campaign
from pumaid.estimation.noise import NoiseModel, noise_of
from pumaid.joint_bins import JointBins, joint_bins

#: Draws of noise over which an estimate's mean is taken.
DRAWS = 60


@cache
def uneven() -> JointBins:
    """Runs of 12, 1, 2 and 7 bins."""
    path = course("constant", -1.0, 1.0, duration=2.0, samples=48)
    runs = [run_of(LEVER, 1, [0.0], course=path, current=np.sin(path[1]), bins=bins) for bins in (12, 1, 2, 7)]
    return joint_bins(LEVER, runs, campaign=Campaign.of(runs))[0]


STATED = NoiseModel(
    np.array([0.6, 0.3, 0.9, 0.0]), np.array([0.02, 0.01, 0.03, 0.05]), np.full(4, 0.04), from_replicates=True
)
NO_LEVEL = NoiseModel(STATED.correlation, STATED.spread, np.zeros(4), from_replicates=True)


@pytest.mark.parametrize("stated", [STATED, NO_LEVEL])
def test_whitening_is_an_inverse_root_of_the_covariance(stated):
    """W' W times the covariance that is stated is the identity; unwhitening is W'."""
    root = stated.whiten(uneven(), np.eye(len(uneven())))
    np.testing.assert_allclose(root.T @ root @ block_diag(*covariances(uneven(), stated)), np.eye(22), atol=1e-9)
    v = np.random.default_rng(1).normal(size=len(uneven()))
    np.testing.assert_allclose(stated.unwhiten(uneven(), v), root.T @ v, rtol=1e-10, atol=1e-8)


def estimates(lab: Lab, din: Din, pattern: float = 0.0) -> list[NoiseModel]:
    """What is found in pure noise of a known kind, on a course of the position (A) that every run repeats."""
    (one,) = lab.bins()
    same = pattern * np.sin(5.0 * one.samples.position[:, 0])
    draws = [din.draw(np.random.default_rng(seed), one.lengths) for seed in range(DRAWS)]
    return [noise_of(one, same + drawn) for drawn in draws]


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.8])
@pytest.mark.parametrize("pattern", [0.0, 0.1])
def test_replicates_show_the_noise_whatever_the_model_misses(correlation, pattern):
    """Correlation and spread within 3 %, the level's square within 4 standard errors, beside ten times the physics."""
    din = Din(spread=0.01, correlation=correlation, level=0.006)
    found = estimates(lever(), din, pattern)
    assert all(one.from_replicates for one in found)
    assert np.mean([one.correlation.mean() for one in found]) == pytest.approx(correlation, abs=0.03)
    assert np.mean([one.spread.mean() for one in found]) == pytest.approx(0.01, rel=0.03)
    squares = np.array([float(one.level[0]) ** 2 for one in found])
    assert abs(squares.mean() - 0.006**2) < 4.0 * squares.std() / np.sqrt(DRAWS)


def test_without_replicates_missing_physics_passes_for_noise():
    """The residual alone takes what the runs share for noise: twice the spread here; none where nothing hides."""
    din = Din(spread=0.01, correlation=0.5, level=0.006)
    unrepeated = Lab.of(LEVER, design(LEVER, postures=1, speeds=(0.25, 0.35, 0.5, 0.7, 1.0, 1.5), repeats=1))
    clean, missing = (estimates(unrepeated, din, pattern) for pattern in (0.0, 0.03))
    assert not any(one.from_replicates for one in clean + missing)
    assert np.mean([one.spread.mean() for one in clean]) == pytest.approx(0.01, rel=0.05)
    assert np.mean([one.spread.mean() for one in missing]) > 2.0 * 0.01


def test_short_runs_hide_correlation_and_that_is_mended():
    """With 16 bins a run the plain estimate of a correlation of 0.8 is short by 0.2; what is told is within 0.06."""
    short = Lab.of(LEVER, design(LEVER), bins=16)
    (one,) = short.bins()
    plain = []
    for seed in range(DRAWS):
        parts = np.split(Din(correlation=0.8).draw(np.random.default_rng(seed), one.lengths), one.first[1:])
        centred = [part - part.mean() for part in parts]
        plain.append(sum(c[1:] @ c[:-1] for c in centred) / sum(c @ c for c in centred))
    found = estimates(short, Din(correlation=0.8))
    assert np.mean(plain) < 0.62
    assert np.mean([one.correlation.mean() for one in found]) == pytest.approx(0.8, abs=0.06)
    assert np.mean([one.spread.mean() for one in found]) == pytest.approx(0.01, rel=0.1)


def test_runs_whose_cells_last_otherwise_have_their_own_noise(monkeypatch):
    """Slow runs made noisy and quick ones quiet are told apart, though they repeat in one field."""
    monkeypatch.setattr("pumaid.estimation.noise.FEWEST_BINS", 200)
    (one,) = lever().bins()
    is_slow = np.abs([run.speed for run in one.runs]) < 0.4
    rng, parts = np.random.default_rng(3), []
    for length, slow in zip(one.lengths, is_slow, strict=True):
        parts.append(Din(0.02 if slow else 0.005, 0.7 if slow else 0.2, 0.0).draw(rng, [length]))
    found = noise_of(one, np.concatenate(parts))
    for group, spread, correlation in ((is_slow, 0.02, 0.7), (~is_slow, 0.005, 0.2)):
        np.testing.assert_allclose(found.spread[group], spread, rtol=0.15)
        np.testing.assert_allclose(found.correlation[group], correlation, atol=0.15)


def test_no_noise_at_all_is_not_zero():
    """What a simulation without noise leaves is rounding; a spread of nothing could not be divided by."""
    (one,) = lever().bins()
    assert np.all(noise_of(one, np.zeros(len(one))).spread > 0.0)
