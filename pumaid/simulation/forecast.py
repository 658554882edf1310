"""What an experiment will be worth: standard errors that a plan promises on a robot of which enough is assumed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.records import Motion
from pumaid.robot import Robot
from pumaid.simulation.noise import correlation
from pumaid.simulation.recursion import Constants, Geometry, carried
from pumaid.simulation.truth import Noise, Truth
from pumaid.trajectory import cruise

Floats = NDArray[np.float64]

#: Points at which a run's regressors are averaged over its span.
_POINTS = 48
#: Information below this share of a parameter's own is rounding: nothing of it is known.
_BLIND = 1e-11


def gravity_names(robot: Robot) -> tuple[str, ...]:
    """Names of the gravity parameters and neighbour ratios, in the order in which `jacobian` has them."""
    names: list[str] = []
    for joint in robot.joints:
        own = ("x", "y") if joint.is_revolute else ("mass",)
        names += [f"gravity.l{joint.number}.{part}" for part in own]
    return (*names, *(f"gain_ratio.{i}.{i + 1}" for i in range(1, robot.n_joints)))


def jacobian(robot: Robot, known: Constants, position: Floats) -> Floats:
    """Change of every joint's gravity current per unit of every parameter of `gravity_names`.

    The current is linear in each constant and in each ratio alone, so differences are exact.

    Parameters
    ----------
    robot
        J joints.
    known
        Where the slope is taken.
    position
        (N, J) rad or m.

    Returns
    -------
    slopes
        (N, J, p), A per unit of the parameter.
    """
    n, zero, geometry = robot.n_joints, np.zeros(robot.n_joints), Geometry.of(robot, position)
    columns = []
    for j, joint in enumerate(robot.joints):
        unit = np.eye(n)[j]
        if joint.is_revolute:
            columns.append(carried(robot, Constants(unit, zero, zero, known.ratio), geometry))
            columns.append(carried(robot, Constants(zero, unit, zero, known.ratio), geometry))
        else:
            columns.append(carried(robot, Constants(zero, zero, unit, known.ratio), geometry))
    at_known = carried(robot, known, geometry)
    for i in range(n - 1):
        without = replace(known, ratio=np.where(np.arange(n - 1) == i, 0.0, known.ratio))
        columns.append((at_known - carried(robot, without, geometry)) / known.ratio[i])
    return np.stack(columns, axis=-1)


def run_slopes(robot: Robot, known: Constants, *, joint: int, holds: Floats) -> Floats:
    """What one joint's runs tell: slopes of its current's cos q, sin q and constant parts.

    Parameters
    ----------
    robot, known
        As for `jacobian`.
    joint
        Moving joint, from 1.
    holds
        (K, J) postures.

    Returns
    -------
    slopes
        (K, 3, p): parts cos q, sin q and constant, per unit of each parameter.
    """
    j, count = joint - 1, len(holds)
    ends = np.concatenate([holds, holds])
    ends[:count, j], ends[count:, j] = 0.0, 0.5 * np.pi
    found = jacobian(robot, known, ends)[:, j]
    at_zero, at_quarter = found[:count], found[count:]
    nothing = np.zeros_like(at_zero)
    parts = [at_zero, at_quarter, nothing] if robot.joints[j].is_revolute else [nothing, nothing, at_zero]
    return np.stack(parts, axis=1)


def run_moments(span: tuple[float, float], seconds: float, noise: Noise, *, joint: int, rate: float) -> Floats:
    """Information of one run on its cos q, sin q and constant parts, under the noise that its samples share.

    Noise of a sample about the run's level counts with the variance that its correlation leaves to slow signals; the
    level adds its own variance to the run's mean, however many samples there are.

    Parameters
    ----------
    span
        First and last position at constant speed, rad (or m: only the constant part then has a use).
    seconds
        At constant speed.
    noise, joint, rate
        Standard deviations of joint `joint` (from 1), and samples a second.

    Returns
    -------
    moments
        (3, 3), 1/A2.
    """
    q = np.linspace(*span, _POINTS)
    parts = np.column_stack([np.cos(q), np.sin(q), np.ones(_POINTS)])
    phi = correlation(noise, rate)
    slow = noise.sample_std[joint - 1] ** 2 * (1 + phi) / (1 - phi)
    level = noise.level_std[joint - 1] ** 2
    samples = max(seconds * rate, 1.0)
    gram, total = samples * parts.T @ parts / _POINTS, samples * parts.mean(axis=0)
    return np.asarray((gram - np.outer(total, total) * level / (slow + samples * level)) / slow)


@dataclass(frozen=True, eq=False, slots=True)
class Forecast:
    """Predicted standard errors: `names` of the parameters, `information` (p, p) on them, SI."""

    names: tuple[str, ...]
    information: Floats

    def std_errors(self) -> dict[str, float]:
        """Name -> standard error, SI; parameters of which the runs tell nothing are left out."""
        size = np.sqrt(np.diag(self.information))
        seen = size > 0
        scaled = self.information[np.ix_(seen, seen)] / np.outer(size[seen], size[seen])
        values, vectors = np.linalg.eigh(scaled)
        is_blind = values < _BLIND * max(values[-1], 1.0) if len(values) else np.zeros(0, bool)
        sure = ~np.any(np.abs(vectors[:, is_blind]) > 1e-4, axis=1)
        weights = np.where(is_blind, 0.0, 1.0 / np.where(is_blind, 1.0, values))
        errors = np.sqrt(vectors**2 @ weights) / size[seen]
        names = [name for name, told in zip(self.names, seen, strict=True) if told]
        return {name: float(error) for name, error, told in zip(names, errors, sure, strict=True) if told}


def forecast(truth: Truth, motions: Iterable[Motion], *, names: Sequence[str], rate: float = 100.0) -> Forecast:
    """Standard errors that the joint estimate of all parameters will have, by the Cramer-Rao bound.

    Parameters
    ----------
    truth
        What is assumed of the robot: its constants and its noise.
    motions
        Runs that are fitted (held-out ones are passed over).
    names
        Gravity parameters and ratios that the arm has; the friction terms are added.
    rate
        Samples a second.
    """
    robot = truth.robot
    every = gravity_names(robot)
    keep = [every.index(name) for name in names if name in every]
    terms = ("coulomb", "plus"), ("viscous", "plus"), ("coulomb", "minus"), ("viscous", "minus")
    friction = [f"{effect}.j{joint.number}.{sign}" for joint in robot.joints for effect, sign in terms]
    information = np.zeros((len(keep) + len(friction),) * 2)
    fitted = [motion for motion in motions if motion.purpose == "fit"]
    for joint in range(1, robot.n_joints + 1):
        own = [motion for motion in fitted if motion.joint == joint]
        if not own:
            continue
        holds, which = np.unique([motion.hold for motion in own], axis=0, return_inverse=True)
        slopes = run_slopes(robot, truth.constants, joint=joint, holds=holds)[:, :, keep]
        for motion, slope in zip(own, slopes[which], strict=True):
            span, seconds = cruise(robot, motion)
            moments = run_moments(span, seconds, truth.noise, joint=joint, rate=rate)
            wide = np.zeros((3, len(information)))
            wide[:, : len(keep)] = slope
            sign = 1.0 if motion.end >= motion.start else -1.0
            first = len(keep) + 4 * (joint - 1) + (0 if sign > 0 else 2)
            wide[2, first : first + 2] = 1.0, sign * motion.velocity
            information += wide.T @ moments @ wide
    return Forecast((*(every[k] for k in keep), *friction), information)
