"""Frames by roll, pitch and yaw or by an axis, and postures that are near one another."""

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import ArrayLike

from pumaid.maths import Counts, Floats


def apart(first: ArrayLike, second: ArrayLike) -> Floats:
    """How far held positions are apart (rad or m, not negative), whole turns taken out; NaN where either is NaN.

    Encoders of endless joints are unwrapped file by file, so one posture may be told with turns between. A sliding
    joint that travels 2 pi m is taken for one of them: none does.
    """
    gap = np.asarray(first, dtype=float) - np.asarray(second, dtype=float)
    return np.abs(np.remainder(gap + np.pi, 2.0 * np.pi) - np.pi)


def placement(xyz: ArrayLike, rpy: ArrayLike, axis: ArrayLike = (0.0, 0.0, 1.0)) -> Floats:
    """A (4, 4) frame shifted by `xyz` (m), turned by `rpy` (rad) and then by the least angle that takes z to `axis`.

    Source
    ------
    URDF's definition of ``origin`` (wiki.ros.org/urdf/XML/joint): Rot_z(yaw) Rot_y(pitch) Rot_x(roll).
    """
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    about_y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    about_z = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    out = np.eye(4)
    out[:3, :3] = about_z @ about_y @ about_x @ turn_of_z(axis)
    out[:3, 3] = xyz
    return out


def turn_of_z(axis: ArrayLike) -> Floats:
    """The rotation (3, 3) by the least angle that takes z to the direction of a vector; about x where that is -z."""
    x, y, z = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    if z < 1e-15 - 1.0:
        return np.diag([1.0, -1.0, -1.0])
    cross = np.array([[0.0, 0.0, x], [0.0, 0.0, y], [-x, -y, 0.0]])
    return np.eye(3) + cross + cross @ cross / (1.0 + z)


def roll_pitch_yaw(rotation: Floats) -> tuple[float, float, float]:
    """Angles (rad) with Rot_z(yaw) Rot_y(pitch) Rot_x(roll) = `rotation` (3, 3), exact also at a pitch of 90 deg."""
    yaw = float(np.arctan2(rotation[1, 0], rotation[0, 0]))
    pitch = float(np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0])))
    # Roll from what is left when yaw is taken out: near a right angle the errors of both then cancel.
    side = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
    roll = float(np.arctan2(-side @ rotation[:, 2], side @ rotation[:, 1]))
    return roll, pitch, yaw


Numbers = Counts


def grouped(count: int, alike: Callable[[int, Numbers], Numbers]) -> Iterator[list[int]]:
    """Groups of numbers 0..count-1, each of a first one and those after it that are like it and like no earlier first.

    Parameters
    ----------
    count
        How many there are.
    alike
        Of a number and (n,) numbers, those of these that are like it.

    Examples
    --------
    >>> values = np.array([1.0, 5.0, 1.1, 5.1, 1.2])
    >>> list(grouped(5, lambda first, others: others[np.abs(values[others] - values[first]) < 0.15]))
    [[0, 2], [1, 3], [4]]
    """
    remaining = np.arange(count, dtype=np.int64)
    while len(remaining):
        members = np.zeros(len(remaining), np.bool_)
        members[np.searchsorted(remaining, alike(int(remaining[0]), remaining))] = True
        members[0] = True
        yield remaining[members].tolist()
        remaining = remaining[~members]


def posture_groups(postures: Floats, within: float) -> list[list[int]]:
    """Numbers (from 0) of (N, J) postures that are `within` (rad or m) of the first of their group."""
    return list(grouped(len(postures), lambda first, rest: near(postures, first, rest, within=within)))


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
