"""Do robots differ, and which: chances that are chances, whatever the errors and however few the robots."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from pumaid.maths.heterogeneity import alike, apart, between, holm, pooled

SIGMAS = np.array([1.0, 2.0, 0.5, 3.0, 1.5, 1.0])


def drawn(rng, count: int, *, spread: float = 0.0, freedom: int = 12):
    """Estimates of `count` robots around one value, with errors that are themselves estimated."""
    sigma = SIGMAS[:count]
    values = 5.0 + spread * rng.standard_normal(count) + sigma * rng.standard_normal(count)
    errors = sigma * np.sqrt(rng.chisquare(freedom, count) / freedom)
    return values, errors, np.full(count, float(freedom))


@pytest.mark.parametrize("count", [2, 3, 6])
def test_equal_robots_are_told_different_as_often_as_promised(count):
    """Of 4000 fleets of equal robots 5 % have a chance below 5 %, errors of twelve degrees of freedom: to 1.2 %."""
    rng = np.random.default_rng(31)
    chances = np.array([alike(*drawn(rng, count)) for _ in range(4000)])
    assert np.mean(chances < 0.05) == pytest.approx(0.05, abs=0.012)


def test_with_equal_known_errors_it_is_the_usual_analysis_of_variance():
    """With errors of equal groups the chance is that of the one-way F test, to a hundredth of it."""
    rng = np.random.default_rng(32)
    groups = [rng.normal(0.3 * k, 1.0, 400) for k in range(3)]
    errors = np.array([np.std(one, ddof=1) / 20.0 for one in groups])
    found = alike(np.array([one.mean() for one in groups]), errors, np.full(3, 399.0))
    assert found == pytest.approx(stats.f_oneway(*groups, equal_var=False).pvalue, rel=0.01)


@pytest.mark.parametrize(("count", "spread"), [(2, 0.0), (4, 0.0), (6, 0.0), (6, 4.0)])
def test_a_robot_of_the_others_kind_seldom_stands_out(count, spread):
    """At 5 % no more than 7 % of robots stand out, also where all of them differ."""
    rng = np.random.default_rng(33)
    chances = np.concatenate([apart(*drawn(rng, count, spread=spread))[1] for _ in range(1500)])
    assert np.mean(chances < 0.05) < 0.07


def test_the_one_that_differs_is_found():
    """One of six is ten of its errors off: it stands out, its distance is told from the others, and none else does."""
    rng = np.random.default_rng(34)
    values, errors, freedoms = drawn(rng, 6)
    values[2] += 10.0
    off, chance = apart(values, errors, freedoms)
    rest = np.delete(np.arange(6), 2)
    assert off[2] == pytest.approx(values[2] - pooled(values[rest], errors[rest])[0], rel=0.3)
    assert chance[2] < 0.01 and np.all(chance[rest] > 0.05)


def test_the_spread_between_robots_is_found():
    """Over 400 fleets of six the mean square of the spread is what was drawn, to 15 %; equal ones have little."""
    rng = np.random.default_rng(35)
    found = [between(*drawn(rng, 6, spread=4.0, freedom=200)[:2]) for _ in range(400)]
    assert np.mean(np.square(found)) == pytest.approx(16.0, rel=0.15)
    assert between(np.full(5, 2.0), SIGMAS[:5]) == 0.0


def test_holm_is_the_slow_rule():
    """Each corrected chance is below a level exactly where the stepwise rule rejects."""
    rng = np.random.default_rng(36)
    chances = rng.uniform(size=9) ** 4
    for level in (0.01, 0.05, 0.2):
        order, rejected = np.argsort(chances), np.zeros(9, dtype=bool)
        for step, one in enumerate(order):
            if chances[one] * (9 - step) >= level:
                break
            rejected[one] = True
        np.testing.assert_array_equal(holm(chances) < level, rejected)
