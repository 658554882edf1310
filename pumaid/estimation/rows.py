"""The runs of each joint as rows of one system: design and current, whitened by the noise of bins and reduced."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.effect_spec import scale_of
from pumaid.estimation import noise as noises
from pumaid.estimation.bilinear import Bilinear
from pumaid.estimation.noise import Levels, NoiseModel
from pumaid.joint_bins import JointBins
from pumaid.maths.recursion import LARGEST_RATIO, Gains
from pumaid.model import DELAY, Model
from pumaid.preprocessing.options import STROKE

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]

#: Singular values of a run's own columns below this share of its largest are rounding.
FLAT = 1e-10
#: Runs that are reduced at once.
AT_ONCE = 500
#: Share of the range that is physical by which a parameter is uncertain before any data.
QUARTER = 0.25
#: How much firmer than its prior a shape is held at a bound.
TIGHT = 1e6
#: s, beside half a step of the log: what filters of drives and a fieldbus put between a current and its position.
LAG = 0.001
#: Bins of a run, beside twice the parameters of its own fit, from which correlation is read.
FEWEST_BINS = 12


@dataclass(frozen=True, eq=False)
class Row:
    """The runs of one joint: its bins, their design matrix, and both reduced to what a fit needs.

    Attributes
    ----------
    bins
        R runs, N bins.
    design
        (N, p) A per unit of each parameter, in the gain of the link's own joint.
    inner
        Noise of bins without the level that a run shares; a bin that it whitens has variance one.
    ones, regressors, target
        (R, k), (R, k, p), (R, k): each run's constant, design and current, whitened by `inner`, along the k directions
        that its design and the first harmonic of the position span (what a model leaves there is noise); zero where a
        run spans fewer.
    counts
        (R,) directions of each run.
    moved
        (R, k, P) likewise, what effects of the load change with parameters and ratios through the load; None where it
        is not looked at.
    slow
        How many times the density of `inner` slow noise has inside runs.
    """

    bins: JointBins
    design: Floats
    inner: NoiseModel
    ones: Floats
    regressors: Floats
    target: Floats
    counts: Counts
    moved: Floats | None = None
    slow: float = 1.0

    @classmethod
    def of(
        cls, bins: JointBins, design: Floats, inner: NoiseModel, *, moved: Floats | None = None, slow: float = 1.0
    ) -> Row:
        """Whitened and reduced; `moved` is (N, P)."""
        p, more = design.shape[1], np.zeros((len(bins), 0)) if moved is None else moved
        parts = [bins.harmonic, more, design, np.ones(len(bins)), bins.current]
        table = inner.decorrelated(bins, np.column_stack(parts))
        small, counts, _ = reduced(bins, table[:, :-2], table[:, -2:])
        through = None if moved is None else small[:, :, -2 - p - more.shape[1] : -2 - p]
        return cls(
            bins, design, inner, small[:, :, -2], small[:, :, -2 - p : -2], small[:, :, -1], counts, through, slow
        )

    @property
    def joint(self) -> int:
        """From 1."""
        return self.bins.joint

    @property
    def is_stroke(self) -> NDArray[np.bool_]:
        """(R,) runs from rest to rest.

        Their accelerations are smoothed differences of positions, and stand in for all that a change of speed does: in
        them the model misses by far more than where nothing is accelerated.
        """
        return self.bins.is_stroke

    def quiet_ones(self, levels: Levels) -> Floats:
        """(R, k) constants of runs divided by how loud they are."""
        return np.asarray(self.ones / np.sqrt(self._loud(levels))[:, None])

    def whitened(self, levels: Levels, values: Floats) -> Floats:
        """(R k, q) of (R, k, q) by what a whole fit leaves."""
        quiet = values / np.sqrt(self._loud(levels))[:, None, None]
        return noises.whiten(levels, self.quiet_ones(levels), quiet).reshape(self.target.size, -1)

    def _loud(self, levels: Levels) -> Floats:
        return np.where(self.is_stroke, levels.loud, 1.0)

    @property
    def stacked(self) -> Floats:
        """(R k, p) regressors."""
        return self.regressors.reshape(-1, self.regressors.shape[2])

    @property
    def joined(self) -> Floats:
        """(R, k, p + 1): regressors and target side by side."""
        return np.concatenate([self.regressors, self.target[:, :, None]], axis=2)


def reduced(bins: JointBins, design: Floats, others: Floats) -> tuple[Floats, Counts, Floats]:
    """Columns of each run along the directions that its design spans.

    Parameters
    ----------
    bins
        R runs, N bins.
    design
        (N, p).
    others
        (N, q) what else is wanted along these directions; the last is what the run's own fit explains.

    Returns
    -------
    small
        (R, k, p + q), zero where a run spans fewer than k.
    counts
        (R,) directions of each run.
    own
        (R, p) minimum-norm parameters of each run's own least squares.
    """
    live = np.flatnonzero(design.any(axis=0))
    size = np.linalg.norm(design[:, live], axis=0)
    table, m = np.column_stack([design[:, live] / size, others]), len(live)
    chunks = [(start, min(start + AT_ONCE, len(bins.runs))) for start in range(0, len(bins.runs), AT_ONCE)]
    parts = [_reduced(bins, table, m, part=part) for part in chunks]
    counts = np.concatenate([counts for _, counts, _ in parts])
    k = max(int(counts.max()), 1)
    small = np.zeros((len(bins.runs), k, design.shape[1] + others.shape[1]))
    columns = np.append(live, design.shape[1] + np.arange(others.shape[1]))
    for (start, stop), (along, _, _) in zip(chunks, parts, strict=True):
        along[:, :, :m] *= size
        small[start:stop, : min(k, along.shape[1]), columns] = along[:, :k]
    own = np.zeros((len(bins.runs), design.shape[1]))
    own[:, live] = np.concatenate([alone for _, _, alone in parts]) / size
    return small, counts, own


def _reduced(bins: JointBins, table: Floats, m: int, *, part: tuple[int, int]) -> tuple[Floats, Counts, Floats]:
    """`reduced` of runs from one number to another of (N, m + q) scaled columns."""
    first, lengths = bins.first[part[0] : part[1]], bins.lengths[part[0] : part[1]]
    here = np.arange(first[0], first[-1] + lengths[-1])
    padded = np.zeros((len(first), max(int(lengths.max()), 1), table.shape[1]))
    padded[bins.run[here] - part[0], here - first[bins.run[here] - part[0]]] = table[here]
    upper: Floats = np.asarray(np.linalg.qr(padded, mode="r"))
    left, singular, right = np.linalg.svd(upper[:, :, :m], full_matrices=False)
    kept = singular > FLAT * np.maximum(singular[:, :1], 1e-300)
    along = np.where(kept[:, :, None], left.transpose(0, 2, 1) @ upper[:, :, m:], 0.0)
    small = np.concatenate([np.where(kept, singular, 0.0)[:, :, None] * right, along], axis=2)
    shares = np.divide(along[:, :, -1], singular, out=np.zeros_like(singular), where=kept)
    return small, kept.sum(axis=1), np.einsum("rkm,rk->rm", right, shares)


def inner_noise(bins: JointBins, design: Floats) -> tuple[NoiseModel, float]:
    """White noise inside runs, by what each leaves beside its own fit, and how many times more slow noise there is."""
    wide = np.column_stack([design, bins.harmonic])
    _, lost, own = reduced(bins, wide, bins.current[:, None])
    residual = bins.current - np.einsum("np,np->n", wide, own[bins.run])
    enough = bins.lengths >= np.maximum(FEWEST_BINS, 2 * lost)
    return noises.inside_runs(bins, residual, lost=np.asarray(lost, dtype=float), enough=enough).plain(bins)


def limits(rows: Sequence[Row], model: Model) -> Floats:
    """(p,) standard error at which each parameter, acting in full, is as uncertain as all that its joint drew."""
    drawn = {row.joint: float(np.sqrt(row.bins.mean_square)) for row in rows}
    speed = {row.joint: max(abs(run.speed) for run in row.bins.runs) for row in rows}
    pull = {row.joint: _hardest(row) for row in rows}
    g = float(np.linalg.norm(model.robot.gravity))
    full = {"gravity": dict.fromkeys(range(1, model.robot.n_joints + 1), g), "viscous": speed, "inertia": pull}
    out = []
    for index, column in enumerate(model.columns):
        if column.place is not None:
            out.append(_limit(model, rows, index))
        elif column.effect == DELAY:
            out.append(max((_delay(row) for row in rows if row.joint == column.owner), default=LAG))
        else:
            in_full = full.get(column.effect, {}).get(column.owner, 1.0) or 1.0
            out.append(max(drawn.get(column.owner, max(drawn.values())), np.finfo(float).tiny) / in_full)
    return np.array(out)


def _hardest(row: Row) -> float:
    """Largest acceleration of strokes, rad/s2 or m/s2."""
    pulls = np.abs(row.bins.samples.acceleration)[row.is_stroke[row.bins.run]]
    return float(pulls.max(initial=0.0))


def _delay(row: Row) -> float:
    """s, what a joint's delay in strokes may be before any data."""
    steps = [run.duration / max(run.samples, 1) for run in row.bins.runs if run.kind == STROKE]
    return 0.5 * float(np.mean(steps)) + LAG if steps else LAG


def _limit(model: Model, rows: Sequence[Row], index: int) -> float:
    """Of a parameter of an effect, from what a unit of it draws; of a shape, how far it may go."""
    column = model.columns[index]
    if column.shape is not None and column.place is not None:
        term = model.effects[column.place]
        return scale_of(term.shapes(model.robot)[column.shape], term.shape[column.shape])
    return plausible([(row.bins, float(np.abs(row.design[:, index]).max())) for row in rows], column.span)


def plausible(peaks: Sequence[tuple[JointBins, float]], span: float) -> float:
    """The size that a parameter of an effect may have before any data.

    Parameters
    ----------
    peaks
        Joints, and the most (A) that a unit of it draws there.
    span
        From the lowest to the highest value that is physical.
    """
    tiny = np.finfo(float).tiny
    each = [max(float(np.sqrt(bins.mean_square)), tiny) / peak for bins, peak in peaks if peak > 0.0]
    return min(each + [QUARTER * span] * math.isfinite(span), default=1.0)


def priors(model: Model, limit: Floats, *, is_tight: bool) -> Floats:
    """(h, p) a prior for each parameter of effects, and each delay: before any data it may be as large as its limit.

    The paper's parameters have none: what the data do not show of them is not identifiable. An effect's are held so
    that a shape at which it looks like the paper's model does not let it, and with it that model, run off.

    Parameters
    ----------
    model
        The model.
    limit
        (p,) as `limits` gives it.
    is_tight
        Whether shapes that are best at a bound are kept there.
    """
    columns = [(index, column) for index, column in enumerate(model.columns) if _has_prior(model, index)]
    out = np.zeros((len(columns), len(model.columns)))
    for row, (index, column) in zip(out, columns, strict=True):
        at_bound = column.place is not None and column.shape in model.effects[column.place].held
        row[index] = (TIGHT if is_tight and at_bound else 1.0) / limit[index]
    return out


def _has_prior(model: Model, index: int) -> bool:
    column = model.columns[index]
    return column.place is not None or column.effect == DELAY


def system_of(rows: Sequence[Row], levels: Mapping[int, Levels], owners: Counts) -> Bilinear:
    """The rows whitened by each joint's own noise."""
    stacked = np.vstack([row.whitened(levels[row.joint], row.joined) for row in rows])
    number = np.concatenate([np.full(row.target.size, row.joint - 1) for row in rows])
    return Bilinear(number, stacked[:, :-1], stacked[:, -1], owners)


def levels_of(
    rows: Sequence[Row],
    levels: Mapping[int, Levels],
    values: Floats,
    *,
    gains: Gains,
    owners: Counts,
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
        return noises.estimate(row.ones, design, residual, counts=row.counts, is_loud=row.is_stroke)
    longer = max(row.target.shape[1], len(extra))

    def joined(values: Floats, last: Floats) -> Floats:
        out = np.zeros((len(values) + 1, longer, *values.shape[2:]))
        out[:-1, : values.shape[1]], out[-1, : len(last)] = values, last
        return out

    return noises.estimate(
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
    spread = float(np.median(row.inner.spread))
    least = max(noises.EXACT**2 * row.bins.mean_square, np.finfo(float).tiny ** 0.5) / spread**2
    loud = 1.0 + max(levels.loud - 1.0, 0.0) * max(int(np.count_nonzero(row.is_stroke)), 1)
    return replace(levels, sample=max(levels.sample, least), loud=loud)


def reach_of(model: Model, limit: Floats, gains: Gains) -> Floats:
    """(p + edges,) standard errors that say nothing; what has a prior is never as uncertain as that."""
    has_prior = np.array([_has_prior(model, index) for index in range(len(model.columns))], dtype=bool)
    return np.concatenate([np.where(has_prior, 2.0 * limit, limit), np.full(len(gains.edges), LARGEST_RATIO)])
