"""From a fit to its parameters: value, error and interval, or the reason why the data do not determine one."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Run
from pumaid.effect_spec import Column
from pumaid.effects import Scope
from pumaid.estimate import IDENTIFIED, NOT_IDENTIFIABLE, Combination, Value
from pumaid.estimation import reasons
from pumaid.estimation.covariance import Clustered, completed, interval, two_sided
from pumaid.estimation.fit import Fit, Row
from pumaid.estimation.noise import freedoms
from pumaid.estimation.reasons import Facts, Reason
from pumaid.maths.bilinear import LARGEST_RATIO, RATIO_KNOWN, Bilinear, Gains, JointSolution
from pumaid.model import DELAY, Model
from pumaid.samples import Samples

Floats = NDArray[np.float64]
Absorbed = dict[int, list[tuple[int, int]]]

#: A variance that rests on fewer degrees of freedom than this is taken from the working model of the noise instead.
FEWEST_FREEDOMS = 3.0

#: A ratio of gains counts as identified when its standard error is below `RATIO_KNOWN` (gains of neighbours are of
#: comparable size, so such an interval tells something whatever the value), or when zero is outside its 99.9 %
#: interval. Either way the load that carries it must itself be non-zero at that level: else the interval is none of a
#: ratio (Fieller).
RATIO_LEVEL = 0.001

#: An effect's parameter whose error is above this share of what it can be at all has not been seen.
OPEN = 0.5

#: Share of a direction that makes a parameter part of it; well above the jitter of held positions.
PART_OF = 1e-3

#: Share of an effect's column beyond the rest of the model, below which it is none: what is made from fitted loads is
#: known to a few parts in a thousand.
SAME = 1e-3

#: Share of its standard error by which a confounded effect moves a parameter that is then known only with it.
MOVED = 0.7

_SHARED = "it acts on several joints, and the recursion solves one after the other; identify without --recursive"


@dataclass(frozen=True, eq=False, slots=True)
class Sheet:
    """A fit with the covariance that belongs to it: of all joints together or of the recursion.

    `solution` holds the values shown; `absorbed` is that of `Start`, of the recursion only; `confounded` by parameter
    or ratio (from 0) what effects and the rest of the model show only together; `profiles` by column (from 0)
    intervals that are not a tangent's.
    """

    fitted: Fit
    runs: Sequence[Run]
    solution: JointSolution
    covariance: Floats
    freedoms: Floats
    absorbed: Absorbed
    confounded: Mapping[int, tuple[str, ...]] = field(default_factory=dict)
    profiles: Mapping[int, tuple[float, float]] = field(default_factory=dict)

    @property
    def numbers(self) -> Floats:
        """(p,) the parameters."""
        return self.solution.values

    @property
    def gains(self) -> Gains:
        """The ratios."""
        return self.solution.gains

    @classmethod
    def of(cls, fitted: Fit, runs: Sequence[Run], errors: Clustered) -> Sheet:
        """The fit over all joints."""
        sheet = cls._with(fitted, runs, fitted.solution, errors=errors, absorbed={})
        return replace(sheet, confounded=confounded(fitted))

    @classmethod
    def of_recursion(cls, fitted: Fit, runs: Sequence[Run], errors: Clustered) -> Sheet:
        """The recursion alone."""
        assert fitted.first is not None
        return cls._with(fitted, runs, fitted.first.solution, errors=errors, absorbed=fitted.first.absorbed)

    @classmethod
    def _with(
        cls, fitted: Fit, runs: Sequence[Run], solution: JointSolution, *, errors: Clustered, absorbed: Absorbed
    ) -> Sheet:
        """Clustered by run, by the working model where clusters are too few."""
        poor = errors.freedoms < FEWEST_FREEDOMS
        covariance = completed(solution.linear.inverse, errors.covariance, poor)
        return cls(fitted, runs, solution, covariance, _freedoms(fitted, solution, errors), absorbed)

    @property
    def is_recursive(self) -> bool:
        """Whether the values are the recursion's."""
        return self.fitted.first is not None and self.solution is self.fitted.first.solution

    def blind(self) -> Floats:
        """(p, b) undetermined directions, each as far as it may plausibly reach (see `Estimate.blind`)."""
        return self.reach()[: len(self.numbers)]

    def reach(self) -> Floats:
        """(p + edges, b) `blind` over parameters and ratios."""
        blind = self.solution.linear.blind
        edges = np.full(len(blind) - len(self.numbers), LARGEST_RATIO)
        return np.concatenate([self.fitted.limit, edges])[:, None] * blind

    def values(self) -> tuple[Value, ...]:
        """Every parameter, then every ratio of neighbours."""
        facts = {joint: Facts.of(joint, self.runs) for joint in range(1, self.fitted.model.robot.n_joints + 1)}
        return (*self._parameters(facts), *self._ratios(facts))

    def _parameters(self, facts: dict[int, Facts]) -> list[Value]:
        model = self.fitted.model
        out = []
        for index, column in enumerate(model.columns):
            if column.effect == DELAY and column.place is None:
                continue
            bare = Value(column.name, column.symbol, column.owner or None, column.unit)
            partners = self._partners(index)
            is_idle = column.scope in (Scope.JOINT, Scope.LINK) and facts[column.owner].runs == 0
            if is_idle or partners is not None or self._is_open(index):
                lever = self._lever(index)
                because = reasons.of_column(model, column, facts=facts, partners=partners or [], lever=lever)
                if column.place is None and index in self.confounded:
                    because = Reason(f"these data could not tell it from {reasons.some(self.confounded[index])}")
                out.append(_unknown(bare, because))
            elif self.is_recursive and self.fitted.system.owners[index] < 0:
                out.append(_unknown(bare, Reason(_SHARED)))
            else:
                variance = float(self.covariance[index, index] + np.sum(self.reach()[index] ** 2))
                number = self.numbers[index] + shape_of(model, column)
                ends = self.profiles.get(index)
                out.append(_known(bare, number, variance, self.freedoms[index], ends=ends))
        for name, why in model.structure.absent.items():
            link, part = int(name.split(".")[1][1:]), name.rsplit(".", 1)[1]
            symbol = f"m{link}" if part == "mass" else f"k{link}{part}"
            out.append(_unknown(Value(name, symbol, link, "A s2/m"), Reason(why)))
        return out

    def _is_open(self, index: int) -> bool:
        """Whether an effect's parameter is known hardly better than before any data, or a shape best at a bound."""
        model, column = self.fitted.model, self.fitted.model.columns[index]
        if column.place is None:
            return False
        error = float(np.sqrt(self.solution.linear.inverse[index, index]))
        if index in self.profiles:
            error = _error_of(self.profiles[index], self.freedoms[index])
        return column.shape in model.effects[column.place].held or error > OPEN * self.fitted.limit[index]

    def _lever(self, index: int) -> float:
        """RMS of a gravity column over its joint's own runs, as a share of g; 1 for other columns."""
        column = self.fitted.model.columns[index]
        row = next((row for row in self.fitted.rows if row.joint == column.owner), None)
        if row is None or column.effect != "gravity":
            return 1.0
        square = float(np.average(row.design[:, index] ** 2, weights=row.bins.count))
        return float(np.sqrt(square) / np.linalg.norm(self.fitted.model.robot.gravity))

    def _partners(self, index: int) -> list[str] | None:
        """Names of what parameter `index` is only determined together with; None where it is determined."""
        if index in self.confounded:
            return list(self.confounded[index])
        blind, lost = self.solution.linear.blind, self.absorbed.get(index)
        # The projector on the undetermined directions does not depend on how they are chosen within their span.
        share = np.abs(blind @ blind[index])
        if share[index] <= PART_OF**2 and lost is None:
            return None
        edges = [(_above(self.gains, edge) + 1, edge + 1) for edge in self.gains.edges]
        names = [*self.fitted.model.names, *(ratio_name(*pair) for pair in edges)]
        # Ratios are measured by another limit, and must not outshine the parameters.
        p = len(self.numbers)
        least = PART_OF * np.where(np.arange(len(share)) < p, share[:p].max(), share.max())
        together = [name for n, name in enumerate(names) if share[n] > least[n] and n != index]
        return [*together, *(ratio_name(*pair) for pair in lost or [])]

    def _ratios(self, facts: dict[int, Facts]) -> list[Value]:
        """Ratios of neighbours, and where a joint's is unknown that to the next joint further out whose is known."""
        n, out, further = self.fitted.model.robot.n_joints, [], []
        for inner in range(1, n):
            ratios = (self._ratio(inner, outer, facts) for outer in range(inner + 1, n + 1))
            out.append(next(ratios))
            if out[-1].state != IDENTIFIED:
                further += [ratio for ratio in ratios if ratio.state == IDENTIFIED][:1]
        return [*out, *further]

    def _ratio(self, inner: int, outer: int, facts: dict[int, Facts]) -> Value:
        model, bare = self.fitted.model, Value(ratio_name(inner, outer), f"eta{inner}/eta{outer}", inner, "")
        value, gradient = _gradient(self.gains, inner - 1, outer - 1)
        if facts[inner].runs == 0 or facts[outer].runs == 0 or not np.isfinite(value):
            return _unknown(bare, reasons.of_ratio(model, inner, outer, facts=facts))
        p, edges = len(self.numbers), np.flatnonzero(gradient)
        together = [name for edge in edges for name in self.confounded.get(p + int(edge), ())]
        if together:
            return _unknown(bare, Reason(f"these data could not tell it from {reasons.some(together)}"))
        if any(self._partners(p + int(edge)) is not None or self._rests_on_open(int(edge)) for edge in edges):
            return _unknown(bare, reasons.of_ratio(model, inner, outer, facts=facts))
        variance = float(gradient @ self.covariance[p:, p:] @ gradient + np.sum((gradient @ self.reach()[p:]) ** 2))
        freedoms = float(np.min(self.freedoms[p + edges])) if edges.size else np.inf
        error = float(np.sqrt(max(variance, 0.0)))
        certain = error < RATIO_KNOWN or two_sided(value / error, freedoms) < RATIO_LEVEL
        if certain and all(self._carries(int(edge)) for edge in edges):
            return _known(bare, value, variance, freedoms)
        felt, noise = self._felt(edges)
        return _unknown(bare, reasons.of_ratio(model, inner, outer, facts=facts, felt=felt, noise=noise))

    def _cluster(self, edge: int) -> Floats:
        """(p,) bool: gravity parameters behind edge number `edge`."""
        gains = self.gains
        lower = gains.edges[edge]
        below = np.array([lower in gains.path(row) for row in range(gains.n_rows)])
        is_link = np.array([column.effect == "gravity" for column in self.fitted.model.columns])
        owners = self.fitted.system.owners
        return is_link & (owners >= 0) & below[owners]

    def _rests_on_open(self, edge: int) -> bool:
        """Whether the row that gave an edge took any load for known that the recursion had left open."""
        gains, columns = self.gains, list(self.absorbed)
        row = gains.parent[gains.edges[edge]]
        beside = [number for number, lower in enumerate(gains.edges) if gains.parent[lower] == row]
        return any(bool(self._cluster(number)[columns].any()) for number in beside)

    def _carries(self, edge: int) -> bool:
        """Whether the load behind an edge is itself non-zero at `RATIO_LEVEL`."""
        for index in np.flatnonzero(self._cluster(edge)):
            error = float(np.sqrt(self.covariance[index, index]))
            if error > 0.0 and two_sided(self.numbers[index] / error, self.freedoms[index]) < RATIO_LEVEL:
                return True
        return False

    def _felt(self, edges: NDArray[np.int64]) -> tuple[float, float]:
        """RMS (A) of the weakest ratio's part of its joint's current, and that part's standard error."""
        worst = (0.0, 0.0)
        for edge in edges:
            lower = self.gains.edges[edge]
            upper = _above(self.gains, lower)
            row = next(row for row in self.fitted.rows if row.joint == upper + 1)
            weights = np.zeros(len(self.numbers))
            for member in range(self.gains.n_rows):
                if lower in self.gains.path(member):
                    of_member = self.fitted.system.owners == member
                    weights[of_member] = self.gains.scale(lower, member) * self.numbers[of_member]
            nu = float(np.sqrt(np.average((row.design @ weights) ** 2, weights=row.bins.count)))
            p = len(self.numbers)
            part = (abs(self.gains.edge[lower]) * nu, float(np.sqrt(self.covariance[p + edge, p + edge])) * nu)
            if worst == (0.0, 0.0) or part[0] * worst[1] < worst[0] * part[1]:
                worst = part
        return worst


@dataclass(frozen=True, eq=False, slots=True)
class Lost:
    """Sums of effects' linear parameters that the rest of the model could take over whole.

    `effects` (m,) and `rest` (k,) are numbers of parameters and ratios (from 0); `ways` (h, m) the sums, in units of
    the columns' sizes `size` (m,), and `taken` (h, k) what of the rest stands for each.
    """

    effects: NDArray[np.int64]
    rest: NDArray[np.int64]
    size: Floats
    ways: Floats
    taken: Floats

    @classmethod
    def of(cls, fitted: Fit) -> Lost:
        """Of a fit: what of its effects no run tells from its other columns."""
        columns, jacobian = fitted.model.columns, fitted.solution.jacobian
        effects = np.array([n for n, c in enumerate(columns) if c.place is not None and c.shape is None], dtype=int)
        rest = np.array([n for n, c in enumerate(columns) if c.place is None], dtype=int)
        rest = np.concatenate([rest, np.arange(len(columns), jacobian.shape[1])])
        size, scale = (np.linalg.norm(jacobian[:, numbers], axis=0) for numbers in (effects, rest))
        effects, size, scale = effects[size > 0], size[size > 0], np.where(scale > 0, scale, 1.0)
        if not len(effects):
            return cls(effects, rest, size, np.zeros((0, 0)), np.zeros((0, len(rest))))
        unit, base = jacobian[:, effects] / size, jacobian[:, rest] / scale
        share, *_ = np.linalg.lstsq(base, unit, rcond=1e-12)
        _, sizes, right = np.linalg.svd(unit - base @ share, full_matrices=False)
        ways = right[sizes < SAME * max(1.0, sizes[0])]
        return cls(effects, rest, size, ways, -(ways @ share.T) / scale)


def confounded(fitted: Fit) -> dict[int, tuple[str, ...]]:
    """What effects and the rest of the model show only together: number (from 0) of a parameter or ratio -> partners.

    What the data say of either is what a prior says, so neither is identified.
    """
    lost = Lost.of(fitted)
    names = list(fitted.model.names)
    names += [ratio_name(_above(fitted.gains, edge) + 1, edge + 1) for edge in fitted.gains.edges]
    error = np.sqrt(np.diag(fitted.inverse))
    out: dict[int, tuple[str, ...]] = {}
    for way, taken in zip(lost.ways, lost.taken, strict=True):
        # As far as what is plausible of the effect lets it.
        reach = 1.0 / np.max(np.abs(way / lost.size) / fitted.limit[lost.effects])
        effects = [int(n) for n, part in zip(lost.effects, np.abs(way), strict=True) if part > PART_OF]
        moved = np.abs(taken) * reach > MOVED * error[lost.rest]
        rest = [int(n) for n, is_moved in zip(lost.rest, moved, strict=True) if is_moved]
        for group, partners in ((effects, rest or effects), (rest, effects)):
            out |= {n: tuple(dict.fromkeys((*out.get(n, ()), *(names[k] for k in partners if k != n)))) for n in group}
    return out


def shape_of(model: Model, column: Column) -> float:
    """Where a shape stands in the model: its column holds what the fit moves it by. 0 for other columns."""
    if column.shape is None or column.place is None:
        return 0.0
    return model.effects[column.place].shape[column.shape]


def ratio_name(inner: int, outer: int) -> str:
    """Name of the ratio of the gains of two joints (from 1)."""
    return f"gain_ratio.{inner}.{outer}"


def _above(gains: Gains, row: int) -> int:
    """The row that `row` hangs from."""
    upper = gains.parent[row]
    return row if upper is None else upper


def _gradient(gains: Gains, row: int, other: int) -> tuple[float, Floats]:
    """eta_row / eta_other and its derivative by every edge."""
    value = gains.ratio(row, other)
    out = np.zeros(len(gains.edges))
    if not np.isfinite(value):
        return value, out
    down, up = gains.path(other), gains.path(row)
    for number, edge in enumerate(gains.edges):
        if (edge in down) != (edge in up):
            along = edge in down
            size = gains.edge[edge]
            product = np.prod([gains.edge[step] for step in down if step in gains.edges and step not in (*up, edge)])
            out[number] = product / _outer(gains, up, down) if along else -value / size
    return value, out


def _outer(gains: Gains, up: list[int], down: list[int]) -> float:
    """Product of the edges from `row` to the common ancestor."""
    return float(np.prod([gains.edge[step] for step in up if step in gains.edges and step not in down]))


def _freedoms(fitted: Fit, solution: JointSolution, errors: Clustered) -> Floats:
    """(p + edges,) degrees of freedom; the working model's own where clusters are too few."""
    out = errors.freedoms.copy()
    poor = out < FEWEST_FREEDOMS
    gains, start = solution.gains, 0
    first = fitted.first
    is_first = first is not None and solution is first.solution
    variances, rows = (first.levels, first.rows) if first is not None and is_first else (fitted.levels, fitted.rows)
    joints = np.array([*fitted.system.owners, *(_above(gains, edge) for edge in gains.edges)])
    for row in rows:
        stop = start + row.target.size
        chosen = np.flatnonzero(poor & (joints == row.joint - 1))
        if len(chosen):
            levels = variances[row.joint]
            estimated: Floats | float = float(levels.freedoms)
            if row.joint not in fitted.weak:
                J = solution.jacobian[start:stop].reshape(*row.target.shape, -1)
                inverse, ones = solution.linear.inverse, row.quiet_ones(levels)
                estimated = freedoms(levels, ones=ones, jacobian=J, inverse=inverse)[chosen]
            out[chosen] = np.clip(estimated, 1.0, float(levels.freedoms))
        start = stop
    return out


def _error_of(ends: tuple[float, float], freedoms: float) -> float:
    """The standard error that an interval so wide would have."""
    low, high = interval(0.0, 1.0, freedoms)
    return float((ends[1] - ends[0]) / (high - low))


def _known(
    bare: Value, value: float, variance: float, freedoms: float, *, ends: tuple[float, float] | None = None
) -> Value:
    error = float(np.sqrt(max(variance, 0.0))) if ends is None else _error_of(ends, freedoms)
    low, high = ends or interval(float(value), error, freedoms)
    return Value(
        bare.name, bare.symbol, bare.joint, bare.unit, float(value), error, (low, high), float(freedoms), IDENTIFIED
    )


def _unknown(bare: Value, why: Reason) -> Value:
    return Value(
        bare.name, bare.symbol, bare.joint, bare.unit, state=NOT_IDENTIFIABLE, reason=why.text, next_run=why.next_run
    )


#: Postures of a joint whose load is told: one is the usual case, more than three nobody reads.
MOST_POSTURES = 3

#: A sum is determined when what it may be off by, beyond its standard error, is below this share of the joint's RMS
#: current. Held positions creep by a few mrad between runs, so the share is small but never zero.
LEANING = 0.02

#: A sum is worth telling when one of its terms has an error this many times its own.
WORTH = 30.0

#: Terms below this share of the largest are rounding.
SHARE = 1e-9


def determined(sheet: Sheet, values: Sequence[Value]) -> tuple[Combination, ...]:
    """Sums of parameters that the data determine although a term of theirs, of `values`, is not or far less well."""
    errors = {value.name: math.inf if value.std_error is None else value.std_error for value in values}
    sums: list[Combination] = []
    for row in sorted(sheet.fitted.rows, key=lambda row: row.joint):
        candidates = [*_friction(sheet, row), *_loads(sheet, row)]
        sums += [
            sum_
            for sum_ in (_sum(sheet, row, *item) for item in candidates if _matters(sheet, row, item[0]))
            if any(abs(weight) * errors[name] > WORTH * sum_.std_error for name, weight in sum_.terms.items())
        ]
    sums += _of_effects(sheet)
    return tuple(sum_ for sum_ in sums if math.isfinite(sum_.value))


def _of_effects(sheet: Sheet) -> Iterable[Combination]:
    """Of each effect that the data tell only in part from the rest of the model: the parts that they do tell."""
    if not sheet.confounded:
        return
    lost, model = Lost.of(sheet.fitted), sheet.fitted.model
    for place, term in enumerate(model.effects):
        members = np.array([model.columns[n].place == place for n in lost.effects], dtype=bool)
        if not np.any(lost.ways[:, members]) or not members.any():
            continue
        _, sizes, right = np.linalg.svd(lost.ways[:, members])
        for weights in right[np.count_nonzero(sizes > SHARE * sizes[0]) :]:
            whole = np.zeros(len(sheet.covariance))
            whole[lost.effects[members]] = weights * lost.size[members]
            whole /= np.abs(whole).sum() * np.sign(whole[np.argmax(np.abs(whole))])
            where = f" of joint {term.number}" if term.number else ""
            row = next(row for row in sheet.fitted.rows if term.touches(row.joint))
            text = f"{term.effect.name}{where}: what does not pass for the rest of the model"
            yield _sum(sheet, row, whole, text, unit=model.columns[int(lost.effects[members][0])].unit)


def _matters(sheet: Sheet, row: Row, weights: Floats) -> bool:
    """Whether parameters of plausible size would make this sum more than `LEANING` of the joint's current."""
    reach = float(np.linalg.norm(weights[: len(sheet.numbers)] * sheet.fitted.limit))
    return reach > LEANING * math.sqrt(row.bins.mean_square)


def _sum(sheet: Sheet, row: Row, weights: Floats, text: str, *, unit: str = "A") -> Combination:
    """The sum with its standard error; NaN where it leans on a direction that the data do not determine."""
    names = sheet.fitted.model.names
    bare = weights[: len(names)]
    large = np.abs(bare) > SHARE * np.max(np.abs(bare), initial=0.0)
    terms = {name: float(weight) for name, weight, is_large in zip(names, bare, large, strict=True) if is_large}
    off = float(np.linalg.norm(weights @ sheet.reach()))
    variance = float(weights @ sheet.covariance @ weights) + off**2
    leaning = [
        n for n in np.flatnonzero(large) if n in sheet.confounded and sheet.fitted.model.columns[n].place is None
    ]
    off = math.sqrt(max(variance, 0.0)) if leaning else off
    value = float(bare @ sheet.numbers) if off < LEANING * math.sqrt(row.bins.mean_square) else math.nan
    return Combination(terms, value, math.sqrt(max(variance, 0.0)), unit, text)


def _friction(sheet: Sheet, row: Row) -> Iterable[tuple[Floats, str]]:
    """Coulomb plus viscous at the one speed that was run, each way."""
    names = sheet.fitted.model.names
    facts = Facts.of(row.joint, sheet.runs)
    for sign, side, way in ((1, "plus", "forward"), (-1, "minus", "backward")):
        if facts.has_one_speed(sign):
            speed = sign * float(np.mean(facts.speeds[sign]))
            weights = np.zeros(len(sheet.covariance))
            weights[names.index(f"coulomb.j{row.joint}.{side}")] = 1.0
            weights[names.index(f"viscous.j{row.joint}.{side}")] = speed
            yield weights, f"friction of joint {row.joint} {way}, at the one speed that was run"


def _loads(sheet: Sheet, row: Row) -> Iterable[tuple[Floats, str]]:
    """The whole gravity load of a revolute joint at positions 0 and a quarter turn, in each posture that was run."""
    model = sheet.fitted.model
    if not model.robot.joint(row.joint).is_revolute:
        return
    gravity = np.array([column.effect == "gravity" for column in model.columns])
    held = np.nan_to_num(np.array([run.posture for run in row.bins.runs]))
    postures = row.bins.postures[:MOST_POSTURES]
    for number, group in enumerate(postures, start=1):
        position = np.tile(held[group[0]], (2, 1))
        position[:, row.joint - 1] = [0.0, math.pi / 2.0]
        samples = Samples(row.joint, position, np.zeros_like(position), np.zeros(2), np.ones(2))
        which = f" (posture {number})" if len(postures) > 1 else ""
        joints = np.full(2, row.joint - 1)
        load = Bilinear(joints, model.base(samples) * gravity, np.zeros(2), sheet.fitted.system.owners)
        weights = load.jacobian(sheet.gains, sheet.numbers)
        yield weights[0], f"weight felt by joint {row.joint} at position 0{which}"
        yield weights[1], f"weight felt by joint {row.joint} a quarter turn on{which}"
