"""From a fit to its parameters: value, error and interval, or the reason why the data do not determine one."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import special

from pumaid.dataset import STROKE
from pumaid.effect_spec import Column
from pumaid.effects import Samples, Scope
from pumaid.errors import listed
from pumaid.estimate import IDENTIFIED, NOT_IDENTIFIABLE, Combination, Value
from pumaid.estimation import reasons
from pumaid.estimation.fit import Fit, Row, clusters
from pumaid.estimation.noise import freedoms
from pumaid.estimation.reasons import NAMED, JointCoverage, Reason, reason
from pumaid.joint_bins import SAME_POSTURE
from pumaid.kinematics import posture_groups
from pumaid.maths import LARGEST_RATIO, RATIO_KNOWN, Bilinear, Counts, Flags, Floats, Gains, JointSolution

#: An eigenvalue of I - H below this belongs to a direction that a run fits alone, but for what a prior says: its
#: residual tells nothing, and its variance is taken from the working model.
FITTED_ALONE = 1e-3
#: Runs that are worked on at once: what each pulls takes some 25 kB.
AT_ONCE = 1000
#: Share of the largest singular value of a row's scaled normal matrix below which there is only rounding: its columns'
#: own singular values, squared, with four digits to spare above machine precision.
ROUNDING = 1e-12
#: A variance that rests on fewer degrees of freedom than this is taken from the working model of the noise instead.
FEWEST_FREEDOMS = 3.0
#: A ratio of gains counts as identified when its standard error is below `RATIO_KNOWN` (gains of neighbours are of
#: comparable size, so such an interval tells something whatever the value), or when zero is outside its 99.9 %
#: interval. Either way the load that carries it must itself be non-zero at that level: else the interval is none of a
#: ratio (Fieller).
RATIO_LEVEL = 0.001
#: An effect's parameter whose error is above this share of its plausible size is not identified.
OPEN = 0.5
#: Share of a direction that makes a parameter part of it; well above the jitter of held positions.
PART_OF = 1e-3
#: Share of an effect's column beyond the rest of the model, below which it is none: what is made from fitted loads is
#: known to a few parts in a thousand.
SAME = 1e-3
#: Share of its standard error by which a confounded effect moves a parameter that is then known only with it.
MOVED = 0.7
#: Postures of a joint whose load is stated: one is the usual case, more than three nobody reads.
MOST_POSTURES = 3
#: A sum is determined when what it may be off by, beyond its standard error, is below this share of the joint's RMS
#: current. Held positions creep by a few mrad between runs, so the share is small but never zero.
LEANING = 0.02
#: A sum is worth stating when one of its terms has an error this many times its own.
WORTH = 30.0
#: Terms below this share of the largest are rounding.
SHARE = 1e-9


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


@dataclass(frozen=True, eq=False, slots=True)
class FittedParameters:
    """A fit with the covariance that belongs to it: of all joints together or of the recursion.

    `solution` holds the values shown: the fit's own, or those of the recursion that it began with. `covariance` (P, P)
    is of parameters and ratios, `freedoms` (P,) are behind each variance; `coverage` says by joint (from 1) what its
    runs cover. `absorbed` is that of `Fit`, of the recursion only; `confounded` names what the data show only
    together with a parameter or ratio (from 0), `profiles` has profile-likelihood intervals by column.
    """

    fitted: Fit
    solution: JointSolution
    covariance: Floats
    freedoms: Floats
    coverage: Mapping[int, JointCoverage]
    absorbed: Mapping[int, list[tuple[int, int]]] = field(default_factory=dict)
    confounded: Mapping[int, tuple[str, ...]] = field(default_factory=dict)
    profiles: Mapping[int, tuple[float, float]] = field(default_factory=dict)

    @classmethod
    def of(
        cls, fitted: Fit, errors: Clustered, coverage: Mapping[int, JointCoverage], *, recursive: bool = False
    ) -> "FittedParameters":
        """Of the fit over all joints, or of the recursion; by the working model where clusters are too few."""
        first = fitted.first if recursive else None
        solution = first.solution if first else fitted.solution
        covariance = completed(solution.linear.inverse, errors.covariance, errors.freedoms < FEWEST_FREEDOMS)
        dof = _freedoms(fitted, errors, recursive=recursive)
        absorbed = first.absorbed if first else {}
        partners = {} if first else confounded(fitted)[2]
        return cls(fitted, solution, covariance, dof, coverage, absorbed=absorbed, confounded=partners)

    def reach(self) -> Floats:
        """(P, b) undetermined directions of parameters and ratios, as long as is plausible (see `Estimate.blind`)."""
        blind = self.solution.linear.blind
        size = np.pad(self.fitted.limit, (0, len(blind) - len(self.fitted.limit)), constant_values=LARGEST_RATIO)
        return np.asarray(size[:, None] * blind)

    def values(self) -> tuple[Value, ...]:
        """Every parameter, every ratio of neighbours, and where such is open the next one outward that is known."""
        model, out = self.fitted.model, []
        for index, column in enumerate(model.columns):
            out.append(self._parameter(index, column))
        for name, why in model.structure.absent.items():
            link, part = int(name.split(".")[1][1:]), name.rsplit(".", 1)[1]
            symbol = f"m{link}" if part == "mass" else f"k{link}{part}"
            out.append(_open(Value(name, symbol, link, "A s2/m"), {"reason": why}))
        n, further = model.robot.n_joints, list[Value]()
        for inner in range(1, n):
            ratios = (self._ratio(inner, outer) for outer in range(inner + 1, n + 1))
            out.append(next(ratios))
            if out[-1].state != IDENTIFIED:
                further += [ratio for ratio in ratios if ratio.state == IDENTIFIED][:1]
        return (*out, *further)

    def _parameter(self, index: int, column: Column) -> Value:
        model, partners = self.fitted.model, self._partners(index)
        bare = Value(column.name, column.symbol, column.owner or None, column.unit)
        is_idle = column.scope in (Scope.JOINT, Scope.LINK) and self.coverage[column.owner].runs == 0
        if column.place is None and index in self.confounded and not is_idle:
            return _open(bare, reason("confounded", names=listed(self.confounded[index], NAMED)))
        is_open = is_idle or partners is not None
        if column.place is not None:
            # Known hardly better than before any data, or a shape best at a bound.
            error = float(np.sqrt(self.solution.linear.inverse[index, index]))
            if index in self.profiles:
                error = _error_of(self.profiles[index], self.freedoms[index])
            is_open |= column.shape in model.effects[column.place].held or error > OPEN * self.fitted.limit[index]
        if is_open:
            row = next((row for row in self.fitted.rows if row.joint == column.owner), None)
            lever = 1.0  # RMS of a gravity column over its joint's own runs, as a share of g
            if row is not None and column.effect == "gravity":
                square = float(np.average(row.design[:, index] ** 2, weights=row.bins.count))
                lever = math.sqrt(square) / float(np.linalg.norm(model.robot.gravity))
            why = reasons.of_column(model, column, coverage=self.coverage, partners=partners or [], lever=lever)
            return _open(bare, why)
        if self.solution is not self.fitted.solution and self.fitted.system.owners[index] < 0:
            return _open(bare, reason("several joints"))
        variance = float(self.covariance[index, index] + np.sum(self.reach()[index] ** 2))
        # A shape's column holds what the fit moves the shape by.
        start = 0.0 if column.shape is None else model.effects[column.place or 0].shape[column.shape]
        ends = self.profiles.get(index)
        return _identified(bare, self.solution.values[index] + start, variance, self.freedoms[index], ends=ends)

    def _partners(self, index: int) -> list[str] | None:
        """Names of what parameter `index` is only determined together with; None where it is determined."""
        if index in self.confounded:
            return list(self.confounded[index])
        blind, lost = self.solution.linear.blind, self.absorbed.get(index)
        # The projector on the undetermined directions does not depend on how they are chosen within their span.
        share = np.abs(blind @ blind[index])
        if share[index] <= PART_OF**2 and lost is None:
            return None
        # Ratios are measured by another limit, and must not outshine the parameters.
        p = len(self.solution.values)
        least = PART_OF * np.where(np.arange(len(share)) < p, share[:p].max(), share.max())
        names = _names(self.fitted, self.solution.gains)
        together = [name for n, name in enumerate(names) if share[n] > least[n] and n != index]
        return [*together, *(f"gain_ratio.{inner}.{outer}" for inner, outer in lost or [])]

    def _ratio(self, inner: int, outer: int) -> Value:
        p, load = len(self.solution.values), (0.0, 0.0)
        bare = Value(f"gain_ratio.{inner}.{outer}", f"eta{inner}/eta{outer}", inner, "")
        value, gradient = ratio_gradient(self.solution.gains, inner - 1, outer - 1)
        edges = [int(edge) for edge in np.flatnonzero(gradient)]
        if self.coverage[inner].runs and self.coverage[outer].runs and np.isfinite(value):
            together = [name for edge in edges for name in self.confounded.get(p + edge, ())]
            if together:
                return _open(bare, reason("confounded", names=listed(together, NAMED)))
            # The row that gave an edge may have taken a load for known that the recursion had left open.
            uppers = self.solution.gains.uppers
            beside = [k for edge in edges for k, upper in enumerate(uppers) if upper == uppers[edge]]
            is_guess = any(not set(self.absorbed).isdisjoint(self._behind(k).tolist()) for k in beside)
            if not is_guess and all(self._partners(p + edge) is None for edge in edges):
                off = float(np.sum((gradient @ self.reach()[p:]) ** 2))
                variance = float(gradient @ self.covariance[p:, p:] @ gradient) + off
                dof = min((float(self.freedoms[p + edge]) for edge in edges), default=np.inf)
                error = float(np.sqrt(max(variance, 0.0)))
                is_certain = error < RATIO_KNOWN or two_sided(value / error, dof) < RATIO_LEVEL
                errors = np.sqrt(np.diag(self.covariance))
                chance = 0.0  # that no load is behind an edge
                for edge in edges:
                    loads = [n for n in self._behind(edge) if errors[n] > 0.0]
                    chances = [two_sided(self.solution.values[n] / errors[n], self.freedoms[n]) for n in loads]
                    chance = max(chance, min(chances, default=1.0))
                if is_certain and chance < RATIO_LEVEL:
                    return _identified(bare, value, variance, dof)
                load = min(map(self._load, edges), key=lambda pair: pair[0] / max(pair[1], 1e-300), default=load)
        return _open(bare, reasons.of_ratio(self.fitted.model, inner, outer, coverage=self.coverage, load=load))

    def _behind(self, edge: int) -> Counts:
        """Numbers of the gravity parameters behind edge number `edge`."""
        subtree = self.solution.gains.subtree(self.solution.gains.edges[edge])
        is_load = [column.effect == "gravity" for column in self.fitted.model.columns]
        return np.flatnonzero(is_load & np.isin(self.fitted.system.owners, subtree))

    def _load(self, edge: int) -> tuple[float, float]:
        """RMS (A) of what comes through an edge in its upper joint's current, and that part's standard error."""
        gains, number = self.solution.gains, len(self.solution.values) + edge
        upper = gains.uppers[edge]
        row = next(row for row in self.fitted.rows if row.joint == upper + 1)
        at_bins = Bilinear(np.full(len(row.bins), upper), row.design, row.bins.current, self.fitted.system.owners)
        slopes = at_bins.jacobian(gains, self.solution.values)[:, number]
        slope = math.sqrt(float(np.average(slopes**2, weights=row.bins.count)))
        return abs(gains.ratios[edge]) * slope, float(np.sqrt(self.covariance[number, number])) * slope


def confounded(fitted: Fit) -> tuple[Counts, Floats, dict[int, tuple[str, ...]]]:
    """Sums of effects' linear parameters that the rest of the model could take over whole, and what takes them over.

    Returns (m,) numbers (from 0) of the effects' parameters; (h, m) sums of these; and number of a parameter or ratio
    -> names of what the data show only together with it: what they say of either is what a prior says.
    """
    jacobian, columns, out = fitted.solution.jacobian, fitted.model.columns, dict[int, tuple[str, ...]]()
    names, error = _names(fitted, fitted.gains), np.sqrt(np.diag(fitted.inverse))
    is_effect = np.zeros(jacobian.shape[1], dtype=bool)
    is_effect[: len(columns)] = [column.place is not None for column in columns]
    norms = np.linalg.norm(jacobian, axis=0)
    effects = np.array([n for n in np.flatnonzero(is_effect & (norms > 0)) if columns[n].shape is None], dtype=int)
    if not len(effects):
        return effects, np.zeros((0, 0)), out
    rest, size = np.flatnonzero(~is_effect), norms[effects]
    scale = np.where(norms[rest] > 0, norms[rest], 1.0)
    unit, base = jacobian[:, effects] / size, jacobian[:, rest] / scale
    share, *_ = np.linalg.lstsq(base, unit, rcond=1e-12)
    _, sizes, right = np.linalg.svd(unit - base @ share, full_matrices=False)
    ways = right[sizes < SAME * max(1.0, sizes[0])]
    for way in ways:
        # As far as what is plausible of the effect lets it.
        reach = 1.0 / np.max(np.abs(way / size) / fitted.limit[effects])
        members = effects[np.abs(way) > PART_OF].tolist()
        taking = rest[np.abs((way @ share.T) / scale) * reach > MOVED * error[rest]].tolist()
        for group, with_it in ((members, taking or members), (taking, members)):
            for n in group:
                out[n] = tuple(dict.fromkeys((*out.get(n, ()), *(names[k] for k in with_it if k != n))))
    return effects, ways / size, out


def ratio_gradient(gains: Gains, row: int, other: int) -> tuple[float, Floats]:
    """eta_row / eta_other and its derivative by every edge."""
    value, down, up = gains.ratio(row, other), gains.path(other), gains.path(row)
    powers = np.array([(edge in down) - (edge in up) for edge in gains.edges], dtype=float)
    rate = np.divide(powers, gains.ratios, out=np.zeros(len(powers)), where=gains.ratios != 0.0)
    return value, np.nan_to_num(value * rate)


def _names(fitted: Fit, gains: Gains) -> list[str]:
    """(P,) of parameters and ratios."""
    return [
        *fitted.model.names,
        *(f"gain_ratio.{up + 1}.{low + 1}" for up, low in zip(gains.uppers, gains.edges, strict=True)),
    ]


def _freedoms(fitted: Fit, errors: Clustered, *, recursive: bool) -> Floats:
    """(P,) degrees of freedom; the working model's own where clusters are too few."""
    source = fitted.first if recursive and fitted.first else fitted
    out, solution, start = errors.freedoms.copy(), source.solution, 0
    poor = out < FEWEST_FREEDOMS
    joints = np.array([*fitted.system.owners, *solution.gains.uppers])
    for row in source.rows:
        stop = start + row.target.size
        chosen = np.flatnonzero(poor & (joints == row.joint - 1))
        if len(chosen):
            levels = source.levels[row.joint]
            estimated: Floats | float = float(levels.freedoms)
            if row.joint not in fitted.weak:
                J = solution.jacobian[start:stop].reshape(*row.target.shape, -1)
                ones, inverse = row.ones, solution.linear.inverse
                estimated = freedoms(levels, ones=ones, jacobian=J, inverse=inverse)[chosen]
            out[chosen] = np.clip(estimated, 1.0, float(levels.freedoms))
        start = stop
    return out


def _error_of(ends: tuple[float, float], dof: float) -> float:
    """The standard error that an interval so wide would have."""
    low, high = interval(0.0, 1.0, dof)
    return float((ends[1] - ends[0]) / (high - low))


def _identified(
    bare: Value, value: float, variance: float, dof: float, *, ends: tuple[float, float] | None = None
) -> Value:
    error = float(np.sqrt(max(variance, 0.0))) if ends is None else _error_of(ends, dof)
    ci95 = ends or interval(float(value), error, dof)
    return replace(bare, value=float(value), std_error=error, ci95=ci95, dof=float(dof))


def _open(bare: Value, why: Reason) -> Value:
    return replace(bare, state=NOT_IDENTIFIABLE, **why)


def combinations(fitted: FittedParameters, values: Sequence[Value]) -> tuple[Combination, ...]:
    """Sums of parameters that the data determine although a term of theirs, of `values`, is not or far less well."""
    errors = {value.name: math.inf if value.std_error is None else value.std_error for value in values}
    model, sums = fitted.fitted.model, list[Combination]()
    for row in sorted(fitted.fitted.rows, key=lambda row: row.joint):
        rms = math.sqrt(row.bins.mean_square)
        sums_at_joint = list(_felt(fitted, row))
        for sign, side, way in ((1, "plus", "forward"), (-1, "minus", "backward")):
            covered, names = fitted.coverage[row.joint], model.names
            if covered.has_one_speed(sign):
                weights = np.zeros(len(fitted.covariance))
                weights[names.index(f"coulomb.j{row.joint}.{side}")] = 1.0
                weights[names.index(f"viscous.j{row.joint}.{side}")] = sign * float(np.mean(covered.speeds[sign]))
                text = f"friction of joint {row.joint} {way}, at the one speed that was run"
                sums_at_joint.append((weights, text, "A", 1.0))
        for weights, text, unit, size in sums_at_joint:
            # Parameters of plausible size would make this sum a part of the joint's current.
            reach = size * float(np.linalg.norm(weights[: len(model.columns)] * fitted.fitted.limit))
            total = _sum(fitted, row, weights, text, unit=unit, size=size)
            far = (abs(weight) * errors[name] > WORTH * total.std_error for name, weight in total.terms.items())
            sums += [total] if reach > LEANING * rms and any(far) else []
    # Of each effect that the rest of the model takes over in part: the parts that it does not.
    effects, ways, _ = (
        confounded(fitted.fitted) if fitted.confounded else (np.zeros(0, dtype=int), np.zeros((0, 0)), {})
    )
    for place, term in enumerate(model.effects):
        members = np.array([model.columns[n].place == place for n in effects], dtype=bool)
        if not np.any(ways[:, members]):
            continue
        numbers, size = effects[members], np.linalg.norm(fitted.fitted.solution.jacobian[:, effects[members]], axis=0)
        _, sizes, right = np.linalg.svd(ways[:, members] * size)
        row = next(row for row in fitted.fitted.rows if term.touches(row.joint))
        where = f" of joint {term.number}" if term.number else ""
        text = f"{term.effect.name}{where}: what does not pass for the rest of the model"
        for weights in right[np.count_nonzero(sizes > SAME) :]:
            whole = np.zeros(len(fitted.covariance))
            whole[numbers] = weights * size
            whole /= np.abs(whole).sum() * np.sign(whole[np.argmax(np.abs(whole))])
            sums.append(_sum(fitted, row, whole, text, unit=model.columns[numbers[0]].unit))
    return tuple(total for total in sums if math.isfinite(total.value))


def _sum(
    fitted: FittedParameters, row: Row, weights: Floats, text: str, *, unit: str = "A", size: float = 1.0
) -> Combination:
    """The sum with its standard error; NaN where it rests on a direction that the data do not determine.

    `size` is what it is multiplied by in the joint's current.
    """
    columns = fitted.fitted.model.columns
    bare = weights[: len(columns)]
    terms = {int(n): float(bare[n]) for n in np.flatnonzero(np.abs(bare) > SHARE * np.abs(bare).max(initial=0.0))}
    off = float(np.linalg.norm(weights @ fitted.reach()))
    error = math.sqrt(max(float(weights @ fitted.covariance @ weights) + off**2, 0.0))
    if any(n in fitted.confounded and columns[n].place is None for n in terms):
        off = error
    value = float(bare @ fitted.solution.values) if size * off < LEANING * math.sqrt(row.bins.mean_square) else math.nan
    return Combination({columns[n].name: weight for n, weight in terms.items()}, value, error, unit, text)


def _felt(fitted: FittedParameters, row: Row) -> Iterator[tuple[Floats, str, str, float]]:
    """Weights, text, unit and size of what a joint feels in each posture that was run: the gravity load of a revolute
    one at positions 0 and a quarter turn, and where it went from rest to rest its inertia, which acted with that
    acceleration and knows the outer joints' positions only.
    """
    model, number, bins = fitted.fitted.model, row.joint, row.bins
    joint, has_weight = model.robot.joint(number), np.array([c.effect == "gravity" for c in model.columns])
    held = np.array([run.posture for run in bins.runs])
    strokes = np.flatnonzero([run.kind == STROKE for run in bins.runs])
    pulls = bins.samples.acceleration[np.isin(bins.run, strokes)]

    def weights(posture: Floats, angle: float, pull: float) -> Floats:
        """(P,) A by each parameter and ratio at rest, the joint at an angle, or what a unit of acceleration adds."""
        position = np.tile(np.nan_to_num(posture), (2, 1))
        position[:, number - 1] = angle
        still = np.zeros_like(position)
        base = model.base(Samples(number, position, still, np.array([0.0, pull]), np.ones(2)))
        part = base[:1] * has_weight[: base.shape[1]] if pull == 0.0 else base[1:] - base[:1]
        whole = np.pad(part, ((0, 0), (0, len(has_weight) - base.shape[1])))
        felt = Bilinear(np.full(1, number - 1), whole, np.zeros(1), fitted.fitted.system.owners)
        return np.asarray(felt.jacobian(fitted.solution.gains, fitted.solution.values)[0])

    for group in bins.postures[:MOST_POSTURES] if joint.is_revolute else ():
        which = _held_at(held[group[0]], "others") if len(bins.postures) > 1 else ""
        yield weights(held[group[0]], 0.0, 0.0), f"weight felt by joint {number} at position 0{which}", "A", 1.0
        text = f"weight felt by joint {number} a quarter turn on{which}"
        yield weights(held[group[0]], math.pi / 2.0, 0.0), text, "A", 1.0
    groups = posture_groups(held[strokes][:, number:], SAME_POSTURE) if len(strokes) else []
    for members in groups[:MOST_POSTURES]:
        posture = held[strokes[members[0]]]
        which = _held_at(posture[number:], "outer joints") if len(groups) > 1 else ""
        text, size = f"inertia felt by joint {number}{which}", float(np.sqrt(np.mean(pulls**2)))
        yield weights(posture, 0.0, 1.0), text, f"A s2/{joint.position_unit}", size


def _held_at(posture: Floats, joints: str) -> str:
    """Where the joints of a posture are held, as a part of a sentence."""
    places = ", ".join("-" if math.isnan(position) else f"{position:.2f}" for position in posture)
    return f", {joints} at ({places})"
