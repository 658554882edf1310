"""From a fit to the parameters' sheet: value, error and interval, or the reason why there is none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.chosen import Column
from pumaid.dataset import Run
from pumaid.effects import Scope
from pumaid.estimation import reasons
from pumaid.estimation.gauge import Gauge
from pumaid.estimation.ratios import RATIO_KNOWN
from pumaid.estimation.reasons import Facts, Reason
from pumaid.estimation.system import Fitted
from pumaid.maths.joint_fit import JointSolution
from pumaid.maths.levels import freedoms
from pumaid.maths.recursion import LARGEST_RATIO, Gains
from pumaid.maths.statistics import Clustered, completed, interval, two_sided
from pumaid.model import Model
from pumaid.records import IDENTIFIED, NOT_IDENTIFIABLE, Value

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

_SHARED = "it acts on several joints, and the recursion solves one after the other; identify without --recursive"


@dataclass(frozen=True, eq=False, slots=True)
class Sheet:
    """A fit with the covariance that belongs to it: of all joints together or of the recursion.

    `solution` holds the values shown; `absorbed` is that of `Fitted`, of the recursion only; `gauge` what added effects
    show only together with the paper's model; `profiles` by column (from 0) intervals that are not a tangent's.
    """

    fitted: Fitted
    runs: Sequence[Run]
    solution: JointSolution
    covariance: Floats
    freedoms: Floats
    absorbed: Absorbed
    gauge: Gauge | None = None
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
    def of(cls, fitted: Fitted, runs: Sequence[Run], errors: Clustered, *, gauge: Gauge | None = None) -> Sheet:
        """The fit over all joints."""
        return replace(cls._with(fitted, runs, fitted.solution, errors=errors, absorbed={}), gauge=gauge)

    @classmethod
    def of_recursion(cls, fitted: Fitted, runs: Sequence[Run], errors: Clustered) -> Sheet:
        """The recursion alone."""
        return cls._with(fitted, runs, fitted.first, errors=errors, absorbed=fitted.absorbed)

    @classmethod
    def _with(
        cls, fitted: Fitted, runs: Sequence[Run], solution: JointSolution, *, errors: Clustered, absorbed: Absorbed
    ) -> Sheet:
        """Clustered by run, by the working model where clusters are too few."""
        poor = errors.freedoms < FEWEST_FREEDOMS
        covariance = completed(solution.linear.inverse, errors.covariance, poor)
        return cls(fitted, runs, solution, covariance, _freedoms(fitted, solution, errors), absorbed)

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
            bare = Value(column.name, column.symbol, column.owner or None, column.unit)
            partners = self._partners(index)
            is_idle = column.scope in (Scope.JOINT, Scope.LINK) and facts[column.owner].runs == 0
            if is_idle or partners is not None or self._is_open(index):
                lever = self._lever(index)
                because = reasons.of_column(model, column, facts=facts, partners=partners or [], lever=lever)
                out.append(_unknown(bare, because))
            elif self.solution is self.fitted.first and self.fitted.system.owners[index] < 0:
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
        square = float(np.sum(row.regressors[:, :, index] ** 2)) / row.samples
        return float(np.sqrt(square) / np.linalg.norm(self.fitted.model.robot.gravity))

    def _partners(self, index: int) -> list[str] | None:
        """Names of what parameter `index` is only determined together with; None where it is determined."""
        if self.gauge is not None and index in self.gauge.partners:
            return self.gauge.partners[index]
        blind, lost = self.solution.linear.blind, self.absorbed.get(index)
        # The projector on the undetermined directions does not depend on how they are chosen within their span.
        share = np.abs(blind @ blind[index])
        if share[index] <= PART_OF**2 and lost is None:
            return None
        edges = [(_above(self.gains, edge) + 1, edge + 1) for edge in self.gains.edges]
        names = [*self.fitted.model.names, *(_ratio_name(*pair) for pair in edges)]
        # Ratios are measured by another limit, and must not outshine the parameters.
        p = len(self.numbers)
        least = PART_OF * np.where(np.arange(len(share)) < p, share[:p].max(), share.max())
        together = [name for n, name in enumerate(names) if share[n] > least[n] and n != index]
        return [*together, *(_ratio_name(*pair) for pair in lost or [])]

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
        model, bare = self.fitted.model, Value(_ratio_name(inner, outer), f"eta{inner}/eta{outer}", inner, "")
        value, gradient = _gradient(self.gains, inner - 1, outer - 1)
        if facts[inner].runs == 0 or facts[outer].runs == 0 or not np.isfinite(value):
            return _unknown(bare, reasons.of_ratio(model, inner, outer, facts=facts))
        p, edges = len(self.numbers), np.flatnonzero(gradient)
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
            nu = float(np.sqrt(np.sum((row.stacked @ weights) ** 2) / row.samples))
            p = len(self.numbers)
            part = (abs(self.gains.edge[lower]) * nu, float(np.sqrt(self.covariance[p + edge, p + edge])) * nu)
            if worst == (0.0, 0.0) or part[0] * worst[1] < worst[0] * part[1]:
                worst = part
        return worst


def shape_of(model: Model, column: Column) -> float:
    """Where a shape stands in the model: its column holds what the fit moves it by. 0 for other columns."""
    if column.shape is None or column.place is None:
        return 0.0
    return model.effects[column.place].choice.shape[column.shape]


def _ratio_name(inner: int, outer: int) -> str:
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


def _freedoms(fitted: Fitted, solution: JointSolution, errors: Clustered) -> Floats:
    """(p + edges,) degrees of freedom; the working model's own where clusters are too few."""
    out = errors.freedoms.copy()
    poor = out < FEWEST_FREEDOMS
    gains, start = solution.gains, 0
    variances = fitted.first_levels if solution is fitted.first else fitted.levels
    joints = np.array([*fitted.system.owners, *(_above(gains, edge) for edge in gains.edges)])
    for row in fitted.rows:
        stop = start + row.target.size
        chosen = np.flatnonzero(poor & (joints == row.joint - 1))
        if len(chosen):
            levels = variances[row.joint]
            own: Floats | float = float(levels.freedoms)
            if row.joint not in fitted.weak:
                J = solution.jacobian[start:stop].reshape(*row.target.shape, -1)
                own = freedoms(levels, ones=row.quiet_ones(levels), jacobian=J, inverse=solution.linear.inverse)[chosen]
            out[chosen] = np.clip(own, 1.0, float(levels.freedoms))
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
