"""Whether a move between two postures strikes something, however a controller drives it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pumaid.clearance import Clearance, trapezoids
from pumaid.trajectory import MOVE_SHARE, accelerations, highest_speeds

Floats = NDArray[np.float64]


def struck(clearance: Clearance, starts: Floats, ends: Floats) -> NDArray[np.bool_]:
    """(K,) whether moves between postures (K, J), rad or m, strike something, driven straight or as the robot does.

    Straight in the joints' space is how URScript and the ROS 2 form of a plan move; the virtual robot, as some real
    ones, lets every joint run by its own trapezoid of speed, which bends the path.
    """
    speeds, ramps = _pace(clearance)
    return clearance.struck_moves(starts, ends, speeds=speeds, accelerations=ramps)


def explained(clearance: Clearance, start: Floats, end: Floats) -> str:
    """What comes nearest on the move from `start` (J,) to `end` (J,), on the worse of both courses."""
    speeds, ramps = _pace(clearance)
    bent = trapezoids(start[None], end[None], speeds=speeds, accelerations=ramps)
    if clearance.gap_along(bent, 1)[0] < clearance.gap(start[None], end[None])[0]:
        return f"where each joint runs by its own trapezoid of speed, {clearance.explain_along(bent)}"
    return clearance.explain(start, end)


def _pace(clearance: Clearance) -> tuple[Floats, Floats]:
    """(J,) speeds and accelerations of moves."""
    return MOVE_SHARE * highest_speeds(clearance.robot), accelerations(clearance.robot)
