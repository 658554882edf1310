"""What further effects would add to a fit, linearised: products with its derivatives, scores and sizes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pumaid.effect_spec import EffectTerm, columns_each
from pumaid.estimation.fit import Fit, with_loads
from pumaid.estimation.gls import plausible
from pumaid.samples import Samples

Floats = NDArray[np.float64]

#: Share of a column's squares beyond what is fitted already, below which there is only rounding.
NOTHING = 1e-9


@dataclass(frozen=True, eq=False, slots=True)
class Refit:
    """An effect added to a linearised fit: `gain` is the fall of the weighted squares, `values` (p,) its linear
    parameters, ``half half'`` (p, k) their covariance; `shift` (P, p) is by how much all else moves with each of them.
    """

    gain: float
    values: Floats
    half: Floats
    shift: Floats


class Projector:
    """What is left of further columns beyond a fit, all else refitted.

    Columns are means over bins where `at_nodes`, else values at their middles; loads are those of `whole`, where given,
    else those that the bins have.
    """

    def __init__(self, solved: Fit, *, whole: Fit | None = None, at_nodes: bool = False) -> None:
        self.solved, self.whole, self.at_nodes = solved, whole, at_nodes
        stops = np.cumsum([0, *(len(row.bins.runs) for row in solved.joints)]).tolist()
        self.runs = {row.bins.joint: slice(*stops[k : k + 2]) for k, row in enumerate(solved.joints)}
        self.total = stops[-1]
        self._loaded: dict[int, Samples] = {}

    @cached_property
    def base_scores(self) -> Floats:
        """(R, P) score of each run for the fit's parameters."""
        out = np.zeros((self.total, len(self.solved.inverse)))
        for row in self.solved.joints:
            out[self.runs[row.bins.joint], row.acting] = row.bins.sums(row.slim * row.residual[:, None])
        return out

    def columns(self, terms: Sequence[EffectTerm]) -> dict[int, Floats]:
        """Joint -> (N, V) columns (A per unit) of one effect with several shapes, side by side, where it acts."""
        made, robot = dict[int, Floats](), self.solved.model.robot
        for row in self.solved.joints:
            if terms[0].touches(row.bins.joint):
                columns = columns_each(terms, robot, self._samples(row.bins.joint, terms[0].effect.needs_loads))
                made[row.bins.joint] = row.bins.averaged(columns) if self.at_nodes else columns
        return {joint: columns for joint, columns in made.items() if np.any(columns)}

    def _samples(self, joint: int, needs_loads: bool) -> Samples:
        bins = self.solved.row(joint).bins
        points = bins.nodes[0] if self.at_nodes else bins.samples
        if self.whole is None or not needs_loads:
            return points
        if joint not in self._loaded:
            self._loaded[joint] = with_loads(self.whole, points, (3 if self.at_nodes else 1) * bins.lengths)
        return self._loaded[joint]

    def whitened(self, columns: Mapping[int, Floats]) -> dict[int, Floats]:
        """The same by the noise of each joint."""
        rows = {joint: self.solved.row(joint) for joint in columns}
        return {joint: rows[joint].noise.whiten(rows[joint].bins, values) for joint, values in columns.items()}

    def crossed(self, white: Mapping[int, Floats]) -> Floats:
        """(P, V) products of the fit's derivatives with whitened columns (N, V) by joint."""
        out = np.zeros((len(self.solved.inverse), next(iter(white.values())).shape[1]))
        for joint, columns in white.items():
            row = self.solved.row(joint)
            out[row.acting] += row.slim.T @ columns
        return out

    def scores(self, white: Mapping[int, Floats], width: int) -> tuple[Floats, Floats, Floats]:
        """Scores and information beyond the fit of k candidates of m (`width`) columns each, side by side.

        Of whitened columns (N, V) by joint, zero in joints that are absent: (R, V) scores of all joints' runs,
        (k, m, m) information of each candidate, and (V,) squares of the columns before the projection.
        """
        cross = self.crossed(white)
        turned = self.solved.inverse @ cross
        scores, gram = -self.base_scores @ turned, np.zeros((cross.shape[1] // width, width, width))
        for joint, columns in white.items():
            row = self.solved.row(joint)
            scores[self.runs[joint]] += row.bins.sums(columns * row.residual[:, None])
            gram += _products(columns, columns, width)
        raw = np.diagonal(gram, axis1=1, axis2=2).ravel()
        return scores, gram - _products(cross, turned, width), raw

    def refits(self, terms: Sequence[EffectTerm], *, limits: Floats | None = None) -> list[Refit]:
        """An effect with each of some shapes, without its derivatives, its linear parameters held by priors.

        `limits` (p,) are their prior deviations; where not given, those that a fit with this shape has.
        """
        robot, columns = self.solved.model.robot, self.columns(terms)
        spans = [column.span for column in replace(terms[0], fitted=()).parts(robot, 0)]
        width = len(spans)
        if not columns:
            shift = np.zeros((len(self.solved.inverse), width))
            return [Refit(0.0, np.zeros(width), np.zeros((width, 0)), shift)] * len(terms)
        white = self.whitened(columns)
        cross = self.crossed(white)
        shifts = -self.solved.inverse @ cross
        gram = np.sum([_products(values, values, width) for values in white.values()], axis=0)
        beyond = gram + _products(cross, shifts, width)
        parts = [self.solved.row(joint).residual @ values for joint, values in white.items()]
        total = np.sum(parts, axis=0).reshape(-1, width)
        peaks = {joint: np.abs(values).max(axis=0).reshape(-1, width) for joint, values in columns.items()}
        out = []
        for k in range(len(terms)):
            usual = limits
            if usual is None:
                each = [
                    [(self.solved.row(j).bins, float(peak[k, n])) for j, peak in peaks.items()] for n in range(width)
                ]
                usual = np.array([plausible(pairs, span) for pairs, span in zip(each, spans, strict=True)])
            raw = np.diag(gram[k])
            size = np.sqrt(np.where(raw > 0, raw, 1.0))
            scale = np.maximum(usual * size, NOTHING)
            values, vectors = np.linalg.eigh(beyond[k] / np.outer(size, size) + np.diag(scale**-2.0))
            is_shown = values > NOTHING
            half = vectors[:, is_shown] / np.sqrt(values[is_shown]) / size[:, None]
            solution = half @ (half.T @ total[k])
            out.append(Refit(float(solution @ total[k]), solution, half, shifts[:, k * width : (k + 1) * width]))
        return out


def _products(left: Floats, right: Floats, width: int) -> Floats:
    """(k, m, m) products of the m columns of each of k candidates, side by side in both (N, V) tables."""
    out = np.empty((left.shape[1] // width, width, width))
    if len(out) == 1:
        return np.asarray((left.T @ right)[None])
    for i, j in np.ndindex(width, width):
        out[:, i, j] = np.einsum("nk,nk->k", left[:, i::width], right[:, j::width])
    return out
