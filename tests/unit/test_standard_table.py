"""Recipes of standard Denavit-Hartenberg tables: where joints and stated points are, and which kind a table is of."""

import math
from pathlib import Path

import numpy as np
import pytest

from pumaid.errors import Faults, PumaidError
from pumaid.io.recipe import read_recipe, shipped_recipes

HEAD = "name: arm\ngravity: [0, 0, -9.80665]\nunits: {angle: deg}\n"
STANDARD = HEAD + "convention: standard\n"
#: alpha (deg), a and d (m) of the UR5e as its maker publishes them.
UR5E = ((90, 0, 0.1625), (0, -0.425, 0), (0, -0.3922, 0), (90, 0, 0.1333), (-90, 0, 0.0997), (0, 0, 0.0996))
#: Modified: alpha (deg), a and d (m) of the PUMA 560, Armstrong, Khatib and Burdick (1986).
PUMA = ((0, 0, 0), (-90, 0, 0.2435), (0, 0.4318, -0.0934), (90, -0.0203, 0.4331), (-90, 0, 0), (90, 0, 0))


def row(alpha: float, a: float, d: float, *, theta: float = 0.0, kind: str = "revolute") -> str:
    return f"  - {{type: {kind}, theta: {theta!r}, alpha: {alpha!r}, a: {a!r}, d: {d!r}}}\n"


def robot_of(folder: Path, text: str):
    (folder / "recipe.yaml").write_text(text)
    return read_recipe(folder / "recipe.yaml")


def about(axis: int, angle: float) -> np.ndarray:
    """(4, 4) of an elementary rotation."""
    out, (i, j) = np.eye(4), ((1, 2), (2, 0), (0, 1))[axis]
    out[i, i] = out[j, j] = math.cos(angle)
    out[i, j], out[j, i] = -math.sin(angle), math.sin(angle)
    return out


def along(axis: int, length: float) -> np.ndarray:
    """(4, 4) of an elementary shift."""
    out = np.eye(4)
    out[axis, 3] = length
    return out


@pytest.mark.parametrize("seed", range(6))
def test_axes_are_those_of_the_product_of_elementary_motions(tmp_path, seed: int) -> None:
    """Each joint's axis is the z of the frame before it; a tool and a payload are where the last frame has them."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 8))
    kinds = rng.choice(["revolute", "revolute", "prismatic"], n)
    alphas, thetas = rng.choice([-90.0, 90.0, 30.0, -125.0], n), rng.uniform(-170, 170, n)
    lengths, shifts, q = rng.uniform(-0.5, 0.5, n), rng.uniform(-0.5, 0.5, n), rng.uniform(-1, 1, n)
    rows = zip(alphas, lengths, shifts, thetas, kinds, strict=True)
    joints = "".join(
        row(float(alpha), float(a), float(d), theta=float(theta), kind=kind) for alpha, a, d, theta, kind in rows
    )
    safety = "safety: {floor: -9, tool: [0.1, 0.2, 0.3]}\nfiles: {x: {payload: {mass: 1, at: [0.1, 0.2, 0.3]}}}\n"
    robot = robot_of(tmp_path, f"{STANDARD}joints:\n{joints}{safety}")
    turned, placed = robot.frames(q[None])
    frame = np.eye(4)
    for joint in range(n):
        z, offset = frame[:3, 2], placed[0, joint] - frame[:3, 3]
        assert np.allclose(turned[0, joint, :, 2], z, atol=1e-12)
        assert np.linalg.norm(np.cross(offset, z)) < 1e-12
        turn, slide = (q[joint], 0.0) if kinds[joint] == "revolute" else (0.0, q[joint])
        frame = frame @ about(2, math.radians(thetas[joint]) + turn) @ along(2, shifts[joint] + slide)
        frame = frame @ along(0, lengths[joint]) @ about(0, math.radians(alphas[joint]))
    tip = frame[:3, :3] @ [0.1, 0.2, 0.3] + frame[:3, 3]
    assert robot.safety is not None
    for point in (robot.safety.tool, robot.payloads["x"][1:]):
        assert np.allclose(turned[0, -1] @ point + placed[0, -1], tip, atol=1e-12)


def test_published_tables_of_both_kinds_are_one_arm(tmp_path) -> None:
    """The UR5e's standard table is the shipped recipe, and the PUMA's modified one is itself with its rows moved up."""
    made = robot_of(tmp_path, STANDARD + "joints:\n" + "".join(row(*numbers) for numbers in UR5E))
    shipped = read_recipe(shipped_recipes()["ur5e"])
    assert np.allclose(made.placements, shipped.placements, atol=1e-12)
    moved = [(*after[:2], numbers[2]) for numbers, after in zip(PUMA, [*PUMA[1:], (0, 0, 0)], strict=True)]
    paper = robot_of(tmp_path, HEAD + "joints:\n" + "".join(row(*numbers) for numbers in PUMA))
    standard = robot_of(tmp_path, STANDARD + "joints:\n" + "".join(row(*numbers) for numbers in moved))
    assert np.allclose(standard.placements, paper.placements, atol=1e-12)


def test_the_tip_of_a_standard_table_is_the_end_of_its_last_row(tmp_path) -> None:
    """Without a tool what is held clear is the last frame's origin, which `a` takes away from the joint."""
    safety = "safety: {floor: -1}\n"
    rows = row(90, 0, 0.3) + row(0, 0.4, 0.0)
    last = robot_of(tmp_path, f"{STANDARD}joints:\n{rows}{safety}").safety
    assert last is not None and last.tool == pytest.approx((0.4, 0.0, 0.0))
    plain = robot_of(tmp_path, f"{HEAD}joints:\n{rows}{safety}").safety
    assert plain is not None and plain.tool is None


@pytest.mark.parametrize(
    ("head", "table", "joints", "kind"), [(HEAD, UR5E, "5 and 6", "standard"), (STANDARD, PUMA, "1 and 2", "modified")]
)
def test_a_table_of_the_other_kind_is_told_by_two_joints_on_one_line(tmp_path, head, table, joints, kind) -> None:
    """The refusal names the joints and the key that mends it, and that mends it."""
    rows = "joints:\n" + "".join(row(*numbers) for numbers in table)
    with pytest.raises(PumaidError) as refused:
        robot_of(tmp_path, head + rows)
    assert refused.value.slug == "recipe-wrong" and f"joints {joints} turn about one line" in refused.value.what
    assert refused.value.mend.endswith(f"convention: {kind}")
    assert robot_of(tmp_path, f"{HEAD}convention: {kind}\n{rows}").n_joints == 6


@pytest.mark.parametrize("name", sorted(shipped_recipes()))
def test_shipped_tables_are_not_taken_for_standard_ones(tmp_path, name: str) -> None:
    text = shipped_recipes()[name].read_text(encoding="utf-8")
    assert robot_of(tmp_path, f"convention: modified\n{text}").joints == read_recipe(shipped_recipes()[name]).joints


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("convention: craig\n", "did you mean|known here: modified, standard"),
        ("convention: standard\n", "place all joints in one way"),
    ],
)
def test_what_is_no_convention(tmp_path, text: str, said: str) -> None:
    """A word that is none, and a placement in a standard table."""
    joints = row(90, 0, 0.3) + "  - {type: revolute, placement: {xyz: [0, 0, 1]}}\n"
    with pytest.raises(PumaidError) as refused:
        robot_of(tmp_path, f"{HEAD}{text}joints:\n{joints}")
    faults = refused.value.faults if isinstance(refused.value, Faults) else (refused.value,)
    assert any(part in fault.mend for fault in faults for part in said.split("|"))
