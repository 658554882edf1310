"""What repeats between runs: nothing in noise, all of it where physics hides, and the floor between."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from searches import LEVER, Din, Lab, design, lever, pendulum

from pumaid.diagnosis.sign_flip import ReplicateTest, replicate_test
from pumaid.estimation.noise import noise_of
from pumaid.joint_bins import JointBins

DIN = Din(spread=0.01, correlation=0.6, level=0.006)


def shared(field: JointBins, misfit: np.ndarray) -> ReplicateTest | None:
    """ReplicateTest, whitened by the noise that the repeats show."""
    return replicate_test(field, misfit, noise_of(field, misfit).whiten(field, misfit))


def of(lab: Lab, seed: int, pattern: float = 0.0, din: Din = DIN) -> ReplicateTest:
    """ReplicateTest of noise about a course of the position (A) that every run repeats."""
    field = lab.bins()[0]
    drawn = din.draw(np.random.default_rng(seed), field.lengths)
    return shared(field, drawn + pattern * np.sin(4.0 * field.samples.position[:, 0]))


@pytest.mark.parametrize("din", [DIN, Din(is_heavy=True), Din(correlation=0.9, level=0.02)])
def test_noise_repeats_by_chance_alone(din):
    """Over 100 experiments chances are even or told up to twice too small: docs/statistics.md owns up to that.

    The noise by which runs are whitened is taken from the differences of the same pairs, and flips do not undo that.
    """
    found = np.array([of(lever(), seed, din=din).p_value for seed in range(100)])
    for level, told in ((0.05, 0.1), (0.5, 0.65)):
        assert (
            stats.binom.ppf(0.001, 100, level) <= np.count_nonzero(found <= level) <= stats.binom.ppf(0.999, 100, told)
        )


def test_what_repeats_is_seen_below_the_noise():
    """A course of half the noise's size is called chance in fewer than one of ten experiments."""
    size = np.sqrt(2.0) * 0.5 * np.hypot(0.01, 0.006)
    found = [of(lever(), seed, size).p_value for seed in range(30)]
    assert np.count_nonzero(np.array(found) > 0.01) <= 3


@pytest.mark.parametrize(("length", "size"), [(1, 0.0025), (8, 0.007)])
def test_fast_and_slow_courses_are_seen_in_slow_noise(length, size):
    """In 0.014 A of slow noise, what is fast is seen at a sixth of it, what changes every 8 bins at half of it."""
    lab, din = lever(), Din(spread=0.01, correlation=0.95, level=0.01)
    field, found = lab.bins()[0], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        own = np.repeat(rng.normal(0.0, size, 200), length)[: int(field.lengths.max())]
        course = np.concatenate([own[:count] for count in field.lengths])
        found.append(shared(field, din.draw(rng, field.lengths) + course).p_value)
    assert np.count_nonzero(np.array(found) > 0.01) <= 2


@pytest.mark.parametrize("pattern", [0.0, 0.05])
def test_the_floor_is_the_noise_whatever_repeats(pattern):
    """Half the mean squared difference of repeats is spread and level together, within 3 %."""
    found = np.mean([of(lever(), seed, pattern).floor ** 2 for seed in range(40)])
    assert np.sqrt(found) == pytest.approx(np.hypot(0.01, 0.006), rel=0.03)


def test_the_share_is_that_of_the_mean_square():
    """Physics of variance V in noise of variance N repeats with V / (V + N)."""
    own = 0.05**2 * np.mean(np.sin(4.0 * lever().bins()[0].samples.position[:, 0]) ** 2)
    found = np.mean([of(lever(), seed, 0.05).share for seed in range(30)])
    assert found == pytest.approx(own / (own + 0.01**2 + 0.006**2), rel=0.05)


def test_what_changes_in_time_does_not_repeat():
    """A warm-up makes repeats differ: it raises the floor and is no reason to call what is left physics of position."""
    lab = pendulum()
    field = lab.bins()[0]
    warm = 0.05 * field.samples.direction * np.exp(-field.samples.time / (0.2 * field.samples.time.max()))
    plain, moved = (shared(field, DIN.draw(np.random.default_rng(1), field.lengths) + c) for c in (0.0, warm))
    assert moved.floor > 1.2 * plain.floor


def test_too_few_pairs_say_nothing():
    """Of three pairs every flip that matters comes up one time in eight."""
    lab = Lab.of(LEVER, design(LEVER, postures=1, speeds=(0.5,), repeats=3))
    field = lab.bins()[0]
    assert len(field.pairs) == 4 and replicate_test(field, np.ones(len(field)), np.ones(len(field))) is not None
    short = lab.bins(lab.runs[:4])[0]
    assert len(short.pairs) < 4 and replicate_test(short, np.ones(len(short)), np.ones(len(short))) is None
