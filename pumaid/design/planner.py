"""From prior robots and a time budget to motions: coverage, then greedy choice and exchange, then their order.

A coverage is what every joint gets whatever it tells, since diagnosis needs it: postures, speeds, whole ranges,
replicates.
"""

import itertools
import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pumaid.design.candidate_runs import SHARES, Block, Collision, Sweep, free_blocks, home, postures, speeds, sweeps
from pumaid.design.information import (
    CandidateInformation,
    ContinuousDesign,
    Criterion,
    Exchange,
    Prior,
    candidate_information,
    continuous_design,
    existing_names,
    rounded,
)
from pumaid.errors import ModelError, Where
from pumaid.maths import Counts, Floats
from pumaid.model import minimal
from pumaid.robot import Robot
from pumaid.trajectory import MOVE_SHARE, RAMP_TIME, Motion, Plan, Posture, duration, highest_speeds
from pumaid.units import number

#: Different speeds of a joint at least: three tell a straight line from a bend, the fourth which bend.
SPEEDS = 4
#: Postures of a joint where time is not short: what depends on load or place shows between them.
POSTURES = 4
#: s a joint that a pass takes about: longer budgets are filled with more passes, up to so many.
_PASS, _MOST_PASSES = 200.0, 20
#: s a joint where no time is given, and s of a run over part of the range in a coverage.
_USUAL, _PART = 210.0, 0.8
#: s between blocks, as a share of the way from home.
_OPENING = 0.8
#: Share of the best candidate's worth a second below which candidates are not looked at.
_WORTH = 0.6
#: Rounds of fitting a plan into its time, and the share of the time that is enough.
_FITTINGS, _FULL = 5, 0.98
#: Share of an even plan's information on top of which postures of the coverage are compared.
_BACKGROUND = 0.5
#: Random postures a joint, and how many times that are drawn where the recipe forbids some.
_DRAWN, _MORE = 20, 4
#: A posture serves a parameter whose error grows by this factor without it; from the second on it is lost. Parameters
#: that are named of a posture, at most.
_SERVES, _LOST, _NAMED = 1.15, 1e3, 3
#: Information on gravity below this is rounding.
_CARRIES = 1e-6


@dataclass(frozen=True, slots=True)
class Coverage:
    """How much every joint gets at least."""

    postures: int
    whole: int  # postures with a run over the whole range at top speed, in every pass; others come in every second
    share: float  # of the time, that it may take
    passes: int = 2  # how often the arm is gone through

    @property
    def rounds(self) -> float:
        """How often a candidate is made that is counted once: in every second pass where there are several."""
        return max(1.0, 0.5 * self.passes)


#: The most first.
COVERAGES = (Coverage(4, 4, 0.4), Coverage(4, 2, 0.4), Coverage(4, 1, 0.9), Coverage(3, 1, 0.9), Coverage(2, 1, 0.9))


class Planner:
    """Makes plans for one arm, which may be any of the prior robots; the same seed makes the same plan.

    `seconds` are those of the robot, moves included, `shares` speeds as shares of each joint's top speed, `postures`
    those of a joint, `passes` how often the arm is gone through; None where the planner decides. `names` are the
    gravity parameters and ratios that the arm has.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        prior: Prior,
        seed: int,
        tell: Callable[[str], None],
        seconds: float | None = None,
        shares: Sequence[float] | None = None,
        postures: int | None = None,
        passes: int | None = None,
    ) -> None:
        self.robot, self.prior, self.seed, self.tell = robot, prior, seed, tell
        self.seconds, self.shares, self.postures, self.passes = seconds, shares, postures, passes
        self.structure, self.collision = minimal(robot), Collision(robot)
        self.names = existing_names(robot, self.structure)
        tell("choosing postures")
        rng = np.random.default_rng([seed, 3])
        shares = sorted(shares or SHARES)
        blocks, self.judging = list[Block](), list[Block]()
        for joint in range(1, self.robot.n_joints + 1):
            parts = self._free(joint, shares, rng)
            # Runs for judging have speeds, and where there are enough a posture, that no fitted run has.
            between = (math.sqrt(shares[0] * shares[1]), math.sqrt(shares[-2] * shares[-1]))
            holds = np.array([part[0].hold for part in parts[POSTURES:] or parts])
            ways = sweeps(self.robot, joint, speeds(self.robot, joint, between))
            if judged := free_blocks(self.collision, holds, ways):
                hold = judged[-1].hold
                chosen = {block.sweeps[0].speed: block.sweeps[0] for block in judged[::-1] if block.hold == hold}
                self.judging.append(Block(hold, tuple(chosen.values()), "heldout"))
                parts = [part for part in parts if part[0].hold != hold or len(parts) <= POSTURES]
            blocks += [block for part in parts for block in part]
        self.candidates = candidate_information(prior.robots, blocks, names=self.names)
        pace = MOVE_SHARE * highest_speeds(self.robot)
        away = np.abs(np.array([block.hold for block in blocks]) - home(self.robot)) / pace
        self._away = _OPENING * (np.max(away, axis=1) + RAMP_TIME)
        sizes = self.prior.typical_sizes()
        self.sizes = np.array([sizes[name] for name in self.candidates.names])
        self.criterion = Criterion(self.sizes, np.ones(len(self.sizes), dtype=bool))

    def plan(self) -> Plan:
        """The plan that is asked for, without what it promises.

        Raises
        ------
        ModelError [plan-too-short]
            The least experiment that shows everything takes longer.
        """
        self.tell("choosing runs")
        many = 2
        if self.seconds is not None:
            many = int(np.clip(round(self.seconds / (_PASS * self.robot.n_joints)), 2, _MOST_PASSES))
        least = {"passes": self.passes or many} | ({"postures": self.postures} if self.postures else {})
        coverages = [replace(coverage, **least) for coverage in COVERAGES]
        coverages += [] if self.passes else [replace(coverages[-1], passes=1)]
        usual = coverages[1]
        budget = self.seconds or max(
            _USUAL * self.robot.n_joints, usual.rounds * self._seconds(self._cover(usual)) / usual.share
        )
        optimum = self._optimum(budget)
        for coverage in coverages:
            required = self._cover(coverage)
            needed = coverage.rounds * self._seconds(required)
            if needed <= coverage.share * budget:
                break
        best: Plan | None = None
        allowed = budget
        for _ in range(_FITTINGS):
            made = self._chosen(required, coverage, optimum, allowed=allowed)
            if made.duration <= budget and (best is None or (made.efficiency or 0.0) > (best.efficiency or 0.0)):
                best = made
            if _FULL * budget <= made.duration <= budget:
                break
            allowed += 0.99 * budget - made.duration
        if best is not None:
            return best
        raise ModelError(
            "plan-too-short",
            f"{number(budget / 60.0)} minutes are too short: the least experiment that shows everything takes about"
            f" {math.ceil(needed / 6.0) / 10.0:g} minutes",
            mend=f"give --minutes {math.ceil(needed / 60.0)} or more, or fewer postures, replicates or faster speeds",
        )

    def efficiency(self, promised: dict[str, float], seconds: float) -> float | None:
        """Best conceivable error in some s as a share of promised errors; None where a parameter is not shown."""
        if seconds <= 0.0:
            return None
        bound = self._optimum(seconds).bound
        counted = np.array(self.candidates.names)[self.criterion.counted].tolist()
        if any(name not in promised for name in counted):
            return None
        errors = np.log([promised[name] for name in counted]) - np.log(self.sizes[self.criterion.counted])
        return float(np.exp(bound - errors.mean()))

    def _free(self, joint: int, shares: Sequence[float], rng: np.random.Generator) -> list[list[Block]]:
        """Candidates of a joint in each of many postures in which it can run."""
        count, robot = max(_DRAWN, (self.postures or 0) + 1), self.robot
        drawn = count if self.collision.is_free else _MORE * count
        holds = postures(robot, joint, count=drawn, rng=rng)
        ways = sweeps(robot, joint, speeds(robot, joint, shares))
        parts = [free_blocks(self.collision, hold[None], ways) for hold in holds]
        if free := [part for part in parts if part]:
            return free[:count]
        moving, name = np.arange(robot.n_joints) == joint - 1, robot.joint(joint).name
        start, end = (np.where(moving, place, holds[0]) for place in (ways[0].low, ways[0].high))
        hit = self.collision.first_hit(start, end)
        why = "" if hit is None else f"; at home: {hit}"
        raise ModelError(
            "plan-unsafe",
            f"joint {joint} ({name}) collides in all of {len(holds)} postures of the others{why}",
            Where(joint=joint),
            "widen the limits, or correct the recipe's boxes and spheres",
        )

    def _optimum(self, budget: float) -> ContinuousDesign:
        """The continuous optimum; parameters that even it leaves unknown count no longer."""
        whole = Criterion(self.sizes, np.ones(len(self.sizes), dtype=bool))
        optimum = continuous_design(self.candidates, whole, budget)
        errors = whole.errors(self.candidates.information(optimum.counts))
        counted = np.median(errors, axis=0) <= self.sizes
        self.criterion = replace(whole, counted=counted | (not counted.any()))
        return optimum if counted.all() else continuous_design(self.candidates, self.criterion, budget)

    def _seconds(self, counts: Counts) -> float:
        """s of a round in which each candidate is made `counts` (L,) times, about, with the runs for judging."""
        lasting = sum(duration(self.robot, Plan(self.robot.name, block.motions)) for block in self.judging)
        away = float(np.mean(self._away)) * len(self.judging)
        return Exchange(self.candidates, self.criterion, self._away, math.inf).cost(counts) + lasting + away

    def _cover(self, coverage: Coverage) -> Counts:
        """(L,) how often each candidate is made in a round of a coverage, in the postures that tell most."""
        table, usual = self.candidates, self.seconds or _USUAL * self.robot.n_joints
        even = np.full(len(table), _BACKGROUND * usual / float(np.sum(table.seconds)))
        information, counts = table.information(even), np.zeros(len(table), dtype=np.int64)
        # A share of the time is half that share of the criterion, a logarithm.
        opening = 0.5 * coverage.passes / usual * self._away
        for joint in self.robot.joints:
            places = {k: block.sweeps[0] for k, block in enumerate(table.blocks) if block.joint == joint.number}
            posture = dict(zip(places, table.posture[list(places)].tolist(), strict=True))
            free = dict.fromkeys(posture.values())
            for place, ways in enumerate(self._covering(list(dict.fromkeys(places.values())), coverage)):
                options = [[k for k, way in places.items() if posture[k] == at and way in ways] for at in free]
                fullest = max((len(made) for made in options), default=0)
                options = [made for made in options if made and len(made) == fullest]
                if not options:
                    break
                gathered = coverage.passes * np.array([table.each(np.array(made)).sum(axis=0) for made in options])
                values = self.criterion.value(information + gathered)
                best = int(np.argmin(rounded(values + opening[[made[0] for made in options]])))
                del free[posture[options[best][0]]]
                counts[options[best]] += min(coverage.passes, 2) if place < coverage.whole else 1
                information = information + gathered[best]
        return counts

    def _covering(self, ways: Sequence[Sweep], coverage: Coverage) -> Iterator[list[Sweep]]:
        """The sweeps of each posture of a joint: parts of the range at slower speeds, and tours at the highest."""
        *rising, fast = sorted({sweep.speed for sweep in ways})
        half = (len(rising) + 1) // 2
        slower = [speed for k in range(half) for speed in rising[k::half]]  # so that a few of them lie far apart
        count = math.ceil(((len(rising) + 1 if self.shares else SPEEDS) - 1) / coverage.postures)
        fastest = [sweep for sweep in ways if sweep.speed == fast]
        widest = max(round(sweep.high - sweep.low, 9) for sweep in fastest)
        tours = [sweep for sweep in fastest if round(sweep.high - sweep.low, 9) == widest]
        for place in range(coverage.postures):
            chosen = list[Sweep]()
            turns = range(place * count, (place + 1) * count) if slower else ()
            for speed in dict.fromkeys(slower[turn % len(slower)] for turn in turns):
                parts = [sweep for sweep in ways if sweep.speed == speed]
                parts.sort(key=lambda sweep: round(abs((sweep.high - sweep.low) / sweep.speed - _PART), 6))
                chosen.append(parts[:2][place % len(parts[:2])])  # above and below home in turns
            if place < coverage.whole or not chosen:
                chosen.append(tours[place % len(tours)])
            yield chosen

    def _chosen(self, required: Counts, coverage: Coverage, optimum: ContinuousDesign, *, allowed: float) -> Plan:
        """Runs chosen on top of the coverage for `allowed` s, in order."""
        passes, rounds = coverage.passes, coverage.rounds
        pool = np.flatnonzero((optimum.worth > _WORTH) | (required > 0))
        part = self.candidates.only(pool)
        table = replace(part, seconds=rounds * part.seconds, squares=rounds * part.squares)
        judging = self._seconds(np.zeros(len(self.candidates), dtype=np.int64))
        exchange = Exchange(table, self.criterion, 1.5 * rounds * self._away[pool], allowed - judging)
        counts = exchange.exchanged(
            exchange.filled(required[pool]),
            required=required[pool],
            tell=lambda value: self.tell(f"exchanging runs: error {number(math.exp(value), 3)}"),
        )
        orders = []
        for turn in range(passes):
            judged = [block for k, block in enumerate(self.judging) if k % passes == turn]
            blocks = [replace(block, sweeps=block.sweeps[: min(2, coverage.whole)]) for block in judged]
            for posture in np.unique(table.posture[counts > 0]):
                places = np.flatnonzero(table.posture == posture)
                times = counts[places] if passes == 1 else (counts[places] + (turn + posture) % 2) // 2
                if times.any():
                    ways = tuple(table.blocks[k].sweeps[0] for k in np.repeat(places, times))
                    blocks.append(Block(table.blocks[places[0]].hold, ways))
            orders.append(blocks)
        rng = np.random.default_rng([self.seed, 4])
        motions = schedule(self.robot, orders, collision=self.collision, rng=rng)
        bare = Plan(self.robot.name, motions, tuple(self._reasons(table, counts)), seed=self.seed)
        efficiency = math.exp(optimum.bound - exchange.value(counts))
        return replace(bare, duration=duration(self.robot, bare), efficiency=efficiency)

    def _reasons(self, candidates: CandidateInformation, counts: Counts) -> Iterator[Posture]:
        """Every posture of a plan with the parameters that it serves; those for judging come last of each joint."""
        before = self.criterion.errors(candidates.information(counts))
        for joint in self.robot.joints:
            label = f"joint {joint.number} ({joint.name})"
            numbers = [k for k in np.flatnonzero(counts) if candidates.blocks[k].joint == joint.number]
            shown = candidates.information(np.isin(np.arange(len(counts)), numbers).astype(float))[:, : len(self.names)]
            carries = bool(np.any(shown[..., : len(self.names)] > _CARRIES))
            for posture in np.unique(candidates.posture[numbers]):
                is_here = candidates.posture == posture
                errors = self.criterion.errors(candidates.information(np.where(is_here, 0, counts)))
                growth = np.median(errors / before, axis=0)[: len(self.names)].tolist()
                rises = [(-round(rise, 6), name) for name, rise in zip(self.names, growth, strict=True)]
                rises = [(rise, name) for rise, name in sorted(rises)[:_NAMED] if -rise >= _SERVES]
                sizes = (f"{-rise:.2g} times as large" if -rise < _LOST else "without end" for rise, _ in rises)
                parts = [f"{name} {size}" for (_, name), size in zip(rises, sizes, strict=True)]
                why = "adds a load that differs from that of the other postures"
                if not carries:
                    why = f"{label} carries no weight that can be told from friction: its runs are for friction"
                elif parts:
                    why = f"without it the error of {', '.join(parts)}"
                hold = candidates.blocks[int(np.argmax(is_here))].hold
                yield Posture(joint.number, hold, tuple(name for _, name in rises), why)
            why = f"{label} is judged here, at speeds that no fit uses"
            yield from (Posture(b.joint, b.hold, (), why) for b in self.judging if b.joint == joint.number)


#: Random orders of a pass that are improved, and of which the shortest is taken.
_STARTS = 30
#: Rounds in which orders avoid the moves that were found to strike something.
_ROUNDS = 60
#: s that a move costs which strikes something.
_STRUCK = 1e6
#: Passes up to which each joint's highest speed is asked for early.
_FEW = 2


def schedule(
    robot: Robot, passes: Sequence[Sequence[Block]], *, collision: Collision, rng: np.random.Generator
) -> tuple[Motion, ...]:
    """Motions in the order in which they are made.

    Each pass has its own order, so that replicates are a pass apart: the shortest of thirty random orders after each
    block has been moved to its best place. Of few passes the first begins with the fastest block of every joint, since
    what changes with time and what changes with speed look alike where slow runs come early and fast ones late.

    Raises
    ------
    ModelError [plan-unsafe]
        A posture cannot be reached without a collision.
    """
    parts = list(passes)
    if 0 < len(passes) <= _FEW and collision.is_free:  # with obstacles, fewer blocks at a time leave fewer free ways
        fits = [block for block in passes[0] if block.purpose == "fit"]
        fits.sort(key=lambda block: max(sweep.speed for sweep in block.sweeps))
        fastest = {block.joint: block for block in fits}
        is_first = [block is fastest.get(block.joint) for block in passes[0]]
        halves = [[b for b, first in zip(passes[0], is_first, strict=True) if first is half] for half in (True, False)]
        parts = [*halves, *passes[1:]]
    parts = [part for part in parts if part]
    out: list[Motion] = []
    now: Sequence[float] | None = None
    for part, later in zip(parts, [*parts[1:], []], strict=True):
        order = _shortest(robot, part, [now, *(block.hold for block in later)], collision=collision, rng=rng)
        for block in (part[k] for k in order):
            shuffled = tuple(block.sweeps[k] for k in rng.permutation(len(block.sweeps)))
            out += replace(block, sweeps=shuffled).motions
        now = part[order[-1]].hold
    return tuple(out)


def _shortest(
    robot: Robot,
    blocks: Sequence[Block],
    around: Sequence[Sequence[float] | None],
    *,
    collision: Collision,
    rng: np.random.Generator,
) -> list[int]:
    """The shortest order of B blocks whose moves are free of collisions.

    `around` are the posture in which the arm stands (None: in any) and those to one of which it goes afterwards.
    """
    count, (now, *later) = len(blocks), around
    places = np.array([*(block.hold for block in blocks), blocks[0].hold if now is None else now])
    # s of moves between blocks, from the start (node B) and to the end (node B + 1), which costs nothing. To the
    # microsecond: an order and its reverse take equally long, and rounding must not choose between them.
    cost, pace = np.zeros((count + 2, count + 2)), MOVE_SHARE * highest_speeds(robot)
    cost[:-1, :-1] = np.round(np.max(np.abs(places[:, None] - places) / pace, axis=2), 6)
    cost[count] *= now is not None
    struck, hit = Counter[int](), ""

    def first_hit(before: int, after: int) -> str | None:
        ends = [places[after]] if after <= count else [np.array(place) for place in later]
        hits = [collision.first_hit(places[before], end) for end in ends]
        return hits[0] if hits and all(hits) else None

    def length(path: Sequence[int]) -> float:
        return round(float(np.sum(cost[path[:-1], path[1:]])), 6)

    for _ in range(1 if collision.is_free else _ROUNDS):
        paths = [_improved(cost, rng.permutation(count).tolist()) for _ in range(_STARTS)]
        for path in sorted(paths, key=length):
            if length(path) >= _STRUCK:
                continue
            moves = list(itertools.pairwise(path if now is not None else path[1:]))
            for move, where in {move: where for move in moves if (where := first_hit(*move))}.items():
                cost[move], hit = _STRUCK, where
                before, after = move
                struck[after if after <= count else before] += 1
            if length(path) < _STRUCK:
                return path[1:-1]
    ((block, _),) = struck.most_common(1)
    raise ModelError(
        "plan-unsafe",
        f"no way leads to or from a posture of joint {blocks[block].joint} without a collision: {hit}",
        Where(joint=blocks[block].joint),
        "narrow the limits, give fewer postures, or correct the recipe's boxes and spheres",
    )


def _improved(cost: Floats, order: list[int]) -> list[int]:
    """The path from the start over all blocks to the end, each put where it makes the way shortest, twice."""
    start, end = len(order), len(order) + 1
    for block in 2 * list(order):
        rest = [k for k in order if k != block]
        before, after = [start, *rest], [*rest, end]
        place = int(np.argmin(np.round(cost[before, block] + cost[block, after] - cost[before, after], 6)))
        order = [*rest[:place], block, *rest[place:]]
    return [start, *order, end]
