"""Covariances that are robust to what samples of one run share, and the intervals that they support."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from pumaid.estimation.fit import Fit
from pumaid.estimation.fit import run_of as runs_of
from pumaid.maths.bilinear import Bilinear, Gains

Floats = NDArray[np.float64]

#: An eigenvalue of I - H below this belongs to a direction that a run fits alone, but for what a prior says: its
#: residual tells nothing, and its variance is taken from the working model.
FITTED_ALONE = 1e-3
#: Runs that are worked on at once: what each pulls takes some 25 kB.
AT_ONCE = 1000
#: Share of the largest singular value of a row's scaled normal matrix below which there is only rounding: its columns'
#: own singular values, squared, with four digits to spare above machine precision.
ROUNDING = 1e-12


@dataclass(frozen=True, eq=False, slots=True)
class Clustered:
    """Covariance (p, p) clustered by run and the degrees of freedom (p,) behind each parameter's variance."""

    covariance: Floats
    freedoms: Floats


def clustered(
    jacobians: Sequence[Floats], residuals: Sequence[Floats], inverse: Floats, *, kin: NDArray[np.int64] | None = None
) -> Clustered:
    """Cluster-robust covariance with the bias-reduced correction CR2 and Satterthwaite degrees of freedom.

    What a single run determines leaves no residual that could tell its error: there the working model's noise counts,
    as well known as the runs that it was estimated from are many.

    Parameters
    ----------
    jacobians
        One (k, p) a run, whitened by the working model of the noise.
    residuals
        One (k,) a run, whitened likewise.
    inverse
        (p, p) inverse information of all runs together.
    kin
        For each run the number of those whose noise is estimated together; all where not given.

    Source
    ------
    R. M. Bell and D. F. McCaffrey, Survey Methodology 28 (2002) 169-181; J. E. Pustejovsky and E. Tipton, J. Bus. Econ.
    Stat. 36 (2018) 672-683.
    """
    p = len(inverse)
    scores, alone = np.zeros((len(jacobians), p)), np.zeros((len(jacobians), p))
    lent = np.zeros((p, p))
    trace, squares, gram = np.zeros(p), np.zeros(p), np.zeros((p, p, p))
    for start in range(0, len(jacobians), AT_ONCE):
        block = slice(start, start + AT_ONCE)
        scores[block], squared, pull, out = _turned(jacobians[block], residuals[block], inverse)
        alone[block] = np.sum(out**2, axis=1)
        lent += np.einsum("rkp,rkq->pq", out, out)
        for contrast, u in enumerate(pull):
            turned = u @ inverse
            crossed = np.sum(u * turned, axis=1)
            trace[contrast] += np.sum(squared[:, contrast] - crossed)
            squares[contrast] += np.sum(squared[:, contrast] ** 2) - 2.0 * np.sum(squared[:, contrast] * crossed)
            gram[contrast] += u.T @ turned
    squares += np.sum(gram * gram.transpose(0, 2, 1), axis=(1, 2))
    by_residuals = trace.copy()
    for group in _alike(np.zeros(len(jacobians), dtype=np.int64) if kin is None else kin):
        borrowed = alone[group].sum(axis=0)
        trace += borrowed
        squares += borrowed**2 / max(1, len(group) - 1)
    # Where next to nothing of a variance comes from residuals, they tell nothing of how well it is known.
    shown = (squares > 0) & (by_residuals > FITTED_ALONE * trace)
    return Clustered(scores.T @ scores + lent, np.divide(trace**2, squares, out=np.zeros(p), where=shown))


def completed(working: Floats, errors: Floats, poor: NDArray[np.bool_]) -> Floats:
    """A covariance of which some parameters are known by another one only; no combination of it is below zero.

    Taking the poor ones' rows and columns from the other would not do: the two together may give a sum of parameters a
    variance below zero. The poor ones depend on the rest as by `working`, and are never surer than there.

    Parameters
    ----------
    working
        (p, p) by which all are known.
    errors
        (p, p) that holds for the others.
    poor
        (p,) those that `errors` does not tell.
    """
    good = ~poor
    if not poor.any():
        return errors
    size = np.sqrt(np.maximum(np.diag(working), 0.0))
    size = np.where(size > 0.0, size, 1.0)
    scaled, certain = working / np.outer(size, size), errors[np.ix_(good, good)]
    slope = scaled[np.ix_(poor, good)] @ np.linalg.pinv(scaled[np.ix_(good, good)], rcond=1e-10, hermitian=True)
    rest = scaled[np.ix_(poor, poor)] - slope @ scaled[np.ix_(good, poor)]
    slope *= size[poor][:, None] / size[good]
    whole = slope @ certain @ slope.T + rest * np.outer(size[poor], size[poor])
    whole[np.diag_indices_from(whole)] += np.maximum(np.diag(working)[poor] - np.diag(whole), 0.0)
    out = np.empty_like(errors)
    out[np.ix_(good, good)], out[np.ix_(poor, poor)] = certain, 0.5 * (whole + whole.T)
    out[np.ix_(poor, good)] = slope @ certain
    out[np.ix_(good, poor)] = out[np.ix_(poor, good)].T
    return out


def _alike(keys: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Numbers of the items that have one key, key by key."""
    return [np.flatnonzero(keys == key) for key in np.unique(keys)]


def _turned(
    jacobians: Sequence[Floats], residuals: Sequence[Floats], inverse: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Of R runs: scores (R, p), squares of what each tells of a contrast (R, p), and (p, R, p) its pull by contrast.

    And (R, k, p) what a unit of noise does in directions that a run fits alone, nothing in the others.
    """
    p = len(inverse)
    out = np.zeros((len(jacobians), max(map(len, jacobians)), p))
    scores, squared = np.zeros((len(jacobians), p)), np.zeros((len(jacobians), p))
    pull = np.zeros((p, len(jacobians), p))  # how each run's J' A J M pulls a contrast
    for alike in _alike(np.array([len(block) for block in jacobians])):
        J = np.array([jacobians[number] for number in alike])
        e = np.array([residuals[number] for number in alike])
        eigenvalues, vectors = np.linalg.eigh(np.eye(J.shape[1]) - _times(J, inverse) @ J.transpose(0, 2, 1))
        is_alone = eigenvalues <= FITTED_ALONE
        root = np.where(is_alone, 0.0, 1.0 / np.sqrt(np.maximum(eigenvalues, FITTED_ALONE)))
        A = (vectors * root[:, None, :]) @ vectors.transpose(0, 2, 1)
        scores[alike] = np.einsum("rkp,rk->rp", J, np.einsum("rkl,rl->rk", A, e)) @ inverse
        out[alike, : J.shape[1]] = _times(vectors.transpose(0, 2, 1) @ J, inverse) * is_alone[:, :, None]
        a = _times(A @ J, inverse)
        squared[alike] = np.sum(a**2, axis=1)
        pull[:, alike] = (J.transpose(0, 2, 1) @ a).transpose(2, 0, 1)
    return scores, squared, pull, out


def _times(rows: Floats, square: Floats) -> Floats:
    """(R, k, p) times (p, p) as one product."""
    return (rows.reshape(-1, len(square)) @ square).reshape(rows.shape)


def interval(value: float, std_error: float, freedoms: float, *, level: float = 0.95) -> tuple[float, float]:
    """Student's interval; the normal one where `freedoms` is infinite."""
    half = float(special.stdtrit(freedoms, 0.5 + level / 2.0)) * std_error
    return value - half, value + half


def two_sided(statistic: float, freedoms: float) -> float:
    """Probability of a Student t at least as large as |statistic|."""
    return float(2.0 * special.stdtr(freedoms, -abs(statistic)))


def fit_covariance(fitted: Fit) -> Clustered:
    """Of all parameters and ratios of a fit, clustered by run."""
    run_of = runs_of(fitted.rows)
    order = [np.flatnonzero(run_of == number) for number in range(int(run_of.max()) + 1)]
    solution, inverse = fitted.solution, fitted.inverse
    kin = np.repeat([row.joint for row in fitted.rows], [len(row.bins.runs) for row in fitted.rows])
    jacobians, residuals = ([values[rows] for rows in order] for values in (solution.jacobian, solution.residual))
    errors = clustered(jacobians, residuals, inverse, kin=kin)
    # What rests on the prior of a ratio or shape is as uncertain as the prior says: no run's residual shows that.
    priors = inverse * fitted.prior
    return Clustered(errors.covariance + priors @ priors.T, errors.freedoms)


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
    residual = system.left(values, gains)
    covariance, freedoms = np.zeros((size, size)), np.zeros(size)
    for row in reversed(range(gains.n_rows)):
        equations = np.flatnonzero(system.row == row)
        columns = np.concatenate(
            [np.flatnonzero(system.owners == row), [p + k for k, e in enumerate(edges) if gains.parent[e] == row]]
        ).astype(int)
        if len(equations) == 0 or len(columns) == 0:
            continue
        J = jacobian[equations]
        scale = np.linalg.norm(J[:, columns], axis=0)
        unit = np.divide(J[:, columns], scale, out=np.zeros((len(equations), len(columns))), where=scale > 0)
        back = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0)
        inverse = back[:, None] * np.linalg.pinv(unit.T @ unit, rcond=ROUNDING, hermitian=True) * back
        outer = np.setdiff1d(np.arange(size), columns)
        carry = -inverse @ J[:, columns].T @ J[:, outer]
        numbers = [equations[runs[equations] == run] for run in np.unique(runs[equations])]
        alone = clustered([jacobian[n][:, columns] for n in numbers], [residual[n] for n in numbers], inverse)
        outer_covariance = covariance[np.ix_(outer, outer)]
        crossed = carry @ outer_covariance
        covariance[np.ix_(columns, columns)] = alone.covariance + crossed @ carry.T
        covariance[np.ix_(columns, outer)] = crossed
        covariance[np.ix_(outer, columns)] = crossed.T
        freedoms[columns] = alone.freedoms
    return Clustered(covariance, freedoms)
