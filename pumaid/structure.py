"""Which parameters of the paper's model exist for an arm at all, derived from its geometry by rank."""

import itertools
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from pumaid.effects import catalogue
from pumaid.maths import Floats, rank
from pumaid.maths.bilinear import Recursion
from pumaid.rigid_body import base_parameters
from pumaid.robot import Joint, Robot
from pumaid.samples import Samples

#: Random postures a joint: several times the most columns that a row can have (2 n + 4 for n = 10 joints).
POSTURES = 120


@dataclass(frozen=True, slots=True)
class Structure:
    """The minimal parameters of an arm.

    `absent` maps names of gravity parameters that no motion can show, `redundant` pairs (i, i+1) of joints (from 1)
    whose ratio of gains none can, to why; `embodied` are prismatic joints whose constant load hides in their Coulomb
    terms (eq. 32, 33).
    """

    absent: dict[str, str] = field(default_factory=dict)
    embodied: tuple[int, ...] = ()
    redundant: dict[tuple[int, int], str] = field(default_factory=dict)


def minimal(robot: Robot, *, seed: int = 0) -> Structure:
    """Derive the minimal parameters from random postures (by `seed`) and random parameters of the arm.

    A friction term absorbs what a gravity column shares with it. Source: S.-K. Lin, Theorem 3 and Corollary 4, found
    here by rank instead of by their case rules.
    """
    return _of_geometry(tuple(robot.joints), tuple(robot.gravity), seed)


def in_motion(robot: Robot) -> Structure:
    """The parameters of gravity that no motion of all joints shows; ratios of gains are left to the data."""
    shown = {(link, part.removeprefix("m") or "mass") for link, part in base_parameters(robot).names}
    weightless, absent = minimal(robot).absent, {}
    for joint in robot.joints:
        other = f"no motion shows the weight of link {joint.number} ({joint.name}) apart from that of other links"
        for parameter in catalogue()["gravity"].parameters(robot, joint.number):
            if (joint.number, parameter.name) not in shown:
                name = f"gravity.l{joint.number}.{parameter.name}"
                absent[name] = weightless.get(name, other)
    return Structure(absent)


@lru_cache(maxsize=16)  # one command makes many models of one arm
def _of_geometry(joints: tuple[Joint, ...], pull: tuple[float, float, float], seed: int) -> Structure:
    rng, robot = np.random.default_rng(seed), Robot("", joints, pull)
    gravity, n = catalogue()["gravity"], robot.n_joints
    widths = [len(gravity.parameters(robot, link)) for link in range(1, n + 1)]
    owners = np.repeat(np.arange(n), widths)
    recursion = Recursion(owners, n)
    truth = rng.uniform(0.5, 2.0, len(owners)) * rng.choice([-1.0, 1.0], len(owners))
    absent: dict[str, str] = {}
    embodied: list[int] = []
    for row in reversed(range(n)):
        rows, sign = _random_rows(robot, row, rng)
        matrix, owned, roots = recursion.design(row, rows)
        friction = np.column_stack([sign > 0, sign < 0]).astype(float)
        sure = rank.independent(np.hstack([friction, _cleaned(matrix)]), first=2)[2:]
        constant = bool(rows[:, owned].any()) and not sure[: len(owned)].any()
        if constant and not robot.joint(row + 1).is_revolute:
            embodied.append(row + 1)
        for column, is_sure in zip(owned, sure[: len(owned)], strict=True):
            recursion.values[column] = truth[column] if is_sure else 0.0
            if not is_sure:
                link = row + 1
                name = gravity.parameters(robot, link)[column - owned[0]].name
                absent[f"gravity.l{link}.{name}"] = _why_absent(robot, link, constant)
        for root, is_sure in zip(roots, sure[len(owned) :], strict=True):
            if is_sure:
                recursion.gains.merge(row, root, float(rng.uniform(0.5, 2.0)))
    redundant = {}
    for inner, outer in itertools.pairwise(joints):
        if not np.isfinite(recursion.gains.ratio(inner.number - 1, outer.number - 1)):
            why = f"joint {inner.number} ({inner.name}) does not feel the weight that joint {outer.number}"
            redundant[inner.number, outer.number] = f"{why} ({outer.name}) carries, in any posture"
    return Structure(absent, tuple(sorted(embodied)), redundant)


def _random_rows(robot: Robot, row: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Gravity regressors (N, p) of one row at random postures, and directions of motion (N,)."""
    gravity, links = catalogue()["gravity"], range(1, robot.n_joints + 1)
    position = rng.uniform(-np.pi, np.pi, (POSTURES, robot.n_joints))
    samples = Samples(row + 1, position, np.zeros_like(position))
    felt = gravity.columns_of(robot, samples, links[row:])
    blocks = [felt.get(link, np.zeros((POSTURES, len(gravity.parameters(robot, link))))) for link in links]
    return np.hstack(blocks), rng.choice([-1.0, 1.0], POSTURES)


def _cleaned(matrix: Floats) -> Floats:
    """Columns that are zero but for rounding (twists of 90 degrees are not exact) made zero."""
    size = np.linalg.norm(matrix, axis=0)
    return np.where(size > 1e-9 * np.sqrt(len(matrix)), matrix, 0.0)


def _why_absent(robot: Robot, link: int, constant: bool) -> str:
    name = f"joint {link} ({robot.joint(link).name})"
    if robot.joint(link).is_revolute:
        return f"{name} turns about the direction of gravity in every posture and so carries no weight"
    if constant:
        return (
            f"the angle between {name} and gravity never changes, so its constant load cannot be told from Coulomb"
            f" friction and is part of coulomb.j{link}.plus and .minus"
        )
    return f"{name} stays perpendicular to gravity in every posture and so carries no weight"
