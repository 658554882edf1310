"""Kinematics of serial chains: link frames by modified Denavit-Hartenberg parameters (Craig), or by placements."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

#: Axes nearer to parallel than this (rad) are parallel, and nearer to meeting (m) meet: rounding, no geometry.
PARALLEL, MEETING = 1e-10, 1e-10
#: Nearly parallel is: within the first angle (rad), by which one written with four decimals may be off; or within the
#: second where the common normal's feet lie far from the joints' own places (m along the axes), as of a calibrated arm.
SLIGHTLY, CLEARLY, FAR = 1e-4, 0.02, 5.0


def apart(first: ArrayLike, second: ArrayLike) -> Floats:
    """How far held positions are apart (rad or m, not negative), whole turns taken out; NaN where either is NaN.

    Encoders of endless joints are unwrapped file by file, so one posture may be told with turns between. A sliding
    joint that travels 2 pi m is taken for one of them: none does.
    """
    gap = np.asarray(first, dtype=float) - np.asarray(second, dtype=float)
    return np.abs(np.remainder(gap + np.pi, 2.0 * np.pi) - np.pi)


def link_rotation(alpha: ArrayLike, theta: ArrayLike) -> Floats:
    """Rotations (..., 3, 3) that turn frame i into frame i-1, for a twist and (...) joint angles (rad): Rot_x(alpha)
    Rot_z(theta); column k is axis k of frame i in frame i-1.

    Source
    ------
    J. J. Craig, Introduction to Robotics, 3rd ed., eq. (3.6).
    """
    angle = np.asarray(theta, dtype=float)
    c, s = np.cos(angle), np.sin(angle)
    ca, sa = np.cos(alpha), np.sin(alpha)
    out = np.empty((*angle.shape, 3, 3))
    for row, columns in enumerate(((c, -s, 0.0), (s * ca, c * ca, -sa), (s * sa, c * sa, ca))):
        for column, values in enumerate(columns):
            out[..., row, column] = values
    return out


def axes(alphas: ArrayLike, thetas: ArrayLike) -> Floats:
    """Rotations (N, J, 3, 3) from every link frame to the base; ``[:, i, :, 2]`` is z of link i+1 in base axes.

    Parameters
    ----------
    alphas
        (J,) twists (rad).
    thetas
        (N, J) DH angles (rad): measured position plus offset for a revolute joint, the offset for a prismatic one.
    """
    angles = np.atleast_2d(np.asarray(thetas, dtype=float))
    cosines, sines = np.cos(angles), np.sin(angles)
    out = np.empty((*angles.shape, 3, 3))
    x, y, z = np.broadcast_to(np.eye(3)[:, None], (3, len(angles), 3))
    for link, alpha in enumerate(np.asarray(alphas, dtype=float)):
        c, s = cosines[:, link, None], sines[:, link, None]
        level, z = np.cos(alpha) * y + np.sin(alpha) * z, np.cos(alpha) * z - np.sin(alpha) * y
        x, y = c * x + s * level, c * level - s * x
        out[:, link, :, 0], out[:, link, :, 1], out[:, link, :, 2] = x, y, z
    return out


def frames(alphas: ArrayLike, lengths: ArrayLike, *, offsets: ArrayLike, thetas: ArrayLike) -> tuple[Floats, Floats]:
    """Rotations (N, J, 3, 3) of every link frame to the base, and its origin (N, J, 3) in base axes (m).

    Parameters
    ----------
    alphas, lengths
        (J,) twists (rad) and link lengths `a` (m).
    offsets, thetas
        (N, J) DH displacements `d` (m) and angles (rad).
    """
    along_x = np.asarray(lengths, dtype=float)
    along_z = np.atleast_2d(np.asarray(offsets, dtype=float))
    rotations = axes(alphas, thetas)
    steps = rotations[..., 2] * along_z[..., None]
    steps[:, 0, 0] += along_x[0]
    steps[:, 1:] += rotations[:, :-1, :, 0] * along_x[1:, None]
    return rotations, np.cumsum(steps, axis=1)


def origins(alphas: ArrayLike, lengths: ArrayLike, *, offsets: ArrayLike, thetas: ArrayLike) -> Floats:
    """(N, J, 3) origins of every link frame in base axes, m; arguments as for `frames`."""
    return frames(alphas, lengths, offsets=offsets, thetas=thetas)[1]


@dataclass(frozen=True, slots=True)
class SerialChain:
    """Joints from base to tip.

    `placements` (J, 4, 4) are each joint's frame, at zero, in the frame that the joint before moves (m), the first in
    the base; `axes` (J, 3) unit vectors in the joint's own frame; `slides` (J,) tells which joints slide instead of
    turning.
    """

    placements: Floats
    axes: Floats
    slides: NDArray[np.bool_]

    def lines(self, positions: ArrayLike) -> tuple[Floats, Floats]:
        """Directions and points, each (N, J, 3) in base axes, of every joint's axis at (N, J) positions (rad or m)."""
        q = np.atleast_2d(np.asarray(positions, dtype=float))
        directions, points = np.empty((*q.shape, 3)), np.empty((*q.shape, 3))
        frame_before = np.broadcast_to(np.eye(4), (len(q), 4, 4))
        for joint, (placement, axis) in enumerate(zip(self.placements, self.axes, strict=True)):
            frame = frame_before @ placement
            directions[:, joint] = frame[:, :3, :3] @ axis
            points[:, joint] = frame[:, :3, 3]
            frame_before = frame @ _motion(axis, q[:, joint], slides=bool(self.slides[joint]))
        return directions, points


def placement(xyz: ArrayLike, rpy: ArrayLike) -> Floats:
    """A (4, 4) frame shifted by `xyz` (m) and turned by `rpy` (rad): Rot_z(yaw) Rot_y(pitch) Rot_x(roll).

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


@dataclass(frozen=True, slots=True)
class DhChain:
    """Modified DH parameters (J,), rad and m, and the (4, 4) frame 0 in the chain's base (m).

    `theta` of a joint that turns and `d` of one that slides are added to its position.
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
    Nearly parallel axes have no usable normal: make them parallel first (`straightened`).

    Source
    ------
    J. J. Craig, Introduction to Robotics, 3rd ed., section 3.4.
    """
    directions, points = (values[0] for values in chain.lines(np.zeros((1, len(chain.axes)))))
    z = np.vstack([[0.0, 0.0, 1.0], directions])
    feet = np.vstack([np.zeros(3), points])
    if _is_nearly_parallel(z[0], z[1], feet[1]):
        z[0] = np.sign(z[1, 2]) * z[1]
    n = len(directions)
    alpha, a, d, theta = np.zeros(n + 1), np.zeros(n + 1), np.zeros(n + 1), np.zeros(n + 1)
    x, foot = np.cross([0.0, 1.0, 0.0], z[0]), feet[0]
    x, base = x / np.linalg.norm(x), np.eye(4)
    for i in range(n):
        normal, origin = _normal(z[i : i + 2], feet[i : i + 2], x)
        if i == 0:
            base[:3] = np.column_stack([normal, np.cross(z[0], normal), z[0], origin])
        theta[i] = _angle(x, normal, about=z[i])
        d[i] = (origin - foot) @ z[i]
        alpha[i + 1] = _angle(z[i], z[i + 1], about=normal)
        a[i + 1] = (feet[i + 1] - origin) @ normal
        x, foot = normal, origin + a[i + 1] * normal
    d[n] = (feet[n] - foot) @ z[n]
    return DhChain(alpha[1:], a[1:], d[1:], theta[1:], base)


def _normal(z: Floats, points: Floats, before: Floats) -> tuple[Floats, Floats]:
    """Direction of the common normal of two axes, and its foot on the first."""
    cross = np.cross(z[0], z[1])
    between = points[1] - points[0]
    if np.linalg.norm(cross) < PARALLEL:
        aside = between - (between @ z[0]) * z[0]
        meets = np.linalg.norm(aside) < MEETING
        # x of the frame before stands across this axis but for rounding, which is taken out.
        normal = before - (before @ z[0]) * z[0] if meets else aside
        return _nearer(normal / np.linalg.norm(normal), before, z[0]), points[0]
    along = np.cross(between, z[1]) @ cross / (cross @ cross)
    return _nearer(cross / np.linalg.norm(cross), before, z[0]), points[0] + along * z[0]


def _nearer(normal: Floats, before: Floats, axis: Floats) -> Floats:
    """Of two opposite directions the one within a quarter turn; at exactly a quarter, the one turned forward."""
    angle = _angle(before, normal, about=axis)
    quarter = math.pi / 2.0
    return normal if -quarter + 1e-9 < angle <= quarter + 1e-9 else -normal


def _angle(start: Floats, end: Floats, *, about: Floats) -> float:
    return math.atan2(float(np.cross(start, end) @ about), float(start @ end))


def straightened(chain: SerialChain) -> tuple[SerialChain, dict[int, float]]:
    """The chain with nearly parallel neighbours made parallel, since their common normal says nothing of the arm.

    Every joint stays in its place against the one before; what follows the second axis turns with it. With it the
    joints (from 1) that were turned, and by how much (rad).
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


Numbers = NDArray[np.int64]


def grouped(count: int, alike: Callable[[int, Numbers], NDArray[np.bool_]]) -> Iterator[list[int]]:
    """Groups of numbers 0..count-1, each of a first one and those after it that are like it and like no earlier first.

    Parameters
    ----------
    count
        How many there are.
    alike
        Of a number and (n,) numbers, whether each of these is like it.

    Examples
    --------
    >>> values = np.array([1.0, 5.0, 1.1, 5.1, 1.2])
    >>> list(grouped(5, lambda first, others: np.abs(values[others] - values[first]) < 0.15))
    [[0, 2], [1, 3], [4]]
    """
    remaining = np.arange(count, dtype=np.int64)
    while len(remaining):
        members = alike(int(remaining[0]), remaining)
        members[0] = True
        yield remaining[members].tolist()
        remaining = remaining[~members]


def near(postures: Floats, first: int, numbers: Numbers, *, within: float) -> Numbers:
    """Those of some postures that are one's neighbours, whole turns taken out.

    Parameters
    ----------
    postures
        (N, J) rad or m; where one is NaN it is near any.
    first, numbers
        The one's number, and (n,) numbers.
    within
        How far apart (rad or m) they may be at each joint.
    """
    # Joint after joint: of thousands of postures few are left for the second.
    for column in postures.T:
        if not len(numbers):
            break
        numbers = numbers[~(apart(column[first], column[numbers]) > within)]
    return numbers


def marked(others: Numbers, chosen: Numbers) -> NDArray[np.bool_]:
    """(n,) which of some rising numbers are chosen."""
    out = np.zeros(len(others), dtype=np.bool_)
    out[np.searchsorted(others, chosen)] = True
    return out
