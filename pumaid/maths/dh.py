"""Modified Denavit-Hartenberg parameters (Craig) of a serial chain, from the lines of its axes."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.maths.chain import SerialChain, turn

Floats = NDArray[np.float64]

#: Axes nearer to parallel than this (rad) are parallel, and nearer to meeting (m) meet: rounding, no geometry.
PARALLEL, MEETING = 1e-10, 1e-10
#: Nearly parallel is: within the first angle (rad), by which one written with four decimals may be off; or within the
#: second where the common normal's feet lie far from the joints' own places (m along the axes), as of a calibrated arm.
SLIGHTLY, CLEARLY, FAR = 1e-4, 0.02, 5.0


@dataclass(frozen=True, slots=True)
class DhChain:
    """Modified DH parameters, and where their frame 0 stands.

    Attributes
    ----------
    alpha, a, d, theta
        (J,) rad and m; `theta` of a joint that turns and `d` of one that slides are added to its position.
    base
        (4, 4) frame 0 in the chain's base (m).
    """

    alpha: Floats
    a: Floats
    d: Floats
    theta: Floats
    base: Floats


def modified_dh(chain: SerialChain) -> DhChain:
    """Parameters whose frames have z along the chain's axes, in the chain's own sense and with its own zeros.

    Each x lies along the common normal of its joint's axis and the next one; of the two directions it takes the one
    that turns `theta` least. Where the normal is free to shift (parallel axes, and the last axis) it goes through the
    joint's own origin; where it is free to turn (axes that coincide, and the last axis) `theta` is zero. The axis
    before the first is the base's z, or where the first is nearly parallel to it, the first axis moved to the base.

    Parameters
    ----------
    chain
        At least one joint; nearly parallel axes made parallel (`straightened`), for they have no usable normal.

    Source
    ------
    J. J. Craig, Introduction to Robotics, 3rd ed., section 3.4.
    """
    directions, points = (values[0] for values in chain.lines(np.zeros((1, len(chain.axes)))))
    z = np.vstack([[0.0, 0.0, 1.0], directions])
    own = np.vstack([np.zeros(3), points])
    if _is_nearly_parallel(z[0], z[1], own[1]):
        z[0] = np.sign(z[1, 2]) * z[1]
    n = len(directions)
    alpha, a, d, theta = np.zeros(n + 1), np.zeros(n + 1), np.zeros(n + 1), np.zeros(n + 1)
    x, foot = np.cross([0.0, 1.0, 0.0], z[0]), own[0]
    x, base = x / np.linalg.norm(x), np.eye(4)
    for i in range(n):
        normal, origin = _normal(z[i : i + 2], own[i : i + 2], x)
        if i == 0:
            base[:3] = np.column_stack([normal, np.cross(z[0], normal), z[0], origin])
        theta[i] = _angle(x, normal, about=z[i])
        d[i] = (origin - foot) @ z[i]
        alpha[i + 1] = _angle(z[i], z[i + 1], about=normal)
        a[i + 1] = (own[i + 1] - origin) @ normal
        x, foot = normal, origin + a[i + 1] * normal
    d[n] = (own[n] - foot) @ z[n]
    return DhChain(alpha[1:], a[1:], d[1:], theta[1:], base)


def _normal(z: Floats, own: Floats, before: Floats) -> tuple[Floats, Floats]:
    """Direction of the common normal of two axes, and its foot on the first."""
    cross = np.cross(z[0], z[1])
    between = own[1] - own[0]
    if np.linalg.norm(cross) < PARALLEL:
        aside = between - (between @ z[0]) * z[0]
        meets = np.linalg.norm(aside) < MEETING
        # x of the frame before stands across this axis but for rounding, which is taken out.
        normal = before - (before @ z[0]) * z[0] if meets else aside
        return _nearer(normal / np.linalg.norm(normal), before, z[0]), own[0]
    along = np.cross(between, z[1]) @ cross / (cross @ cross)
    return _nearer(cross / np.linalg.norm(cross), before, z[0]), own[0] + along * z[0]


def _nearer(normal: Floats, before: Floats, axis: Floats) -> Floats:
    """Of two opposite directions the one within a quarter turn; at exactly a quarter, the one turned forward."""
    angle = _angle(before, normal, about=axis)
    quarter = math.pi / 2.0
    return normal if -quarter + 1e-9 < angle <= quarter + 1e-9 else -normal


def _angle(start: Floats, end: Floats, *, about: Floats) -> float:
    return math.atan2(float(np.cross(start, end) @ about), float(start @ end))


def straightened(chain: SerialChain) -> tuple[SerialChain, dict[int, float]]:
    """The chain with nearly parallel neighbours made parallel, since their common normal says nothing of the arm.

    Every joint stays in its place against the one before; what follows the second axis turns with it.

    Parameters
    ----------
    chain
        As its description states it.

    Returns
    -------
    chain
        The same object where nothing was nearly parallel.
    angles
        Joint (from 1) -> by how much it was turned (rad).
    """
    placements, angles = chain.placements.copy(), {}
    for joint in range(1, len(placements)):
        previous, frame = chain.axes[joint - 1], placements[joint]
        now = frame[:3, :3] @ chain.axes[joint]
        if _is_nearly_parallel(previous, now, frame[:3, 3]):
            cross = np.cross(now, previous) * np.sign(now @ previous)
            size = float(np.linalg.norm(cross))
            angles[joint + 1] = math.asin(size)
            frame[:3, :3] = turn(cross / size, math.asin(size)) @ frame[:3, :3]
    return (replace(chain, placements=placements) if angles else chain), angles


def _is_nearly_parallel(first: Floats, second: Floats, between: Floats) -> bool:
    """Whether two axes, `between` (m) apart, are so by more than rounding and too near for a usable normal."""
    cross = np.cross(first, second)
    size = float(np.linalg.norm(cross))
    if not PARALLEL < size < CLEARLY:
        return False
    feet = [np.cross(between, axis) @ cross / size**2 for axis in (first, second)]
    return size < SLIGHTLY or float(np.abs(feet).max()) > FAR
