"""Covariances that are robust to what samples of one run share, and the intervals that they support."""

from dataclasses import dataclass

import numpy as np
from scipy import special

from pumaid.estimation.fit import Fit, clusters
from pumaid.maths import Counts, Flags, Floats
from pumaid.maths.bilinear import Bilinear, Gains

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
    jacobian: Floats, residual: Floats, inverse: Floats, *, runs: Counts, kin: Counts | None = None
) -> Clustered:
    """Cluster-robust covariance with the bias-reduced correction CR2 and Satterthwaite degrees of freedom.

    What a single run determines leaves no residual that could tell its error: there the working model's noise counts,
    as well known as the runs that it was estimated from are many: of each run, by rising number, `kin` (R,) says with
    which others that was, all where not given. `jacobian` (N, p) and `residual` (N,) are whitened by the working model,
    `inverse` (p, p) is the inverse information of all runs together, `runs` (N,) the run of each equation.

    Source: R. M. Bell and D. F. McCaffrey, Survey Methodology 28 (2002) 169-181; J. E. Pustejovsky and E. Tipton, J.
    Bus. Econ. Stat. 36 (2018) 672-683.
    """
    # Rows of each run by rising number, zero where a run has fewer than others.
    _, run, lengths = np.unique(runs, return_inverse=True, return_counts=True)
    order, p = np.argsort(run, kind="stable"), len(inverse)
    table = np.zeros((len(lengths), int(lengths.max()), p + 1))
    place = np.arange(len(runs)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    table[run[order], place] = np.column_stack([jacobian, residual])[order]
    scores, alone = np.zeros((len(table), p)), np.zeros((len(table), p))
    lent, trace, squares, gram = np.zeros((p, p)), np.zeros(p), np.zeros(p), np.zeros((p, p, p))
    for start in range(0, len(table), AT_ONCE):
        block = slice(start, start + AT_ONCE)
        J, e = table[block, :, :-1], table[block, :, -1:]
        eigenvalues, vectors = np.linalg.eigh(np.eye(J.shape[1]) - J @ inverse @ J.transpose(0, 2, 1))
        is_alone = eigenvalues <= FITTED_ALONE
        root = np.where(is_alone, 0.0, 1.0 / np.sqrt(np.maximum(eigenvalues, FITTED_ALONE)))
        A = (vectors * root[:, None, :]) @ vectors.transpose(0, 2, 1)
        scores[block] = np.sum(J * (A @ e), axis=1) @ inverse
        # What a unit of noise does in directions that a run fits alone.
        out = (vectors.transpose(0, 2, 1) @ J * is_alone[:, :, None]) @ inverse
        alone[block] = np.sum(out**2, axis=1)
        lent += np.tensordot(out, out, ((0, 1), (0, 1)))
        a = A @ J @ inverse
        squared, pull = np.sum(a**2, axis=1), J.transpose(0, 2, 1) @ a  # how each run's J' A J M pulls a contrast
        turned = inverse @ pull
        crossed = np.sum(pull * turned, axis=1)
        trace += np.sum(squared - crossed, axis=0)
        squares += np.sum(squared**2 - 2.0 * squared * crossed, axis=0)
        gram += pull.transpose(2, 1, 0) @ turned.transpose(2, 0, 1)
    squares += np.sum(gram * gram.transpose(0, 2, 1), axis=(1, 2))
    by_residuals = trace.copy()
    groups = np.zeros(len(table), dtype=np.int64) if kin is None else kin
    for group in np.unique(groups):
        borrowed = alone[groups == group].sum(axis=0)
        trace += borrowed
        squares += borrowed**2 / max(1, np.count_nonzero(groups == group) - 1)
    # Where next to nothing of a variance comes from residuals, they tell nothing of how well it is known.
    is_shown = (squares > 0) & (by_residuals > FITTED_ALONE * trace)
    return Clustered(scores.T @ scores + lent, np.divide(trace**2, squares, out=np.zeros(p), where=is_shown))


def completed(working: Floats, errors: Floats, poor: Flags) -> Floats:
    """A covariance `errors` (p, p) of which the `poor` parameters (p,) are known by `working` (p, p) only.

    Taking the poor ones' rows and columns from the other would not do: the two together may give a sum of parameters a
    variance below zero. The poor ones depend on the rest as by `working`, and are never surer than there.
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


def interval(value: float, std_error: float, freedoms: float, *, level: float = 0.95) -> tuple[float, float]:
    """Student's interval; the normal one where `freedoms` is infinite."""
    half = float(special.stdtrit(freedoms, 0.5 + level / 2.0)) * std_error
    return value - half, value + half


def two_sided(statistic: float, freedoms: float) -> float:
    """Probability of a Student t at least as large as |statistic|."""
    return float(2.0 * special.stdtr(freedoms, -abs(statistic)))


def fit_covariance(fitted: Fit) -> Clustered:
    """Of all parameters and ratios of a fit, clustered by run."""
    solution, inverse = fitted.solution, fitted.inverse
    runs, kin = clusters(fitted.rows)
    errors = clustered(solution.jacobian, solution.residual, inverse, runs=runs, kin=kin)
    # What rests on the prior of a ratio or shape is as uncertain as the prior says: no run's residual shows that.
    priors = inverse * fitted.prior
    return Clustered(errors.covariance + priors @ priors.T, errors.freedoms)


def recursion_covariance(system: Bilinear, values: Floats, gains: Gains, *, runs: Counts) -> Clustered:
    """Covariance of the recursion's parameters and ratios, clustered by `runs` (N,), with each one's freedoms in its
    own row.

    Row i is least squares given the outer rows' results, so an outer run moves it, too: by minus the row's own solution
    operator times the derivative of the row's prediction by the outer results.
    """
    p, jacobian, residual = len(values), system.jacobian(gains, values), system.left(values, gains)
    size = jacobian.shape[1]
    covariance, freedoms = np.zeros((size, size)), np.zeros(size)
    for row in reversed(range(gains.n_rows)):
        equations = np.flatnonzero(system.row == row)
        edges = [p + k for k, upper in enumerate(gains.uppers) if upper == row]
        columns = np.append(np.flatnonzero(system.owners == row), edges).astype(int)
        if len(equations) == 0 or len(columns) == 0:
            continue
        J = jacobian[np.ix_(equations, columns)]
        scale = np.linalg.norm(J, axis=0)
        back = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0)
        unit = J * back
        inverse = back[:, None] * np.linalg.pinv(unit.T @ unit, rcond=ROUNDING, hermitian=True) * back
        outer = np.setdiff1d(np.arange(size), columns)
        carry = -inverse @ J.T @ jacobian[np.ix_(equations, outer)]
        alone = clustered(J, residual[equations], inverse, runs=runs[equations])
        crossed = carry @ covariance[np.ix_(outer, outer)]
        covariance[np.ix_(columns, columns)] = alone.covariance + crossed @ carry.T
        covariance[np.ix_(columns, outer)], covariance[np.ix_(outer, columns)] = crossed, crossed.T
        freedoms[columns] = alone.freedoms
    return Clustered(covariance, freedoms)
