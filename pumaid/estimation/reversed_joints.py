"""Joints whose positions are counted the other way round than the recipe says: what would be left of the currents."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pumaid.effects.base import Scope
from pumaid.estimation.fit import Fit
from pumaid.estimation.link_lengths import mean_motion
from pumaid.joint_bins import JointBins
from pumaid.maths import Counts
from pumaid.rigid_body import base_parameters

#: Bins of a joint that are looked at; share of an error to which a turned joint must bring it, and what it may add.
MOST_BINS, FALLS, RISES = 3000, 0.5, 1.05


@dataclass(frozen=True, slots=True)
class Reversal:
    """A joint (from 1) that seems to be counted the other way: at joint `missed` the error left (A), now and then."""

    joint: int
    missed: int
    now: float
    then: float


def reversals(fitted: Fit, missed: Sequence[int]) -> list[Reversal]:
    """Joints that, turned round, at least halve the error of a joint of `missed` and raise none; the best first.

    Each joint's currents are regressed by themselves on all base parameters and the rest of its columns.
    """
    out, before = list[Reversal](), {row.bins.joint: _left(fitted, row.bins.joint, None) for row in fitted.joints}
    for joint in fitted.model.robot.joints:
        after = {number: _left(fitted, number, joint.number) for number in before}
        ratios = {number: after[number] / before[number] for number in before if before[number] > 0.0}
        best = min((number for number in missed if number in ratios), key=lambda number: ratios[number], default=0)
        if best and ratios[best] < FALLS and max(ratios.values()) < RISES:
            out.append(Reversal(joint.number, best, before[best], after[best]))
    return sorted(out, key=lambda reversal: reversal.then / reversal.now)


def _left(fitted: Fit, number: int, turned: int | None) -> float:
    """RMSE (A) of a joint's bins by a regression of their own, the positions of joint `turned` counted backward."""
    model, row = fitted.model, fitted.by_bin[number]
    bins = row.bins
    cells = _spread(bins)
    signs = np.ones((model.robot.n_joints, 1))
    if turned is not None:
        signs[turned - 1] = -1.0
    motion = [signs * part for part in mean_motion(bins, cells)]
    of_joints = np.flatnonzero([column.scope is not Scope.LINK for column in model.columns])
    body = base_parameters(model.robot).rows(*motion)[number - 1]
    design = np.column_stack([row.bare[np.ix_(cells, of_joints)], body.T])
    weights = np.sqrt(bins.count[cells] / bins.count[cells].sum())
    design, wanted = design * weights[:, None], bins.current[cells] * weights
    size = np.linalg.norm(design, axis=0)
    design = design[:, size > 1e-9 * size.max()] / size[size > 1e-9 * size.max()]
    solution = np.linalg.lstsq(design, wanted, rcond=1e-6)[0]
    return float(np.linalg.norm(wanted - design @ solution))


def _spread(bins: JointBins) -> Counts:
    """Numbers of the bins of whole runs, spread over all of them."""
    runs = np.unique(bins.run)
    step = max(1, round(len(bins) / MOST_BINS))
    return np.flatnonzero(np.isin(bins.run, runs[::step]))
