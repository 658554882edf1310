"""A finding's picture: bins, error bars and lines are what a slow loop over the cells gives."""

import numpy as np
import pytest
import worlds

from pumaid.diagnosis.diagnose import SLOWEST, Trial, curve
from pumaid.effect_spec import EffectTerm
from pumaid.effects import Samples, catalogue


def falling(velocity: float) -> EffectTerm:
    """s a exp(-v / velocity)."""
    return EffectTerm(catalogue()["stribeck"], 2, {"velocity": velocity, "exponent": 1.0})


SPEEDS = (0.1, 0.3, 0.6, 1.0)


def bins(seed: int = 0, *, bins: int = 40, repeats: int = 2) -> Samples:
    """Joint 2 of the pendulum at four speeds, both ways, each run twice."""
    rng, runs = np.random.default_rng(seed), []
    for number, (speed, way) in enumerate([(v, s) for v in SPEEDS for s in (1, -1)] * repeats):
        ones = np.ones(bins)
        q = np.linspace(-1.5, 1.5, bins) * way + rng.uniform(-0.01, 0.01)
        runs.append((q, way * speed * ones * (1 + 1e-3 * rng.normal(size=bins)), way * ones, number * ones))
    q, v, way, run = (np.concatenate(part) for part in zip(*runs, strict=True))
    zeros = np.zeros_like(q)
    travel = np.tile(np.linspace(0.0, 3.0, bins), 2 * len(SPEEDS) * repeats)
    position, velocity = np.column_stack([zeros, q]), np.column_stack([zeros, v])
    more = {"direction": way, "time": run * 5.0, "travel": travel, "temperature": zeros * np.nan, "run": run}
    return Samples(2, position, velocity, acceleration=zeros, **more)


def without_line(samples: Samples, values: np.ndarray) -> np.ndarray:
    """What Coulomb and viscous friction of each direction leave of `values`."""
    speed = samples.velocity[:, 1]
    forward = samples.direction > 0
    base = np.column_stack([forward, ~forward, speed * forward, speed * ~forward])
    return values - base @ np.linalg.lstsq(base, values, rcond=None)[0]


def test_bins_are_means_over_runs():
    """Means and standard errors of each speed are those of the runs' own means."""
    samples = bins()
    before, after = np.random.default_rng(1).normal(size=(2, len(samples)))
    found = curve(worlds.PENDULUM, samples, before=before, trials=[Trial(falling(0.2), [0.1], after)])
    runs = [n for n in np.unique(samples.run) if samples.direction[samples.run == n][0] < 0]
    slow = [n for n in runs if abs(samples.velocity[samples.run == n, 1].mean()) < 0.2]
    means = [after[samples.run == n].mean() for n in slow]
    back = found.sides[1]
    assert back.direction == -1 and len(back.centres) == len(SPEEDS) and back.runs.tolist() == [2.0] * 4
    assert back.after[0] == pytest.approx(np.mean(means), rel=1e-12)
    assert back.errors[0] == pytest.approx(np.std(means, ddof=1) / np.sqrt(2), rel=1e-12)


def test_rivals_part_below_the_slowest_run():
    """Two scales that agree on the speeds run differ where nobody ran, and the picture goes there."""
    samples = bins()
    left = without_line(samples, 0.1 * falling(0.2).linear(worlds.PENDULUM, samples)[:, 0])
    trials = [Trial(falling(scale), np.array([0.1]), 0.0 * left) for scale in (0.2, 0.1)]
    lines = curve(worlds.PENDULUM, samples, before=left, trials=trials).lines
    first, rival = lines[0], lines[2]
    gap = np.abs(np.interp(first.places, rival.places, rival.values) - first.values)
    assert first.places[0] == pytest.approx(SLOWEST * min(SPEEDS), rel=0.01)
    assert gap[0] > 2.0 * np.abs(np.interp(min(SPEEDS), first.places, gap))


def test_a_ripple_is_folded_on_its_period():
    """Over one period the bins show the wave that many periods hide."""
    samples, effect = bins(bins=400), EffectTerm(catalogue()["ripple"], 2, {"frequency": 40.0})
    wave = 0.05 * np.cos(40.0 * samples.position[:, 1])
    trial = Trial(effect, np.array([0.05, 0.0]), 0.0 * wave)
    found = curve(worlds.PENDULUM, samples, before=wave, trials=[trial])
    side = found.sides[0]
    assert found.period == pytest.approx(2 * np.pi / 40.0)
    assert side.before == pytest.approx(0.05 * np.cos(40.0 * side.centres), abs=2e-3)  # a bin is 1/32 of a period
