"""Least squares that says which directions of the parameters the data do not determine."""

from dataclasses import dataclass

import numpy as np

from pumaid.maths import Flags, Floats

#: Singular values of the column-scaled matrix below this share of the largest are rounding: triangles are formed in
#: double precision (1e-16) from regressors of order one, and merging thousands of them loses about six digits.
RELATIVE_TOLERANCE = 1e-9
#: With limits the columns are not scaled to one length, so only what is surely rounding of the largest counts as zero.
ROUNDING = 1e-13
#: Eigenvalues of a scaled information below this share of the largest are directions that the data do not show; columns
#: shorter than a share of the longest are zero but for rounding.
FLAT, FAINT = 1e-10, 1e-12
#: A parameter whose share in an undetermined unit direction is below this does not belong to it (rounding).
SHARE_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False, slots=True)
class Solution:
    """A minimum-norm least-squares solution (p,) with its blind directions.

    `inverse` (p, p) is the pseudo-inverse of the information matrix, the covariance when the rows are whitened; `blind`
    (p, b) has directions, in columns, of unit length in the scaled parameters, that the rows do not determine; `scale`
    (p,) are the column norms by which the parameters were scaled, 0 for a zero column.
    """

    values: Floats
    inverse: Floats
    blind: Floats
    scale: Floats

    @property
    def determined(self) -> Flags:
        """(p,) whether each parameter is free of every blind direction."""
        if self.blind.size == 0:
            return np.ones(len(self.values), dtype=bool)
        return np.max(np.abs(self.blind), axis=1) < SHARE_TOLERANCE


def solve(
    rows: Floats, target: Floats, *, limit: Floats | None = None, tolerance: float = RELATIVE_TOLERANCE
) -> Solution:
    """Least squares by a column-scaled singular value decomposition, minimum norm where the rank is short.

    `rows` (N, p) and `target` (N,) are whitened: each target has unit variance (any common one without `limit`).
    `limit` (p,) is the largest standard error at which a parameter still says anything: a direction is blind, too, when
    its standard error exceeds one, each parameter measured by its limit. Singular values below the share `tolerance` of
    the largest count as zero.

    Source: C. L. Lawson and R. J. Hanson, Solving Least Squares Problems, ch. 14 (the paper used their HFTI).
    """
    norms = np.linalg.norm(rows, axis=0)
    if not norms.any():
        p = len(norms)
        return Solution(np.zeros(p), np.zeros((p, p)), np.eye(p), norms)
    inverse_scale = np.divide(1.0, norms, out=np.zeros_like(norms), where=norms > 0)
    if limit is not None:
        inverse_scale = np.where(norms > 0, limit, 0.0)
    basis, singular, right = np.linalg.svd(rows * inverse_scale, full_matrices=len(rows) < len(norms))
    full = np.zeros(len(norms))
    full[: len(singular)] = singular
    is_shown = full > (tolerance * full[0] if limit is None else max(1.0, ROUNDING * full[0]))
    shown = np.flatnonzero(is_shown)
    half = inverse_scale[:, None] * (right[shown].T / full[shown])
    values = half @ (basis[:, shown].T @ target)
    return Solution(values, half @ half.T, right[~is_shown].T, norms)


def independent(rows: Floats, *, first: int = 0, tolerance: float = RELATIVE_TOLERANCE) -> Flags:
    """(p,) which columns are determined once the `first` leading columns have had the first word.

    The leading columns absorb what any other column shares with them, so a column that is a combination of leading
    ones is not determined while the leading ones stay so.
    """
    scale = np.linalg.norm(rows, axis=0)
    unit = np.divide(rows, scale, out=np.zeros_like(rows), where=scale > 0)
    lead, rest = unit[:, :first], unit[:, first:]
    if first:
        vectors, singular, _ = np.linalg.svd(lead, full_matrices=False)
        basis = vectors[:, singular > tolerance * singular[0]]
        lead, rest = basis.T @ lead, rest - basis @ (basis.T @ rest)
        rest[:, np.linalg.norm(rest, axis=0) < tolerance * 100] = 0.0
    parts = [solve(part, np.zeros(len(part)), tolerance=tolerance).determined for part in (lead, rest)]
    return np.concatenate(parts) & (scale > 0)


def pseudo_inverse(information: Floats) -> tuple[Floats, int]:
    """Pseudo-inverse (P, P) of a symmetric matrix in scaled columns, and the rank."""
    size = np.sqrt(np.maximum(np.diagonal(information), 0.0))
    unit = np.divide(1.0, size, out=np.zeros_like(size), where=size > FAINT * size.max(initial=0.0))
    values, vectors = np.linalg.eigh(information * unit[:, None] * unit[None, :])
    is_shown = values > FLAT * values[-1]
    half = vectors[:, is_shown] / np.sqrt(values[is_shown])
    return (unit[:, None] * half) @ (half.T * unit[None, :]), int(np.count_nonzero(is_shown))
