"""What an unknown delay between a current and its positions does to strokes, as more noise of a known course."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Run, run_columns
from pumaid.robot import Robot

Floats = NDArray[np.float64]

#: s, beside half a step of the log: what filters of drives and a fieldbus put between a current and its position.
LAG = 0.001
#: rad; half steps below it are none.
TINY = 1e-9


@dataclass(frozen=True, eq=False, slots=True)
class Doubt:
    """What a delay of one standard deviation adds to a run's current (A).

    `along` (k,) in units of the triangle's regressors, `bins` (M,) in the run's weighted bins, of which `beyond` (M,)
    is what the triangle does not know of; `basis` (M, k) are its regressors there.
    """

    along: Floats
    bins: Floats
    beyond: Floats
    basis: Floats

    def over(self, noise: float) -> Doubt:
        """The same over the noise of a sample (A)."""
        return replace(self, along=self.along / noise, bins=self.bins / noise, beyond=self.beyond / noise)

    @property
    def axis(self) -> Floats:
        """(M,) a for which ``I - a a'`` is the inverse root of the covariance ``I + w w'``, w being `bins`."""
        square = float(self.bins @ self.bins)
        share = (1.0 - 1.0 / np.sqrt(1.0 + square)) / square if square > 0.0 else 0.0
        return self.bins * np.sqrt(share)

    def calmed(self, base: Floats, target: Floats, *, current: Floats, rest: float) -> tuple[Floats, Floats, float]:
        """A run's equations with this noise, too, as equations of noise one, and what is beyond them.

        Parameters
        ----------
        base, target
            (k, c) the triangle's regressors, and (k,) in the equations.
        current
            (M,) A, weighted, in the bins.
        rest
            Sum of squares (A2) beyond the equations.
        """
        seen = base @ self.along
        known, square = float(seen @ seen), float(seen @ seen + self.beyond @ self.beyond)
        if known == 0.0:
            return base, target, rest
        share, cross = 1.0 / (1.0 + square), float(seen @ target + self.beyond @ current)
        shrunk = float(np.sqrt(1.0 - share * known))
        unit = seen / np.sqrt(known)
        calm = base - (1.0 - shrunk) * np.outer(unit, unit @ base)
        pulled = target - share * cross * seen
        pulled = pulled + (1.0 / shrunk - 1.0) * unit * float(unit @ pulled)
        left = rest + float(target @ target - pulled @ pulled) - share * cross**2
        # Bins hold the ends of a stroke, over which the triangle's averages are not whole.
        axis = self.axis
        columns, drawn = self.basis - np.outer(axis, axis @ self.basis), current - axis * float(axis @ current)
        beyond = drawn - columns @ np.linalg.lstsq(columns, drawn, rcond=1e-9)[0]
        return calm, pulled, max(left, float(beyond @ beyond))


def doubts(robot: Robot, runs: Sequence[Run]) -> list[Doubt | None]:
    """Of the runs of one joint: of each stroke its doubt, of others none.

    A current that comes late by `t` is off by `-t di/dt`. In a stroke `di/dt` is mostly inertia times jerk, which runs
    against the speed: a millisecond passes for a tenth of a light joint's viscous friction. A joint's delay is one for
    all its strokes, so that it does not average out: each of n strokes has it with n times its variance.
    """
    strokes = sum(run.kind == "stroke" for run in runs)
    return [_doubt(robot, run, strokes) if run.kind == "stroke" else None for run in runs]


def axes(robot: Robot, runs: Sequence[Run], noise: float) -> Floats:
    """(N,) the axes of doubts of the runs of one joint, bin by bin; zero where a run has none."""
    every = zip(runs, doubts(robot, runs), strict=True)
    axes = [np.zeros(len(run.bins)) if doubt is None else doubt.over(noise).axis for run, doubt in every]
    return np.concatenate(axes)


def _doubt(robot: Robot, run: Run, strokes: int) -> Doubt | None:
    own, bins, factor = run.joint - 1, run.bins, run.triangle.factor
    q, turns = bins.position[:, own], robot.joint(run.joint).is_revolute
    # Of cosines over a bin's equal steps the mean is that at its middle times this.
    step = 0.5 * np.abs(bins.velocity) * run.duration / max(run.samples - 1, 1)
    span = np.divide(np.sin(bins.count * step), bins.count * np.sin(step), out=np.ones(len(q)), where=step > TINY)
    basis = run_columns(q, turns=turns, motion=(bins.velocity, bins.acceleration))
    basis[:, :2] *= span[:, None]
    weight = np.sqrt(bins.count)
    if len(bins) <= basis.shape[1]:
        return None
    current = basis @ np.linalg.lstsq(factor[:, :-1], factor[:, -1], rcond=1e-9)[0]
    count = max(run.samples, 1)
    delay = np.sqrt(strokes) * (0.5 * run.duration / count + LAG)
    added = delay * weight * np.gradient(current, bins.time)
    if not np.all(np.isfinite(added)):
        return None
    along = np.linalg.lstsq(weight[:, None] * basis, added, rcond=1e-9)[0]
    return Doubt(along, added, added - weight * (basis @ along), weight[:, None] * basis)
