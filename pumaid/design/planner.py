"""From assumed robots and a time budget to motions: coverage, then what tells most, then order, then the clock."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.clearance import Clearance
from pumaid.design.compose import Draft
from pumaid.design.coverage import Extent, cover
from pumaid.design.criterion import POWERS, Criterion
from pumaid.design.laps import SHARES, Course, courses, free, seconds, speeds
from pumaid.design.menu import Menu, Ways, menu
from pumaid.design.outlook import RATE
from pumaid.design.postures import SHORTLIST, shortlist
from pumaid.design.relaxed import Relaxed, relaxed
from pumaid.design.timetable import Block, timetable
from pumaid.errors import ModelError
from pumaid.records import Motion, Plan
from pumaid.robot import Robot
from pumaid.simulation.ranges import reference
from pumaid.simulation.truth import Truth
from pumaid.trajectory import MOVE_SHARE, RAMP_TIME, duration, highest_speeds
from pumaid.units import number

Floats = NDArray[np.float64]

#: What every joint gets at least (postures, of them with whole spans, of them in every pass, s of parts, courses for
#: judging, a middle speed in every pass), and the share of the time that it may take: the first that takes no more, the
#: rest goes to what tells most.
_EXTENTS = (
    ((4, 4, 4, 2.0, 2, True), 0.4),
    ((4, 2, 2, 0.8, 2, True), 0.45),
    ((4, 1, 1, 0.8, 1, True), 0.6),
    ((4, 1, 1, 0.8, 1, False), 0.9),
    ((3, 1, 1, 0.8, 1, False), 0.9),
    ((2, 1, 1, 0.8, 1, False), 0.9),
)
#: s a joint that a pass takes about: longer budgets are filled with more passes, up to so many.
_PASS, _MOST_PASSES = 200.0, 20
#: s a joint where no time is given.
USUAL = 210.0
#: s between blocks at first, as a share of the way from the arm's reference posture; measured after a timetable.
_OPENING = 0.8
#: Share of the best lap's worth a second below which laps are not looked at.
_WORTH = 0.6
#: Rounds of fitting a plan into its time, and the share of the time that is enough.
_FITTINGS, _FULL = 5, 0.98
#: Share of the best experiment's information on which postures of the coverage are compared.
_GROUND = 0.5


@dataclass(frozen=True, slots=True)
class Wish:
    """What a user asks for; None where the planner decides.

    Attributes
    ----------
    seconds
        Robot time, moves included.
    shares
        Speeds, as shares of each joint's highest.
    postures, passes
        Postures a joint, and how often everything is made.
    criterion
        A key of `pumaid.design.criterion.POWERS`.
    """

    seconds: float | None = None
    shares: tuple[float, ...] | None = None
    postures: int | None = None
    passes: int | None = None
    criterion: str = "geometric"


@dataclass(frozen=True, eq=False, slots=True)
class Made:
    """A plan's motions, and what its reasons are made from.

    Attributes
    ----------
    motions
        In order.
    draft
        Laps of a pass.
    best
        The best conceivable experiment in the same time.
    judged
        (J, J) the posture in which each joint is judged.
    extent
        The coverage that was kept.
    """

    motions: tuple[Motion, ...]
    draft: Draft
    best: Relaxed
    judged: Floats
    extent: Extent

    @property
    def efficiency(self) -> float:
        """Predicted error of the best conceivable experiment as a share of this one's (0..1)."""
        return float(np.exp(self.best.bound - self.draft.value()))


class Planner:
    """Plans for one robot: what is worth a look is found once.

    Parameters
    ----------
    truths
        Assumed robots.
    names
        Gravity parameters and ratios that the arm has.
    size
        Name -> what is usual of it, SI.
    wish
        What is asked for.
    seed
        Same seed, same plan.
    tell
        Called with a word on what is done.
    """

    def __init__(
        self,
        truths: Sequence[Truth],
        names: Sequence[str],
        *,
        size: dict[str, float],
        wish: Wish,
        seed: int,
        tell: Callable[[str], None],
    ) -> None:
        self.truths, self.names, self.wish, self.seed, self.tell = truths, names, wish, seed, tell
        self.robot: Robot = truths[0].robot
        self.clearance = Clearance.of(self.robot)
        tell("looking for postures that tell something")
        rng = np.random.default_rng([seed, 3])
        count = max(SHORTLIST, wish.postures or 0)
        self.holds = shortlist(truths, names=names, clearance=self.clearance, rate=RATE, rng=rng, count=count)
        shares = tuple(sorted(wish.shares or SHARES))
        self.menu = self._menu(shares)
        self.judging, self._away = self._judging(shares), self._far()
        self.usual = np.array([size[name] for name in self.menu.names])
        self.criterion = Criterion(
            POWERS[wish.criterion], self.usual if POWERS[wish.criterion] else np.ones(len(self.usual))
        )
        self.hopeless: tuple[str, ...] = ()

    def _far(self) -> Floats:
        """(L,) s from the arm's reference posture to that of each lap."""
        home, pace = reference(self.robot), MOVE_SHARE * highest_speeds(self.robot)
        each = [np.max(np.abs(holds - home) / pace, axis=1) + RAMP_TIME for holds in self.holds]
        return np.array([each[j - 1][k] for j, k in zip(self.menu.joint, self.menu.hold, strict=True)])

    def _menu(self, shares: Sequence[float]) -> Menu:
        ways = []
        for joint, holds in zip(self.robot.joints, self.holds, strict=True):
            some = courses(self.robot, joint.number, speeds(self.robot, joint.number, shares))
            ways.append(Ways(joint.number, holds, some, free(self.clearance, holds, some)))
        return menu(self.truths, ways, names=self.names, rate=RATE)

    def _judging(self, shares: Sequence[float]) -> list[tuple[Course, ...]]:
        """For each joint two courses over parts of the span, at a fast and a slow speed that no fitted run has."""
        between = (math.sqrt(shares[-2] * shares[-1]), math.sqrt(shares[0] * shares[1]))
        found: list[tuple[Course, ...]] = []
        for joint in self.robot.joints:
            each = [courses(self.robot, joint.number, speeds(self.robot, joint.number, (share,))) for share in between]
            found.append((each[0][0], each[1][min(1, len(each[1]) - 1)]))
        return found

    def made(self) -> Made:
        """The plan that is asked for.

        Raises
        ------
        ModelError [plan-too-short]
            The least experiment that shows everything takes longer.
        """
        self.tell("sharing out the time")
        extents = self._extents()
        is_asked = self.wish.postures is not None or self.wish.passes is not None or self.wish.shares is not None
        usual, share = extents[0 if is_asked else 1]
        budget = self.wish.seconds or max(USUAL * self.robot.n_joints, self._least(usual) / share)
        best = self._best(budget)
        fitting = (one for one, share in extents if self._least(one) <= share * budget)
        extent = next(fitting, extents[-1][0])
        allowed, opening = budget, _OPENING
        kept: Made | None = None
        for _ in range(_FITTINGS):
            draft = self._filled(extent, allowed, opening, best)
            made = self._ordered(draft, extent, best)
            taken = self._duration(made.motions)
            if taken <= budget and (kept is None or draft.value() < kept.draft.value()):
                kept = made
            if _FULL * budget <= taken <= budget:
                break
            opening = self._opening(made)
            allowed += 0.99 * budget - taken
        if kept is None:
            raise self._too_short(budget, extents[-1][0])
        return kept

    def efficiency(self, promised: dict[str, float], budget: float) -> float | None:
        """Best conceivable error as a share of given errors; None where some are missing or nothing runs.

        Parameters
        ----------
        promised
            Name -> predicted standard error, SI.
        budget
            s that their runs take.
        """
        if budget <= 0.0:
            return None
        best = self._best(budget)
        counted = [name for name in self.menu.names if name not in self.hopeless]
        if any(name not in promised for name in counted):
            return None
        errors = np.array([promised[name] for name in counted])
        share = self.criterion.size if self.criterion.counted is None else self.criterion.size[self.criterion.counted]
        return float(np.exp(best.bound - np.mean(np.log(errors / share))))

    def _best(self, budget: float) -> Relaxed:
        """The best conceivable experiment; what even that leaves in the dark counts no longer."""
        # By the geometric mean: the worst of what stays dark whatever is done would starve all others.
        plain = Criterion(0.0, self.criterion.size)
        best = relaxed(self.menu, plain, seconds=self.menu.seconds, total=budget)
        share = np.median(plain.errors(self.menu.information(best.weights)), axis=0) / self.usual
        counted = share <= 1.0
        if not np.any(counted):
            counted[:] = True  # in so little time all stays dark, and no parameter is worth less than the others
        self.hopeless = tuple(name for name, light in zip(self.menu.names, counted, strict=True) if not light)
        if not self.hopeless and self.criterion.power == 0.0:
            return best
        self.criterion = replace(self.criterion, counted=counted)
        return relaxed(self.menu, self.criterion, seconds=self.menu.seconds, total=budget)

    def _extents(self) -> list[tuple[Extent, float]]:
        """What every joint may get at least, the most that is wanted first, and what share of the time it may take."""
        wish = self.wish
        many = 2
        if wish.seconds is not None:
            many = int(np.clip(round(wish.seconds / (_PASS * self.robot.n_joints)), 2, _MOST_PASSES))
        found = []
        for (postures, whole, again, part, judged, middle), share in _EXTENTS:
            passes = wish.passes or many
            one = Extent(wish.postures or postures, whole, again, part, passes=passes, judged=judged, middle=middle)
            found.append((one, share))
        last, share = found[-1]
        return [*found, *([] if wish.passes else [(replace(last, passes=1), share)])]

    def _least(self, extent: Extent) -> float:
        """s that the coverage alone takes, about."""
        return self._draft(extent, _OPENING).seconds() + self._judging_seconds(extent)

    def _draft(self, extent: Extent, opening: float, best: Relaxed | None = None) -> Draft:
        """The coverage alone."""
        usual = USUAL * self.robot.n_joints
        even = np.full(len(self.menu), usual / float(np.sum(self.menu.seconds)))
        pool = np.arange(len(self.menu)) if best is None else np.flatnonzero(best.worth > _WORTH)
        draft = Draft(self.menu, self.criterion, extent.times, opening * self._away, pool)
        ground = _GROUND * self.menu.information(even if best is None else best.weights)
        # A share of the time is half that share of the criterion, a logarithm.
        haste = 0.5 * extent.passes / (self.wish.seconds or usual)
        cover(draft, extent, ground, haste=haste, all_speeds=self.wish.shares is not None)
        return draft

    def _filled(self, extent: Extent, allowed: float, opening: float, best: Relaxed) -> Draft:
        draft = self._draft(extent, opening, best)
        running = allowed - self._judging_seconds(extent)
        self.tell("choosing runs")
        draft.fill(running)
        draft.exchange(running, lambda value: self.tell(f"exchanging runs: error {number(math.exp(value), 3)}"))
        return draft

    def _judging_seconds(self, extent: Extent) -> float:
        """s of the runs that are kept for judging."""
        away = float(np.mean(self._away)) * _OPENING
        running = sum(seconds(self.robot, course) for some in self.judging for course in some[: extent.judged])
        return float(running) + away * len(self.judging)

    def _ordered(self, draft: Draft, extent: Extent, best: Relaxed) -> Made:
        """Motions of a draft, in order; joints take turns in which pass they are judged."""
        rng = np.random.default_rng([self.seed, 4])
        judged = self._judged(draft, rng)
        passes: list[list[Block]] = []
        for number_of_pass in range(extent.passes):
            blocks = _blocks(draft, number_of_pass % len(draft.times))
            for joint, some in enumerate(self.judging, start=1):
                if joint % min(2, extent.passes) == number_of_pass:
                    hold = tuple(judged[joint - 1].tolist())
                    blocks.append(Block(joint, hold, some[: extent.judged], "heldout"))
            passes.append(blocks)
        motions = timetable(self.robot, passes, clearance=self.clearance, rng=rng)
        return Made(motions, draft, best, judged, extent)

    def _judged(self, draft: Draft, rng: np.random.Generator) -> Floats:
        """(J, J) for each joint a posture that no fit sees where there is one, of those that can be reached."""
        out = []
        for way, some in zip(self.menu.ways, self.judging, strict=True):
            used = {hold for joint, hold in map(draft.menu.block_of, draft.laps(0)) if joint == way.joint}
            ways = free(self.clearance, way.holds, some).all(axis=1)
            others = [k for k in np.flatnonzero(ways).tolist() if k not in used]
            options = others or np.flatnonzero(way.usable.any(axis=1)).tolist()
            out.append(way.holds[int(rng.choice(options))])
        return np.array(out)

    def _duration(self, motions: Sequence[Motion]) -> float:
        return duration(self.robot, Plan(robot=self.robot.name, motions=tuple(motions)))

    def _opening(self, made: Made) -> float:
        """Time between blocks as it came out, as a share of that from the reference posture to each."""
        running = sum(self._duration([motion]) for motion in made.motions)
        nominal = 0.0
        for kind, often in enumerate(made.draft.times):
            opened = {self.menu.block_of(lap): float(self._away[lap]) for lap in made.draft.laps(kind)}
            nominal += often * sum(opened.values())
        nominal += float(np.mean(self._away)) * len(self.judging)
        return max(self._duration(made.motions) - running, 0.0) / nominal

    def _too_short(self, budget: float, least: Extent) -> ModelError:
        draft = self._draft(least, _OPENING)
        needed = self._duration(self._ordered(draft, least, Relaxed(np.zeros(0), 0.0, 0.0, np.zeros(0))).motions)
        return ModelError(
            "plan-too-short",
            f"{number(budget / 60.0)} minutes are too short: the least experiment that shows everything takes"
            f" {math.ceil(needed / 6.0) / 10.0:g} minutes",
            mend=f"give --minutes {math.ceil(needed / 60.0)} or more, or fewer postures, replicates or faster speeds",
        )


def _blocks(draft: Draft, kind: int) -> list[Block]:
    """The laps of a kind of pass, gathered by joint and posture."""
    found: dict[tuple[int, int], list[Course]] = {}
    for lap in draft.laps(kind):
        found.setdefault(draft.menu.block_of(lap), []).append(draft.menu.course_of(lap))
    return [
        Block(joint, tuple(draft.menu.of(joint).holds[hold].tolist()), tuple(some))
        for (joint, hold), some in sorted(found.items())
    ]
