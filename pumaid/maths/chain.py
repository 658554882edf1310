"""A serial chain as a URDF states it: homogeneous transforms and axes, without link parameters of any convention."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SerialChain:
    """Joints from base to tip.

    Attributes
    ----------
    placements
        (J, 4, 4) each joint's frame, at zero, in the frame that the joint before moves (m); the first in the base.
    axes
        (J, 3) unit vectors along each joint's axis, in its own frame.
    slides
        (J,) whether each joint slides instead of turning.
    """

    placements: Floats
    axes: Floats
    slides: NDArray[np.bool_]

    def lines(self, positions: ArrayLike) -> tuple[Floats, Floats]:
        """Where every joint's axis lies in each posture.

        Parameters
        ----------
        positions
            (N, J), rad or m.

        Returns
        -------
        directions, points
            Each (N, J, 3), in base axes: unit vectors, and a point of each axis (the joint's own origin, m).
        """
        q = np.atleast_2d(np.asarray(positions, dtype=float))
        directions, points = np.empty((*q.shape, 3)), np.empty((*q.shape, 3))
        so_far = np.broadcast_to(np.eye(4), (len(q), 4, 4))
        for joint, (placement, axis) in enumerate(zip(self.placements, self.axes, strict=True)):
            here = so_far @ placement
            directions[:, joint] = here[:, :3, :3] @ axis
            points[:, joint] = here[:, :3, 3]
            so_far = here @ _motion(axis, q[:, joint], slides=bool(self.slides[joint]))
        return directions, points


def placement(xyz: ArrayLike, rpy: ArrayLike) -> Floats:
    """A frame shifted by `xyz` (m) and turned by `rpy` (rad): Rot_z(yaw) Rot_y(pitch) Rot_x(roll).

    Returns
    -------
    transform
        (4, 4).

    Source
    ------
    URDF's definition of ``origin`` (wiki.ros.org/urdf/XML/joint): roll, pitch, yaw about fixed axes.
    """
    out = np.eye(4)
    for axis, angle in zip(np.eye(3), np.asarray(rpy, dtype=float), strict=True):
        out[:3, :3] = turn(axis, angle) @ out[:3, :3]
    out[:3, 3] = xyz
    return out


def turn(axis: ArrayLike, angle: ArrayLike) -> Floats:
    """Rotations about a unit vector by (...) angles (rad), by Rodrigues' formula; (..., 3, 3)."""
    x, y, z = np.asarray(axis, dtype=float)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    amount = np.asarray(angle, dtype=float)[..., None, None]
    return np.eye(3) + np.sin(amount) * cross + (1.0 - np.cos(amount)) * (cross @ cross)


def _motion(axis: Floats, position: Floats, *, slides: bool) -> Floats:
    """What a joint does to all that it carries: (N, 4, 4)."""
    out = np.broadcast_to(np.eye(4), (len(position), 4, 4)).copy()
    if slides:
        out[:, :3, 3] = position[:, None] * axis
    else:
        out[:, :3, :3] = turn(axis, position)
    return out
