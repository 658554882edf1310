"""What each posture of a plan is for, in the user's words: which ratio it shows, and what would be lost without it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.design.menu import Menu
from pumaid.design.planner import Made, Planner
from pumaid.kinematics import axes
from pumaid.records import Posture
from pumaid.robot import Robot
from pumaid.simulation.forecast import gravity_names, run_slopes
from pumaid.units import factor, number

Floats = NDArray[np.float64]

#: A posture serves a parameter whose error without it is so many times as large; from the second on it is not seen.
_MORE, _UNSEEN = 1.15, 1e3
#: Parameters that are named of a posture, at most.
_NAMED = 3
#: A, difference of the outer links' load between two postures below which they show no ratio.
_NOTHING = 1e-6


@dataclass(frozen=True, slots=True)
class Pair:
    """Two postures of a joint between which the load of the outer links differs most: they show a ratio.

    Attributes
    ----------
    ratio
        ``gain_ratio.2.3``.
    joint
        Moves.
    holds
        Of the joint's postures.
    apart
        A by which the current differs, at most along the span.
    """

    ratio: str
    joint: int
    holds: tuple[int, int]
    apart: float


def postures(planner: Planner, made: Made) -> tuple[Posture, ...]:
    """Every posture of a plan with what it serves, those for judging last of each joint.

    Parameters
    ----------
    planner, made
        The plan, and what it was made from.
    """
    pairs = shown_by(planner, made)
    out: list[Posture] = []
    for joint in planner.robot.joints:
        own = _holds(made, joint.number)
        for place, hold in enumerate(own):
            out.append(_posture(planner, made, (joint.number, hold), pairs=pairs, is_first=place == 0))
        judged = tuple(made.judged[joint.number - 1].tolist())
        why = f"joint {joint.number} ({joint.name}) is judged here, at speeds that no fit has seen"
        is_new = all(not np.allclose(planner.menu.of(joint.number).holds[hold], judged) for hold in own)
        out.append(Posture(joint.number, judged, (), f"{why}, and in a posture of its own" if is_new else why))
    return tuple(out)


def shown_by(planner: Planner, made: Made) -> tuple[Pair, ...]:
    """For each ratio that the arm has the two postures of the plan that tell it best."""
    robot, names = planner.robot, gravity_names(planner.robot)
    out = []
    for name in planner.names:
        if not name.startswith("gain_ratio"):
            continue
        found: list[Pair] = []
        for joint in range(1, int(name.split(".")[1]) + 1):
            own = _holds(made, joint)
            ways = planner.menu.of(joint)
            loads = np.stack(
                [
                    abs(truth.parameters()[name])
                    * run_slopes(robot, truth.constants, joint=joint, holds=ways.holds[own])[:, :, names.index(name)]
                    for truth in planner.truths
                ]
            )
            apart = _amplitude(loads[:, :, None] - loads[:, None])
            a, b = np.unravel_index(int(np.argmax(np.round(apart, 9))), apart.shape)
            found.append(Pair(name, joint, (own[min(a, b)], own[max(a, b)]), float(apart[a, b])))
        best = max(found, key=lambda pair: (round(pair.apart, 9), pair.joint))
        if best.apart > _NOTHING:
            out.append(best)
    return tuple(out)


def _amplitude(apart: Floats) -> Floats:
    """(...) A, median over robots of how far loads (G, ..., 3) of cos, sin and constant part differ along a turn."""
    return np.asarray(np.median(np.hypot(apart[..., 0], apart[..., 1]) + np.abs(apart[..., 2]), axis=0))


def _holds(made: Made, joint: int) -> list[int]:
    """Postures in which a joint is fitted, in the order in which they were chosen."""
    menu = made.draft.menu
    laps = made.draft.laps(0)
    return list(dict.fromkeys(int(menu.hold[lap]) for lap in laps if menu.joint[lap] == joint))


def _fellow(made: Made, pair: Pair, hold: int) -> int:
    """The number, from 1, of the other posture of a pair in the plan's list of its joint."""
    (other,) = set(pair.holds) - {hold}
    return _holds(made, pair.joint).index(other) + 1


def _posture(
    planner: Planner, made: Made, block: tuple[int, int], *, pairs: tuple[Pair, ...], is_first: bool
) -> Posture:
    joint, hold = block
    robot, menu = planner.robot, planner.menu
    name = f"joint {joint} ({robot.joint(joint).name})"
    place = menu.of(joint).holds[hold]
    rises = _rises(planner, made, block)
    ratios = {pair.ratio: pair for pair in pairs if pair.joint == joint and hold in pair.holds}
    serves = tuple(dict.fromkeys([*ratios, *rises]))
    if not _carries(planner, menu, joint):
        why = f"{name} carries no weight that can be told from friction: its runs are for friction"
        return Posture(
            joint, tuple(place.tolist()), serves, why if is_first else f"{why}, here to see if the posture matters"
        )
    told = [_stance(robot, joint, place)]
    told += [
        f"shows {pair.ratio} with posture {_fellow(made, pair, hold)} of this joint, where the outer links' load"
        f" differs by {number(pair.apart, 2)} A"
        for pair in ratios.values()
    ]
    told += [_loss(rises)] if rises else []
    if len(told) == 1:
        told.append("the load differs from that of the other postures")
    return Posture(joint, tuple(place.tolist()), serves, "; ".join(told))


def _rises(planner: Planner, made: Made, block: tuple[int, int]) -> dict[str, float]:
    """Gravity parameters and ratios whose error rises without a posture's runs, and how many times, worst first."""
    menu, draft = planner.menu, made.draft
    count = len(menu)
    rest = [turn for turn in draft.chosen if menu.block_of(turn % count) != block]
    before = planner.criterion.errors(draft.information())
    after = planner.criterion.errors(draft.information(rest))
    share = np.median(after / before, axis=0)
    known = set(gravity_names(planner.robot))
    found = {name: float(rise) for name, rise in zip(menu.names, share, strict=True) if name in known and rise >= _MORE}
    worst = sorted(found.items(), key=lambda item: (-round(item[1], 6), item[0]))[:_NAMED]
    return {name: rise if rise < _UNSEEN else math.inf for name, rise in worst}


def _carries(planner: Planner, menu: Menu, joint: int) -> bool:
    """Whether a joint's runs tell anything but friction."""
    return bool(np.any(np.abs(menu.factors[joint - 1][..., :-4]) > 1e-9))


def _loss(rises: dict[str, float]) -> str:
    """What would be lost without a posture, worst first."""
    dark = [name for name, rise in rises.items() if math.isinf(rise)]
    worse = [(rise, name) for name, rise in rises.items() if not math.isinf(rise)]
    told = []
    if dark:
        # One posture shows the sum of several loads; it takes another to divide it among them.
        listed = ", ".join(dark[:-1]) + (" and " if len(dark) > 1 else "") + dark[-1]
        told.append(f"without it {listed} could not be told {'apart' if len(dark) > 1 else 'at all'}")
    if worse:
        listed = ", ".join(f"{name} would be {rise:.2g} times" for rise, name in worse)
        told.append(f"without it the error of {listed} as large")
    return "; ".join(told)


def _stance(robot: Robot, joint: int, hold: Floats) -> str:
    axis = axes(robot.alphas, robot.dh_angles(hold[None]))[0, joint - 1, :, 2]
    gravity = np.asarray(robot.gravity)
    size = float(np.linalg.norm(gravity)) or 1.0
    tilt_deg = math.acos(min(1.0, abs(float(axis @ gravity)) / size)) / factor("deg")
    return f"the axis of joint {joint} stands {tilt_deg:.0f} deg from the direction of gravity"
