"""Errors of the recursion: what each run contributes to every estimate, carried from the outer rows inward."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pumaid.maths.joint_fit import Bilinear
from pumaid.maths.recursion import Gains
from pumaid.maths.statistics import Clustered, clustered

Floats = NDArray[np.float64]

#: Share of the largest singular value of a row's scaled normal matrix below which there is only rounding: its columns'
#: own singular values, squared, with four digits to spare above machine precision.
ROUNDING = 1e-12


def recursion_covariance(system: Bilinear, values: Floats, gains: Gains, *, runs: NDArray[np.int64]) -> Clustered:
    """Covariance of the recursion's parameters and ratios, clustered by run.

    Row i is least squares given the outer rows' results, so an outer run moves it, too: by minus the row's own
    solution operator times the derivative of the row's prediction by the outer results.

    Parameters
    ----------
    system
        Whitened rows.
    runs
        (N,) run of each equation.
    values, gains
        The recursion's result.

    Returns
    -------
    clustered
        Over [values, edges]; degrees of freedom are those of each parameter's own row.
    """
    edges, p = gains.edges, len(values)
    size = p + len(edges)
    jacobian = system.jacobian(gains, values)
    residual = system.target - system.scaled(gains) @ values
    covariance, freedoms = np.zeros((size, size)), np.zeros(size)
    for row in reversed(range(gains.n_rows)):
        here = np.flatnonzero(system.row == row)
        own = np.concatenate(
            [np.flatnonzero(system.owners == row), [p + k for k, e in enumerate(edges) if gains.parent[e] == row]]
        ).astype(int)
        if len(here) == 0 or len(own) == 0:
            continue
        J = jacobian[here]
        scale = np.linalg.norm(J[:, own], axis=0)
        unit = np.divide(J[:, own], scale, out=np.zeros((len(here), len(own))), where=scale > 0)
        back = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0)
        inverse = back[:, None] * np.linalg.pinv(unit.T @ unit, rcond=ROUNDING, hermitian=True) * back
        outer = np.setdiff1d(np.arange(size), own)
        carry = -inverse @ J[:, own].T @ J[:, outer]
        numbers = [here[runs[here] == run] for run in np.unique(runs[here])]
        alone = clustered([jacobian[n][:, own] for n in numbers], [residual[n] for n in numbers], inverse)
        outer_covariance = covariance[np.ix_(outer, outer)]
        crossed = carry @ outer_covariance
        covariance[np.ix_(own, own)] = alone.covariance + crossed @ carry.T
        covariance[np.ix_(own, outer)] = crossed
        covariance[np.ix_(outer, own)] = crossed.T
        freedoms[own] = alone.freedoms
    return Clustered(covariance, freedoms)
