"""The least value between bounds, held against scipy's."""

from __future__ import annotations

import math

import pytest
from scipy import optimize

from pumaid.estimation.noise import least

COSTS = {
    "parabola": (lambda x: (x - 0.3) ** 2, (-1.0, 2.0)),
    "quartic": (lambda x: (x - 1.7) ** 4 + 0.1 * x, (-3.0, 5.0)),
    "corner": (lambda x: abs(x - 0.123), (-2.0, 1.0)),
    "at the lower end": (lambda x: x, (2.0, 3.0)),
    "at the upper end": (lambda x: -math.exp(x), (-1.0, 1.0)),
    "flat": (lambda x: 1.0, (0.0, 1.0)),
    "likelihood": (lambda x: 40.0 * math.log(1.0 + math.exp(-x)) + 9.0 * x, (-10.0, 14.0)),
    "waves": (lambda x: math.sin(3.0 * x) + 0.1 * x * x, (-4.0, 4.0)),
}


@pytest.mark.parametrize("within", [1e-5, 1e-2])
@pytest.mark.parametrize("name", COSTS)
def test_steps_are_those_of_scipy(name, within):
    """Where and what is found, and the points that were looked at, are the same to the bit."""
    cost, bounds = COSTS[name]
    ours, theirs = [], []
    found = least(lambda x: ours.append(float(x)) or cost(x), bounds, within=within)
    other = optimize.minimize_scalar(
        lambda x: theirs.append(float(x)) or cost(x), bounds=bounds, method="bounded", options={"xatol": within}
    )
    assert ours == theirs
    assert found == (other.x, other.fun)
