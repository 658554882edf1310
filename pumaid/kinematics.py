"""Axes' directions of a serial chain in Craig's modified Denavit-Hartenberg convention, for a batch of postures."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def apart(first: ArrayLike, second: ArrayLike) -> Floats:
    """How far held positions are apart (rad or m, not negative), whole turns taken out; NaN where either is NaN.

    Encoders of endless joints are unwrapped file by file, so one posture may be told with turns between. A sliding
    joint that travels 2 pi m is taken for one of them: none does.
    """
    gap = np.asarray(first, dtype=float) - np.asarray(second, dtype=float)
    return np.abs(np.remainder(gap + np.pi, 2.0 * np.pi) - np.pi)


def link_rotation(alpha: ArrayLike, theta: ArrayLike) -> Floats:
    """Rotation that turns frame i into frame i-1: Rot_x(alpha) Rot_z(theta).

    Parameters
    ----------
    alpha
        Twist (rad); of several links so that it fits their angles.
    theta
        (...) joint angles (rad).

    Returns
    -------
    rotation
        (..., 3, 3); column k is axis k of frame i in frame i-1.

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
    """Rotations from every link frame to the base.

    Parameters
    ----------
    alphas
        (J,) twists (rad).
    thetas
        (N, J) DH angles (rad): measured position plus offset for a revolute joint, the offset for a prismatic one.

    Returns
    -------
    rotations
        (N, J, 3, 3); ``rotations[:, i, :, 2]`` is z of link i+1 in base axes.
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
    """Rotations of every link frame to the base, and its origin in base axes.

    Parameters
    ----------
    alphas, lengths
        (J,) twists (rad) and link lengths `a` (m).
    offsets, thetas
        (N, J) DH displacements `d` (m) and angles (rad).

    Returns
    -------
    rotations, positions
        (N, J, 3, 3), and (N, J, 3) in m.
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
