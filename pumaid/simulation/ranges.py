"""Where a plan may go: spans, reference positions and candidate postures within the recipe's limits."""

from __future__ import annotations

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


def anywhere(robot: Robot, count: int, rng: np.random.Generator) -> Floats:
    """(count, J) positions: turning joints at any angle, sliding joints where a plan may move them."""
    share = rng.uniform(-np.pi, np.pi, (count, robot.n_joints)) / np.pi
    ends = np.array([(-np.pi, np.pi) if joint.is_revolute else span(joint) for joint in robot.joints])
    middle, half = 0.5 * ends.sum(axis=1), 0.5 * np.diff(ends, axis=1)[:, 0]
    return np.asarray(middle + half * share)
