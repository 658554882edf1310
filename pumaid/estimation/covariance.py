"""The covariance of a fit's parameters and ratios, robust to what the samples of one run share, and intervals."""

import numpy as np
from scipy import special

from pumaid.estimation.fit import Fit, clusters
from pumaid.estimation.noise import AT_ONCE, freedoms
from pumaid.maths import Bilinear, Counts, Flags, Floats, Gains

#: An eigenvalue of I - H below this belongs to a direction that a run fits alone, but for what a prior says: its
#: residual tells nothing, and its variance is taken from the working model.
FITTED_ALONE = 1e-3
#: A variance that rests on fewer degrees of freedom than this is taken from the working model of the noise instead.
FEWEST_FREEDOMS = 3.0


def clustered(
    jacobian: Floats, residual: Floats, inverse: Floats, *, runs: Counts, kin: Counts | None = None
) -> tuple[Floats, Floats]:
    """(p, p) cluster-robust covariance with the bias-reduced correction CR2, and (p,) Satterthwaite degrees of freedom.

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
    return scores.T @ scores + lent, np.divide(trace**2, squares, out=np.zeros(p), where=is_shown)


def completed(working: Floats, errors: Floats, poor: Flags) -> Floats:
    """A covariance `errors` (p, p) of which the `poor` parameters (p,) are known by `working` (p, p) only.

    Taking the poor ones' rows and columns from the other would not do: the two together may give a sum of parameters a
    variance below zero. The poor ones depend on the rest as by `working`, and are never surer than there.
    """
    good, bad = np.flatnonzero(~poor), np.flatnonzero(poor)
    size = np.sqrt(np.where(np.diag(working) > 0.0, np.diag(working), 1.0))
    scaled, spread = working / np.outer(size, size), np.eye(len(working))[:, good]
    slope = scaled[np.ix_(bad, good)] @ np.linalg.pinv(scaled[np.ix_(good, good)], rcond=1e-10, hermitian=True)
    rest = scaled[np.ix_(bad, bad)] - slope @ scaled[np.ix_(good, bad)]
    spread[bad] = slope * size[bad][:, None] / size[good]
    out = spread @ errors[np.ix_(good, good)] @ spread.T
    out[np.ix_(bad, bad)] += rest * np.outer(size[bad], size[bad])
    out[bad, bad] = np.maximum(out[bad, bad], np.diag(working)[bad])
    return np.asarray(0.5 * (out + out.T))


def interval(value: float, std_error: float, freedoms: float, *, level: float = 0.95) -> tuple[float, float]:
    """Student's interval; the normal one where `freedoms` is infinite."""
    half = float(special.stdtrit(freedoms, 0.5 + level / 2.0)) * std_error
    return value - half, value + half


def two_sided(statistic: float, freedoms: float) -> float:
    """Probability of a Student t at least as large as |statistic|."""
    return float(2.0 * special.stdtr(freedoms, -abs(statistic)))


def recursion_covariance(system: Bilinear, values: Floats, gains: Gains, *, runs: Counts) -> tuple[Floats, Floats]:
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
        # The columns' own singular values, squared, with four digits to spare above machine precision.
        inverse = back[:, None] * np.linalg.pinv(unit.T @ unit, rcond=1e-12, hermitian=True) * back
        outer = np.setdiff1d(np.arange(size), columns)
        carry = -inverse @ J.T @ jacobian[np.ix_(equations, outer)]
        alone, freedoms[columns] = clustered(J, residual[equations], inverse, runs=runs[equations])
        crossed = carry @ covariance[np.ix_(outer, outer)]
        covariance[np.ix_(columns, columns)] = alone + crossed @ carry.T
        covariance[np.ix_(columns, outer)], covariance[np.ix_(outer, columns)] = crossed, crossed.T
    return covariance, freedoms


def covariance_of(fitted: Fit) -> tuple[Floats, Floats]:
    """(P, P) covariance of all parameters and ratios of a fit, or of the recursion that it began with, and (P,) degrees
    of freedom: clustered by run, by the working model of the noise where clusters are too few.
    """
    solution, (runs, kin) = fitted.solution, clusters(fitted.rows)
    if fitted.first is None:
        covariance, dof = recursion_covariance(fitted.system, solution.values, solution.gains, runs=runs)
    else:
        covariance, dof = clustered(solution.jacobian, solution.residual, fitted.inverse, runs=runs, kin=kin)
        # What rests on the prior of a ratio or shape is as uncertain as the prior says: no run's residual shows that.
        priors = fitted.inverse * fitted.prior
        covariance = covariance + priors @ priors.T
    poor = dof < FEWEST_FREEDOMS
    joints = np.array([*fitted.system.owners, *solution.gains.uppers])
    parts = np.split(solution.jacobian, np.cumsum([row.target.size for row in fitted.rows])[:-1])
    for row, part in zip(fitted.rows, parts, strict=True):
        noise, chosen = fitted.noises[row.joint], np.flatnonzero(poor & (joints == row.joint - 1))
        if len(chosen):
            J = part.reshape(*row.target.shape, -1)
            estimated = np.full(len(joints), float(noise.freedoms))
            if row.joint not in fitted.weak:
                estimated = freedoms(noise, ones=row.ones, jacobian=J, inverse=fitted.inverse)
            dof[chosen] = np.clip(estimated[chosen], 1.0, float(noise.freedoms))
    return completed(fitted.inverse, covariance, poor) if poor.any() else covariance, dof
