"""A weighted fit of bins, of which every table, test and plan asks its question; each joint's runs are rows of it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pumaid.dataset import BLOCK
from pumaid.effect_spec import EffectTerm
from pumaid.effects import Samples
from pumaid.errors import ModelError, Where
from pumaid.estimation.noise import EXACT, NoiseModel, noise_of, reduced
from pumaid.joint_bins import JointBins
from pumaid.maths import USUAL_RATIO, Bilinear, Counts, Floats, Gains, JointSolution, inverse_root
from pumaid.model import Model, loads_at

#: Share of a column's square below which the model absorbs it: what is left is rounding and creep of held positions.
ABSORBED = 1e-5
#: Share of an effect's squares beyond what is fitted already, below which there is only rounding.
NOTHING = 1e-9


@dataclass(frozen=True, eq=False)
class Row:
    """The R runs (N bins) of one joint: their design matrix, and both reduced to what a fit needs.

    `design` is (N, p) A per unit of each parameter, in the gain of the link's own joint. `inner` is the noise of bins
    without the level that a run shares; what it whitens has variance one, and `slow` times its density is slow noise
    inside runs. `ones` (R, k), `regressors` (R, k, p) and `target` (R, k) are each run's constant, design and current,
    whitened, along the k directions that its design and the first harmonic of the position span (what a model leaves
    there is noise); zero where a run spans fewer than k, of which `counts` (R,) says how many. `moved` (R, k, P) is
    likewise what effects of the load change with parameters and ratios through the load, None where it is not looked
    at.
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
    ) -> "Row":
        """Whitened and reduced; `moved` is (N, P). Raises ModelError (effects-astray) where a column overflows."""
        acting, more = np.flatnonzero(design.any(axis=0)), np.zeros((0, len(bins))) if moved is None else moved.T
        parts = np.vstack([bins.harmonic.T, more, design.T[acting], np.ones(len(bins)), bins.current])
        if not np.isfinite(parts).all():
            where, mend = Where(joint=bins.joint), "add fewer effects; nothing was written"
            raise ModelError("effects-astray", f"columns of joint {bins.joint} overflow: it went astray", where, mend)
        table = inner.decorrelated(bins, parts.T)  # column after column
        small, counts, _ = reduced(bins, table[:, :-2], table[:, -2:])
        regressors, before = np.zeros((*small.shape[:2], design.shape[1])), 2 + len(more)
        regressors[:, :, acting] = small[:, :, before:-2]
        through = None if moved is None else small[:, :, 2:before]
        return cls(bins, design, inner, small[:, :, -2], regressors, small[:, :, -1], counts, through, slow)

    @property
    def joint(self) -> int:
        """From 1."""
        return self.bins.joint

    def in_columns(self, old: Sequence[str], new: Sequence[str]) -> "Row":
        """The same runs where the columns called `old` are `new`; what is not among them is zero."""
        place = {name: n for n, name in enumerate(old)}
        index = [place.get(name, len(old)) for name in new]
        design, regressors = (
            np.concatenate([part, np.zeros((*part.shape[:-1], 1))], axis=-1)[..., index]
            for part in (self.design, self.regressors)
        )
        return replace(self, design=design, regressors=regressors, moved=None)

    def noise(self, sample: float, level: float = 0.0, freedoms: int = 0) -> NoiseModel:
        """The noise with other variances, of a sample (over that of `inner`) and of the level that a run shares (A2).

        Never below what is rounding of the joint's current.
        """
        least = max(EXACT**2 * self.bins.mean_square, np.finfo(float).tiny ** 0.5)
        sample = max(sample, least / float(np.median(self.inner.spread)) ** 2)
        spread, shared = self.inner.spread * np.sqrt(sample), np.full(len(self.inner.spread), np.sqrt(level))
        return replace(self.inner, spread=spread, level=shared, sample=sample, freedoms=freedoms)

    def whitened(self, noise: NoiseModel, values: Floats) -> Floats:
        """(R k, q) of (R, k, q) by what a whole fit leaves."""
        return noise.whiten_reduced(self.ones, values).reshape(self.target.size, -1)

    @property
    def joined(self) -> Floats:
        """(R, k, p + 1): regressors and target side by side."""
        return np.concatenate([self.regressors, self.target[:, :, None]], axis=2)


@dataclass(frozen=True, eq=False)
class FitRow:
    """One joint of a fit, bin by bin: its N bins, with loads by the fit where effects need them, and their noise.

    `bare` (N, P) is the derivative of the prediction by every parameter and ratio, `misfit` (N,) A what the fit leaves;
    `jacobian` and `residual` are the same, whitened.
    """

    bins: JointBins
    noise: NoiseModel
    bare: Floats
    misfit: Floats

    @cached_property
    def jacobian(self) -> Floats:
        """(N, P) whitened, column after column."""
        live, out = np.flatnonzero(self.bare.any(axis=0)), np.zeros(self.bare.shape, order="F")
        out[:, live] = self.noise.whiten(self.bins, self.bare.T[live].T)
        return out

    @cached_property
    def residual(self) -> Floats:
        """(N,) whitened."""
        return self.noise.whiten(self.bins, self.misfit)

    @property
    def drawn(self) -> Floats:
        """(N,) A that the model predicts."""
        return np.asarray(self.bins.current - self.misfit)

    @property
    def rmse(self) -> float:
        """RMSE (A) of the samples; within bins the prediction is taken for a straight line."""
        return float(np.sqrt(np.average(self.bins.squares(self.misfit), weights=self.bins.count)))


@dataclass(frozen=True, eq=False)
class Fit:
    """A weighted fit: everything else is a question asked of it.

    `rows` has a row for each joint that moves, outermost first, `noises` the noise by joint (from 1) that the fit
    is weighted by; of `weak` joints the level a run could not be estimated (too few runs). `assigned` (J,) is the joint
    (from 0) in whose gain link j's parameters are: its own or, where that never moves, the next inner one that does and
    feels them; -1 where there is none. `system` holds the whitened rows, `prior` (P,) the inverse of the prior standard
    deviation of each parameter and ratio as for `fit_bilinear`, `limit` (p,) the standard error at which each parameter
    says nothing any more.

    `first` is the recursion, where the fit began with it. Its `absorbed` maps a column (from 0) that it leaves open to
    the ratios (i, j) of gains (joints from 1) whose loads it absorbs.
    """

    model: Model
    rows: tuple[Row, ...]
    assigned: Counts
    noises: dict[int, NoiseModel]
    weak: tuple[int, ...]
    system: Bilinear
    solution: JointSolution
    prior: Floats
    limit: Floats
    first: "Fit | None" = None
    absorbed: Mapping[int, list[tuple[int, int]]] = field(default_factory=dict)

    @property
    def gains(self) -> Gains:
        """The ratios found."""
        return self.solution.gains

    @property
    def values(self) -> Floats:
        """(p,) linear parameters, in the order of the model's columns."""
        return self.solution.values

    @cached_property
    def inverse(self) -> Floats:
        """(P, P) inverse information of parameters and ratios, priors included."""
        return np.asarray(self.solution.linear.half @ self.solution.linear.half.T)

    def scales(self) -> Floats:
        """(J, J) eta_i / eta_j of links as the fit has them; NaN where unknown, 0 below the diagonal."""
        is_felt = self.assigned[None, :] >= np.arange(len(self.assigned))[:, None]
        return np.triu(np.where(is_felt, self.gains.scales()[:, self.assigned], np.nan))

    def information(self) -> Floats:
        """(P, P) of all bins, without priors."""
        return np.asarray(sum(row.jacobian.T @ row.jacobian for row in self.joints))

    @property
    def rank(self) -> int:
        """Directions of the parameters that the data determine."""
        return len(self.inverse) - self.solution.linear.blind.shape[1]

    @cached_property
    def square(self) -> float:
        """Sum of squares of the whitened residuals of all bins."""
        return sum(float(row.residual @ row.residual) for row in self.joints)

    @property
    def size(self) -> int:
        """Bins of all joints."""
        return sum(len(row.bins) for row in self.joints)

    @property
    def scale(self) -> float:
        """Variance of a whitened residual: one where the noise model is right."""
        return self.square / max(self.size - self.rank, 1)

    def columns_of(self, place: int) -> Counts:
        """Numbers (from 0) of an effect's parameters and fitted shapes, by its place in the model."""
        return np.array([n for n, column in enumerate(self.model.columns) if column.place == place], dtype=int)

    def sizes(self, place: int) -> Floats:
        """Linear parameters of an effect, by its place in the model."""
        return self.values[[n for n in self.columns_of(place) if self.model.columns[n].shape is None]]

    def signs(self, term: EffectTerm) -> Floats:
        """(p,) sign that each parameter of an effect must have at this arm; 0 where either is possible."""
        signs = np.array(term.effect.signs(term.shape), dtype=float)
        if len(signs) == 0:
            return np.zeros(len(term.effect.parameters(self.model.robot, term.number)))
        # Friction draws current along the motion, or, where the motor counts it so, backwards.
        named = dict(zip(self.model.names, self.values.tolist(), strict=True))
        plus, minus = (named.get(f"coulomb.j{term.number}.{way}", 0.0) for way in ("plus", "minus"))
        return signs * (np.sign(plus - minus) if term.effect.opposes_motion else 1.0)

    @cached_property
    def by_bin(self) -> dict[int, FitRow]:
        """Joint (from 1) -> the fit at its bins."""
        return {row.joint: self.at(row.bins, row.design, noise=self.noises[row.joint]) for row in self.rows}

    def felt(self, term: EffectTerm, joint: int) -> float:
        """What multiplies an effect's columns in a joint (from 1): of what is carried the ratio of gains, zero where
        that is unknown; of others one."""
        return float(np.nan_to_num(self.scales()[joint - 1, -1])) if term.is_carried else 1.0

    def linear(self, term: EffectTerm, samples: Samples) -> Floats:
        """(M, p) A in the moving joint per unit of each linear parameter of an effect, at the fit's ratios."""
        return term.linear(self.model.robot, samples) * self.felt(term, samples.joint)

    def without(self, place: int) -> "Fit":
        """Its least squares about its own ratios and loads without one effect, by its place in the model.

        A fit anew would bend the ratios that the effect has shown. All bins of a joint weigh alike and alone: what an
        instant not yet right leaves would pass for slow noise, and hide all of it but its edges.
        """
        gone, p = self.columns_of(place), len(self.values)
        rest, theta = np.delete(np.arange(len(self.inverse)), gone), np.append(self.values, self.gains.ratios)
        rows = dict[int, FitRow]()
        for joint, row in self.by_bin.items():
            none = np.zeros(len(row.bins.runs))
            white = NoiseModel(none, none + np.median(row.noise.spread), none)
            misfit = row.misfit + row.bare[:, gone] @ theta[gone]
            rows[joint] = FitRow(row.bins, white, row.bare[:, rest], misfit)
        pull = self.prior**2 * (np.repeat([0.0, USUAL_RATIO], [p, len(theta) - p]) - theta)
        asked = pull[rest] + sum(row.jacobian.T @ row.residual for row in rows.values())
        information = sum(row.jacobian.T @ row.jacobian for row in rows.values())
        half = inverse_root(information + np.diag(self.prior[rest] ** 2))
        step = half @ (half.T @ asked)
        rows = {joint: replace(row, misfit=row.misfit - row.bare @ step) for joint, row in rows.items()}
        linear = replace(self.solution.linear, half=half, blind=np.zeros((len(rest), len(rest) - half.shape[1])))
        solution = replace(self.solution, values=(theta[rest] + step)[: p - len(gone)], linear=linear)
        model = self.model.with_effects([term for n, term in enumerate(self.model.effects) if n != place])
        prior, limit = self.prior[rest], np.delete(self.limit, gone)
        return replace(self, model=model, solution=solution, prior=prior, limit=limit).with_rows(rows)

    def with_rows(self, rows: Mapping[int, FitRow]) -> "Fit":
        """The same fit with some joints' rows by bin replaced."""
        copy = replace(self)
        copy.__dict__["by_bin"] = (self.by_bin if len(rows) < len(self.rows) else {}) | dict(rows)
        return copy

    @property
    def joints(self) -> tuple[FitRow, ...]:
        """The fit at the bins of each joint, base first."""
        return tuple(self.by_bin[joint] for joint in sorted(self.by_bin))

    def at(self, bins: JointBins, design: Floats | None = None, *, noise: NoiseModel | None = None) -> FitRow:
        """The fit at any bins of a joint, weighted by `noise`, where not given as these bins show it.

        (N, p) `design` is by its model; where not given it is made, and the bins have loads by the fit.
        """
        local = self._beside(bins, design)
        bins = bins if design is not None else bins.with_samples(with_loads(self, bins))
        misfit = local.left(self.values, self.gains)
        return FitRow(bins, noise or noise_of(bins, misfit), local.jacobian(self.gains, self.values), misfit)

    def misfit(self, bins: JointBins, design: Floats | None = None) -> Floats:
        """(N,) A that it leaves at any bins of a joint, whose (N, p) `design` is made where not given."""
        return self._beside(bins, design).left(self.values, self.gains)

    def _beside(self, bins: JointBins, design: Floats | None = None) -> Bilinear:
        design = design_of(self.model, bins, self) if design is None else design
        return Bilinear(np.array([bins.joint - 1]), design, bins.current, self.system.owners)


def clusters(rows: Sequence[Row]) -> tuple[Counts, Counts]:
    """(N,) cluster (from 0) of each equation of some rows, a run or a block of all joints; (R,) the joint of each, 0 of
    blocks.
    """
    runs = [run for row in rows for run in row.bins.runs]
    keys = [(run.joint * (run.kind != BLOCK), run.origin, run.first_row, run.clock) for run in runs]
    numbers = {key: number for number, key in enumerate(dict.fromkeys(keys))}
    widths = [row.target.shape[1] for row in rows for _ in row.bins.runs]
    return np.repeat([numbers[key] for key in keys], widths), np.array([joint for joint, *_ in numbers])


def with_loads(fitted: Fit, bins: JointBins, *, at_nodes: bool = False) -> Samples:
    """The samples of (N,) bins, or of their (k N,) nodes, with loads by the fit."""
    samples, scales = bins.nodes[0] if at_nodes else bins.samples, fitted.scales()
    return replace(
        samples, loads=loads_at(fitted.model, bins, solution=fitted.values, scales=scales, at_nodes=at_nodes)
    )


def with_row(fitted: Fit, row: FitRow) -> Fit:
    """The same fit with one joint's row at other bins, or of other noise; what it holds stays held."""
    other, half = fitted.with_rows({row.bins.joint: row}), fitted.solution.linear.half
    half = half @ inverse_root(half.T @ (other.information() + np.diag(fitted.prior**2)) @ half)
    linear = replace(fitted.solution.linear, half=half)
    return replace(fitted, solution=replace(fitted.solution, linear=linear)).with_rows(other.by_bin)


def elsewhere(fitted: Fit, bins: JointBins) -> FitRow:
    """One joint of the fit at runs that were not fitted, their noise like that of fitted runs as fast."""
    old = fitted.by_bin[bins.joint]
    return fitted.at(bins, noise=old.noise.at(old.bins, bins))


def loaded(fitted: Fit) -> Fit:
    """The same fit, the bins of which have loads by it, for candidates that need them."""
    rows = {
        joint: replace(row, bins=row.bins.with_samples(with_loads(fitted, row.bins)))
        for joint, row in fitted.by_bin.items()
    }
    return fitted.with_rows(rows)


def design_of(model: Model, bins: JointBins, before: Fit | None = None) -> Floats:
    """(N, p) the model's design at bins of one joint, effects of the load by the fit `before`."""
    loads = None
    if any(term.needs_loads and term.touches(bins.joint) for term in model.effects):
        assert before is not None, "effects of the load wait for a fit"
        loads = with_loads(before, bins, at_nodes=True).loads
    return model.design(bins, loads)


def plausible(peaks: Sequence[tuple[JointBins, float]], span: float) -> float:
    """The size that a parameter of an effect may have before any data.

    `peaks` are joints and the most (A) that a unit of it draws there, `span` goes from the lowest to the highest value
    that is physical; before any data a parameter is uncertain by a quarter of that.
    """
    sizes = [max(float(np.sqrt(bins.mean_square)), np.finfo(float).tiny) / peak for bins, peak in peaks if peak > 0.0]
    return min(sizes + [0.25 * span] * math.isfinite(span), default=1.0)


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

    Columns are means over bins where `at_nodes`, else values at their middles, the `samples` by joint; loads are those
    of `whole`, where given, else those that the bins have.
    """

    def __init__(self, solved: Fit, *, whole: Fit | None = None, at_nodes: bool = False) -> None:
        self.solved, self.at_nodes, self.samples = solved, at_nodes, dict[int, Samples]()
        for bins in (row.bins for row in solved.joints):
            points = bins.nodes[0] if at_nodes else bins.samples
            self.samples[bins.joint] = points if whole is None else with_loads(whole, bins, at_nodes=at_nodes)
        stops = np.cumsum([0, *(len(row.bins.runs) for row in solved.joints)]).tolist()
        self.runs = {row.bins.joint: slice(*stops[k : k + 2]) for k, row in enumerate(solved.joints)}

    @cached_property
    def base_scores(self) -> Floats:
        """(R, P) score of each run for the fit's parameters."""
        out = np.zeros((sum(len(row.bins.runs) for row in self.solved.joints), len(self.solved.inverse)))
        for row in self.solved.joints:
            out[self.runs[row.bins.joint]] = row.bins.products(row.residual, row.jacobian)
        return out

    def columns(self, terms: Sequence[EffectTerm]) -> dict[int, Floats]:
        """Joint -> (N, V) columns (A per unit) of one effect with several shapes, side by side, where it acts.

        Derivatives by a term's `fitted` shapes are among them.
        """
        made, robot = dict[int, Floats](), self.solved.model.robot
        for row in self.solved.joints:
            if terms[0].touches(row.bins.joint):
                samples = self.samples[row.bins.joint]
                columns = np.hstack([(term.columns if term.fitted else term.linear)(robot, samples) for term in terms])
                if terms[0].is_carried:
                    columns = columns * self.solved.felt(terms[0], row.bins.joint)
                made[row.bins.joint] = row.bins.averaged(columns) if self.at_nodes else columns
        return {joint: columns for joint, columns in made.items() if np.any(columns)}

    def whitened(self, columns: Mapping[int, Floats]) -> dict[int, Floats]:
        """The same by the noise of each joint."""
        rows = {joint: self.solved.by_bin[joint] for joint in columns}
        return {joint: rows[joint].noise.whiten(rows[joint].bins, values) for joint, values in columns.items()}

    def crossed(self, white: Mapping[int, Floats]) -> Floats:
        """(P, V) products of the fit's derivatives with whitened columns (N, V) by joint."""
        out = np.zeros((len(self.solved.inverse), next(iter(white.values())).shape[1]))
        for joint, columns in white.items():
            out += self.solved.by_bin[joint].jacobian.T @ columns
        return out

    def scores(self, white: Mapping[int, Floats], width: int) -> tuple[Floats, Floats, Floats]:
        """Scores and information beyond the fit of k candidates of m (`width`) columns each, side by side.

        Of whitened columns (N, V) by joint, zero in joints that are absent: (R, V) scores of all joints' runs,
        (k, m, m) information of each candidate, and (V,) squares of the columns before the projection.
        """
        cross = self.crossed(white)
        gram = np.sum([_products(columns, columns, width) for columns in white.values()], axis=0)
        scores = np.zeros((len(self.base_scores), cross.shape[1]))
        for joint, columns in white.items():
            row = self.solved.by_bin[joint]
            scores[self.runs[joint]] = row.bins.products(row.residual, columns)
        turned, raw = self.solved.inverse @ cross, np.diagonal(gram, axis1=1, axis2=2).ravel()
        return scores - self.base_scores @ turned, gram - _products(cross, turned, width), raw

    def refits(self, terms: Sequence[EffectTerm], *, limits: Floats | None = None) -> list[Refit]:
        """An effect with each of some shapes, without its derivatives, its linear parameters held by priors.

        `limits` (p,) are their prior deviations; where not given, those that a fit with this shape has.
        """
        robot = self.solved.model.robot
        columns = self.columns([replace(term, fitted=()) for term in terms])
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
        parts = [self.solved.by_bin[joint].residual @ values for joint, values in white.items()]
        total = np.sum(parts, axis=0).reshape(-1, width)
        peaks = {joint: np.abs(values).max(axis=0).reshape(-1, width) for joint, values in columns.items()}
        out = []
        for k in range(len(terms)):
            usual = np.zeros(width) if limits is None else limits
            for n, span in enumerate(spans if limits is None else ()):
                usual[n] = plausible(
                    [(self.solved.by_bin[j].bins, float(peak[k, n])) for j, peak in peaks.items()], span
                )
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
