"""From a fit to its parameters: value, error and interval, or why the data do not determine one and what run would."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pumaid.dataset import BLOCK, CONSTANT, STROKE, Run
from pumaid.effect_spec import Column
from pumaid.effects import Family, Samples, Scope, load_refusal
from pumaid.errors import listed
from pumaid.estimate import IDENTIFIED, NOT_IDENTIFIABLE, Combination, Value
from pumaid.estimation.covariance import covariance_of, interval, two_sided
from pumaid.estimation.fit import Fit, Row
from pumaid.estimation.gls import rise
from pumaid.joint_bins import SAME_POSTURE
from pumaid.maths import LARGEST_RATIO, RATIO_KNOWN, Bilinear, Counts, Floats
from pumaid.model import KNOWN_LOAD, Model
from pumaid.robot import posture_groups
from pumaid.units import number

#: A ratio of gains counts as identified when its standard error is below `RATIO_KNOWN` (gains of neighbours are of
#: comparable size, so such an interval tells something whatever the value), or when zero is outside its 99.9 %
#: interval. Either way the load that carries it must itself be non-zero at that level: else the interval is none of a
#: ratio (Fieller). Where it is known to less than `ROUGHLY` of itself, the least square must also rise, `FAR` standard
#: errors to either side, to at least `RISE` of what a parabola would.
RATIO_LEVEL, ROUGHLY, FAR, RISE = 0.001, 0.05, 3.3, 0.5
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
#: Speeds within this share of each other are one speed, to someone who would tell Coulomb from viscous friction.
ONE_SPEED = 0.02
#: A load of this many standard errors is felt, whatever else keeps its ratio from being known.
SURELY_FELT = 5.0
#: Share of its full lever below which a weight is as good as not felt: an axis within two degrees of upright.
LEAST_LEVER = 0.035

#: Names that a reason lists at most.
NAMED = 3

MOVE_ALONE = "move the joint alone, at several speeds, both ways"
ACCELERATE = "record motion in which several joints accelerate at once"
LEVEL = "repeat the runs of joint {inner}, its axis level, with joint {outer} held at two or more positions"
WITH_TOOL = "record more, and more varied, motion, with a tool or payload of 1 to 2 kg"
TRAVEL = "let the joint travel further, in both directions"
#: Kind -> why a parameter is not determined, and the run that would show it (None where no run would).
REASONS: dict[str, tuple[str, str | None]] = {
    "no runs": ("waits for logs in which its joint moves alone", MOVE_ALONE),
    "no runs of one joint": ("waits for logs in which joint {joint} moves alone", MOVE_ALONE),
    "together": ("only determined together with {names}", "repeat its runs in other postures and at other speeds"),
    "not accelerated": ("no motion in these logs shows it", ACCELERATE),
    "inertia in sums": ("these logs show it only in sums with inertias of other links", ACCELERATE),
    "one direction": ("the joint never moves {way} in these logs", "repeat its {other} runs {way}"),
    "one speed": (
        "every {way} run has {speeds} {unit}, so Coulomb and viscous friction cannot be told apart, only their sum at"
        " that speed",
        "repeat a {way} run at {slower} {unit}",
    ),
    "friction and weight": (
        "over the span and directions in which the joint travels, its friction cannot be told from its weight",
        TRAVEL,
    ),
    "one load": (
        "in these logs the joint's axis keeps one angle to gravity, so its constant load cannot be told from Coulomb"
        " friction",
        "repeat its runs with the joints before it turned so that its axis stands at another angle to gravity",
    ),
    "upright": (
        "the joint's axis stood upright in all its runs, so it felt next to nothing of this weight",
        "repeat its runs with the joints before it turned so that its axis lies level",
    ),
    "one posture": (
        "the joints outward of it were held in one posture only, so its weight cannot be told from that of the links"
        " outward ({names})",
        "repeat its runs with the joints outward of it held elsewhere",
    ),
    "several joints": (
        "it acts on several joints, and the recursion solves one after the other; identify without --recursive",
        None,
    ),
    "confounded": ("these data could not tell it from {names}", None),
    "at bound": ("best at its bound, {bound}", None),
    "any value": ("these data fit nearly as well with any value of it that is physical", None),
    "no effect": ("nothing in these runs depends on it", None),
    "unloaded": ("{why}, and inertia loads it in no run", "move all joints at once, as at work"),
    "no size": ("no size of {effect} shows in these data", None),
    "load alike": (
        "the known loads were alike in all runs of the joints that feel them, so they pass for a part of the last link",
        "repeat runs of a joint that lifts the load without it, or with another one",
    ),
    "ratio, one posture": (
        "the joints outward of joint {inner} were held in one posture only, so its own weight cannot be told from the"
        " weight outward of it",
        LEVEL,
    ),
    "ratio, light link": (
        "link {outer} is too light to be felt by joint {inner}: its weight moves that current by about {felt} A, known"
        " to {noise} A",
        "repeat the runs of joint {inner} with a payload and joint {outer} held at two positions",
    ),
    "ratio, light link in motion": (
        "link {outer} is too light to be felt by joint {inner}: what it asks of that current is about {felt} A, known"
        " to {noise} A",
        WITH_TOOL,
    ),
    "ratio in motion": (
        "in this motion joint {inner}'s own load cannot be told from the load outward of it",
        WITH_TOOL,
    ),
    "ratio": (
        "in no posture of these logs can joint {inner}'s own weight be told from the weight outward of it",
        LEVEL,
    ),
}

#: Family of an effect -> the run that would show it better.
MORE = {
    Family.SPEED: "run the joint at more speeds, slow and fast ones",
    Family.LOAD: "run the joint in postures in which it carries much and little",
    Family.POSITION: TRAVEL,
    Family.TORQUE: TRAVEL,
    Family.START: "run the joint from rest, at several speeds",
    Family.PAYLOAD: "spread repeated runs over a longer time",
    Family.TIME: "spread repeated runs over a longer time",
    Family.TEMPERATURE: "repeat runs with the motor cold and warm",
    Family.GRAVITY: "repeat the runs with the other joints elsewhere",
    Family.CURRENT: "run the joint in postures in which it draws more",
    Family.MOTION: "run the joint with harder acceleration, and slowly",
}


#: The fields `state`, `reason` and `next_run` of a `Value` that is not determined.
Reason = dict[str, Any]


def reason(kind: str, **values: object) -> Reason:
    """An entry of `REASONS` with its values; `more`, where given, is the next run."""
    text, next_run = REASONS[kind]
    next_run = str(values["more"]) if "more" in values else next_run and next_run.format(**values)
    return {"state": NOT_IDENTIFIABLE, "reason": text.format(**values), "next_run": next_run}


#: Joint (from 1) -> the runs in which it moves.
Coverage = Mapping[int, Sequence[Run]]


def speeds_of(runs: Sequence[Run], sign: int) -> list[float]:
    """Speeds in direction `sign` of the runs of one joint, rising; in a block the highest counts."""
    of_blocks = [float(np.max(sign * run.bins.velocity)) for run in runs if run.kind == BLOCK]
    of_runs = [abs(run.speed) for run in runs if run.kind != BLOCK and run.direction == sign]
    return sorted(speed for speed in (*of_blocks, *of_runs) if speed > 0.0)


def has_one_speed(runs: Sequence[Run], sign: int) -> bool:
    """Whether all runs of a joint in direction `sign` have practically one speed."""
    speeds, is_constant = speeds_of(runs, sign), all(run.kind == CONSTANT for run in runs)
    return bool(speeds) and is_constant and speeds[-1] - speeds[0] <= ONE_SPEED * speeds[-1]


def outer_postures(runs: Sequence[Run]) -> int:
    """Sets of positions of the joints outward of the one that moves in these runs; in a block they move, too."""
    held = np.array([run.posture[run.joint :] for run in runs])
    return max(len(posture_groups(held, SAME_POSTURE)), 2 * any(run.kind == BLOCK for run in runs))


def of_column(
    model: Model, column: Column, *, coverage: Coverage, partners: Sequence[str], lever: float = 1.0
) -> Reason:
    """Why `column` is not determined.

    `partners` are the other parameters with which it is only determined together, `lever` the RMS of the column over
    its joint's own runs, as a share of what it is when the axis lies level.
    """
    if column.scope in (Scope.JOINT, Scope.LINK) and not coverage[column.owner]:
        return reason("no runs")
    if column.place is not None:
        term = model.effects[column.place]
        more = MORE.get(term.effect.family, TRAVEL)
        if column.shape in term.held:
            return reason("at bound", bound=number(term.shape[column.shape]), more=more)
        if not partners and (why := term.effect.applies(model.robot, column.owner)) is not None:
            return reason("unloaded", why=why)
        if column.shape is not None or not partners:
            return reason("no effect" if column.shape is None else "any value", more=more)
        rest = [name for name in partners if name.split(".")[0] != column.effect]
        return reason("confounded", names=listed(rest or partners, NAMED), more=more)
    if column.effect in ("coulomb", "viscous"):
        return _of_friction(model, column, coverage[column.owner], partners)
    if column.effect != "gravity":
        kind = "together" if 0 < len(partners) <= NAMED else "inertia in sums" if partners else "not accelerated"
        return reason(kind, names=listed(partners, NAMED))
    of_friction = any(name.startswith(("coulomb", "viscous")) for name in partners)
    if not model.robot.joint(column.owner).is_revolute and of_friction:
        return reason("one load")
    outer = sorted(name for name in partners if name.startswith(("gravity", "gain_ratio")))
    beyond = [name for name in outer if int(name.split(".")[1].lstrip("l")) > column.owner]
    if lever < LEAST_LEVER or not partners:
        return reason("inertia in sums" if load_refusal(model.robot, column.owner) else "upright")
    if beyond and outer_postures(coverage[column.owner]) < 2:
        return reason("one posture", names=listed(beyond, NAMED))
    return (
        reason("together", names=listed(outer, NAMED)) if outer and not of_friction else reason("friction and weight")
    )


def _of_friction(model: Model, column: Column, runs: Sequence[Run], partners: Sequence[str]) -> Reason:
    side = column.name.rsplit(".", 1)[1]
    sign, way, other = (1, "forward", "backward") if side == "plus" else (-1, "backward", "forward")
    covered = speeds_of(runs, sign)
    if not covered:
        return reason("one direction", way=way, other=other)
    joint, low, high = model.robot.joint(column.owner), covered[0], covered[-1]
    pair = {f"{effect}.j{column.owner}.{side}" for effect in ("coulomb", "viscous")}
    if pair - {column.name} <= set(partners):
        speeds = (
            f"practically one speed, {number(high, 2)}"
            if has_one_speed(runs, sign)
            else f"a speed between {number(low, 2)} and {number(high, 2)}"
        )
        unit, slower = f"{joint.position_unit}/s", number(high / 3.0, 2)
        return reason("one speed", way=way, speeds=speeds, slower=slower, unit=unit)
    return reason("friction and weight" if joint.is_revolute else "one load")


def of_ratio(
    model: Model,
    inner: int,
    outer: int,
    *,
    coverage: Coverage,
    load: tuple[float, float] = (0.0, 0.0),
) -> Reason:
    """Why eta_inner / eta_outer (joints from 1) is not determined.

    `load` is the RMS (A) of the part of joint `inner`'s current that carries the ratio, and that part's standard error
    (A).
    """
    redundant = model.structure.redundant.get((inner, outer))
    if redundant is not None:
        return {"state": NOT_IDENTIFIABLE, "reason": redundant, "next_run": None}
    for joint in (inner, outer):
        if not coverage[joint]:
            return reason("no runs of one joint", joint=joint)
    (felt, noise), kind = load, "ratio"
    if outer_postures(coverage[inner]) < 2:
        kind = "ratio" if model.is_dynamic else "ratio, one posture"
    elif 1e-7 < felt < SURELY_FELT * noise:  # A; below there is only rounding
        kind = "ratio, light link"
    kind = f"{kind} in motion" if model.is_dynamic else kind
    return reason(kind, inner=inner, outer=outer, felt=number(felt, 2), noise=number(noise, 2))


class FittedParameters:
    """The parameters of a fit over all joints, or of the recursion `Fit.first`, and what is known of them.

    `covariance` (P, P) is of parameters and ratios, `freedoms` (P,) are behind each variance; `coverage` has the
    fitted runs of each joint. `confounded` names what the data show only together with a parameter or ratio (from
    0); `sums` (h, m) of the `effects` (m,), linear parameters of effects (from 0), the rest of the model could take
    over whole. `profiles` has profile-likelihood intervals by column.
    """

    def __init__(self, fitted: Fit, coverage: Coverage) -> None:
        self.fitted, self.coverage, self.profiles = fitted, coverage, dict[int, tuple[float, float]]()
        self.covariance, self.freedoms = covariance_of(fitted)
        self.confounded, self.effects, self.sums = confounded(fitted)

    def reach(self) -> Floats:
        """(P, b) undetermined directions of parameters and ratios, as long as is plausible (see `Estimate.blind`)."""
        blind = self.fitted.solution.linear.blind
        size = np.pad(self.fitted.limit, (0, len(blind) - len(self.fitted.limit)), constant_values=LARGEST_RATIO)
        return np.asarray(size[:, None] * blind)

    def values(self) -> tuple[Value, ...]:
        """Every parameter, every ratio of neighbours, and where such is open the next one outward that is known."""
        model = self.fitted.model
        # A curve has rows of its own.
        apart = {KNOWN_LOAD, *(term.effect.name for term in model.effects if term.effect.is_free)}
        columns = [(index, column) for index, column in enumerate(model.columns) if column.effect not in apart]
        out = [self._parameter(index, column) for index, column in columns]
        for name, why in model.structure.absent.items():
            link, part = int(name.split(".")[1][1:]), name.rsplit(".", 1)[1]
            symbol = f"m{link}" if part == "mass" else f"k{link}{part}"
            out.append(Value(name, symbol, link, "A s2/m", state=NOT_IDENTIFIABLE, reason=why))
        n, further = model.robot.n_joints, list[Value]()
        for inner in range(1, n):
            ratios = (self._ratio(inner, outer) for outer in range(inner + 1, n + 1))
            out.append(next(ratios))
            if out[-1].state != IDENTIFIED:
                further += [ratio for ratio in ratios if ratio.state == IDENTIFIED][:1]
        return (*out, *further, *(self._torque_constants() if model.scaled else ()))

    def _torque_constants(self) -> Iterator[Value]:
        """N m/A, or N/A, of each joint: one over what known loads ask of the gain of one joint, and ratios to it."""
        fitted, model = self.fitted, self.fitted.model
        index = next(n for n, column in enumerate(model.columns) if column.effect == KNOWN_LOAD)
        owner, gain = model.columns[index].owner, float(fitted.values[index])
        error, dof = math.sqrt(self.covariance[index, index]), self.freedoms[index]
        is_known = self._partners(index) is None and two_sided(gain / max(error, 1e-300), dof) < RATIO_LEVEL
        for joint in model.robot.joints:
            inner, outer = sorted((joint.number, owner))
            unit = "N m/A" if joint.is_revolute else "N/A"
            bare = Value(f"torque_constant.j{joint.number}", f"K{joint.number}", joint.number, unit)
            ratio = Value("", "", None, "", value=1.0) if inner == outer else self._ratio(inner, outer)
            if not is_known or not self.coverage[joint.number] or ratio.value is None:
                why = reason("load alike" if self.coverage[joint.number] else "no runs")
                if is_known and ratio.reason:
                    why |= {"reason": ratio.reason, "next_run": ratio.next_run}
                if index in self.confounded:
                    why = reason("confounded", names=listed(self.confounded[index], NAMED))
                yield replace(bare, **why)
                continue
            sign = 1.0 if joint.number <= owner else -1.0  # the gain is that of the owner times the ratio, or over it
            slope = np.append(np.zeros(len(fitted.values)), sign * self._slope(inner, outer))
            slope[index] = 1.0 / gain
            value = 1.0 / (gain * ratio.value**sign)
            off = float(np.sum((slope @ self.reach()) ** 2))
            variance = value**2 * (float(slope @ self.covariance @ slope) + off)
            yield _identified(bare, value, variance, min(float(self.freedoms[n]) for n in np.flatnonzero(slope)))

    def _slope(self, inner: int, outer: int) -> Floats:
        """(E,) derivative of the logarithm of eta_inner / eta_outer (joints from 1) by the ratio of each edge."""
        gains = self.fitted.gains
        down, up = gains.path(outer - 1), gains.path(inner - 1)
        powers = np.array([(edge in down) - (edge in up) for edge in gains.edges], dtype=float)
        return np.divide(powers, gains.ratios, out=np.zeros(len(powers)), where=gains.ratios != 0.0)

    def _parameter(self, index: int, column: Column) -> Value:
        model, partners = self.fitted.model, self._partners(index)
        bare = Value(column.name, column.symbol, column.owner or None, column.unit)
        is_idle = column.scope in (Scope.JOINT, Scope.LINK) and not self.coverage[column.owner]
        if column.place is None and index in self.confounded and not is_idle:
            return replace(bare, **reason("confounded", names=listed(self.confounded[index], NAMED)))
        is_open = is_idle or partners is not None
        if column.place is not None:
            # Known hardly better than before any data, or a shape best at a bound.
            profile, alone = self.profiles.get(index), float(np.sqrt(self.fitted.inverse[index, index]))
            error = alone if profile is None else _error_of(profile, self.freedoms[index])
            is_open |= column.shape in model.effects[column.place].held or error > OPEN * self.fitted.limit[index]
        if is_open:
            row = next((row for row in self.fitted.rows if row.joint == column.owner), None)
            lever = 1.0  # RMS of a gravity column over its joint's own runs, as a share of g
            if row is not None and column.effect == "gravity":
                square = float(np.average(row.design[:, index] ** 2, weights=row.bins.count))
                lever = math.sqrt(square) / float(np.linalg.norm(model.robot.gravity))
            return replace(
                bare, **of_column(model, column, coverage=self.coverage, partners=partners or [], lever=lever)
            )
        if self.fitted.first is None and self.fitted.system.owners[index] < 0:
            return replace(bare, **reason("several joints"))
        variance = float(self.covariance[index, index] + np.sum(self.reach()[index] ** 2))
        # A shape's column holds what the fit moves the shape by.
        start = 0.0 if column.shape is None else model.effects[column.place or 0].shape[column.shape]
        ends = self.profiles.get(index)
        return _identified(bare, self.fitted.values[index] + start, variance, self.freedoms[index], ends=ends)

    def _partners(self, index: int) -> list[str] | None:
        if index in self.confounded:
            return list(self.confounded[index])
        blind, lost = self.fitted.solution.linear.blind, self.fitted.absorbed.get(index)
        # The projector on the undetermined directions does not depend on how they are chosen within their span.
        share = np.abs(blind @ blind[index])
        if share[index] <= PART_OF**2 and lost is None:
            return None
        # Ratios are measured by another limit, and must not outshine the parameters.
        p = len(self.fitted.values)
        least = PART_OF * np.where(np.arange(len(share)) < p, share[:p].max(), share.max())
        together = [name for n, name in enumerate(_names(self.fitted)) if share[n] > least[n] and n != index]
        return [*together, *(f"gain_ratio.{inner}.{outer}" for inner, outer in lost or [])]

    def _ratio(self, inner: int, outer: int) -> Value:
        p, gains, load = len(self.fitted.values), self.fitted.gains, (0.0, 0.0)
        bare = Value(f"gain_ratio.{inner}.{outer}", f"eta{inner}/eta{outer}", inner, "")
        value = gains.ratio(inner - 1, outer - 1)
        gradient = np.nan_to_num(value * self._slope(inner, outer))
        edges = [int(edge) for edge in np.flatnonzero(gradient)]
        if self.coverage[inner] and self.coverage[outer] and np.isfinite(value):
            together = [name for edge in edges for name in self.confounded.get(p + edge, ())]
            if together:
                return replace(bare, **reason("confounded", names=listed(together, NAMED)))
            # The row that gave an edge may have taken a load for known that the recursion had left open.
            beside = [k for edge in edges for k, upper in enumerate(gains.uppers) if upper == gains.uppers[edge]]
            is_guess = any(not set(self.fitted.absorbed).isdisjoint(self._behind(k).tolist()) for k in beside)
            if not is_guess and all(self._partners(p + edge) is None for edge in edges):
                off = float(np.sum((gradient @ self.reach()[p:]) ** 2))
                variance = float(gradient @ self.covariance[p:, p:] @ gradient) + off
                dof = min((float(self.freedoms[p + edge]) for edge in edges), default=np.inf)
                error = float(np.sqrt(max(variance, 0.0)))
                is_certain = error < RATIO_KNOWN or two_sided(value / error, dof) < RATIO_LEVEL
                if is_certain and all(self._is_loaded(edge) and self._is_bounded(edge) for edge in edges):
                    return _identified(bare, value, variance, dof)
                load = min(map(self._load, edges), key=lambda pair: pair[0] / max(pair[1], 1e-300), default=load)
        return replace(bare, **of_ratio(self.fitted.model, inner, outer, coverage=self.coverage, load=load))

    def _behind(self, edge: int) -> Counts:
        gains = self.fitted.gains
        return np.flatnonzero(
            self.fitted.model.is_load & np.isin(self.fitted.system.owners, gains.subtree(gains.edges[edge]))
        )

    def _is_loaded(self, edge: int) -> bool:
        loads, values = self._behind(edge), self.fitted.values
        errors = np.sqrt(np.diag(self.covariance))
        chances = (two_sided(values[n] / errors[n], self.freedoms[n]) for n in loads if errors[n] > 0.0)
        return min(chances, default=1.0) < RATIO_LEVEL

    def _is_bounded(self, edge: int) -> bool:
        """Whether the likelihood bounds the ratio on edge number `edge` as its standard error says.

        A load that its own joint hardly tells is fitted by what the inner joint draws, whatever the ratio: the interval
        of a linearised fit is then too narrow.

        Source: G. A. F. Seber and C. J. Wild, Nonlinear Regression, ch. 5.8, profile likelihood.
        """
        fitted, place = self.fitted, len(self.fitted.values) + edge
        ratio, error = fitted.gains.ratios[edge], math.sqrt(max(float(fitted.inverse[place, place]), 0.0))
        if fitted.first is None or error < ROUGHLY * abs(ratio):
            return True
        return all(rise(fitted, edge, ratio + side * error) >= RISE * side**2 for side in (-FAR, FAR))

    def _load(self, edge: int) -> tuple[float, float]:
        """RMS (A) of what comes through an edge in its upper joint's current, and that part's standard error."""
        gains, place = self.fitted.gains, len(self.fitted.values) + edge
        row = self.fitted.by_bin[gains.uppers[edge] + 1]
        slope = math.sqrt(float(np.average(row.bare[:, place] ** 2, weights=row.bins.count)))
        return abs(gains.ratios[edge]) * slope, float(np.sqrt(self.covariance[place, place])) * slope

    def combinations(self, values: Sequence[Value]) -> tuple[Combination, ...]:
        """Sums of parameters that the data determine although a term of theirs, of `values`, is less well known."""
        errors = {value.name: math.inf if value.std_error is None else value.std_error for value in values}
        model, sums = self.fitted.model, list[Combination]()
        for row in sorted(self.fitted.rows, key=lambda row: row.joint):
            rms, runs = math.sqrt(row.bins.mean_square), self.coverage[row.joint]
            sums_at_joint = list(self._felt(row))
            for sign, side, way in ((1, "plus", "forward"), (-1, "minus", "backward")):
                if has_one_speed(runs, sign):
                    weights = np.zeros(len(self.covariance))
                    weights[model.names.index(f"coulomb.j{row.joint}.{side}")] = 1.0
                    weights[model.names.index(f"viscous.j{row.joint}.{side}")] = sign * np.mean(speeds_of(runs, sign))
                    text = f"friction of joint {row.joint} {way}, at the one speed that was run"
                    sums_at_joint.append((weights, text, "A", 1.0))
            for weights, text, unit, size in sums_at_joint:
                # Parameters of plausible size would make this sum a part of the joint's current.
                reach = size * float(np.linalg.norm(weights[: len(model.columns)] * self.fitted.limit))
                total = self._sum(row, weights, text, unit=unit, size=size)
                far = (abs(weight) * errors[name] > WORTH * total.std_error for name, weight in total.terms.items())
                sums += [total] if reach > LEANING * rms and any(far) else []
        # Of each effect that the rest of the model takes over in part: the parts that it does not.
        for place, term in enumerate(model.effects):
            members = np.array([model.columns[n].place == place for n in self.effects], dtype=bool)
            if not np.any(self.sums[:, members]):
                continue
            numbers = self.effects[members]
            size = np.linalg.norm(self.fitted.solution.jacobian[:, numbers], axis=0)
            _, sizes, right = np.linalg.svd(self.sums[:, members] * size)
            row = next(row for row in self.fitted.rows if term.touches(row.joint))
            where = f" of joint {term.number}" if term.number else ""
            text = f"{term.effect.name}{where}: what does not pass for the rest of the model"
            for weights in right[np.count_nonzero(sizes > SAME) :]:
                whole = np.zeros(len(self.covariance))
                whole[numbers] = weights * size
                whole /= np.abs(whole).sum() * np.sign(whole[np.argmax(np.abs(whole))])
                sums.append(self._sum(row, whole, text, unit=model.columns[numbers[0]].unit))
        return tuple(total for total in sums if math.isfinite(total.value))

    def _sum(self, row: Row, weights: Floats, text: str, *, unit: str = "A", size: float = 1.0) -> Combination:
        """The sum with its standard error; NaN where it rests on a direction that the data do not determine.

        `size` is what it is multiplied by in the joint's current.
        """
        columns = self.fitted.model.columns
        bare = weights[: len(columns)]
        is_term = np.abs(bare) > 1e-9 * np.abs(bare).max(initial=0.0)  # else rounding
        terms = {int(n): float(bare[n]) for n in np.flatnonzero(is_term)}
        off = float(np.linalg.norm(weights @ self.reach()))
        error = math.sqrt(max(float(weights @ self.covariance @ weights) + off**2, 0.0))
        if any(n in self.confounded and columns[n].place is None for n in terms):
            off = error
        is_known = size * off < LEANING * math.sqrt(row.bins.mean_square)
        value = float(bare @ self.fitted.values) if is_known else math.nan
        return Combination({columns[n].name: weight for n, weight in terms.items()}, value, error, unit, text)

    def _felt(self, row: Row) -> Iterator[tuple[Floats, str, str, float]]:
        """Weights, text, unit and size of what a joint feels in each posture that was run: the gravity load of a
        revolute one at positions 0 and a quarter turn, and where it went from rest to rest its inertia, which acted
        with that acceleration and knows the outer joints' positions only.
        """
        fitted, joint, bins = self.fitted, row.joint, row.bins
        model = fitted.model
        held = np.array([run.posture for run in bins.runs])
        strokes = np.flatnonzero([run.kind == STROKE for run in bins.runs])

        def weights(posture: Floats, angle: float) -> Floats:
            """(2, P) A by each parameter and ratio at rest, the joint at an angle, and what a unit of acceleration
            adds."""
            position = np.tile(np.nan_to_num(posture), (2, 1))
            position[:, joint - 1] = angle
            base = model.base(Samples(joint, position, np.zeros_like(position), np.array([0.0, 1.0]), np.ones(2)))
            parts = np.zeros((2, len(model.columns)))
            parts[:, : base.shape[1]] = base[0], base[1] - base[0]
            parts[0] *= model.is_weight
            felt = Bilinear(np.full(2, joint - 1), parts, np.zeros(2), fitted.system.owners)
            return felt.jacobian(fitted.gains, fitted.values)

        for group in bins.postures[:MOST_POSTURES] if model.robot.joint(joint).is_revolute else ():
            posture = held[group[0]]
            where = _held_at(posture, "others") if len(bins.postures) > 1 else ""
            for angle, place in ((0.0, "at position 0"), (math.pi / 2.0, "a quarter turn on")):
                yield weights(posture, angle)[0], f"weight felt by joint {joint} {place}{where}", "A", 1.0
        groups = posture_groups(held[strokes][:, joint:], SAME_POSTURE) if len(strokes) else []
        for members in groups[:MOST_POSTURES]:
            posture = held[strokes[members[0]]]
            where = _held_at(posture[joint:], "outer joints") if len(groups) > 1 else ""
            size = float(np.sqrt(np.mean(bins.samples.acceleration[np.isin(bins.run, strokes)] ** 2)))
            unit = f"A s2/{model.robot.joint(joint).position_unit}"
            yield weights(posture, 0.0)[1], f"inertia felt by joint {joint}{where}", unit, size


def confounded(fitted: Fit) -> tuple[dict[int, tuple[str, ...]], Counts, Floats]:
    """Sums of effects' linear parameters that the rest of the model could take over whole, and what takes them over.

    Returns number of a parameter or ratio -> names of what the data show only together with it: what they say of
    either is what a prior says; (m,) numbers (from 0) of the effects' parameters; and (h, m) sums of these. The
    recursion, which has no priors, has none.
    """
    jacobian, columns, out = fitted.solution.jacobian, fitted.model.columns, dict[int, tuple[str, ...]]()
    names, error = _names(fitted), np.sqrt(np.diag(fitted.inverse))
    is_effect = np.zeros(jacobian.shape[1], dtype=bool)
    is_effect[: len(columns)] = [column.place is not None for column in columns]
    norms = np.linalg.norm(jacobian, axis=0)
    # What a curve could take over its prior does not let it.
    free = {place for place, term in enumerate(fitted.model.effects) if term.effect.is_free}
    acting = [n for n in np.flatnonzero(is_effect & (norms > 0)) if columns[n].place not in free]
    effects = np.array([n for n in acting if columns[n].shape is None], dtype=int)
    if not len(effects) or fitted.first is None:
        return out, effects, np.zeros((0, len(effects)))
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
    return out, effects, ways / size


def _names(fitted: Fit) -> list[str]:
    edges = zip(fitted.gains.uppers, fitted.gains.edges, strict=True)
    return [*fitted.model.names, *(f"gain_ratio.{up + 1}.{low + 1}" for up, low in edges)]


def _error_of(ends: tuple[float, float], dof: float) -> float:
    low, high = interval(0.0, 1.0, dof)
    return float((ends[1] - ends[0]) / (high - low))


def _identified(
    bare: Value, value: float, variance: float, dof: float, *, ends: tuple[float, float] | None = None
) -> Value:
    error = float(np.sqrt(max(variance, 0.0))) if ends is None else _error_of(ends, dof)
    ci95 = ends or interval(float(value), error, dof)
    return replace(bare, value=float(value), std_error=error, ci95=ci95, dof=float(dof))


def _held_at(posture: Floats, joints: str) -> str:
    places = ", ".join("-" if math.isnan(position) else f"{position:.2f}" for position in posture)
    return f", {joints} at ({places})"
