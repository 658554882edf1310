"""Intervals of effects with shapes from the profile of the likelihood: along a curve a tangent does not tell."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pumaid.effect_spec import EffectTerm, scale_of
from pumaid.effects.base import Shape
from pumaid.estimation.nonlinear import Ends, Linearised, Point, Refit

Floats = NDArray[np.float64]

#: First step of a search for an interval's end, in standard errors, and by how much steps grow; steps to each side at
#: most; and the precision to which the other shapes are found at each, in their scale.
STRIDE, GROWTH, MOST_STEPS, PRECISE = 0.5, 1.5, 12, 1e-2


@dataclass(eq=False, slots=True)
class Profile:
    """The likelihood of one effect's shapes about their best values, everything else refitted at each.

    Attributes
    ----------
    ground
        The fit without the effect, with the noise that is left with it.
    term
        The effect at its best shape.
    limits
        (p,) prior deviations of its linear parameters, those at its best shape: what is plausible does not grow where a
        shape hides what a parameter does.
    path
        Shapes looked at so far, and the fits with them.

    Source
    ------
    D. M. Bates and D. G. Watts, Nonlinear Regression Analysis and Its Applications, Wiley 1988, section 6.1.
    """

    ground: Linearised
    term: EffectTerm
    limits: Floats
    path: list[tuple[Point, Refit]] = field(default_factory=list)

    def shape(self, name: str, *, error: float, reach: float) -> Ends:
        """Ends of the interval of one fitted shape.

        Parameters
        ----------
        name
            The shape.
        error
            Its standard error by the tangent: the first step is half of it.
        reach
            How many standard errors an interval reaches.
        """
        best = self._at(dict(self.term.shape))
        sides = [self._walk(name, best, stride=way * STRIDE * error, rise=reach**2) for way in (-1.0, 1.0)]
        return sides[0], sides[1]

    def linear(self, reach: Floats) -> Floats:
        """(p, 2) ends of the linear parameters' intervals: the envelope of those at all shapes on the way.

        Parameters
        ----------
        reach
            (p,) how many standard errors each interval reaches.
        """
        values = np.array([refit.values for _, refit in self.path])
        errors = np.array([np.linalg.norm(refit.half, axis=1) for _, refit in self.path])
        return self._envelope(values, errors, reach)

    def others(self, reach: Floats) -> Floats:
        """(P, 2) the same of all that was fitted before, parameters and ratios.

        Parameters
        ----------
        reach
            (P,) how many standard errors each interval reaches.
        """
        fitted = self.ground.fit
        start = np.concatenate([fitted.values, [fitted.gains.edge[edge] for edge in fitted.gains.edges]])
        variances = np.diag(fitted.inverse)
        values = np.array([start + refit.shift @ refit.values for _, refit in self.path])
        errors = [np.sqrt(variances + np.sum((refit.shift @ refit.half) ** 2, axis=1)) for _, refit in self.path]
        return self._envelope(values, np.array(errors), reach)

    def _envelope(self, values: Floats, errors: Floats, reach: Floats) -> Floats:
        """(P, 2) lowest and highest ends of intervals at (K, P) values, narrower where the likelihood is lower."""
        gains = np.array([refit.gain for _, refit in self.path])
        remaining = reach**2 - (gains.max() - gains)[:, None]
        widths = np.where(remaining > 0.0, np.sqrt(np.maximum(remaining, 0.0)) * errors, -np.inf)
        return np.column_stack([np.min(values - widths, axis=0), np.max(values + widths, axis=0)])

    def _at(self, shape: Point) -> tuple[Point, Refit]:
        point = shape, self.ground.added(self.term.at(shape), limits=self.limits)
        self.path.append(point)
        return point

    def _walk(self, name: str, best: tuple[Point, Refit], *, stride: float, rise: float) -> float:
        """The end of an interval on one side: where the squares have risen by `rise`, or a bound."""
        facts = self.term.shapes(self.ground.fit.model.robot)[name]
        (shape, before), step = best, stride
        for _ in range(MOST_STEPS):
            value = min(max(shape[name] + step, facts.low), facts.high)
            there, refit = self._best(name, value, shape)
            lost, earlier = best[1].gain - refit.gain, best[1].gain - before.gain
            if lost >= rise:
                share = (np.sqrt(rise) - np.sqrt(max(earlier, 0.0))) / (np.sqrt(lost) - np.sqrt(max(earlier, 0.0)))
                return float(shape[name] + share * (value - shape[name]))
            if value in (facts.low, facts.high):
                return value
            shape, before, step = there, refit, step * GROWTH
        return shape[name]

    def _best(self, name: str, value: float, before: Point) -> tuple[Point, Refit]:
        """The place with this value at which the other fitted shapes are best, from those of the step before."""
        facts = self.term.shapes(self.ground.fit.model.robot)
        free = [facts[other] for other in self.term.fitted if other != name]
        point = self._at(before | {name: value})
        for other in itertools.chain(free, free if len(free) > 1 else ()):
            point = self._along(other, point)
        return point

    def _along(self, shape: Shape, start: tuple[Point, Refit]) -> tuple[Point, Refit]:
        """The best place along one shape near `start`."""
        from scipy import optimize

        at = start[0][shape.name]
        reach = scale_of(shape, at)
        points = [start]

        def cost(value: float) -> float:
            points.append(self._at(start[0] | {shape.name: float(value)}))
            return -points[-1][1].gain

        bounds = (max(at - reach, shape.low), min(at + reach, shape.high))
        optimize.minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": PRECISE * reach})
        return max(points, key=lambda point: point[1].gain)
