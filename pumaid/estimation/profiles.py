"""Intervals of effects with shapes from the profile of the likelihood: along a curve a tangent does not tell."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pumaid.chosen import Chosen, scale_of
from pumaid.effects.base import Shape
from pumaid.estimation.ground import Ground, Refit
from pumaid.maths.least import least
from pumaid.robot import Robot

Floats = NDArray[np.float64]
Ends = tuple[float, float]

#: First step of a search for an interval's end, in standard errors, and by how much steps grow.
STRIDE, GROWTH = 0.5, 1.5

#: Steps to each side at most: a shape that is still within its interval after these is open.
MOST_STEPS = 12

#: Precision to which the other shapes are found at each step, in their scale.
FINE = 1e-2


@dataclass(frozen=True, eq=False, slots=True)
class Point:
    """A place on a profile: a shape, and the fit with it."""

    shape: dict[str, float]
    refit: Refit

    @property
    def gain(self) -> float:
        """Fall of the weighted squares."""
        return self.refit.gain


@dataclass(eq=False, slots=True)
class Profile:
    """The likelihood of one effect's shapes about their best values, everything else refitted at each.

    Attributes
    ----------
    ground
        The fit without the effect, with the noise that is left with it.
    one
        The effect at its best shape.
    robot
        The arm.
    limits
        (p,) prior deviations of its linear parameters, those at its best shape: what is plausible does not grow where a
        shape hides what a parameter does.
    path
        Places looked at so far.

    Source
    ------
    D. M. Bates and D. G. Watts, Nonlinear Regression Analysis and Its Applications, Wiley 1988, section 6.1.
    """

    ground: Ground
    one: Chosen
    robot: Robot
    limits: Floats
    path: list[Point] = field(default_factory=list)

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
        best = self._at(dict(self.one.choice.shape))
        sides = [self._walk(name, best, stride=way * STRIDE * error, rise=reach**2) for way in (-1.0, 1.0)]
        return sides[0], sides[1]

    def linear(self, reach: Floats) -> Floats:
        """(p, 2) ends of the linear parameters' intervals: the envelope of those at all shapes on the way.

        Parameters
        ----------
        reach
            (p,) how many standard errors each interval reaches.
        """
        values = [point.refit.values for point in self.path]
        errors = [np.linalg.norm(point.refit.half, axis=1) for point in self.path]
        return self._envelope(np.array(values), np.array(errors), reach)

    def others(self, reach: Floats) -> Floats:
        """(P, 2) the same of all that was fitted before, parameters and ratios.

        Parameters
        ----------
        reach
            (P,) how many standard errors each interval reaches.
        """
        fitted = self.ground.fitted
        known = np.concatenate([fitted.solution.values, [fitted.gains.edge[edge] for edge in fitted.gains.edges]])
        own = np.einsum("kp,kp->p", self.ground.back, self.ground.back)
        values = [known + point.refit.shift @ point.refit.values for point in self.path]
        errors = [np.sqrt(own + np.sum((point.refit.shift @ point.refit.half) ** 2, axis=1)) for point in self.path]
        return self._envelope(np.array(values), np.array(errors), reach)

    def _envelope(self, values: Floats, errors: Floats, reach: Floats) -> Floats:
        """(P, 2) lowest and highest ends of intervals at (K, P) values, narrower where the likelihood is lower."""
        gains = np.array([point.gain for point in self.path])
        left = reach**2 - (gains.max() - gains)[:, None]
        widths = np.where(left > 0.0, np.sqrt(np.maximum(left, 0.0)) * errors, -np.inf)
        return np.column_stack([np.min(values - widths, axis=0), np.max(values + widths, axis=0)])

    def _at(self, shape: dict[str, float]) -> Point:
        point = Point(shape, self.ground.fit(self.one.at(shape), self.robot, limits=self.limits))
        self.path.append(point)
        return point

    def _walk(self, name: str, best: Point, *, stride: float, rise: float) -> float:
        """The end of an interval on one side: where the squares have risen by `rise`, or a bound."""
        facts = self.one.shapes(self.robot)[name]
        before, step = best, stride
        for _ in range(MOST_STEPS):
            value = min(max(before.shape[name] + step, facts.low), facts.high)
            here = self._best(name, value, before)
            lost, earlier = best.gain - here.gain, best.gain - before.gain
            if lost >= rise:
                share = (np.sqrt(rise) - np.sqrt(max(earlier, 0.0))) / (np.sqrt(lost) - np.sqrt(max(earlier, 0.0)))
                return float(before.shape[name] + share * (value - before.shape[name]))
            if value in (facts.low, facts.high):
                return value
            before, step = here, step * GROWTH
        return before.shape[name]

    def _best(self, name: str, value: float, before: Point) -> Point:
        """The place with this value at which the other fitted shapes are best, from those of the step before."""
        every = self.one.shapes(self.robot)
        others = [every[other] for other in self.one.fitted if other != name]
        here = self._at(before.shape | {name: value})
        for other in itertools.chain(others, others if len(others) > 1 else ()):
            here = self._along(other, here)
        return here

    def _along(self, shape: Shape, start: Point) -> Point:
        """The best place along one shape near `start`."""
        at = start.shape[shape.name]
        reach = scale_of(shape, at)
        bounds = (max(at - reach, shape.low), min(at + reach, shape.high))
        points: dict[float, Point] = {at: start}

        def cost(value: float) -> float:
            points[float(value)] = self._at(start.shape | {shape.name: float(value)})
            return -points[float(value)].gain

        least(cost, bounds, within=FINE * reach)
        return max(points.values(), key=lambda point: point.gain)
