"""Sizes of hidden effects where none are given: such that they show at the joint that has them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import ModelError, Where
from pumaid.robot import Robot
from pumaid.simulation.hidden.catalogue import LAWS
from pumaid.simulation.hidden.law import Hidden, Reach, Typical
from pumaid.simulation.ranges import QUICKEST_SLIDE, QUICKEST_TURN, span
from pumaid.simulation.weight import Weight
from pumaid.trajectory import accelerations, highest_speeds

Floats = NDArray[np.float64]

#: Postures over which loads are looked at, and a load that is rounding: share of the arm's greatest.
_POSTURES, _NOTHING = 400, 1e-6
#: Significant digits of a size.
_DIGITS = 4


class Arm(Protocol):
    """What of a virtual robot the sizes depend on."""

    @property
    def robot(self) -> Robot:
        """Geometry and limits."""

    @property
    def weight(self) -> Weight:
        """Its masses."""

    @property
    def coulomb(self) -> Floats:
        """(J,) A: size of Coulomb friction, mean of both directions."""


def sized(hidden: Sequence[Hidden], arm: Arm) -> tuple[Hidden, ...]:
    """Hidden effects with all their values, one a joint where an effect of joints names none.

    Parameters
    ----------
    hidden
        As named by a user; values that are missing follow from the arm: a part of the joint's Coulomb friction, of its
        load, of its speed.
    arm
        The virtual robot.

    Raises
    ------
    ModelError [hide-wrong]
        The effect needs masses and the arm has only constants; or weight, and the joint carries none.
    """
    usual = typical(arm)
    return tuple(full for one in hidden for full in _sized(one, usual, arm.weight))


def _sized(one: Hidden, usual: Sequence[Typical], weight: Weight) -> list[Hidden]:
    law = LAWS[one.effect]
    if law.needs_masses and weight.links is None:
        what = f"{weight.robot.name} is known by its constants in amperes alone, and {one.effect} needs its masses"
        raise ModelError("hide-wrong", what, Where(field=f"--hide {one.effect}"), "leave out --truth table1")
    is_everywhere = one.joint is None and law.reach is not Reach.ARM
    joints = [joint.joint for joint in usual] if is_everywhere else [one.joint]
    full = [_complete(replace(one, joint=number), usual[(number or len(usual)) - 1]) for number in joints]
    found = [each for each in full if all(math.isfinite(value) for value in each.values.values())]
    if not found:
        what = f"joint {one.joint} carries no weight, and {one.effect} follows the weight"
        raise ModelError("hide-wrong", what, Where(field=f"--hide {one.effect}"), "name a joint that carries weight")
    return found


def _complete(one: Hidden, joint: Typical) -> Hidden:
    law = LAWS[one.effect]
    try:
        usual = law.usual(joint)
    except ZeroDivisionError:
        usual = (math.nan,) * len(law.keys)
    shortened = {key: float(f"{value:.{_DIGITS}g}") for key, value in zip(law.keys, usual, strict=True)}
    return replace(one, values={**shortened, **one.values})


def typical(arm: Arm) -> tuple[Typical, ...]:
    """What is usual of every joint of a virtual arm."""
    robot, weight = arm.robot, arm.weight
    rng = np.random.default_rng(0)
    places = rng.random((_POSTURES, robot.n_joints))
    low, high = np.array([span(joint) for joint in robot.joints]).T
    postures = low + places * (high - low)
    load = weight.current(postures)
    load[:, np.max(np.abs(load), axis=0) < _NOTHING * (np.max(np.abs(load)) or 1.0)] = 0.0
    across = np.full(load.shape, np.nan) if weight.links is None else weight.across(postures)
    quickest = np.where(robot.is_revolute, QUICKEST_TURN, QUICKEST_SLIDE)
    speed, ramps = np.minimum(highest_speeds(robot), quickest), accelerations(robot)
    before = np.roll(arm.coulomb, 1)
    before[0] = arm.coulomb[min(1, robot.n_joints - 1)]
    return tuple(
        Typical(
            joint=j + 1,
            coulomb=float(arm.coulomb[j]),
            speed=float(speed[j]),
            acceleration=float(ramps[j]),
            half_span=float(0.5 * (high[j] - low[j])),
            load=float(np.sqrt(np.mean(load[:, j] ** 2))),
            most=float(np.max(np.abs(load[:, j]))),
            across=float(np.sqrt(np.mean(across[:, j] ** 2))),
            before=float(before[j]),
            last_mass=float("nan") if weight.links is None else float(weight.links.mass[-1]),
            reach=float(sum(abs(joint.a) + abs(joint.d) for joint in robot.joints)) or 1.0,
        )
        for j in range(robot.n_joints)
    )
