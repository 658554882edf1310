"""How near random arms come to what is forbidden, by their own forward kinematics and elementary geometry."""

from collections.abc import Callable, Iterator

import numpy as np

from pumaid.robot import Box, Capsule, Joint, Robot, Safety
from pumaid.trajectory import Plan

#: Random postures, and the share of them beyond which a pair that touches is left out.
POSTURES, ALWAYS = 1000, 0.99


def random_arm(seed: int) -> Robot:
    """Two to five joints, few of them sliding, with radii, and mostly a floor, boxes, a tool; some stand tilted."""
    rng = np.random.default_rng(seed)
    n, joints = int(rng.integers(2, 6)), []
    for number in range(1, n + 1):
        slides = number > 1 and rng.random() < 0.1
        low, high = (0.1, 0.4) if slides else np.radians([-rng.uniform(60, 170), rng.uniform(60, 170)])
        alpha = rng.choice([0.0, 0.5, -0.5]) * np.pi if rng.random() < 0.8 else rng.uniform(-3, 3)
        a, d = rng.choice([0.0, 1.0], 2) * rng.uniform(-0.1, 0.4, 2) if number > 1 else (0.0, rng.uniform(0.2, 0.5))
        theta = rng.uniform(-3, 3) if slides else float(rng.choice([0.0, 0.5, 1.0])) * np.pi
        joints.append(
            Joint(
                number,
                f"j{number}",
                "prismatic" if slides else "revolute",
                theta=float(theta),
                alpha=0.0 if number == 1 else float(alpha),
                a=float(a),
                d=0.0 if slides else float(d),
                limits=(float(low), float(high)),
                max_velocity=0.3 if slides else 1.5,
            )
        )
    corners = rng.uniform(-0.9, 0.7, (int(rng.integers(0, 3)), 3))
    tilt = rng.uniform(-0.3, 0.3, 2) * (rng.random() < 0.3)
    point = tuple(rng.uniform(-0.1, 0.1, 3).tolist())
    return Robot(
        f"random {seed}",
        tuple(joints),
        gravity=(float(tilt[0]) * 9.8, float(tilt[1]) * 9.8, -9.8),
        safety=Safety(
            boxes=tuple(
                Box(f"b{k}", tuple(low.tolist()), tuple((low + rng.uniform(0.05, 0.4, 3)).tolist()))
                for k, low in enumerate(corners)
            ),
            tool=tuple(rng.uniform(-0.15, 0.15, 3).tolist()) if rng.random() < 0.7 else None,
            floor=float(rng.choice([0.0, -0.2, -0.5])) if rng.random() < 0.8 else None,
            links=tuple((link, float(rng.uniform(0.02, 0.05))) for link in range(n + 1)),
            capsules=(Capsule(n, (0.0, 0.0, 0.0), point, 0.03),) if rng.random() < 0.3 else (),
        ),
    )


def frames(robot: Robot, positions: np.ndarray) -> list[np.ndarray]:
    """(N, 4, 4) of the base and every link: Craig's matrices, multiplied."""
    out = [np.tile(np.eye(4), (len(positions), 1, 1))]
    for joint, q in zip(robot.joints, positions.T, strict=True):
        theta = joint.theta + q * (joint.kind == "revolute")
        d = joint.d + q * (joint.kind == "prismatic")
        c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(joint.alpha), np.sin(joint.alpha)
        rows = [[c, -s, 0, joint.a], [s * ca, c * ca, -sa, -sa * d], [s * sa, c * sa, ca, ca * d], [0, 0, 0, 1]]
        out.append(out[-1] @ np.moveaxis(np.array([[cell + 0 * q for cell in row] for row in rows]), 2, 0))
    return out


def rods(robot: Robot) -> Iterator[tuple[int, np.ndarray, np.ndarray, float]]:
    """Link, ends in its frame and radius of every capsule, and of the tip."""
    safety, n = robot.safety, robot.n_joints
    tool = np.array(safety.tool or (0.0, 0.0, 0.0))
    yield n, tool, tool, 0.0
    for rod in safety.capsules:
        yield rod.link, np.array(rod.start), np.array(rod.end), rod.radius
    for link, radius in safety.links:
        if link == n:
            yield link, np.zeros(3), tool, radius
            continue
        joint = robot.joints[link]
        corner = np.array([joint.a, 0.0, 0.0])
        end = corner + joint.d * np.array([0.0, -np.sin(joint.alpha), np.cos(joint.alpha)])
        # A part without length lies in the other one.
        if joint.a or not joint.d:
            yield link, np.zeros(3), corner, radius
        if joint.d:
            yield link, corner, end, radius


def least(start: np.ndarray, end: np.ndarray, distance: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """(N,) least distance of segments to a convex body: it is convex along them, so thirds are cut away."""
    low, high = np.zeros(len(start)), np.ones(len(start))
    for _ in range(22):
        left, right = (2 * low + high) / 3, (low + 2 * high) / 3
        nearer = distance(start + left[:, None] * (end - start)) < distance(start + right[:, None] * (end - start))
        low, high = np.where(nearer, low, left), np.where(nearer, right, high)
    return distance(start + (0.5 * (low + high))[:, None] * (end - start))


def to_segment(point: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(N,) distance of points from segments."""
    way = end - start
    share = np.clip(np.sum((point - start) * way, axis=1) / np.maximum(np.sum(way**2, axis=1), 1e-18), 0.0, 1.0)
    return np.linalg.norm(point - start - share[:, None] * way, axis=1)


def gaps(robot: Robot, positions: np.ndarray) -> np.ndarray:
    """(N, P) m of every pair that is to be kept apart, those that touch in nearly every posture among them."""
    safety, placed, out = robot.safety, frames(robot, positions), []
    shapes = [
        (link, *(placed[link][:, :3, :3] @ end + placed[link][:, :3, 3] for end in (start, end)), radius)
        for link, start, end, radius in rods(robot)
    ]
    up = -np.array(robot.gravity) / np.linalg.norm(robot.gravity)
    for k, (link, start, end, radius) in enumerate(shapes):
        if link and safety.floor is not None:
            out.append(np.minimum(start @ up, end @ up) - safety.floor - radius)
        for box in safety.boxes if link else ():
            low, high = np.array(box.low), np.array(box.high)
            out.append(
                least(start, end, lambda p, a=low, b=high: np.linalg.norm(p - np.clip(p, a, b), axis=1)) - radius
            )
        for other, begin, finish, size in shapes if k or safety.tool else ():
            if link > other + 1:
                away = least(start, end, lambda p, a=begin, b=finish: to_segment(p, a, b))
                out.append(away - radius - size)
    return np.array(out).T


def watched(robot: Robot, seed: int) -> np.ndarray:
    """(P,) whether a pair does not touch in nearly every posture."""
    low, high = np.transpose([joint.limits for joint in robot.joints])
    drawn = np.random.default_rng(seed).uniform(low, high, (POSTURES, robot.n_joints))
    return np.mean(gaps(robot, drawn) < robot.safety.margin, axis=0) < ALWAYS


def straight(start: np.ndarray, end: np.ndarray, step: float = 0.01) -> np.ndarray:
    """(N, J) positions on a straight way, no joint farther than `step` from one to the next."""
    count = int(np.ceil(np.max(np.abs(end - start)) / step)) + 2
    return start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)


def driven(plan: Plan) -> np.ndarray:
    """(N, J) positions on all runs of a plan, and on the straight ways between them."""
    out, now = [], None
    for motion in plan.motions:
        start, end = np.array(motion.hold, dtype=float), np.array(motion.hold, dtype=float)
        start[motion.joint - 1], end[motion.joint - 1] = motion.start, motion.end
        out += [] if now is None else [straight(now, start)]
        out.append(straight(start, end))
        now = end
    return np.vstack(out)
