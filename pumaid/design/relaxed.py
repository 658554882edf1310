"""The best experiment that could be if laps could be made by halves: where to look, and how far a plan is from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.design.criterion import Criterion
from pumaid.design.menu import Menu

Floats = NDArray[np.float64]

#: Steps at most, and by which share the best lap left may be worth more than the mean one when they end: the value is
#: then within half of that of the optimum of the laps left, a logarithm.
STEPS, NEAR = 120, 0.01
#: Power of the multiplicative step: 1/2 never overshoots for the geometric mean; a little more is faster.
_STRIDE = 0.7
#: Where large errors count with a power p it is `_SOFT` / (`_SOFT` + p) of that, or it overshoots; so many times the
#: steps are then made.
_SOFT, _LONGER = 4.0, 2
#: Steps after which laps that get less than this share of the mean lap's time are passed over, until the last look.
_SORTED, _IDLE = (8, 16, 28), 0.05


@dataclass(frozen=True, eq=False, slots=True)
class Relaxed:
    """The optimum.

    Attributes
    ----------
    weights
        (L,) how often each lap is made.
    value, bound
        Of the criterion, and a value below which no experiment of these laps gets.
    worth
        (L,) 0..1: what a second more of each lap would tell there, as a share of the best.
    """

    weights: Floats
    value: float
    bound: float
    worth: Floats


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
        At most; twice as many where large errors count more.

    Source
    ------
    S. D. Silvey, D. M. Titterington and B. Torsney, Communications in Statistics A 7 (1978) 1379-1389 (the steps, and
    how they shrink with the power); the bound is that of a convex function by its slopes.
    """
    longer = _LONGER if criterion.power else 1
    stride = _STRIDE * _SOFT / (_SOFT + criterion.power)
    alive = np.arange(len(menu))
    few, weights = menu, np.full(len(menu), total / np.sum(seconds))
    for step in range(longer * steps):
        if step in [longer * one for one in _SORTED]:
            spent = weights * seconds[alive]
            kept = spent > _IDLE * spent.mean()
            alive, weights = alive[kept], weights[kept]
            few = menu.only(alive)
        # Rounding may make worth a little less than nothing where the information is nearly singular.
        rate = np.maximum(few.worth(criterion.pull(few.information(weights))), 0.0) / seconds[alive]
        mean = 1.0 / total
        if 0.5 * (float(rate.max()) / mean - 1.0) < 0.5 * NEAR and step > longer * _SORTED[-1]:
            break
        weights = weights * (rate / mean) ** stride
        weights *= total / np.sum(weights * seconds[alive])
    whole = np.zeros(len(menu))
    whole[alive] = weights
    information = menu.information(whole)
    value, rate = float(criterion.value(information)), menu.worth(criterion.pull(information)) / seconds
    return Relaxed(whole, value, value - 0.5 * (float(rate.max()) * total - 1.0), rate / float(rate.max()))
