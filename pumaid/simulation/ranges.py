"""Where a plan may go: spans, reference positions and candidate postures within the recipe's limits."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pumaid.robot import Joint, Robot
from pumaid.units import factor

Floats = NDArray[np.float64]
_DEG = factor("deg")

#: Span of a turning joint without limits (the paper's), and the widest worth its time (both well over half a
#: turn, so that a spring is told from a sinusoid).
USUAL_TURN, WIDEST_TURN = 250.0 * _DEG, 270.0 * _DEG
#: Span of a sliding joint without limits, m, from zero.
USUAL_SLIDE = 0.3
#: Highest speeds that a plan asks of a joint, whatever it could: rad/s, m/s.
QUICKEST_TURN, QUICKEST_SLIDE = 1.75, 0.25
#: What is left free at each limit, as a share of the range, and at most: rad, m. Real controllers overshoot.
_MARGIN, _MOST_TURN, _MOST_SLIDE = 0.02, 3.0 * _DEG, 0.01
#: Held joints stand at multiples of this, so that people can read and set them: rad.
_STEP = 15.0 * _DEG
#: A held joint keeps within this of its reference position where its limits are wider: rad.
_FARTHEST = 150.0 * _DEG


def span(joint: Joint) -> tuple[float, float]:
    """Lowest and highest position that a plan gives the joint when it moves, rad or m."""
    usual = (-0.5 * USUAL_TURN, 0.5 * USUAL_TURN) if joint.is_revolute else (0.0, USUAL_SLIDE)
    if joint.limits is None:
        return usual
    low, high = joint.limits
    margin = min(_MARGIN * (high - low), _MOST_TURN if joint.is_revolute else _MOST_SLIDE)
    low, high = low + margin, high - margin
    if not joint.is_revolute or high - low <= WIDEST_TURN:
        return low, high
    # Of more than a turn the part about zero is used, or the part nearest to it.
    centre = min(max(0.0, low + 0.5 * WIDEST_TURN), high - 0.5 * WIDEST_TURN)
    return centre - 0.5 * WIDEST_TURN, centre + 0.5 * WIDEST_TURN


def reference(robot: Robot) -> Floats:
    """(J,) where joints are held when it does not matter: zero where the limits have it, else their middle."""
    places = []
    for joint in robot.joints:
        low, high = span(joint)
        places.append(0.0 if low <= 0.0 <= high and joint.is_revolute else 0.5 * (low + high))
    return np.array(places)


def anywhere(robot: Robot, count: int, rng: np.random.Generator) -> Floats:
    """(count, J) positions: turning joints at any angle, sliding joints where a plan may move them."""
    share = rng.uniform(-np.pi, np.pi, (count, robot.n_joints)) / np.pi
    ends = np.array([(-np.pi, np.pi) if joint.is_revolute else span(joint) for joint in robot.joints])
    middle, half = 0.5 * ends.sum(axis=1), 0.5 * np.diff(ends, axis=1)[:, 0]
    return np.asarray(middle + half * share)


def candidates(robot: Robot, joint: int, *, free: list[int], count: int, rng: np.random.Generator) -> Floats:
    """Postures that may be held while one joint moves.

    Parameters
    ----------
    robot
        Limits.
    joint
        Moving joint, from 1.
    free
        Joints (from 1) that are varied; the others stay at their reference.
    count
        How many are drawn; the reference and single joints turned by a quarter come on top.
    rng
        Source of the drawn ones.

    Returns
    -------
    postures
        (K, J) rad or m, without repeats.
    """
    home = reference(robot)
    grids = {number: _grid(robot.joint(number), float(home[number - 1])) for number in free}
    postures = [home.copy()]
    for number, grid in grids.items():
        for wanted in (-0.5 * np.pi, 0.5 * np.pi):
            posture = home.copy()
            posture[number - 1] = grid[np.argmin(np.abs(grid - home[number - 1] - wanted))]
            postures.append(posture)
    for _ in range(count):
        posture = home.copy()
        for number, grid in grids.items():
            posture[number - 1] = rng.choice(grid)
        postures.append(posture)
    table = np.array(postures)
    table[:, joint - 1] = home[joint - 1]
    _, first = np.unique(np.round(table, 9), axis=0, return_index=True)
    return table[np.sort(first)]


def _grid(joint: Joint, home: float) -> Floats:
    low, high = span(joint)
    if not joint.is_revolute:
        return np.round(np.linspace(low, high, 5), 4)
    low, high = max(low, home - _FARTHEST), min(high, home + _FARTHEST)
    steps = np.arange(math.ceil(low / _STEP - 1e-9), math.floor(high / _STEP + 1e-9) + 1) * _STEP
    return np.asarray(steps if len(steps) >= 5 else np.linspace(low, high, 5), dtype=float)
