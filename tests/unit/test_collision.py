"""Collisions along paths against dense sampling with distances computed here."""

from dataclasses import replace

import numpy as np
import pytest

from pumaid.design.collision import TOLERANCE, Collision
from pumaid.errors import Faults
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.robot import Box, Capsule, Joint, Robot, Safety


def ball(link: int, centre: tuple[float, ...], radius: float) -> Capsule:
    return Capsule(link, centre, centre, radius)


def arm(seed: int) -> Robot:
    """A random chain of five joints, about a third of them sliding, with six balls, two boxes and a tool."""
    rng = np.random.default_rng(seed)
    kinds = np.where(rng.random(5) < 0.3, "prismatic", "revolute")
    joints = []
    for number, kind in enumerate(kinds, start=1):
        theta, alpha, a, d = rng.uniform(-3, 3), rng.uniform(-3, 3), *rng.uniform(-0.4, 0.4, 2)
        joints.append(Joint(number, f"j{number}", str(kind), theta=theta, alpha=alpha, a=a, d=d))
    balls = [ball(int(rng.integers(0, 6)), tuple(rng.uniform(-0.3, 0.3, 3)), rng.uniform(0.02, 0.1)) for _ in range(6)]
    corners = rng.uniform(-0.8, 0.8, (2, 3))
    boxes = tuple(Box(f"b{k}", tuple(low), tuple(low + rng.uniform(0.01, 0.5, 3))) for k, low in enumerate(corners))
    return Robot(
        "random", tuple(joints), safety=Safety(boxes, tuple(rng.uniform(-0.2, 0.2, 3)), 0.01, capsules=tuple(balls))
    )


def puma(safety: Safety) -> Robot:
    return replace(read_recipe(shipped_recipes()["puma560"]), safety=safety)


def least(robot: Robot, positions: np.ndarray) -> float:
    """Least distance of any pair over (N, J) postures, by forward kinematics and elementary geometry."""
    turned, placed = robot.frames(positions)
    balls = [ball(robot.n_joints, robot.safety.tool, 0.0), *robot.safety.capsules]
    points = [
        np.tile(b.start, (len(positions), 1))
        if b.link == 0
        else placed[:, b.link - 1] + turned[:, b.link - 1] @ np.array(b.start)
        for b in balls
    ]
    gaps = []
    for k, shape in enumerate(balls):
        for box in robot.safety.boxes if shape.link else ():
            outside = np.maximum(np.maximum(np.array(box.low) - points[k], points[k] - np.array(box.high)), 0.0)
            gaps.append(np.linalg.norm(outside, axis=1) - shape.radius)
        for m, other in enumerate(balls[:k]):
            if abs(shape.link - other.link) > 1:
                gaps.append(np.linalg.norm(points[k] - points[m], axis=1) - shape.radius - other.radius)
    return float(np.min(gaps))


@pytest.mark.parametrize("seed", range(5))
def test_paths_are_judged_as_by_a_dense_sweep(seed):
    """A path strikes where 2000 samples come nearer than the margin, and is free where they stay 1 mm outside it."""
    rng, robot = np.random.default_rng(seed), arm(seed)
    starts, ends = rng.uniform(-1.5, 1.5, (2, 30, 5))
    few = np.argsort(rng.random((30, 5)), axis=1) < 3  # where all joints move something is too often struck
    ends, collision, verdicts = np.where(few, starts, ends), Collision(robot), []
    for start, end in zip(starts, ends, strict=True):
        nearest = least(robot, start + np.linspace(0, 1, 2000)[:, None] * (end - start))
        verdicts.append(collision.first_hit(start, end) is not None)
        assert verdicts[-1] or nearest > 0.01
        assert not verdicts[-1] or nearest < 0.01 + TOLERANCE + 0.3e-3
    assert 0 < sum(verdicts) < 30


def test_a_thin_plate_is_not_jumped_over():
    """A plate of 1 mm across a sweep of 2.4 m is seen, where 60 samples of the path all pass it by."""
    robot = puma(Safety((Box("plate", (0.3, 0.001, -2.0), (2.0, 0.002, 2.0)),), tool=(0.0, 0.0, 0.0), margin=0.0))
    start, end = np.zeros(6), np.zeros(6)
    start[0], end[0] = np.radians([-100, 100])
    assert least(robot, start + np.linspace(0, 1, 60)[:, None] * (end - start)) > 1e-3
    collision = Collision(robot)
    assert "the tip comes nearer to the box 'plate' than the margin of 0 mm" in collision.first_hit(start, end)


def test_nothing_forbidden_is_free():
    """Without the block, and with capsules of neighbours only, every path is free."""
    for safety in (None, Safety(capsules=(ball(2, (0, 0, 0), 1.0), ball(3, (0, 0, 0), 1.0)))):
        collision = Collision(puma(safety))
        assert collision.is_free and collision.first_hit(np.zeros(6), np.ones(6)) is None


def test_what_always_touches_is_the_recipes_fault():
    """A box around the whole arm is refused for each part in it; links that fill the way between them are left out."""
    big = (ball(1, (0, 0, 0), 0.4), ball(3, (0, 0, 0), 0.4))
    with pytest.raises(Faults) as caught:
        Collision(puma(Safety((Box("cell", (-9, -9, -9), (9, 9, 9)),), capsules=(*big, ball(2, (0, 0, 0), 0.1)))))
    faults = [str(fault) for fault in caught.value.faults]
    assert all("[safety-always-touching]" in fault and "the box 'cell'" in fault for fault in faults)
    assert len(faults) == 3
    assert Collision(puma(Safety(capsules=big, ignore=((1, 3),)))).touching == []
    collision = Collision(puma(Safety(capsules=big)))
    assert collision.is_free and collision.touching == ["link 3 and link 1"]
