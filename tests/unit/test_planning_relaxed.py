"""The best conceivable experiment: optimal by its slopes, and below whatever can be enumerated or drawn."""

from __future__ import annotations

import itertools
from functools import cache

import numpy as np
import pytest
from menus import assumed, small_menu

from pumaid.design.criterion import Criterion
from pumaid.design.menu import Menu
from pumaid.design.relaxed import Relaxed, relaxed

CASES = [(name, power) for name in ("pendulum2", "stanford") for power in (0.0, 12.0)]
#: How far value and bound may lie apart: what the optimiser says is near enough, twice for laps that were passed over
#: early; a power makes its steps short, and it ends earlier.
APART = {0.0: 0.02, 12.0: 0.08}
TOTAL = 900.0


def criterion(name: str, power: float) -> Criterion:
    """Of the errors, or of errors as shares of what is usual."""
    found = small_menu(name)
    sizes = assumed(name).sizes()
    return Criterion(power, np.array([sizes[one] for one in found.names]) if power else np.ones(len(found.names)))


@cache
def best(name: str, power: float) -> Relaxed:
    """The optimum on a small menu."""
    found = small_menu(name)
    return relaxed(found, criterion(name, power), seconds=found.seconds, total=TOTAL)


@pytest.mark.parametrize(("name", "power"), CASES)
def test_time_is_shared_out(name, power):
    """The weights are not negative and take the time that there is, and value is that of the weights."""
    found, menu = best(name, power), small_menu(name)
    assert np.min(found.weights) >= 0.0
    assert found.weights @ menu.seconds == pytest.approx(TOTAL)
    assert criterion(name, power).value(menu.information(found.weights)) == pytest.approx(found.value)
    assert 0.0 <= found.value - found.bound < APART[power]


@pytest.mark.parametrize(("name", "power"), CASES)
def test_no_lap_is_worth_much_more_than_the_mean(name, power):
    """Equivalence theorem: a hundredth of the time given to any one lap gains at most a hundredth of the told gap."""
    found, menu, wanted = best(name, power), small_menu(name), criterion(name, power)
    now, share = menu.information(found.weights), 0.01
    for first in range(0, len(menu), 50):
        laps = np.arange(first, min(first + 50, len(menu)))
        alone = menu.each(laps.tolist()) * (TOTAL / menu.seconds[laps])[:, None, None, None]
        moved = wanted.value((1 - share) * now + share * alone)
        assert np.all(moved >= found.value - share * (found.value - found.bound) - 1e-9)


def test_the_bound_is_the_best_slope():
    """Far from the optimum, too: value less bound is the steepest fall on the way to all time on one lap."""
    menu, wanted, share = small_menu("pendulum2"), criterion("pendulum2", 0.0), 1e-5
    for steps in (0, 3, 30):
        found = relaxed(menu, wanted, seconds=menu.seconds, total=TOTAL, steps=steps)
        alone = menu.each(range(len(menu))) * (TOTAL / menu.seconds)[:, None, None, None]
        moved = wanted.value((1 - share) * menu.information(found.weights) + share * alone)
        assert found.value - found.bound == pytest.approx(np.max(found.value - moved) / share, rel=0.02)


@pytest.mark.parametrize(("name", "power"), CASES)
def test_worth_ranks_laps_by_what_a_second_more_gains(name, power):
    """The share of the best is that of finite differences of the criterion, lap by lap."""
    found, menu, wanted = best(name, power), small_menu(name), criterion(name, power)
    laps = np.random.default_rng(1).choice(len(menu), 30, replace=False)
    laps[0] = int(np.argmax(found.worth))
    now, step = menu.information(found.weights), 1e-4
    more = menu.each(laps.tolist()) / menu.seconds[laps][:, None, None, None]
    gains = wanted.value(now - step * more) - wanted.value(now + step * more)
    assert found.worth.max() == 1.0
    assert gains / gains[0] == pytest.approx(found.worth[laps], rel=1e-3, abs=1e-4)


@pytest.mark.parametrize(("name", "power"), CASES)
def test_no_random_design_beats_the_bound(name, power):
    """200 random shares of the same time, spread thinly or on few laps, and near the best: all lie above the bound."""
    found, menu, rng = best(name, power), small_menu(name), np.random.default_rng(7)
    drawn = []
    for k in range(200):
        spent = rng.dirichlet(np.full(len(menu), 10.0 ** rng.uniform(-2, 1)))
        spent = spent if k % 2 else 0.1 * spent + 0.9 * found.weights * menu.seconds / TOTAL
        drawn.append(float(criterion(name, power).value(menu.information(TOTAL * spent / menu.seconds))))
    assert min(drawn) >= found.bound
    assert min(drawn) < found.value + 0.2  # some of them are good: the claim is not empty


def tiny() -> Menu:
    """Seven laps of a pendulum that together show everything."""
    menu, rng = small_menu("pendulum2", postures=2), np.random.default_rng(11)
    laps = [rng.choice(np.flatnonzero(menu.joint == joint), count, replace=False) for joint, count in ((1, 4), (2, 3))]
    return menu.only(np.sort(np.concatenate(laps)))


@pytest.mark.parametrize("power", [0.0, 12.0])
def test_no_enumerated_design_beats_the_bound(power):
    """Of all 16384 ways to make seven laps up to three times in a time none is better, and the best is near."""
    menu, wanted = tiny(), Criterion(power, np.ones(len(small_menu("pendulum2").names)))
    each, total = menu.each(range(7)), 6.0 * float(np.mean(menu.seconds))
    counts = np.array(list(itertools.product(range(4), repeat=7)))
    counts = counts[(counts @ menu.seconds <= total) & (counts @ menu.seconds > 0)]
    values = np.concatenate(
        [wanted.value(np.einsum("nl,lgpq->ngpq", some, each)) for some in np.array_split(counts, 40)]
    )
    found = relaxed(menu, wanted, seconds=menu.seconds, total=total)
    assert found.bound <= np.min(values)
    assert np.min(values) < found.value + 0.25  # whole laps only: at most a quarter is lost by rounding


@pytest.mark.parametrize("power", [0.0, 12.0])
def test_four_times_the_time_halves_the_errors(power):
    """The optimum's value falls by the logarithm of two, whatever the criterion."""
    menu = small_menu("pendulum2")
    short, long = (
        relaxed(menu, criterion("pendulum2", power), seconds=menu.seconds, total=total) for total in (100.0, 400.0)
    )
    assert short.value - long.value == pytest.approx(np.log(2.0), abs=1e-6)
