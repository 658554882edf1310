"""What is left against the variable in which an effect lives: the picture by which an engineer believes a finding."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pumaid.diagnosis.candidates import Suspect
from pumaid.diagnosis.records import Binned, Curve, Line
from pumaid.effect_spec import EffectTerm
from pumaid.effects import Family
from pumaid.joint_bins import at, distinct
from pumaid.robot import Robot
from pumaid.samples import Floats, Samples

#: Bins over a span: narrow enough for the shapes of the catalogue, wide enough to hold several runs each.
FINE, COARSE = 32, 16
#: A smooth line of speed has so many points from this share of the slowest speed run to this of the fastest:
#: look-alikes part below the slowest.
POINTS, SLOWEST, FASTEST = 80, 0.4, 1.1
#: Of a family of effects, the variable that shows it; a family that is not named is shown by what the effect itself
#: adds.
VARIABLES = {
    Family.SPEED: "speed",
    Family.LOAD: "load",
    Family.POSITION: "position",
    Family.TORQUE: "position",
    Family.RIPPLE: "position",
    Family.PAYLOAD: "time",
    Family.START: "travel",
    Family.TIME: "time",
    Family.TEMPERATURE: "temperature",
    Family.CURRENT: "current",
}


@dataclass(frozen=True, eq=False, slots=True)
class Trial:
    """An effect as it was fitted: `values` (p,) of its linear parameters, `misfit` (M,) A left with it."""

    term: EffectTerm
    values: Floats
    misfit: Floats


@dataclass(frozen=True, eq=False, slots=True)
class Axis:
    """What a picture is drawn against: a word or two, the unit, (M,) values at the bins of the runs, the number of
    bins of the picture (None where equal values stand together), the period of a folded variable."""

    variable: str
    unit: str
    values: Floats
    bins: int | None = COARSE
    period: float | None = None

    def labels(self) -> Floats:
        """(M,) number of the picture's bin of each value; bins of travel are narrow where the motion begins."""
        if self.bins is None:
            return np.searchsorted(distinct(self.values.tolist()), self.values, side="right").astype(float)
        low, high = (0.0, self.period) if self.period else (np.nanmin(self.values), np.nanmax(self.values))
        share = (self.values - low) / (high - low if high > low else 1.0)
        if self.variable.startswith("travel"):
            share = np.sqrt(share)
        return np.minimum(np.floor(share * self.bins), self.bins - 1)


def curve(robot: Robot, samples: Samples, *, before: Floats, trials: Sequence[Trial]) -> Curve:
    """Bin what is left before and after an effect is added, with the effect's own line and its rivals'.

    A line is what adding the effect changes in the model, so that it runs through what is left before. Over speed it is
    drawn between the speeds that were run, where rivals part; elsewhere at the bins.

    Parameters
    ----------
    robot
        The arm.
    samples
        M bins of all runs of one joint; `Samples.run` tells them apart.
    before
        (M,) A left without the effect.
    trials
        The effect found, then its rivals.

    Returns
    -------
    curve
        A side for each direction of motion that was run.
    """
    main, sides, lines = trials[0], [], []
    axis = _axis(robot, samples, main, change=before - main.misfit)
    for way in (1, -1):
        label = np.where((samples.direction == way) & np.isfinite(axis.values), axis.labels(), np.nan)
        if np.isnan(label).all():
            continue
        places, mean = (_means(values, label, samples.run)[0] for values in (axis.values, before))
        sides.append(Binned(way, places, mean, *_means(main.misfit, label, samples.run)))
        for trial in trials:
            change = _means(before - trial.misfit, label, samples.run)[0]
            lines.append(_line(robot, samples, axis, trial, way=way, places=places, change=change))
    names = [trial.term.effect.name for trial in trials]
    lines.sort(key=lambda line: names.index(line.effect))
    return Curve(samples.joint, axis.variable, axis.unit, tuple(sides), tuple(lines), axis.period)


def _axis(robot: Robot, samples: Samples, trial: Trial, *, change: Floats) -> Axis:
    """The variable in which an effect lives."""
    column, unit, effect = samples.joint - 1, robot.joint(samples.joint).position_unit, trial.term.effect
    position = samples.position[:, column]
    if isinstance(effect, Suspect) and samples.extra is not None:
        return Axis(effect.column, "", samples.extra[:, effect.place])
    frequency = trial.term.shape.get(effect.periodic or "", 0.0)
    if frequency > 0.0:
        period = 2.0 * math.pi / frequency
        return Axis("position within one period", unit, np.mod(position, period), FINE, period)
    run = np.unique(samples.run, return_inverse=True)[1]
    speed = np.bincount(run, np.abs(samples.velocity[:, column])) / np.bincount(run)
    axes = {
        "speed": Axis("speed", f"{unit}/s", speed[run], None),
        "position": Axis("position", unit, position, FINE),
        "travel": Axis("travel since the motion began", unit, samples.travel, FINE),
        "time": Axis("time since the first motion", "s", samples.time),
    }
    if np.isfinite(samples.temperature).any():
        axes["temperature"] = Axis("temperature", "degC", samples.temperature)
    if samples.loads is not None:
        axes["current"] = Axis("predicted current", "A", samples.loads.drawn)
        axes["load"] = Axis("gravity load", "A", samples.loads.moving)
        if "side" in effect.name:
            axes["load"] = Axis("moment across the axis", "A", samples.loads.across)
    return axes.get(VARIABLES.get(effect.family, ""), Axis("what it adds", "A", change))


def _means(values: Floats, label: Floats, run: Floats) -> tuple[Floats, Floats, Floats]:
    """Means over runs in each bin, their standard errors (NaN of one run), and how many runs there are."""
    is_valid = np.isfinite(label)
    both, where = np.unique(np.column_stack([label[is_valid], run[is_valid]]), axis=0, return_inverse=True)
    where = np.ravel(where)
    by_run = np.bincount(where, values[is_valid]) / np.bincount(where)
    _, at = np.unique(both[:, 0], return_inverse=True)
    runs = np.bincount(at)
    mean = np.bincount(at, by_run) / runs
    spread = np.bincount(at, (by_run - mean[at]) ** 2)
    error = np.sqrt(spread / np.where(runs > 1, runs * (runs - 1.0), np.nan))
    return mean, error, runs.astype(float)


def _line(
    robot: Robot, samples: Samples, axis: Axis, trial: Trial, *, way: int, places: Floats, change: Floats
) -> Line:
    """A smooth line over speed where the effect is the joint's own, else the binned change itself."""
    is_local = trial.term.joint in (None, samples.joint) and trial.term.effect.family is Family.SPEED
    if axis.variable != "speed" or not is_local:
        return Line(trial.term.effect.name, way, places, change)
    grid = np.linspace(SLOWEST * places.min(), FASTEST * places.max(), POINTS)
    rest = change - _law(robot, samples, trial, way=way, speeds=places)
    # Coulomb and viscous friction give way when the effect comes in: by a straight line of speed, which the bins tell.
    powers = np.arange(min(2, len(places)))
    straight = np.linalg.lstsq(places[:, None] ** powers, rest, rcond=None)[0]
    smooth = _law(robot, samples, trial, way=way, speeds=grid) + grid[:, None] ** powers @ straight
    return Line(trial.term.effect.name, way, grid, smooth)


def _law(robot: Robot, samples: Samples, trial: Trial, *, way: int, speeds: Floats) -> Floats:
    """(G,) A that the effect alone adds at these speeds, everything else as in the cell of middle speed."""
    ways = np.flatnonzero(samples.direction == way)
    middle = int(ways[np.argsort(np.abs(samples.velocity[ways, samples.joint - 1]))[len(ways) // 2]])
    still = at(samples, np.full(len(speeds), middle))
    velocity = np.zeros_like(still.velocity)
    velocity[:, samples.joint - 1] = way * speeds
    return np.asarray(trial.term.linear(robot, replace(still, velocity=velocity)) @ trial.values)
