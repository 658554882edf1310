"""Kinematics: link frames against 4 x 4 matrices, and modified DH parameters of chains with known tables."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pumaid.kinematics import (
    SerialChain,
    apart,
    axes,
    grouped,
    link_rotation,
    marked,
    modified_dh,
    near,
    origins,
    placement,
    straightened,
)

HALF = np.pi / 2
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


def chain(*joints: tuple) -> SerialChain:
    """Joints of (xyz, rpy), about or along their own z."""
    frames = np.array([placement(xyz, rpy) for xyz, rpy in joints], dtype=float)
    return SerialChain(frames, np.tile([0.0, 0.0, 1.0], (len(joints), 1)), np.zeros(len(joints), dtype=bool))


def rows(arm: SerialChain) -> list[tuple[float, ...]]:
    """theta, alpha, a, d of each joint, to nine decimals."""
    found = modified_dh(arm)
    columns = (found.theta, found.alpha, found.a, found.d)
    return [tuple(round(float(v), 9) + 0.0 for v in row) for row in zip(*columns, strict=True)]


QUARTER = round(HALF, 9)


def test_placement_is_pinocchios() -> None:
    """Roll, pitch and yaw are about fixed axes, as pinocchio has them."""
    pin = pytest.importorskip("pinocchio")
    found = placement([1.0, 2.0, 3.0], [0.3, -0.7, 1.9])
    assert found[:3, :3] == pytest.approx(pin.rpy.rpyToMatrix(0.3, -0.7, 1.9), abs=1e-15)
    assert found[:3, 3].tolist() == [1.0, 2.0, 3.0]


def test_meeting_axes() -> None:
    """Axes that meet have a = 0, and d leads to where they meet, wherever the joints' own places are."""
    arm = chain(((0, 0, 0.1), (0, 0, 0)), ((0.0, -0.2, 0.3), (HALF, 0, 0)))
    assert rows(arm) == [(0.0, 0.0, 0.0, 0.4), (0.0, QUARTER, 0.0, 0.2)]


def test_parallel_axes_keep_the_joints_own_height() -> None:
    """A SCARA's table: lengths in a, each joint's own height in d, and no angle but zero."""
    arm = chain(((0, 0, 0.4), (0, 0, 0)), ((0.3, 0, 0.05), (0, 0, 0)), ((0.25, 0, -0.1), (np.pi, 0, 0)))
    assert rows(arm)[:2] == [(0.0, 0.0, 0.0, 0.4), (0.0, 0.0, 0.3, 0.05)]
    assert rows(arm)[2] == (0.0, round(np.pi, 9), 0.25, 0.1)


def test_lengths_backward_are_negative() -> None:
    """An arm that lies along -x has negative a and no half turns, as the vendor's table of the UR5 has."""
    arm = chain(((0, 0, 0.1), (0, 0, 0)), ((0, 0, 0), (HALF, 0, 0)), ((-0.425, 0, 0), (0, 0, 0)))
    assert rows(arm) == [(0.0, 0.0, 0.0, 0.1), (0.0, QUARTER, 0.0, 0.0), (0.0, 0.0, -0.425, 0.0)]


def test_base_is_turned_and_raised_where_the_first_axis_is_level() -> None:
    """Frame 0 moves along the base's z to the foot of the first normal, and x to that normal."""
    found = modified_dh(chain(((0.3, 0.0, 0.5), (0.0, HALF, HALF))))
    assert found.base[:3, 2].tolist() == [0.0, 0.0, 1.0]
    assert found.base[:3, 3] == pytest.approx([0.0, 0.0, 0.5], abs=1e-15)
    assert abs(found.base[0, 0]) == pytest.approx(1.0)
    assert abs(found.a[0]) == pytest.approx(0.3)


def test_a_slightly_tilted_base_follows_the_first_axis() -> None:
    """A first axis a hair off the vertical is exact all the same: the base tilts, not the arm."""
    arm = chain(((0, 0, 0.4), (3e-6, 0, 0)), ((0.3, 0, 0), (HALF, 0, 0)))
    found = modified_dh(arm)
    assert straightened(arm)[1] == {}
    assert np.arccos(found.base[2, 2]) == pytest.approx(3e-6, rel=1e-3)
    assert np.abs([*found.a, *found.d]).max() < 0.5


def test_nearly_parallel_axes_are_made_parallel() -> None:
    """An angle of 1e-5 is taken out and told; the joint stays in its place."""
    arm = chain(((0, 0, 0.4), (0, 0, 0)), ((0.3, 0, 0), (1e-5, 0, 0)), ((0.2, 0, 0), (HALF, 0, 0)))
    straight, angles = straightened(arm)
    assert angles == {2: pytest.approx(1e-5)}
    assert straight.placements[1] == pytest.approx(placement([0.3, 0, 0], [0, 0, 0]), abs=1e-15)
    assert np.abs(modified_dh(straight).d).max() == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("angle", "is_bent"), [(1e-12, False), (1e-4, True), (1e-3, True), (0.015, True), (0.03, False)]
)
def test_how_parallel_is_nearly(angle: float, is_bent: bool) -> None:
    """Rounding is none, and beyond 0.02 rad an angle is meant; between, it depends on how far off the normal lies."""
    meeting_far_off = chain(((0, 0, 0), (0, 0, 0)), ((0.3, 0, 0), (0.0, angle, 0)))
    assert bool(straightened(meeting_far_off)[1]) == is_bent


def test_a_small_angle_between_axes_that_meet_nearby_stays() -> None:
    """Axes that meet in the joint's own place have a usable normal at any angle that is not rounding."""
    arm = chain(((0, 0, 0), (0, 0, 0)), ((0.0, 0.0, 0.3), (0.0, 1e-3, 0)))
    assert straightened(arm)[0] is arm
    assert modified_dh(arm).alpha[1] == pytest.approx(1e-3, abs=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_groups_are_those_of_a_loop(seed):
    """Each number joins the first group whose first member it is like, also where likeness goes on in chains."""
    values = np.random.default_rng(seed).uniform(0.0, 1.0, 60)
    wanted: list[list[int]] = []
    for number, value in enumerate(values):
        own = next((group for group in wanted if abs(values[group[0]] - value) < 0.05), None)
        if own is None:
            wanted.append([number])
        else:
            own.append(number)
    assert list(grouped(60, lambda first, others: np.abs(values[others] - values[first]) < 0.05)) == wanted


@pytest.mark.parametrize("seed", range(5))
def test_near_postures_are_those_of_a_comparison_with_all(seed):
    """Joint after joint, with whole turns between and unknown positions, the same as all joints at once."""
    rng = np.random.default_rng(seed)
    postures = rng.choice([0.0, 0.3, 1.0], (200, 4)) + rng.normal(scale=0.01, size=(200, 4))
    postures += 2.0 * np.pi * rng.integers(-2, 3, postures.shape)
    postures[rng.random(postures.shape) < 0.05] = np.nan
    others = np.flatnonzero(rng.random(200) < 0.7)
    for first in range(0, 200, 7):
        wanted = ~(apart(postures[first], postures[others]) > 0.02).any(axis=1)
        found = near(postures, first, others, within=0.02)
        assert np.array_equal(found, others[wanted]) and np.array_equal(marked(others, found), wanted)
