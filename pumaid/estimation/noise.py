"""What the noise of each joint is taken for: from what a fit leaves, or from inside runs where these are too few."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pumaid.estimation.rows import Row
from pumaid.maths import levels as variances
from pumaid.maths.joint_fit import Bilinear
from pumaid.maths.levels import Levels
from pumaid.maths.recursion import Gains

Floats = NDArray[np.float64]

#: Noise below this share of the RMS current is rounding: data without noise, whose weights would be infinite. Large
#: enough that rounding, thus weighted, says nothing about a parameter's plausible size.
EXACT = 1e-10

#: Bins of a run from which the correlation of its residual is read, three of them spent on its own first harmonic.
FEWEST_CELLS = 12
#: Correlation of neighbouring bins beyond which a residual is a trend: its long-run variance has no estimate.
MOST_CORRELATED = 0.98


def levels_of(
    rows: Sequence[Row],
    levels: Mapping[int, Levels],
    values: Floats,
    *,
    gains: Gains,
    owners: NDArray[np.int64],
    held: Floats,
) -> dict[int, Levels]:
    """Each joint's noise from what the fit leaves; without joints whose runs are too few to tell.

    What priors keep from fitting is left here, too: they count as equations with the noise that `levels` has.
    """
    out = {}
    for row in rows:
        plain = Bilinear(np.full(row.target.size, row.joint - 1), row.stacked, row.target.ravel(), owners)
        jacobian = plain.jacobian(gains, values)
        edges = [len(values) + k for k, edge in enumerate(gains.edges) if gains.parent[edge] == row.joint - 1]
        own = np.concatenate([np.flatnonzero(owners == row.joint - 1), edges]).astype(int)
        residual = (plain.target - plain.scaled(gains) @ values).reshape(row.target.shape)
        design = jacobian[:, own].reshape(*row.target.shape, -1)
        prior = held[np.any(held[:, own[own < len(values)]], axis=1)] * np.sqrt(levels[row.joint].sample)
        wide = np.hstack([prior, np.zeros((len(prior), len(gains.edges)))])[:, own]
        estimated = _estimate(row, design, residual, prior=(wide, -prior @ values))
        if estimated is not None:
            out[row.joint] = floored(estimated, row)
    return out


def _estimate(row: Row, design: Floats, residual: Floats, *, prior: tuple[Floats, Floats]) -> Levels | None:
    """Noise of a joint from (R, k, q) and (R, k), with (h, q) and (h,) equations of priors as one run more."""
    extra, target = prior
    if not len(extra):
        return variances.estimate(row.ones, design, residual, counts=row.counts, is_loud=row.is_stroke)
    longer = max(row.target.shape[1], len(extra))

    def joined(values: Floats, last: Floats) -> Floats:
        out = np.zeros((len(values) + 1, longer, *values.shape[2:]))
        out[:-1, : values.shape[1]], out[-1, : len(last)] = values, last
        return out

    return variances.estimate(
        joined(row.ones, np.zeros(len(extra))),
        joined(design, extra),
        joined(residual, target),
        counts=np.append(row.counts, len(extra)),
        is_loud=np.append(row.is_stroke, False) if row.is_stroke.any() and not row.is_stroke.all() else None,
    )


def floored(levels: Levels, row: Row) -> Levels:
    """Never below what is rounding of the joint's current; and strokes as loud as all of them together are.

    What strokes have beyond noise, a model's misfit, comes again in each: however many there are, it does not average
    out, and they count as one. Strokes that are calmer (slow noise is less in short runs) lend that to no other run,
    and are not believed more for it.
    """
    least = max(EXACT**2 * row.mean_square, np.finfo(float).tiny ** 0.5)
    loud = 1.0 + max(levels.loud - 1.0, 0.0) * max(int(np.count_nonzero(row.is_stroke)), 1)
    return replace(levels, sample=max(levels.sample, least), loud=loud)


def from_inside(row: Row) -> Levels:
    """Variance of low-frequency noise from the course of the residual inside runs, where runs are too few to compare.

    The residual of a run's own fit is taken as first-order autoregressive over bins; its long-run variance a sample is
    variance x samples a bin x (1 + r) / (1 - r). The level that a run shares stays unknown (zero).
    """
    found = {is_stroke: _inside(row, is_stroke) for is_stroke in (False, True)}
    calm, loud = (total / weight if weight else None for total, weight in (found[False], found[True]))
    weight = found[False][1] or found[True][1]
    sample = calm if calm is not None else loud
    if sample is None:
        return Levels(max(row.rest / max(row.samples - 3, 1), 0.0), 0.0, 1)
    times = max(loud / calm, 1.0) if calm and loud else 1.0
    return Levels(sample, 0.0, max(weight // 4, 1), times)


def of_strokes(row: Row) -> float:
    """Variance (A2) of a sample of slow noise inside a joint's strokes, beyond each one's own harmonic and inertia."""
    total, weight = _inside(row, True)
    return total / weight if weight else 0.0


def _inside(row: Row, is_stroke: bool) -> tuple[float, int]:
    """Long-run variance a sample, times its weight, and the weight, of runs from rest to rest or of the others."""
    total, weight = 0.0, 0
    for run in (run for run, is_one in zip(row.runs, row.is_stroke, strict=True) if is_one == is_stroke):
        bins, own = run.bins, run.joint - 1
        q, current = bins.position[:, own], bins.current
        basis = np.column_stack([np.cos(q), np.sin(q), np.ones(len(q)), bins.acceleration])
        if len(q) < FEWEST_CELLS:
            continue
        residual = current - basis @ np.linalg.lstsq(basis, current, rcond=1e-6)[0]
        square = float(residual @ residual)
        r = float(residual[1:] @ residual[:-1]) / square if square > 0 else 0.0
        r = min(max(r, 0.0), MOST_CORRELATED)
        total += square * float(np.mean(bins.count)) * (1.0 + r) / (1.0 - r)
        weight += len(q) - 3
    return total, weight
