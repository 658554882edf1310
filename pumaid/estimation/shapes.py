"""Nonlinear parameters of effects: looked for on a grid, refined off it, everything else refitted each time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.chosen import Chosen, scale_of
from pumaid.effects import Scope
from pumaid.effects.base import Shape
from pumaid.estimation.extents import extent
from pumaid.estimation.ground import Ground
from pumaid.estimation.views import Sights
from pumaid.model import Model
from pumaid.robot import Robot

Floats = NDArray[np.float64]
Point = dict[str, float]

#: Fall of twice the log likelihood within which 95 % of chances lie for one parameter.
WITHIN = 3.84

#: Points of a grid from which a refinement starts.
STARTS = 2

#: Relative step of the refinement's own derivatives, and its relative gain that is not worth another step: the fit of
#: all parameters together goes on from there.
NUDGE, ENOUGH = 1e-4, 1e-4

#: Frequencies of a long grid that are looked at closely, after a periodogram has ranked them.
SHORTLIST = 24


@dataclass(frozen=True, eq=False, slots=True)
class Found:
    """A shape that was looked for: the effect with it, the fall of the weighted squares, and (name, low, high) ranges.

    A range is of a shape that has no derivative (an instant, a whole number): what the data leave open at 95 %.
    """

    one: Chosen
    gain: float
    ranges: Mapping[str, tuple[float, float]]


def look(ground: Ground, one: Chosen, *, free: Sequence[str], model: Model, sights: Sights) -> Found:
    """The shape of `one` that explains most of what `ground` leaves.

    Parameters
    ----------
    ground
        The fit without it.
    one
        The effect, with the shapes that are given.
    free
        Names of the shapes to look for.
    model, sights
        The arm; the joints on which the effect may act.
    """
    robot, shapes = model.robot, one.shapes(model.robot)
    grid = _grid(ground, one, robot, sights)
    scored = _scored(ground, one, grid, robot)
    if any(not shapes[name].is_searched for name in free):
        grid = _between(one, grid, scored, robot=robot, sights=sights)
        scored = _scored(ground, one, grid, robot)
    order = np.argsort(-scored, kind="stable")
    best, top = dict(grid[order[0]]), float(scored[order[0]])
    searched = [shapes[name] for name in free if shapes[name].is_searched]
    for start in order[:STARTS] if searched else ():
        point, gain = _refined(ground, one, grid[start], shapes=searched, robot=robot)
        if gain > top:
            best, top = point, gain
    fixed = [name for name in free if not shapes[name].is_searched]
    starts = extent(sights, 0 if one.effect.scope is Scope.ARM else one.number).starts
    ranges = {name: _range(shapes[name], grid, scored, starts=starts) for name in fixed}
    return Found(one.at({name: best[name] for name in free}), top, ranges)


def _grid(ground: Ground, one: Chosen, robot: Robot, sights: Sights) -> list[Point]:
    """Where a search begins; given shapes are kept."""
    of = one.number if one.effect.scope is not Scope.ARM else 0
    points = [dict(point) | dict(one.choice.shape) for point in one.effect.grid(robot, extent(sights, of))]
    points = list({tuple(sorted(point.items())): point for point in points}.values())
    periodic = one.effect.periodic
    if periodic is None or periodic in one.choice.shape or len(points) <= SHORTLIST:
        return points
    power = ground.power(one.number, np.array([point[periodic] for point in points]))
    return [points[k] for k in sorted(np.argsort(-power, kind="stable")[:SHORTLIST])]


def _scored(ground: Ground, one: Chosen, grid: Sequence[Point], robot: Robot) -> Floats:
    return np.array([ground.gain(one.at(point), robot) for point in grid])


def _between(one: Chosen, grid: list[Point], scored: Floats, *, robot: Robot, sights: Sights) -> list[Point]:
    """A grid of instants, closer about the best: where runs are many it skips some."""
    of = one.number if one.effect.scope is not Scope.ARM else 0
    facts = extent(sights, of)
    best = grid[int(np.argmax(scored))]
    for name, value in best.items():
        if one.shapes(robot)[name].unit == "s":
            known = sorted(point[name] for point in grid)
            place = known.index(value)
            low, high = known[max(place - 1, 0)], known[min(place + 1, len(known) - 1)]
            starts = [t for t in facts.starts if t <= low][-1:] + [t for t in facts.starts if low <= t]
            stop = next((n for n, t in enumerate(starts) if t > high), len(starts) - 1)
            near = one.effect.grid(robot, replace(facts, starts=tuple(starts[: stop + 1])))
            grid = [*grid, *(dict(best) | dict(point) for point in near)]
    return list({tuple(sorted(point.items())): point for point in grid}.values())


def _refined(
    ground: Ground, one: Chosen, start: Point, *, shapes: Sequence[Shape], robot: Robot
) -> tuple[Point, float]:
    """The best shape near a point of the grid, each measured by its own scale."""
    names = [shape.name for shape in shapes]
    scales = np.array([scale_of(shape, start[shape.name]) for shape in shapes])
    middle = np.array([start[name] for name in names])
    bounds = [((s.low - m) / c, (s.high - m) / c) for s, m, c in zip(shapes, middle, scales, strict=True)]

    def at(step: Floats) -> Point:
        return start | dict(zip(names, (middle + scales * step).tolist(), strict=True))

    def cost(step: Floats) -> float:
        return -ground.gain(one.at(at(step)), robot)

    # What it brings takes as long to load as an identification; most have no shapes to look for together.
    from scipy import optimize

    found = optimize.minimize(
        cost, np.zeros(len(names)), method="L-BFGS-B", bounds=bounds, options={"eps": NUDGE, "ftol": ENOUGH}
    )
    return at(found.x), -float(found.fun)


def _range(shape: Shape, grid: Sequence[Point], scored: Floats, *, starts: Sequence[float]) -> tuple[float, float]:
    """Lowest and highest value of a shape that the data do not exclude; an instant lies anywhere between two starts."""
    kept = [point[shape.name] for point, gain in zip(grid, scored, strict=True) if gain >= scored.max() - WITHIN]
    low, high = min(kept), max(kept)
    if shape.unit == "s":
        low = max((start for start in starts if start <= low), default=low)
        high = min((start for start in starts if start >= high), default=high)
    return low, high
