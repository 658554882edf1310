"""An estimate held against runs: what it predicts, how far off it is, and what it cannot know."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import combinations
from typing import Any, TypeVar

import numpy as np

from pumaid.dataset import Dataset, Run, first_motions
from pumaid.effects import Scope
from pumaid.effects.curve import outside, spoken_form
from pumaid.errors import Note
from pumaid.estimate import Estimate, JointResult
from pumaid.joint_bins import JointBins, joint_bins
from pumaid.maths import Flags, Floats
from pumaid.model import INERTIA, Model, loads_at
from pumaid.preprocessing.replicates import Pair, noise_floor, pairs
from pumaid.robot import Robot

#: Effects of one joint, those together that are known only together.
Groups = tuple[tuple[str, ...], ...]

#: A number or an array of them.
Part = TypeVar("Part", float, Floats)

#: Share of the largest term in an undetermined direction below which a term is not named.
PART = 0.05
#: s between cells of which third differences tell a block's noise: longer than drives and sensors remember.
APART = 0.1
#: A (A) below which a contribution is rounding.
NOTHING = 1e-9
#: An effect's share is stated where the data leave it open by no more than this share of the joint's RMS current (and
#: by no more than the joint's RMSE): beyond, the share would be off by more than five points.
OPEN = 0.05
#: Share of the RMS current below which what the data leave open is rounding.
CLOSED = 1e-6
#: Share of the replicates' noise floor below which an RMSE shows that replicates differ by what the model explains.
BELOW = 0.9
#: Share of a run's bins beyond a curve's range from which that is told.
FEW = 0.02
#: Largest group of effects that is searched for; the rest is one group, which is what a user can still read.
LARGEST_GROUP = 3
#: Name of the share of the current that no effect of the model explains.
UNEXPLAINED = "unexplained"
#: Between the names of effects whose sum the fitted data determine although not each of them: ``coulomb+viscous``.
TOGETHER = "+"


@dataclass(frozen=True, slots=True)
class BudgetPart:
    """One part (A2) of what a model leaves at a joint: what a model with that physics would take away; never negative.

    `name` is ``noise_shared`` (noise that a run has as a whole), ``noise_inside`` (noise inside runs), ``smooth``
    (within a run, a few waves over its travel), ``fast`` (within a run, a ripple), ``start`` (where a run begins),
    ``odd`` (between runs, turns round with the direction), ``even`` (between runs, the same both ways), ``time`` (with
    time or temperature) or ``unassigned`` (repeats, and is none of these). `is_more` says whether it is more than noise
    would give, by a family-wise `p_value`, None where not tested. `against` names variables that show it, the strongest
    first; `cycles` of a ripple are counted `per` turn of the joint (or m of a sliding one), `gearing` per turn of the
    motor, empty where the gear ratio is not known. `points_to` names effects that look like this.
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
    """The mean square (A2) of what a model leaves at one joint, in parts that add up to it.

    `replicates` of the `runs` repeat another; `floor` (A2) is half the mean squared difference of these, None without.
    `limits` are slugs of what these runs cannot split: ``no-replicates``, ``one-direction``, ``one-posture``,
    ``one-speed``, ``two-speeds``, ``few-runs``, ``strokes``, ``several-clocks``, ``no-load``.
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

    @property
    def noise(self) -> float:
        """A2 that no model can remove."""
        return sum(part.mean_square for part in self.parts if part.name.startswith("noise"))


@dataclass(frozen=True, eq=False, slots=True)
class RunScore:
    """One run against the model: RMSE, bias and largest residual of a bin (A), (M,) A `predicted` at its bins.

    `undetermined` says, and `reason` why, the prediction rests on what the fitted data did not determine. `explained`
    is 1 minus the residual's share of the squares about the joint's mean current, None without variance; `parts` maps
    effects to their (M,) part of `predicted`, those that are confounded as one, as in the joint's `shares`.
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
class JointScore(JointResult):
    """One joint over its runs.

    `bias` (over samples) and `rms` (of the measured current) are in A. `shares` maps effects to their share of the mean
    square of the current, which with `UNEXPLAINED` add up to 1: a negative one relieves the motor, and effects of which
    the fitted data determine the sum only stand together, joined by `TOGETHER`. `undetermined` counts runs whose
    prediction rests on what the fitted data did not determine.
    """

    bias: float | None = None
    explained: float | None = None
    rms: float | None = None
    shares: dict[str, float] = field(default_factory=dict)
    undetermined: int = 0
    budget: Budget | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Comparison:
    """A model against measurement on some logs.

    `joints` has a score for each joint of the arm, `runs` for each run in order of the dataset, held-out ones too.
    `rmse` (A) is over all samples of the runs behind `joints`, `heldout` over those of held-out runs. `logs` maps names
    to SHA-256.
    """

    robot: str
    joints: tuple[JointScore, ...]
    runs: tuple[RunScore, ...]
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


class JointPrediction:
    """An estimate at the R runs (N bins) of one joint: design matrix, prediction, and sums over the samples of each
    run.

    `design` (N, p) is A per unit of each parameter, `beyond` maps curves to the (N,) bins that reach beyond
    their range, `predicted` and `residual` (N,) A, `inside` (N,) A2 of variance
    inside bins that the prediction leaves; `parts` (N, E) is the prediction by `effects`. Of each run (R,) there are
    `samples`, and over them the sums of the squared residual (`square`) and current, A2. `counted` (R,) are behind the
    joint's figures: those that are not `heldout`, or all where all are.
    """

    def __init__(self, model: Model, estimate: Estimate, bins: JointBins) -> None:
        self.model, self.estimate, self.bins = model, estimate, bins
        self._factors = np.nan_to_num(model.factors(estimate.scales, bins.joint))
        gravity = (
            loads_at(model, bins, solution=estimate.solution, scales=estimate.scales, at_nodes=True)
            if model.needs_loads()
            else None
        )
        fine, count, nodes = model.at_nodes(bins, gravity), bins.count, replace(bins.nodes[0], loads=gravity)
        curves = [term for term in model.effects if term.effect.is_free and term.touches(bins.joint)]
        self.beyond: dict[str, Flags] = {
            spoken_form(term.shape): outside(model.robot, nodes, term.shape).reshape(len(bins), -1)[
                :, bins.nodes[1].shape[1] // 2
            ]
            for term in curves
        }
        self.design = bins.averaged(fine)
        names = np.array([column.effect for column in model.columns])
        self.effects = tuple(dict.fromkeys(names.tolist()))
        self._is_part = names[:, None] == np.array(self.effects)
        weights = (self._factors * estimate.solution)[:, None] * self._is_part
        fine_parts = fine @ weights
        # What parameters of weight ask of a joint by inertia is not weight.
        if model.is_dynamic and {"gravity", INERTIA} <= {*self.effects}:
            still = model.base(bins.nodes[0], (Scope.LINK,))
            weight, inertia = (self.effects.index(name) for name in ("gravity", INERTIA))
            moved = fine_parts[:, weight] - still @ weights[: still.shape[1], weight]
            fine_parts[:, [weight, inertia]] += np.column_stack([-moved, moved])
        self.parts = bins.averaged(fine_parts)
        self.predicted, drawn = self.parts.sum(axis=1), fine_parts.sum(axis=1)
        self.residual = bins.current - self.predicted
        waves = fine @ (self._factors * estimate.solution * model.is_wave)
        self.inside = bins.inside_left(self.predicted, bins.variance(drawn, waves))
        self.samples = bins.sums(count)
        self.square = bins.sums(count * (self.residual**2 + self.inside))
        self.current_square = bins.sums(count * (bins.current**2 + bins.inside))
        self._fine_parts = fine_parts
        self.heldout = np.array([run.heldout for run in bins.runs], dtype=bool)
        self.counted = ~self.heldout | self.heldout.all()

    @cached_property
    def products(self) -> Floats:
        """(R, E) A2 sums of the current times each part."""
        drawn = self._fine_parts.sum(axis=1)
        variance = partial(self.bins.variance, waves=0.0 * drawn)
        covariance = [0.25 * (variance(drawn + part) - variance(drawn - part)) for part in self._fine_parts.T]
        products = self.bins.current[:, None] * self.parts + np.column_stack(covariance)
        return self.bins.sums(self.bins.count[:, None] * products)

    @cached_property
    def repeated(self) -> list[Pair]:
        """Replicates among `counted`."""
        return pairs([run for run, is_counted in zip(self.bins.runs, self.counted, strict=True) if is_counted])

    def noise_floor(self) -> tuple[float | None, str | None]:
        """RMSE (A) that no model goes below, or why it is unknown.

        Where the model explains by what replicates differ, as effects of time, the floor is that of its residuals.
        """
        floor, why = noise_floor(self.repeated)
        if floor is None or (rmse([(self, self.counted)]) or 0.0) >= BELOW * floor:
            return floor, why
        residual, inside = (np.split(values, self.bins.first[1:]) for values in (self.residual, self.inside))
        runs = [
            replace(run, bins=replace(run.bins, current=residual[n], variance=inside[n]))
            for n, run in enumerate(self.bins.runs)
            if self.counted[n]
        ]
        return noise_floor(pairs(runs))

    def noise_inside(self) -> float | None:
        """RMS (A) of a sample of what comes and goes within tenths of a second in `counted` blocks; None without."""
        blocks = np.flatnonzero(self.bins.is_block & self.counted)
        square = fast_squares(self.bins, self.residual, self.inside)[self.bins.is_block & self.counted]
        return float(np.sqrt(np.average(square, weights=self.samples[blocks]))) if len(blocks) else None

    @cached_property
    def groups(self) -> Groups:
        """The effects by what `counted` runs tell apart: each alone, or those known only together.

        What is left over when all others are known is known too, since the whole is the measured current. (That it may
        look open by itself is due to ratios of gains, which trade with the outer links' loads but are no parameters.)
        """
        samples, bins = float(self.samples[self.counted].sum()), self.counted[self.bins.run]
        rms = float(np.sqrt(self.current_square[self.counted].sum() / samples))
        fitted = self.estimate.joint(self.bins.joint).rmse
        limit = max(min(OPEN * rms, rms if fitted is None else fitted), CLOSED * rms)
        scaled = self.design[bins] * self._factors * np.sqrt(self.bins.count[bins] / samples)[:, None]
        off = np.array([scaled[:, part] @ self.estimate.blind[part] for part in self._is_part.T])
        groups = separable(np.einsum("knb,lnb->kl", off, off), limit)
        return tuple(tuple(self.effects[k] for k in group) for group in groups)

    def run_scores(self, is_fitted: Sequence[bool]) -> Iterator[RunScore]:
        """A score for each run; `is_fitted` (R,) says which the estimate was fitted to."""
        bins, groups = self.bins, self.groups
        total = bins.sums(bins.count * self.residual) / self.samples
        current = bins.sums(bins.count * bins.current)
        mean = current.sum() / self.samples.sum()
        about = self.current_square - 2.0 * mean * current + self.samples * mean**2
        for n, run in enumerate(bins.runs):
            span = slice(bins.first[n], bins.first[n] + bins.lengths[n])
            parts = self.parts[span].reshape(len(run.bins), -1, len(self.effects)).mean(axis=1)  # of cells
            acting = {
                name: parts[:, k]
                for k, name in enumerate(self.effects)
                if self.design[span][:, self._is_part[:, k]].any()
            }
            far = (name for name, is_far in self.beyond.items() if is_far[span].mean() > FEW)
            end = next((f"goes beyond the range on which the curve {name} was learned" for name in far), None)
            reason = None if is_fitted[n] else end or self._undetermined(run, self.design[span])
            yield RunScore(
                run=run,
                rmse=float(np.sqrt(self.square[n] / self.samples[n])),
                bias=float(total[n]),
                largest=float(np.max(np.abs(self.residual[span]), initial=0.0)),
                predicted=parts.sum(axis=1),
                undetermined=reason is not None,
                reason=reason,
                explained=_explained(self.square[n], about[n], self.samples[n]),
                parts=together(acting, groups),
            )

    def figures(self) -> dict[str, Any]:
        """What a `JointFit` and a `JointScore` both say of `counted` runs, by the names of their fields."""
        floor, why = self.noise_floor()
        return {
            "joint": self.bins.joint,
            "runs": int(self.counted.sum()),
            "samples": round(float(self.samples[self.counted].sum())),
            "rmse": rmse([(self, self.counted)]),
            "noise_floor": floor,
            "noise_floor_reason": why,
            "noise_inside": self.noise_inside(),
            "heldout_runs": int(self.heldout.sum()),
            "heldout": rmse([(self, self.heldout)]),
        }

    def joint_score(self, scores: Sequence[RunScore]) -> JointScore:
        """The joint's figures; `scores` are those of its runs. The budget is left out."""
        chosen, bins, figures = self.counted, self.bins, self.figures()
        samples, square = figures["samples"], float(self.square[chosen].sum())
        current = float(self.current_square[chosen].sum())
        totals = [float(bins.sums(bins.count * values)[chosen].sum()) for values in (self.residual, bins.current)]
        parts = self.products[chosen].sum(axis=0) / max(current, NOTHING**2 * samples)
        shares = together(dict(zip(self.effects, parts.tolist(), strict=True)), self.groups)
        shares = {name: share for name, share in shares.items() if share != 0.0 and current > NOTHING**2 * samples}
        return JointScore(
            **figures,
            bias=totals[0] / samples,
            explained=_explained(square, current - totals[1] ** 2 / samples, samples),
            rms=float(np.sqrt(current / samples)),
            shares=shares | {UNEXPLAINED: 1.0 - sum(shares.values())} if shares else {},
            undetermined=sum(score.undetermined for score in scores),
        )

    def _undetermined(self, run: Run, rows: Floats) -> str | None:
        estimate, model = self.estimate, self.model
        if run.accelerates and not model.is_dynamic:
            return "joints accelerate, and the model was fitted to constant speed: inertia is missing"
        is_open = np.isnan(model.factors(estimate.scales, run.joint))
        unknown = is_open & (np.abs(rows * estimate.solution).max(axis=0, initial=0.0) > NOTHING)
        if unknown.any():
            link = int(model.owners[np.flatnonzero(unknown)[0]])
            return (
                f"eta{run.joint}/eta{link} was not determined: what link {link} weighs on joint {run.joint} is known"
                " only for the postures that were fitted"
            )
        used = rows * self._factors
        off = np.sqrt(np.mean((used @ estimate.blind) ** 2, axis=0))
        if float(np.linalg.norm(off)) <= max(estimate.joint(run.joint).rmse or 0.0, NOTHING):
            return None
        size = np.sqrt(np.mean((used * estimate.blind[:, int(np.argmax(off))]) ** 2, axis=0))
        names = [model.names[k] for k in np.argsort(-size)[:3] if size[k] > PART * size.max()]
        return f"this run needs {' and '.join(names)}, which the fitted data do not determine"


def fast_squares(bins: JointBins, residual: Floats, inside: Floats) -> Floats:
    """(R,) A2 of a sample of each block that comes and goes within some tenths of a second; NaN of other runs."""
    out = np.full(len(bins.runs), np.nan)
    for n in np.flatnonzero(bins.is_block):
        cells = slice(bins.first[n], bins.first[n] + bins.lengths[n])
        apart = max(min(round(APART / bins.step[n]), bins.lengths[n] // 4), 1)
        third = np.convolve(residual[cells], np.kron([1.0, -3.0, 3.0, -1.0], np.eye(1, apart)[0]), "valid")
        # Windows of neighbouring cells share two of their three.
        times = 8.4 if bins.is_cells[n] and apart == 1 else 20.0
        out[n] = np.average(inside[cells], weights=bins.count[cells]) + np.mean(third**2) / times
    return out


def predictions(estimate: Estimate, dataset: Dataset, robot: Robot) -> dict[int, JointPrediction]:
    """Joint (from 1) -> the estimate at all of its runs, held-out ones too."""
    model, begun = Model.of_estimate(robot, estimate), first_motions(dataset.runs)
    waves = {term.joint for term in model.effects if term.effect.periodic is not None}
    bins = joint_bins(robot, dataset.runs, begun=begun, is_settled=False, finest=waves)
    return {part.joint: JointPrediction(model, estimate, part) for part in bins}


def rmse(parts: Iterable[tuple[JointPrediction, Flags]]) -> float | None:
    """Root mean square (A) of the residual over all samples of the flagged runs; None without any."""
    sums = [(prediction.square[runs].sum(), prediction.samples[runs].sum()) for prediction, runs in parts]
    samples = sum(count for _, count in sums)
    return float(np.sqrt(sum(square for square, _ in sums) / samples)) if samples else None


def _explained(square: float, about: float, samples: float) -> float | None:
    return float(1.0 - square / about) if about > NOTHING**2 * samples else None


def together(parts: Mapping[str, Part], groups: Groups) -> dict[str, Part]:
    """Sums of parts by group, the effects' names joined by `TOGETHER`; what has no part is left out."""
    out: dict[str, Part] = {}
    for group in groups:
        members = [parts[name] for name in group if name in parts]
        if members:
            out[TOGETHER.join(group)] = sum(members[1:], start=members[0])
    return out


def separable(gram: Floats, limit: float) -> list[tuple[int, ...]]:
    """The finest groups of terms whose sums are each known to `limit`, as indices, in order of their first member.

    `gram` (k, k) are mean products of what any two terms may be off by. Terms that are known by themselves stand alone;
    then the smallest, best-known groups of the rest are taken, and what cannot be grouped so is one group.
    """
    open_terms, groups = list(range(len(gram))), []
    for size in range(1, LARGEST_GROUP + 1):
        for square, group in sorted((gram[np.ix_(k, k)].sum(), k) for k in combinations(open_terms, size)):
            if square <= limit**2 and set(group) <= set(open_terms):
                groups.append(group)
                open_terms = [term for term in open_terms if term not in group]
    return sorted([*groups, tuple(open_terms)] if open_terms else groups)
