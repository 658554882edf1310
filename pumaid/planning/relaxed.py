"""The best experiment that could be if laps could be made by halves: where to look, and how far a plan is from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.planning.criterion import Criterion
from pumaid.planning.menu import Menu

Floats = NDArray[np.float64]

#: Steps at most, and how near (in the logarithm of the error) is near enough.
STEPS, NEAR = 120, 0.01
#: Power of the multiplicative step: 1/2 never overshoots for the geometric mean; a little more is faster.
_STRIDE = 0.7


@dataclass(frozen=True, eq=False, slots=True)
class Relaxed:
    """`weights` (L,): how often each lap is made; `value` of the criterion; a `bound` below which no design gets."""

    weights: Floats
    value: float
    bound: float


def relaxed(menu: Menu, criterion: Criterion, *, seconds: Floats, total: float, steps: int = STEPS) -> Relaxed:
    """Share out `total` s among laps by multiplicative steps.

    Parameters
    ----------
    menu
        The laps.
    criterion
        What is to be small.
    seconds
        (L,) s that a lap costs.
    total
        s in all.
    steps
        At most.

    Source
    ------
    S. D. Silvey, D. M. Titterington and B. Torsney, Communications in Statistics A 7 (1978) 1379-1389 (the steps); the
    bound is that of a convex function by its slopes.
    """
    weights = np.full(len(menu), total / np.sum(seconds))
    best = Relaxed(weights, np.inf, -np.inf)
    for _ in range(steps):
        information = menu.information(weights)
        value = float(criterion.value(information))
        rate = menu.worth(criterion.pull(information)) / seconds
        mean = float(np.sum(weights * seconds * rate) / total)
        bound = value - 0.5 * (float(rate.max()) / mean - 1.0)
        best = Relaxed(weights, value, max(best.bound, bound))
        if best.value - best.bound < NEAR:
            break
        weights = weights * (rate / mean) ** _STRIDE
        weights *= total / np.sum(weights * seconds)
    return best
