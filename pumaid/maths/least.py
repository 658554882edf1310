"""The least value of a function of one number between bounds."""

from __future__ import annotations

import math
from collections.abc import Callable

#: Share of an interval at which a golden section stands.
_GOLDEN = 0.5 * (3.0 - math.sqrt(5.0))
#: Relative distance below which two numbers cost the same to rounding.
_ROUNDING = math.sqrt(2.2e-16)
_MOST_TRIES = 500


def least(cost: Callable[[float], float], bounds: tuple[float, float], *, within: float = 1e-5) -> tuple[float, float]:
    """Where a function with one minimum is least, and its value there.

    Golden sections, and parabolas through the three best points where these lead inwards: as scipy's bounded scalar
    minimisation, whose steps it takes, without what else scipy's optimisers load (longer than an identification takes).

    Parameters
    ----------
    cost
        The function; it is looked at inside the bounds only.
    bounds
        Lowest and highest value.
    within
        How near (beside rounding) the result must come.

    Source
    ------
    R. P. Brent, Algorithms for Minimization without Derivatives (1973), ch. 5; G. E. Forsythe, M. A. Malcolm and
    C. B. Moler, Computer Methods for Mathematical Computations (1977), FMIN.
    """
    low, high = bounds
    best = low + _GOLDEN * (high - low)
    points = [(best, float(cost(best)))] * 3  # best, second, third
    step = before = 0.0
    for _ in range(_MOST_TRIES - 1):
        best, middle = points[0][0], 0.5 * (low + high)
        near = _ROUNDING * abs(best) + within / 3.0
        if abs(best - middle) <= 2.0 * near - 0.5 * (high - low):
            break
        parabolic = _parabola(points, (low, high), before=before) if abs(before) > near else None
        if parabolic is None:
            before = (low if best >= middle else high) - best
            step = _GOLDEN * before
        else:
            before, step = step, parabolic
            if best + step - low < 2.0 * near or high - (best + step) < 2.0 * near:
                step = math.copysign(near, middle - best)
        tried = best + math.copysign(max(abs(step), near), step)
        low, high = _absorb(points, (tried, float(cost(tried))), (low, high))
    return points[0]


def _parabola(points: list[tuple[float, float]], bounds: tuple[float, float], *, before: float) -> float | None:
    """Step to the lowest point of the parabola, if that is inside and the step less than half the last but one."""
    (best, f_best), (second, f_second), (third, f_third) = points
    r, q = (best - second) * (f_best - f_third), (best - third) * (f_best - f_second)
    p, q = (best - third) * q - (best - second) * r, 2.0 * (q - r)
    p, q = (-p if q > 0.0 else p), abs(q)
    inside = q * (bounds[0] - best) < p < q * (bounds[1] - best)
    return p / q if inside and abs(p) < abs(0.5 * q * before) else None


def _absorb(
    points: list[tuple[float, float]], found: tuple[float, float], bounds: tuple[float, float]
) -> tuple[float, float]:
    """Rank a point among the three best, and draw the bounds in behind the worse of it and the best."""
    (low, high), (best, second, third) = bounds, points
    if found[1] <= best[1]:
        points[:] = [found, best, second]
        return (best[0], high) if found[0] >= best[0] else (low, best[0])
    if found[1] <= second[1] or second[0] == best[0]:
        points[:] = [best, found, second]
    elif found[1] <= third[1] or third[0] in (best[0], second[0]):
        points[:] = [best, second, found]
    return (found[0], high) if found[0] < best[0] else (low, found[0])
