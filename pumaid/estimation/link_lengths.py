"""Lengths of links that motion contradicts: a score test of each `a` and `d` of the recipe beside the rigid body."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from pumaid.estimation.fit import ABSORBED, Fit, Projector
from pumaid.joint_bins import JointBins
from pumaid.maths import Counts, Floats
from pumaid.rigid_body import base_parameters
from pumaid.robot import Robot

#: Blocks of a joint in which lengths are tested; m by which each is moved.
MOST_BLOCKS, STEP = 40, 1e-3


@dataclass(frozen=True, slots=True)
class LengthTest:
    """A length of joint `joint` (from 1), ``a`` or ``d``: what should be added to it (m), its standard error, the
    degrees of freedom behind that, and the gain in twice the log likelihood.
    """

    joint: int
    name: str
    more: float
    error: float
    dof: int
    statistic: float


def length_tests(fitted: Fit) -> Iterator[LengthTest]:
    """Each length that the fitted blocks of any motion show apart from the model; errors are of scores by block.

    Columns are derivatives of the fitted current, at the cells' mean motion; what else a length changes the rigid
    body's parameters take up.
    """
    if not any(row.bins.is_block.any() for row in fitted.joints):
        return
    robot, projector = fitted.model.robot, Projector(fitted)
    cells = {row.bins.joint: _tested(row.bins) for row in fitted.joints}
    motions = {row.bins.joint: mean_motion(row.bins, cells[row.bins.joint]) for row in fitted.joints}
    start = {joint: _drawn(fitted, robot, joint, motion) for joint, motion in motions.items()}
    _, block = np.unique(
        [f"{run.origin} {run.first_row}" for r in fitted.joints for run in r.bins.runs], return_inverse=True
    )
    for joint in (joint for joint in robot.joints if joint.placement is None):
        for name in ("a", "d") if joint.is_revolute else ("a",):
            moved = replace(joint, **{name: getattr(joint, name) + STEP})
            other = replace(robot, joints=tuple(moved if part is joint else part for part in robot.joints))
            columns = {}
            for number, motion in motions.items():
                columns[number] = np.zeros((len(fitted.by_bin[number].bins), 1))
                columns[number][cells[number], 0] = (_drawn(fitted, other, number, motion) - start[number]) / STEP
            scores, information, squares = projector.scores(projector.whitened(columns), 1)
            shares, weight = np.bincount(block, scores[:, 0]), float(information[0, 0, 0])
            shares = shares[np.isin(np.arange(len(shares)), block[scores[:, 0] != 0.0])]
            if weight > ABSORBED * squares[0] and len(shares) > 2:
                more, error = float(shares.sum()) / weight, float(np.sqrt(len(shares)) * shares.std(ddof=1)) / weight
                yield LengthTest(joint.number, name, more, error, len(shares) - 1, weight * more**2)


def _tested(bins: JointBins) -> Counts:
    blocks = np.flatnonzero(bins.is_block)
    chosen = blocks[np.unique(np.linspace(0, len(blocks) - 1, MOST_BLOCKS).astype(int))] if len(blocks) else blocks
    return np.flatnonzero(np.isin(bins.run, chosen))


def mean_motion(bins: JointBins, cells: Counts) -> tuple[Floats, Floats, Floats]:
    """(J, N) positions, velocities and accelerations of all joints at some cells of a joint."""
    samples = bins.samples
    pull = np.array([bins.rises(speed) for speed in samples.velocity.T]) / np.maximum(bins.rises(samples.time), 1e-9)
    pull[bins.joint - 1] = samples.acceleration
    return samples.position[cells].T, samples.velocity[cells].T, pull[:, cells]


def _drawn(fitted: Fit, robot: Robot, joint: int, motion: tuple[Floats, Floats, Floats]) -> Floats:
    model = fitted.model
    weights = (np.nan_to_num(model.factors(fitted.scales(), joint)) * fitted.values)[model.inertial]
    rows = replace(base_parameters(model.robot), robot=robot).row(joint, motion)
    return np.asarray(weights[-len(rows) :] @ rows)
