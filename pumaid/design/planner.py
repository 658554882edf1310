"""From prior robots and a time budget to motions: coverage, then greedy choice and exchange, then the schedule.

A coverage is what every joint gets whatever it tells, since diagnosis needs it: postures, speeds, whole ranges,
replicates.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.design.candidate_runs import (
    SHARES,
    Block,
    JointCandidates,
    Sweep,
    home,
    postures,
    seconds_of,
    speeds,
    sweeps,
    usable,
)
from pumaid.design.collision import Collision
from pumaid.design.exchange import POWERS, ContinuousDesign, Criterion, Exchange, continuous_design, rounded
from pumaid.design.information import CandidateInformation, candidate_information, gravity_slopes
from pumaid.design.prior import Prior
from pumaid.design.schedule import schedule
from pumaid.errors import ModelError, Where
from pumaid.robot import Robot
from pumaid.trajectory import MOVE_SHARE, RAMP_TIME, Motion, Plan, duration, highest_speeds
from pumaid.units import number

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]

#: Different speeds of a joint at least: three tell a straight line from a bend, the fourth which bend.
SPEEDS = 4
#: Postures of a joint where time is not short: what depends on load or place shows between them.
POSTURES = 4
#: s a joint that a pass takes about: longer budgets are filled with more passes, up to so many.
_PASS, _MOST_PASSES = 200.0, 20
#: s a joint where no time is given.
_USUAL = 210.0
#: s between blocks, as a share of the way from home.
_OPENING = 0.8
#: Share of the best candidate's worth a second below which candidates are not looked at.
_WORTH = 0.6
#: Rounds of fitting a plan into its time, and the share of the time that is enough.
_FITTINGS, _FULL = 5, 0.98
#: Share of the continuous optimum's information on top of which postures of the coverage are compared.
_BACKGROUND = 0.5
#: Random postures a joint, of a joint whose runs no posture changes, and how many remain after the first look.
_DRAWN, _DRAWN_IDLE, _SHORTLIST = 120, 12, 14
#: Shares of the top speed of the first look, its steps, and its time a joint (s).
_LOOK, _LOOK_STEPS, _LOOK_SECONDS = (0.05, 1.0), 40, 120.0


@dataclass(frozen=True, slots=True)
class Request:
    """What a user asks for; None where the planner decides."""

    seconds: float | None = None  # of the robot, moves included
    shares: tuple[float, ...] | None = None  # speeds as shares of each joint's top speed
    postures: int | None = None  # of a joint
    passes: int | None = None  # how often the arm is gone through
    criterion: str = "geometric"  # a key of `pumaid.design.exchange.POWERS`


@dataclass(frozen=True, slots=True)
class Coverage:
    """How much every joint gets at least."""

    postures: int
    whole: int  # postures with a run over the whole range at top speed, in every pass; others come in every second
    part: float  # s of a run over part of the range
    judged: int  # sweeps a joint that are kept for judging
    share: float  # of the time, that it may take
    middle: bool = False  # whether the first posture gets a middle speed beside the slow one
    passes: int = 2  # how often the arm is gone through

    @property
    def times(self) -> tuple[int, ...]:
        """How often each of the two alternating kinds of pass is made."""
        return (1,) if self.passes == 1 else ((self.passes + 1) // 2, self.passes // 2)


#: The most first.
COVERAGES = (
    Coverage(4, 4, 2.0, 2, 0.4, middle=True),
    Coverage(4, 2, 0.8, 2, 0.45, middle=True),
    Coverage(4, 1, 0.8, 1, 0.6, middle=True),
    Coverage(4, 1, 0.8, 1, 0.9),
    Coverage(3, 1, 0.8, 1, 0.9),
    Coverage(2, 1, 0.8, 1, 0.9),
)


@dataclass(frozen=True, eq=False, slots=True)
class PlanObjective:
    """The criterion of a plan whose passes are of K kinds: candidate l in passes of kind k is number ``k L + l``.

    `times` says how often each kind of pass is made.
    """

    candidates: CandidateInformation
    criterion: Criterion
    times: tuple[int, ...]

    def information(self, counts: Counts) -> Floats:
        """(G, p, p) of all passes."""
        return self.candidates.information(np.asarray(self.times, dtype=float) @ counts.reshape(len(self.times), -1))

    def value(self, counts: Counts) -> float:
        """Of the criterion."""
        return float(self.criterion.value(self.information(counts)))

    def falls(self, counts: Counts) -> Floats:
        """(K L,) about how much the criterion falls by one more of each candidate."""
        products = self.candidates.products(self.criterion.slope(self.information(counts)))
        return 0.5 * np.concatenate([often * products for often in self.times])

    def values_with(self, counts: Counts, candidates: Counts) -> Floats:
        """(N,) criterion with one more of each of N candidates."""
        kind, number_in_pass = np.divmod(candidates, len(self.candidates))
        added = np.asarray(self.times)[kind][:, None, None, None] * self.candidates.each(number_in_pass.tolist())
        return self.criterion.value(self.information(counts) + added)


@dataclass(frozen=True, eq=False, slots=True)
class Made:
    """A plan's motions in order, and what they were chosen by."""

    motions: tuple[Motion, ...]
    objective: PlanObjective
    counts: Counts  # (K L,) how often each candidate is made in a pass of each kind
    judged: Floats  # (J, J) the posture in which each joint is judged
    coverage: Coverage
    efficiency: float  # best conceivable error in the same time as a share of this plan's (0..1)


class Planner:
    """Makes plans for one arm whose gravity parameters and ratios are `names`; the same seed makes the same plan."""

    def __init__(
        self, prior: Prior, names: Sequence[str], *, request: Request, seed: int, tell: Callable[[str], None]
    ) -> None:
        self.truths, self.names, self.request, self.seed, self.tell = prior.robots, names, request, seed, tell
        self.robot: Robot = self.truths[0].robot
        self.collision = Collision(self.robot)
        tell("choosing postures")
        joints = self._shortlist(np.random.default_rng([seed, 3]), max(_SHORTLIST, request.postures or 0))
        shares = sorted(request.shares or SHARES)
        self.candidates = candidate_information(
            self.truths, [self._candidates(joint.joint, joint.holds, shares) for joint in joints], names=names
        )
        # Runs for judging have speeds that no fitted run has.
        between = (math.sqrt(shares[-2] * shares[-1]), math.sqrt(shares[0] * shares[1]))
        self.judging = [self._judging(joint.number, between) for joint in self.robot.joints]
        self._away = self._opening_seconds()
        sizes = prior.typical_sizes()
        self.sizes = np.array([sizes[name] for name in self.candidates.names])
        self.hopeless: tuple[str, ...] = ()
        self.criterion = Criterion(POWERS[request.criterion], self.sizes, np.ones(len(self.sizes), dtype=bool))

    def made(self) -> Made:
        """The plan that is asked for.

        Raises
        ------
        ModelError [plan-too-short]
            The least experiment that shows everything takes longer.
        """
        self.tell("choosing runs")
        coverages, request = self._coverages(), self.request
        is_asked = request.postures is not None or request.passes is not None or request.shares is not None
        usual = coverages[0 if is_asked else 1]
        budget = request.seconds or max(_USUAL * self.robot.n_joints, self._least_seconds(usual) / usual.share)
        optimum = self._optimum(budget)
        fitting = (wanted for wanted in coverages if self._least_seconds(wanted) <= wanted.share * budget)
        coverage = next(fitting, coverages[-1])
        best: Made | None = None
        allowed = budget
        required = self._required(coverage, optimum)
        for _ in range(_FITTINGS):
            made = self._chosen(required, coverage, optimum, allowed=allowed)
            lasting = duration(self.robot, Plan(self.robot.name, made.motions))
            if lasting <= budget and (best is None or made.efficiency > best.efficiency):
                best = made
            if _FULL * budget <= lasting <= budget:
                break
            allowed += 0.99 * budget - lasting
        if best is None:
            raise self._too_short(budget, coverages[-1])
        return best

    def efficiency(self, promised: dict[str, float], seconds: float) -> float | None:
        """Best conceivable error in some s as a share of promised errors; None where a parameter is not shown."""
        if seconds <= 0.0:
            return None
        bound = self._optimum(seconds).bound
        counted = [name for name in self.candidates.names if name not in self.hopeless]
        if any(name not in promised for name in counted):
            return None
        errors = np.log([promised[name] for name in counted]) - np.log(self.sizes[self.criterion.counted])
        return float(np.exp(bound - errors.mean()))

    def _shortlist(self, rng: np.random.Generator, count: int) -> list[JointCandidates]:
        """For each joint the postures on which the continuous optimum, with few sweeps, would spend its time."""
        joints = [self._all_postures(joint.number, rng) for joint in self.robot.joints]
        table = candidate_information(self.truths, joints, names=self.names)
        criterion = Criterion(0.0, np.ones(len(table.names)), np.ones(len(table.names), dtype=bool))
        optimum = continuous_design(table, criterion, _LOOK_SECONDS * self.robot.n_joints, steps=_LOOK_STEPS)
        out = []
        for joint in joints:
            rows = table.joint == joint.joint
            spent = np.bincount(table.hold[rows], (optimum.counts * table.seconds)[rows], minlength=len(joint.holds))
            free = np.flatnonzero(joint.usable.any(axis=1))
            order = free[np.argsort(-rounded(np.asarray(spent[free], dtype=float)), kind="stable")]
            out.append(replace(joint, holds=joint.holds[order[:count]]))
        return out

    def _all_postures(self, joint: int, rng: np.random.Generator) -> JointCandidates:
        """Many postures of a joint with its slowest part and its fastest tour."""
        matter = self._that_matter(joint, rng)
        rest = [number for number in range(1, self.robot.n_joints + 1) if number != joint]
        holds = postures(self.robot, joint, varied=matter or rest, count=_DRAWN if matter else _DRAWN_IDLE, rng=rng)
        table = self._candidates(joint, holds, _LOOK, only_extremes=True)
        if table.usable.any():
            return table
        moving = np.arange(self.robot.n_joints) == joint - 1
        start, end = (np.where(moving, place, holds[0]) for place in (table.sweeps[0].low, table.sweeps[0].high))
        hit, name = self.collision.first_hit(start, end), self.robot.joint(joint).name
        why = "" if hit is None else f"; at home: {self.collision.describe(hit)}"
        raise ModelError(
            "plan-unsafe",
            f"joint {joint} ({name}) collides in all of {len(holds)} postures of the others{why}",
            Where(joint=joint),
            "widen the limits, or correct the recipe's boxes and spheres",
        )

    def _that_matter(self, joint: int, rng: np.random.Generator) -> list[int]:
        """Other joints (from 1) whose position changes what a joint's runs tell."""
        n = self.robot.n_joints
        holds = rng.uniform(-1.0, 1.0, (12, n)) * np.where(self.robot.is_revolute, np.pi, 0.5)
        turned = np.concatenate([holds, *(holds + 0.7 * np.eye(n)[other] for other in range(n))])
        slopes = gravity_slopes(self.truths[:1], joint=joint, holds=turned, names=self.names)[0]
        before, *after = np.split(slopes, n + 1)
        least = 1e-9 * np.max(np.abs(before), initial=1e-300)
        change = [np.max(np.abs(part - before), initial=0.0) for part in after]
        return [other for other in range(1, n + 1) if other != joint and change[other - 1] > least]

    def _candidates(
        self, joint: int, holds: Floats, shares: Sequence[float], *, only_extremes: bool = False
    ) -> JointCandidates:
        ways = sweeps(self.robot, joint, speeds(self.robot, joint, shares))
        ways = tuple(dict.fromkeys((ways[0], ways[-1]))) if only_extremes else ways
        return JointCandidates(joint, holds, ways, usable(self.collision, holds, ways))

    def _judging(self, joint: int, shares: tuple[float, float]) -> tuple[Sweep, ...]:
        """Two sweeps over parts of the range, at a fast and a slow speed."""
        fast, slow = (sweeps(self.robot, joint, speeds(self.robot, joint, (share,))) for share in shares)
        return fast[0], slow[min(1, len(slow) - 1)]

    def _opening_seconds(self) -> Floats:
        """(L,) s that it costs to go to the posture of each candidate, about."""
        middle, pace, table = home(self.robot), MOVE_SHARE * highest_speeds(self.robot), self.candidates
        away = [_OPENING * (np.max(np.abs(j.holds - middle) / pace, axis=1) + RAMP_TIME) for j in table.joints]
        return np.array([away[j - 1][k] for j, k in zip(table.joint, table.hold, strict=True)])

    def _optimum(self, budget: float) -> ContinuousDesign:
        """The continuous optimum; parameters that even it leaves unknown count no longer."""
        # By the geometric mean: the worst of what stays unknown would take the time of all others.
        plain = Criterion(0.0, self.sizes, np.ones(len(self.sizes), dtype=bool))
        optimum = continuous_design(self.candidates, plain, budget)
        errors = plain.errors(self.candidates.information(optimum.counts))
        counted = np.median(errors, axis=0) <= self.sizes
        counted |= not counted.any()
        self.hopeless = tuple(np.array(self.candidates.names)[~counted].tolist())
        if not self.hopeless and self.criterion.power == 0.0:
            return optimum
        self.criterion = replace(self.criterion, counted=counted)
        return continuous_design(self.candidates, self.criterion, budget)

    def _coverages(self) -> list[Coverage]:
        """What every joint may get at least, the most first."""
        request, many = self.request, 2
        if request.seconds is not None:
            many = int(np.clip(round(request.seconds / (_PASS * self.robot.n_joints)), 2, _MOST_PASSES))
        passes = request.passes or many
        out = [replace(item, postures=request.postures or item.postures, passes=passes) for item in COVERAGES]
        return out if request.passes else [*out, replace(out[-1], passes=1)]

    def _least_seconds(self, coverage: Coverage) -> float:
        """s that a coverage takes, about."""
        required = self._required(coverage, None)
        exchange = self._exchange(self.candidates, self._away, coverage.times, budget=math.inf)
        return exchange.cost(required) + self._judging_seconds(coverage)

    def _required(self, coverage: Coverage, optimum: ContinuousDesign | None) -> Counts:
        """(K L,) the coverage, its postures compared on top of the optimum's information or of an even plan's."""
        usual = _USUAL * self.robot.n_joints
        even = np.full(len(self.candidates), usual / float(np.sum(self.candidates.seconds)))
        background = _BACKGROUND * self.candidates.information(even if optimum is None else optimum.counts)
        # A share of the time is half that share of the criterion, a logarithm.
        haste = 0.5 * coverage.passes / (self.request.seconds or usual)
        return _cover(
            self.candidates,
            self.criterion,
            coverage,
            background=background,
            opening=haste * self._away,
            all_speeds=self.request.shares is not None,
        )

    def _exchange(
        self, candidates: CandidateInformation, away: Floats, times: Sequence[int], *, budget: float
    ) -> Exchange:
        often = np.asarray(times, dtype=float)[:, None]
        _, block = np.unique(1000 * candidates.joint + candidates.hold, return_inverse=True)
        blocks = np.concatenate([kind * (block.max() + 1) + block for kind in range(len(times))])
        objective = PlanObjective(candidates, self.criterion, tuple(times))
        return Exchange(objective, (often * candidates.seconds).ravel(), blocks, (often * away).ravel(), budget)

    def _chosen(self, required: Counts, coverage: Coverage, optimum: ContinuousDesign, *, allowed: float) -> Made:
        """Runs chosen on top of the coverage for `allowed` s, in order."""
        table = required.reshape(len(coverage.times), -1)
        pool = np.flatnonzero((optimum.worth > _WORTH) | table.any(axis=0))
        candidates = self.candidates.only(pool)
        budget = allowed - self._judging_seconds(coverage)
        exchange = self._exchange(candidates, self._away[pool], coverage.times, budget=budget)
        least = table[:, pool].ravel()
        counts = exchange.exchanged(
            exchange.filled(least),
            required=least,
            tell=lambda value: self.tell(f"exchanging runs: error {number(math.exp(value), 3)}"),
        )
        objective = PlanObjective(candidates, self.criterion, coverage.times)
        rng = np.random.default_rng([self.seed, 4])
        judged = self._judged(objective, counts, rng)
        passes = []
        for turn in range(coverage.passes):
            blocks = _blocks(candidates, counts.reshape(len(coverage.times), -1)[turn % len(coverage.times)])
            for joint, ways in enumerate(self.judging, start=1):
                if joint % min(2, coverage.passes) == turn:
                    blocks.append(Block(tuple(judged[joint - 1].tolist()), ways[: coverage.judged], "heldout"))
            passes.append(blocks)
        motions = schedule(self.robot, passes, collision=self.collision, rng=rng)
        efficiency = math.exp(optimum.bound - objective.value(counts))
        return Made(motions, objective, counts, judged, coverage, efficiency)

    def _judged(self, objective: PlanObjective, counts: Counts, rng: np.random.Generator) -> Floats:
        """(J, J) for each joint a free posture, one that no fit uses where there is one."""
        candidates, out = objective.candidates, []
        chosen = np.flatnonzero(counts.reshape(len(objective.times), -1).any(axis=0))
        for joint, ways in zip(self.candidates.joints, self.judging, strict=True):
            used = set(candidates.hold[chosen][candidates.joint[chosen] == joint.joint].tolist())
            free = np.flatnonzero(usable(self.collision, joint.holds, ways).all(axis=1)).tolist()
            options = [k for k in free if k not in used] or free or np.flatnonzero(joint.usable.any(axis=1)).tolist()
            out.append(joint.holds[int(rng.choice(options))])
        return np.array(out)

    def _judging_seconds(self, coverage: Coverage) -> float:
        """s of the runs that are kept for judging."""
        away = float(np.mean(self._away)) * len(self.judging)
        return away + sum(seconds_of(self.robot, sweep) for ways in self.judging for sweep in ways[: coverage.judged])

    def _too_short(self, budget: float, least: Coverage) -> ModelError:
        needed = self._least_seconds(least)
        return ModelError(
            "plan-too-short",
            f"{number(budget / 60.0)} minutes are too short: the least experiment that shows everything takes about"
            f" {math.ceil(needed / 6.0) / 10.0:g} minutes",
            mend=f"give --minutes {math.ceil(needed / 60.0)} or more, or fewer postures, replicates or faster speeds",
        )


def _blocks(candidates: CandidateInformation, counts: Counts) -> list[Block]:
    """Candidates, each made `counts` (L,) times, gathered by joint and posture."""
    gathered: dict[tuple[int, tuple[float, ...]], list[Sweep]] = {}
    for place in np.repeat(np.arange(len(counts)), counts).tolist():
        candidate = candidates.candidate(place)
        gathered.setdefault((candidate.joint, candidate.hold), []).extend(candidate.sweeps)
    return [Block(hold, tuple(ways)) for (_, hold), ways in gathered.items()]


def _cover(
    candidates: CandidateInformation,
    criterion: Criterion,
    coverage: Coverage,
    *,
    background: Floats,
    opening: Floats,
    all_speeds: bool,
) -> Counts:
    """(K L,) the candidates of a coverage for each kind of pass, in the postures that tell most.

    Postures are compared on top of the information `background` (G, p, p); `opening` (L,) is by how much the criterion
    could fall in the time that it takes to go to each one.
    """
    counts = np.zeros((len(coverage.times), len(candidates)), dtype=np.int64)
    for joint in candidates.joints:
        taken: set[int] = set()
        for place, ways in enumerate(_covering(joint, coverage, all_speeds=all_speeds)):
            options = [k for k in range(len(joint.holds)) if k not in taken and joint.usable[k, ways].any()]
            options = [k for k in options if joint.usable[k, ways].all()] or options
            if not options:
                break
            made = [[c for w in ways if (c := candidates.find(joint.joint, k, w)) is not None] for k in options]
            gathered = np.array([candidates.each(sets).sum(axis=0) for sets in made])
            values = criterion.value(background + sum(coverage.times) * gathered)
            values = values + opening[[sets[0] for sets in made]]
            best = int(np.argmin(rounded(values)))
            taken.add(options[best])
            kinds = len(coverage.times) if place < coverage.whole else 1
            counts[:kinds, made[best]] += 1
            background = background + sum(coverage.times[:kinds]) * gathered[best]
    return counts.ravel()


def _covering(joint: JointCandidates, coverage: Coverage, *, all_speeds: bool) -> list[list[int]]:
    """The sweeps (numbers) of each posture of a joint."""
    at = sorted({sweep.speed for sweep in joint.sweeps})
    slower = _spread(at[:-1])
    count = max(1, math.ceil(((len(at) if all_speeds else SPEEDS) - 1) / coverage.postures))
    out = []
    for place in range(coverage.postures):
        # The first posture gets one speed more, so that slow and middle come in every pass.
        more = int(coverage.middle)
        turns = range(place * count + min(place, more), (place + 1) * count + more)
        chosen = dict.fromkeys(slower[turn % len(slower)] for turn in turns) if slower else {}
        ways = [_part(joint.sweeps, speed, coverage.part, place=place) for speed in chosen]
        if place < coverage.whole or not ways:
            ways.append(_tour(joint.sweeps, place))
        out.append(ways)
    return out


def _spread(rising: Sequence[float]) -> list[float]:
    """Slowest first, then from the middle, so that a few of them lie far apart."""
    half = (len(rising) + 1) // 2
    pairs = zip(rising[:half], [*rising[half:], None], strict=False)
    return [speed for pair in pairs for speed in pair if speed is not None]


def _tour(ways: Sequence[Sweep], place: int) -> int:
    """The widest sweep at the highest speed, up first and down first in turns."""
    order = sorted(range(len(ways)), key=lambda c: (-ways[c].speed, ways[c].low - ways[c].high, c))
    first = ways[order[0]]
    alike = [c for c in order if (ways[c].speed, ways[c].low, ways[c].high) == (first.speed, first.low, first.high)]
    return alike[place % len(alike)]


def _part(ways: Sequence[Sweep], speed: float, seconds: float, *, place: int) -> int:
    """The sweep at this speed that lasts nearest to `seconds`; parts above and below home take turns."""
    off = {c: abs(math.log((way.high - way.low) / speed / seconds)) for c, way in enumerate(ways) if way.speed == speed}
    alike = [c for c, distance in off.items() if distance <= min(off.values()) + 1e-9]
    return alike[place % len(alike)]
