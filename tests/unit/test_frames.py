"""Axes' directions and origins against rotations and products of 4 x 4 matrices, written out."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pumaid.kinematics import axes, link_rotation, origins

RNG = np.random.default_rng(2)
ALPHAS, LENGTHS = RNG.uniform(-3, 3, 4), RNG.uniform(-1, 1, 4)
OFFSETS, THETAS = RNG.uniform(-1, 1, (6, 4)), RNG.uniform(-3, 3, (6, 4))


def transforms(row: int) -> list[np.ndarray]:
    """Frames of one posture in the base: Trans_x(a) Rot_x(alpha) Trans_z(d) Rot_z(theta), one after another."""
    frames, so_far = [], np.eye(4)
    for alpha, a, d, theta in zip(ALPHAS, LENGTHS, OFFSETS[row], THETAS[row], strict=True):
        about_x, about_z = np.eye(4), np.eye(4)
        about_x[:3, :3], about_x[0, 3] = Rotation.from_euler("x", alpha).as_matrix(), a
        about_z[:3, :3], about_z[2, 3] = Rotation.from_euler("z", theta).as_matrix(), d
        so_far = so_far @ about_x @ about_z
        frames.append(so_far)
    return frames


def test_link_rotation_is_about_x_then_z():
    """One link's rotation is scipy's, for a batch of angles of any shape."""
    angles = RNG.uniform(-3, 3, (2, 3))
    found = link_rotation(0.7, angles)
    assert found.shape == (2, 3, 3, 3)
    wanted = Rotation.from_euler("x", 0.7).as_matrix() @ Rotation.from_euler("z", angles[1, 2]).as_matrix()
    assert found[1, 2] == pytest.approx(wanted, abs=1e-15)


def test_axes_of_a_batch():
    """Every link's axes in the base are those of the 4 x 4 products."""
    found = axes(ALPHAS, THETAS)
    for row in range(6):
        assert found[row] == pytest.approx(np.array([frame[:3, :3] for frame in transforms(row)]), abs=1e-14)


def test_origins_of_a_batch():
    """Every link's origin in the base is that of the 4 x 4 products."""
    found = origins(ALPHAS, LENGTHS, offsets=OFFSETS, thetas=THETAS)
    for row in range(6):
        assert found[row] == pytest.approx(np.array([frame[:3, 3] for frame in transforms(row)]), abs=1e-14)
