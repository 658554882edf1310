"""A model held against runs: what it predicts, how far off it is, and what it cannot know."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Campaign, Dataset, Means, Run
from pumaid.errors import Note
from pumaid.estimate import Estimate
from pumaid.gravity_load import along, loads
from pumaid.joint_bins import JointBins, joined, joint_bins
from pumaid.model import Model
from pumaid.robot import Robot
from pumaid.samples import Samples

Floats = NDArray[np.float64]

#: Effects of one joint, those together that are known only together.
Groups = tuple[tuple[str, ...], ...]

#: A number or an array of them.
Part = TypeVar("Part", float, Floats)

#: Share of the largest term in an undetermined direction below which a term is not named.
PART = 0.05

#: Instants whose regressor is made at once: enough to spare calls, some ten megabytes.
AT_ONCE = 20_000

#: A (A) below which a contribution is rounding.
NOTHING = 1e-9

#: A part's share is told where the data leave it open by no more than this share of the joint's RMS current (and by no
#: more than the joint's RMSE): beyond, the share would be off by more than five points.
OPEN = 0.05

#: Share of the RMS current below which what the data leave open is rounding.
CLOSED = 1e-6

#: Outside runs a joint's motor counts as turning above this share of its largest speed in the stretch: below it the
#: direction of friction is not known.
MOVING = 0.05

#: Name of the share of the current that no effect of the model explains.
UNEXPLAINED = "unexplained"

#: Between the names of effects whose sum the fitted data determine although not each of them: ``coulomb+viscous``.
TOGETHER = "+"


@dataclass(frozen=True, slots=True)
class BudgetPart:
    """One part of what a model leaves at a joint.

    Attributes
    ----------
    name
        ``noise_shared`` (noise that a run has as a whole), ``noise_inside`` (noise inside runs), ``smooth`` (within a
        run, a few waves over its travel), ``fast`` (within a run, a ripple), ``start`` (where a run begins), ``odd``
        (between runs, turns round with the direction), ``even`` (between runs, the same both ways), ``time`` (with time
        or temperature), ``unassigned`` (repeats, and is none of these).
    mean_square
        A2: what a model with that physics would take away; never negative.
    p_value
        Chance of as much in data where nothing is missing, all parts of the joint considered; None where not tested.
    is_more
        Whether that is more than noise would give.
    against
        Variables that show it, the strongest first: ``position``, ``direction``, ``posture``, ``speed``, ``load``,
        ``travel``, ``lag``, ``time``, ``even`` (time, the same both ways), ``temperature``; ``size`` of a ripple that
        changes along the run.
    cycles, per
        Of a ripple: cycles per ``turn`` of the joint, or per ``m`` of a sliding one, the strongest first.
    gearing
        Of each of these, how many cycles it makes per turn of the motor; empty where the gear ratio is not known.
    points_to
        Names of the effects that look like this.
    """

    name: str
    mean_square: float
    p_value: float | None = None
    is_more: bool = False
    against: tuple[str, ...] = ()
    cycles: tuple[float, ...] = ()
    per: str = ""
    gearing: tuple[float, ...] = ()
    points_to: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Budget:
    """The mean square of what a model leaves at one joint, in parts that add up to it.

    Attributes
    ----------
    mean_square
        A2, of samples: the RMSE squared.
    parts
        Every part, in the order of `BudgetPart.name`.
    runs, replicates
        How many runs there are, and how many of them repeat another.
    floor
        A2: half the mean squared difference of repeated runs; None without replicates.
    limits
        What these runs cannot split, by slug: ``no-replicates``, ``one-direction``, ``one-posture``, ``one-speed``,
        ``two-speeds``, ``few-runs``, ``strokes``, ``several-clocks``, ``no-load``.
    """

    mean_square: float
    parts: tuple[BudgetPart, ...]
    runs: int
    replicates: int
    floor: float | None = None
    limits: tuple[str, ...] = ()

    def part(self, name: str) -> BudgetPart:
        """The part called `name`."""
        return next(part for part in self.parts if part.name == name)

    def by_name(self) -> dict[str, float]:
        """Name -> A2 of every part."""
        return {part.name: part.mean_square for part in self.parts}

    @property
    def noise(self) -> float:
        """A2 that no model can remove."""
        return sum(part.mean_square for part in self.parts if part.name.startswith("noise"))


@dataclass(frozen=True, eq=False, slots=True)
class RunScore:
    """One run against the model.

    Attributes
    ----------
    run
        The run.
    rmse, bias
        Over its samples: root mean square and mean of measured minus predicted, A.
    largest
        Largest absolute residual of a bin, A.
    predicted
        (M,) A at the run's bins.
    undetermined
        Whether the prediction leans on what the fitted data did not determine, with `reason`.
    explained
        1 minus the residual's share of the squares about the joint's mean current, no unit; None without variance.
    parts
        Effect -> (M,) its part of `predicted`, A; one part for effects that cannot be told apart, as in the joint's
        `shares`.
    """

    run: Run
    rmse: float
    bias: float
    largest: float
    predicted: Floats
    undetermined: bool = False
    reason: str | None = None
    explained: float | None = None
    parts: dict[str, Floats] = field(default_factory=dict)

    @property
    def residual(self) -> Floats:
        """(M,) measured minus predicted at the run's bins, A."""
        return self.run.bins.current - self.predicted


@dataclass(frozen=True, slots=True)
class JointScore:
    """One joint over its runs; held-out runs are counted apart unless there are no others.

    Attributes
    ----------
    joint
        From 1.
    runs, samples
        How many stand behind the figures.
    rmse, bias
        Over samples, A; None without runs.
    explained
        Share of the current's variance about its mean, no unit.
    noise_floor, noise_floor_reason
        RMSE that no model goes below (A), or why it is not known.
    rms
        Root mean square of the measured current, A.
    shares
        Effect -> its share of the mean square of the current, no unit; with `UNEXPLAINED` for what the model leaves
        they add up to 1. A negative share relieves the motor. Effects of which the fitted data determine the sum only
        stand together, joined by `TOGETHER`.
    heldout_runs, heldout
        Runs that the plan keeps for judging, and their RMSE, A.
    undetermined
        Runs of which the model could not know enough.
    budget
        Where the error lives: its square in parts; None without runs.
    """

    joint: int
    runs: int
    samples: int
    rmse: float | None
    bias: float | None
    explained: float | None
    noise_floor: float | None
    noise_floor_reason: str | None = None
    rms: float | None = None
    shares: dict[str, float] = field(default_factory=dict)
    heldout_runs: int = 0
    heldout: float | None = None
    undetermined: int = 0
    budget: Budget | None = None


@dataclass(frozen=True, slots=True)
class OutsideScore:
    """One joint outside runs, by the `reason` that the stretches are no runs (ramps, several joints moving).

    Inertia is missing there by design. `rmse` and `bias` are of bin means while the joint moves, A.
    """

    joint: int
    reason: str
    samples: int
    rmse: float
    bias: float


@dataclass(frozen=True, eq=False, slots=True)
class Comparison:
    """A model against measurement on some logs.

    Attributes
    ----------
    robot
        Its name.
    joints
        One a joint of the arm.
    runs
        In order of the evidence, held-out ones too.
    outside
        What lies outside runs.
    rmse
        Over all samples of the runs behind `joints`, A; None without runs.
    heldout
        Over all samples of held-out runs, A; None where there are none.
    logs
        Name -> SHA-256.
    notes
        What a user should know.
    recipe_digest, version
        SHA-256 of the recipe, and of which version of the program the model is.
    """

    robot: str
    joints: tuple[JointScore, ...]
    runs: tuple[RunScore, ...]
    outside: tuple[OutsideScore, ...] = ()
    rmse: float | None = None
    logs: dict[str, str] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()
    heldout: float | None = None
    recipe_digest: str = ""
    version: str = ""

    def of_joint(self, joint: int) -> tuple[RunScore, ...]:
        """Scores of the runs in which `joint` (from 1) moves."""
        return tuple(score for score in self.runs if score.run.joint == joint)

    def worst(self, count: int) -> tuple[RunScore, ...]:
        """The `count` runs with the largest RMSE against their joint's noise floor, or its RMSE where unknown."""
        scale = {score.joint: score.noise_floor or score.rmse or 1.0 for score in self.joints}
        return tuple(sorted(self.runs, key=lambda score: -score.rmse / scale[score.run.joint])[:count])


@dataclass(frozen=True, slots=True)
class Tally:
    """A run's sums over its samples: of squares of the residual and the current (A2), of both themselves (A).

    `products` maps an effect to the sum of measured current times its part of the prediction (A2). `doubts` (k, k)
    sums, over undetermined directions, the products of what any two of the k effects may be off by (A2).
    """

    run: Run
    samples: int
    squares: float
    total: float
    current_squares: float
    current_total: float
    products: dict[str, float]
    doubts: Floats


@dataclass(frozen=True, eq=False, slots=True)
class Judge:
    """A model with the values that it is judged with."""

    model: Model
    estimate: Estimate
    campaign: Campaign

    @classmethod
    def of(cls, robot: Robot, estimate: Estimate, dataset: Dataset) -> Judge:
        """The model of `estimate`, to be held against `dataset`."""
        return cls(Model.of_estimate(robot, estimate), estimate, Campaign.of(dataset.runs, dataset.rejects))

    def scaled(self, joint: int) -> Floats:
        """(p,) what each parameter counts in joint `joint`: value times ratio of gains, 0 where that is unknown."""
        return self._factors(joint) * self.estimate.solution

    def _factors(self, joint: int) -> Floats:
        return np.nan_to_num(self.model.factors(self.estimate.scales, joint))

    def tallies(self, runs: Sequence[Run]) -> list[Tally]:
        """The sums of each run."""
        out: dict[int, Tally] = {}
        for joint in sorted({run.joint for run in runs}):
            numbers = [n for n, run in enumerate(runs) if run.joint == joint]
            judged = self.judged([runs[n] for n in numbers])
            out |= dict(zip(numbers, (tally for tally, _ in judged), strict=True))
        return [out[n] for n in range(len(runs))]

    def judged(self, runs: Sequence[Run]) -> list[tuple[Tally, Floats]]:
        """The sums of each of some runs of one joint, and its regressor (M, p) at its bins."""
        robot = self.model.robot
        (bins,) = joint_bins(robot, runs, campaign=self.campaign, is_settled=False)
        nodes, _ = bins.nodes
        gravity = None
        if self.model.needs_loads():
            gravity = along(
                self.model, nodes, 3 * bins.lengths, solution=self.estimate.solution, scales=self.estimate.scales
            )
        fine = np.hstack([self.model.along_nodes(bins), self.model.beyond(replace(nodes, loads=gravity))])
        rows = bins.averaged(fine)
        return list(zip(self._tallies(bins, fine, rows), np.split(rows, bins.first[1:]), strict=True))

    def _tallies(self, bins: JointBins, fine: Floats, rows: Floats) -> list[Tally]:
        """Of each run, from the regressor at the nodes of its bins (3 N, p) and its means over them (N, p)."""
        weights, factors, count = self.scaled(bins.joint), self._factors(bins.joint), bins.count
        drawn = fine @ weights
        misfit = bins.current - rows @ weights
        inside = bins.inside_left(rows @ weights, bins.variance(drawn))
        products, effects = {}, self.effects()
        for name, columns in effects.items():
            part, along_part = rows[:, columns] @ weights[columns], fine[:, columns] @ weights[columns]
            varies = 0.25 * (bins.variance(drawn + along_part) - bins.variance(drawn - along_part))
            products[name] = bins.sums(count * (bins.current * part + varies))
        scaled, blind = rows * factors, self.estimate.blind
        off = np.array([scaled[:, columns] @ blind[columns] for columns in effects.values()])
        off *= np.sqrt(count)[None, :, None]
        sums = np.column_stack(
            [
                bins.sums(count),
                bins.sums(count * (misfit**2 + inside)),
                bins.sums(count * misfit),
                bins.sums(count * (bins.current**2 + bins.inside)),
                bins.sums(count * bins.current),
            ]
        )
        doubts = [np.einsum("knb,lnb->kl", part, part) for part in np.split(off, bins.first[1:], axis=1)]
        return [
            Tally(
                run=run,
                samples=int(samples),
                squares=float(squares),
                total=float(total),
                current_squares=float(current_squares),
                current_total=float(current_total),
                products={name: float(values[number]) for name, values in products.items()},
                doubts=doubts[number],
            )
            for number, (run, (samples, squares, total, current_squares, current_total)) in enumerate(
                zip(bins.runs, sums, strict=True)
            )
        ]

    def _loaded(self, samples: Samples) -> Samples:
        if not self.model.needs_loads():
            return samples
        gravity = loads(self.model, samples, solution=self.estimate.solution, scales=self.estimate.scales)
        return replace(samples, loads=gravity)

    def effects(self) -> dict[str, NDArray[np.bool_]]:
        """Effect -> (p,) which parameters are its own, in the model's order."""
        names = [column.effect for column in self.model.columns]
        return {name: np.array([other == name for other in names]) for name in dict.fromkeys(names)}

    def groups(self, tallies: Sequence[Tally]) -> Groups:
        """The effects of one joint by what `tallies` can tell apart: each alone, or those known only together.

        What is left over when all others are known is known too, since the whole is the measured current. (That it may
        look open by itself is due to ratios of gains, which trade with the outer links' loads but are no parameters.)
        """
        names, samples = list(self.effects()), sum(tally.samples for tally in tallies)
        rms = np.sqrt(sum(tally.current_squares for tally in tallies) / samples)
        rmse = self.estimate.joint(tallies[0].run.joint).rmse
        limit = max(min(OPEN * rms, rms if rmse is None else rmse), CLOSED * rms)
        doubts = np.sum([tally.doubts for tally in tallies], axis=0) / samples
        return tuple(tuple(names[k] for k in group) for group in told_apart(doubts, limit))

    def rows(self, many: Sequence[Samples]) -> Iterator[Floats]:
        """The regressor (M, p) of each of `many`; neighbours of one joint are looked at together, which is quicker."""
        start = 0
        while start < len(many):
            end, instants = start, 0
            while end < len(many) and many[end].joint == many[start].joint and instants < AT_ONCE:
                instants += len(many[end])
                end += 1
            design = self.model.regressor(self._loaded(joined(many[start:end])))
            yield from np.split(design, np.cumsum([len(samples) for samples in many[start:end]])[:-1])
            start = end

    def score(self, tally: Tally, rows: Floats, *, mean: float, groups: Groups, is_fitted: bool) -> RunScore:
        """A run's figures and its prediction at bins, whose regressor `rows` (M, p) is, in parts by `groups`."""
        run, weights = tally.run, self.scaled(tally.run.joint)
        acting = {name: columns for name, columns in self.effects().items() if rows[:, columns].any()}
        single = {name: rows[:, columns] @ weights[columns] for name, columns in acting.items()}
        parts = together(single, groups)
        predicted = rows @ weights
        about = tally.current_squares - 2.0 * mean * tally.current_total + tally.samples * mean**2
        reason = self._undetermined(run, rows, is_fitted=is_fitted)
        residual = run.bins.current - predicted
        return RunScore(
            run=run,
            rmse=float(np.sqrt(tally.squares / tally.samples)),
            bias=tally.total / tally.samples,
            largest=float(np.max(np.abs(residual), initial=0.0)),
            predicted=predicted,
            undetermined=reason is not None,
            reason=reason,
            explained=1.0 - tally.squares / about if about > NOTHING**2 * tally.samples else None,
            parts=parts,
        )

    def _undetermined(self, run: Run, rows: Floats, *, is_fitted: bool) -> str | None:
        """Why the fitted data cannot tell what `run` should draw, or None where they can."""
        if is_fitted:
            return None
        scale = self.model.factors(self.estimate.scales, run.joint)
        if self.model.is_foreign(run):
            stand_in = any(joint == run.joint for joint, _ in self.estimate.stroke_postures)
            instead = "that of the nearest posture stands in" if stand_in else "none is counted"
            return f"the inertia of joint {run.joint} in this posture was not identified; {instead}"
        unknown = np.isnan(scale) & (np.abs(rows * self.estimate.solution).max(axis=0, initial=0.0) > NOTHING)
        if unknown.any():
            link = int(self.model.owners[np.flatnonzero(unknown)[0]])
            return (
                f"eta{run.joint}/eta{link} was not determined: what link {link} weighs on joint {run.joint} is known"
                " only for the postures that were fitted"
            )
        used = rows * np.nan_to_num(scale)
        off = np.sqrt(np.mean((used @ self.estimate.blind) ** 2, axis=0))
        if float(np.linalg.norm(off)) <= max(self.estimate.joint(run.joint).rmse or 0.0, NOTHING):
            return None
        size = np.sqrt(np.mean((used * self.estimate.blind[:, int(np.argmax(off))]) ** 2, axis=0))
        names = [self.model.names[k] for k in np.argsort(-size)[:3] if size[k] > PART * size.max()]
        return f"this run needs {' and '.join(names)}, which the fitted data do not determine"

    def outside(self, dataset: Dataset) -> tuple[OutsideScore, ...]:
        """Scores of what is no run, by joint and reason; bins in which a joint's motor rests are not its own."""
        stretches = [
            (joint, reject.reason, reject.bins, reject.clock)
            for reject in dataset.rejects
            for joint in reject.joints
            if reject.bins is not None
        ]
        stretches.sort(key=lambda stretch: stretch[:2])
        moving = [self._moving(bins, joint) for joint, _, bins, _ in stretches]
        pairs = zip(stretches, moving, strict=True)
        many = [self._ramp(bins, joint, keep, clock) for (joint, _, bins, clock), keep in pairs]
        residuals: dict[tuple[int, str], list[tuple[Floats, Floats]]] = {}
        for (joint, reason, bins, _), keep, rows in zip(stretches, moving, self.rows(many), strict=True):
            residual = bins.current[keep, joint - 1] - rows @ self.scaled(joint)
            residuals.setdefault((joint, reason), []).append((bins.count[keep].astype(float), residual))
        out = []
        for (joint, reason), pieces in residuals.items():
            counts = np.concatenate([count for count, _ in pieces])
            residual = np.concatenate([values for _, values in pieces])
            if counts.sum() > 0:
                rmse = float(np.sqrt(np.average(residual**2, weights=counts)))
                bias = float(np.average(residual, weights=counts))
                out.append(OutsideScore(joint, reason, int(counts.sum()), rmse, bias))
        return tuple(out)

    def _ramp(self, bins: Means, joint: int, keep: NDArray[np.bool_], clock: int) -> Samples:
        """The bins `keep` as what effects see of `joint`; without acceleration, since inertia is missing by design."""
        velocity, time, robot = bins.velocity[keep], bins.time[keep], self.model.robot
        return Samples(
            joint,
            bins.position[keep],
            velocity,
            acceleration=np.zeros(len(velocity)),
            direction=np.sign(robot.shaft_velocity(velocity)[:, joint - 1]),
            time=self.campaign.since(joint, clock, time),
            elapsed=self.campaign.since(0, clock, time),
            travel=np.abs(robot.shaft_velocity(bins.position[keep] - bins.position[0])[:, joint - 1]),
            temperature=np.full(len(velocity), np.nan),
            run=np.zeros(len(velocity)),
        )

    def _moving(self, bins: Means, joint: int) -> NDArray[np.bool_]:
        """(M,) whether the motor of `joint` turns, and its current is measured."""
        speed = np.abs(self.model.robot.shaft_velocity(bins.velocity)[:, joint - 1])
        return np.isfinite(bins.current[:, joint - 1]) & (speed > MOVING * np.max(speed, initial=0.0))


def rmse(tallies: Sequence[Tally]) -> float | None:
    """Root mean square (A) of the residual over all samples of some runs; None without any."""
    samples = sum(tally.samples for tally in tallies)
    return float(np.sqrt(sum(tally.squares for tally in tallies) / samples)) if samples else None


def together(parts: Mapping[str, Part], groups: Groups) -> dict[str, Part]:
    """Parts by group, the sum where effects are known only together; what has no part is left out.

    Parameters
    ----------
    parts
        Effect -> its part.
    groups
        Every effect once.

    Returns
    -------
    sums
        A group's effects joined by `TOGETHER` -> the sum of their parts.
    """
    out: dict[str, Part] = {}
    for group in groups:
        members = [parts[name] for name in group if name in parts]
        if members:
            out[TOGETHER.join(group)] = sum(members[1:], start=members[0])
    return out


#: Largest group that is looked for; what is left beyond is one group, which is what a user can still read.
LARGEST_GROUP = 3


def told_apart(gram: Floats, limit: float) -> list[tuple[int, ...]]:
    """The finest groups of terms whose sums are each known to `limit`.

    Terms that are known by themselves stand alone; then the smallest, best-known groups of the others are taken, and
    what cannot be grouped so is one group.

    Parameters
    ----------
    gram
        (k, k) mean products of what any two terms may be off by: the diagonal holds squares, and the sum over a
        group's rows and columns is the square of what the group's sum may be off by.
    limit
        What a sum may be off by and still count as known, in the root of the gram's unit.

    Returns
    -------
    groups
        Indices, each once; in order of their first member.

    Examples
    --------
    Two terms that may move against each other by 1, and one that is known:

    >>> told_apart(np.array([[1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, 0.0]]), 0.1)
    [(0, 1), (2,)]
    """
    open_terms, groups = list(range(len(gram))), []
    for size in range(1, LARGEST_GROUP + 1):
        ranked = sorted((_off(gram, group), group) for group in combinations(open_terms, size))
        for off, group in ranked:
            if off <= limit and set(group) <= set(open_terms):
                groups.append(group)
                open_terms = [term for term in open_terms if term not in group]
    if open_terms:
        groups.append(tuple(open_terms))
    return sorted(groups)


def _off(gram: Floats, group: Sequence[int]) -> float:
    """What the sum of a group may be off by."""
    return float(np.sqrt(max(gram[np.ix_(group, group)].sum(), 0.0)))
