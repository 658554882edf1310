"""Plan an experiment, or say what a given plan promises, with what the user should know of it.

From prior robots and a time budget to motions: coverage, then greedy choice and exchange, then their order. A coverage
is what every joint gets whatever it tells, since diagnosis needs it: postures, speeds, whole ranges, replicates.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from pumaid.design.candidate_runs import (
    SHARES,
    Block,
    NoWay,
    Sweep,
    free_blocks,
    home,
    postures,
    schedule,
    speeds,
    sweeps,
)
from pumaid.design.collision import TOLERANCE, Collision
from pumaid.design.information import (
    RATE,
    CandidateInformation,
    ContinuousDesign,
    Criterion,
    Exchange,
    Prior,
    absent_names,
    candidate_information,
    parameter_names,
    predicted_errors,
    prior_robots,
    rounded,
    shown_names,
    typical_sizes,
)
from pumaid.errors import ModelError, Note, Where
from pumaid.estimate import Estimate
from pumaid.maths import Counts
from pumaid.preprocessing.binning import DEFAULTS
from pumaid.robot import Payload, Robot
from pumaid.trajectory import MOVE_SHARE, RAMP_TIME, Plan, Posture, duration, highest_speeds, span, trapezoids
from pumaid.units import factor, number

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
#: Postures that are given up at most because no free way leads to them.
_LEFT_OUT = 8
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

    `seconds` are those of the robot, moves included; None where the planner decides. `names` are the gravity parameters
    and ratios that the arm has.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        prior: Prior,
        seed: int,
        tell: Callable[[str], None],
        seconds: float | None = None,
    ) -> None:
        self.robot, self.prior, self.seed, self.tell = robot, prior, seed, tell
        self.seconds = seconds
        self.names, self.collision = shown_names(robot), Collision(robot, spare=TOLERANCE)
        tell("choosing postures")
        rng = np.random.default_rng([seed, 3])
        blocks, self.judging = list[Block](), list[Block]()
        for joint in range(1, self.robot.n_joints + 1):
            parts = self._free(joint, rng)
            # Runs for judging have speeds, and where there are enough a posture, that no fitted run has.
            between = (math.sqrt(SHARES[0] * SHARES[1]), math.sqrt(SHARES[-2] * SHARES[-1]))
            holds = np.array([part[0].hold for part in parts[POSTURES:] or parts])
            if judged := free_blocks(
                self.collision, holds, sweeps(self.robot, joint, speeds(self.robot, joint, between))
            ):
                hold = judged[-1].hold
                chosen = {block.sweeps[0].speed: block.sweeps[0] for block in judged[::-1] if block.hold == hold}
                self.judging.append(Block(hold, tuple(chosen.values()), "heldout"))
                parts = [part for part in parts if part[0].hold != hold or len(parts) <= POSTURES]
            blocks += [block for part in parts for block in part]
        self.candidates = candidate_information(prior.robots, blocks, names=self.names)
        pace = MOVE_SHARE * highest_speeds(self.robot)
        away = np.abs(np.array([block.hold for block in blocks]) - home(self.robot)) / pace
        self._away = _OPENING * (np.max(away, axis=1) + RAMP_TIME)
        tables = [truth.parameters() for truth in prior.robots]
        sizes = typical_sizes(tables, {name: name.split(".")[0] for name in tables[0]})
        self.sizes = np.array([sizes[name] for name in self.candidates.names])
        self.whole = self.criterion = Criterion(self.sizes, np.ones(len(self.sizes), dtype=bool))

    def plan(self) -> Plan:
        """The plan that is asked for, without what it promises and postures to which no free way was found.

        Raises
        ------
        ModelError [plan-too-short]
            The least experiment that shows everything takes longer.
        NoWay [plan-unsafe]
            Too many postures cannot be reached.
        """
        for _ in range(_LEFT_OUT):
            try:
                return self._planned()
            except NoWay as error:
                blocks, stuck = self.candidates.blocks, error.hold
                free = np.flatnonzero([block.hold != stuck for block in blocks])
                if len({blocks[place].joint for place in free}) < self.robot.n_joints:
                    raise
                self.candidates, self._away = self.candidates.only(free), self._away[free]
                self.judging = [block for block in self.judging if block.hold != stuck]
        return self._planned()

    def _planned(self) -> Plan:
        self.tell("choosing runs")
        many = int(np.clip(round((self.seconds or 0.0) / (_PASS * self.robot.n_joints)), 2, _MOST_PASSES))
        coverages = [*(replace(coverage, passes=many) for coverage in COVERAGES), replace(COVERAGES[-1], passes=1)]
        usual = coverages[1]
        budget = self.seconds or max(
            _USUAL * self.robot.n_joints, usual.rounds * self._seconds(self._cover(usual)) / usual.share
        )
        optimum = ContinuousDesign(self.candidates, self.whole, budget)
        # Parameters that even the continuous optimum leaves unknown count no longer.
        counted = np.median(self.whole.errors(self.candidates.information(optimum.counts)), axis=0) <= self.sizes
        self.criterion = replace(self.whole, counted=counted | (not counted.any()))
        optimum = optimum if counted.all() else ContinuousDesign(self.candidates, self.criterion, budget)
        for coverage in coverages:
            required = self._cover(coverage)
            needed = coverage.rounds * self._seconds(required)
            if needed <= coverage.share * budget:
                break
        best: Plan | None = None
        lowest, allowed = math.inf, budget
        for _ in range(_FITTINGS):
            made, value = self._chosen(required, coverage, optimum, allowed=allowed)
            if made.duration <= budget and value < lowest:
                best, lowest = made, value
            if _FULL * budget <= made.duration <= budget:
                break
            allowed += 0.99 * budget - made.duration
        if best is not None:
            return best
        raise ModelError(
            "plan-too-short",
            f"{number(budget / 60.0)} minutes are too short: the least experiment that shows everything takes about"
            f" {math.ceil(needed / 6.0) / 10.0:g} minutes",
            mend=f"give --minutes {math.ceil(needed / 60.0)} or more, or faster speeds in the recipe",
        )

    def _free(self, joint: int, rng: np.random.Generator) -> list[list[Block]]:
        robot, count = self.robot, _DRAWN if self.collision.is_free else _MORE * _DRAWN
        holds = postures(robot, joint, count=count, rng=rng)
        ways = sweeps(robot, joint, speeds(robot, joint, SHARES))
        if free := [part for hold in holds if (part := free_blocks(self.collision, hold[None], ways))]:
            # First those with a free way home, between which most ways are free.
            middle = home(robot)
            free.sort(key=lambda part: self.collision.first_hit(np.array(part[0].hold), middle) is not None)
            return free[:_DRAWN]
        moving, name = np.arange(robot.n_joints) == joint - 1, robot.joint(joint).name
        start, end = (np.where(moving, place, holds[0]) for place in (ways[0].low, ways[0].high))
        hit = self.collision.first_hit(start, end)
        why = "" if hit is None else f"; at home: {hit}"
        raise ModelError(
            "plan-unsafe",
            f"joint {joint} ({name}) collides in all of {len(holds)} postures of the others{why}",
            Where(joint=joint),
            "widen the limits, or correct the recipe's block safety",
        )

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
            for place, ways in enumerate(self._covering(Counter(places.values()), coverage)):
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

    def _covering(self, ways: Counter[Sweep], coverage: Coverage) -> Iterator[list[Sweep]]:
        """The sweeps of each posture of a joint: parts of the range at slower speeds, and tours at the highest.

        `ways` are its sweeps with the number of postures in which they are free.
        """
        *rising, fast = sorted({sweep.speed for sweep in ways})
        half = (len(rising) + 1) // 2
        slower = [speed for k in range(half) for speed in rising[k::half]]  # so that a few of them lie far apart
        count = math.ceil((SPEEDS - 1) / coverage.postures)
        fastest = [sweep for sweep in ways if sweep.speed == fast]
        enough = min(coverage.whole, max(ways[sweep] for sweep in fastest))
        widest = max(round(sweep.high - sweep.low, 9) for sweep in fastest if ways[sweep] >= enough)
        tours = [sweep for sweep in fastest if round(sweep.high - sweep.low, 9) == widest]
        for place in range(coverage.postures):
            chosen = list[Sweep]()
            turns = range(place * count, (place + 1) * count) if slower else ()
            for speed in dict.fromkeys(slower[turn % len(slower)] for turn in turns):
                parts = sorted(
                    (sweep for sweep in ways if sweep.speed == speed),
                    key=lambda sweep: round(abs((sweep.high - sweep.low) / sweep.speed - _PART), 6),
                )
                chosen.append(parts[:2][place % len(parts[:2])])  # above and below home in turns
            if place < coverage.whole or not chosen:
                chosen.append(tours[place % len(tours)])
            yield chosen

    def _chosen(
        self, required: Counts, coverage: Coverage, optimum: ContinuousDesign, *, allowed: float
    ) -> tuple[Plan, float]:
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
                    blocks.append(
                        Block(
                            table.blocks[places[0]].hold,
                            tuple(table.blocks[k].sweeps[0] for k in np.repeat(places, times)),
                        )
                    )
            orders.append(blocks)
        motions = schedule(self.robot, orders, collision=self.collision, rng=np.random.default_rng([self.seed, 4]))
        bare = Plan(self.robot.name, motions, tuple(self._reasons(table, counts)), seed=self.seed)
        return replace(bare, duration=duration(self.robot, bare)), exchange.value(counts)

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
                yield Posture(
                    joint.number, candidates.blocks[int(np.argmax(is_here))].hold, tuple(name for _, name in rises), why
                )
            why = f"{label} is judged here, at speeds that no fit uses"
            yield from (Posture(b.joint, b.hold, (), why) for b in self.judging if b.joint == joint.number)


#: Minutes of a plan at most.
_LONGEST = 1440.0
#: A standard error above this share of a ratio leaves it unknown.
_WEAK = 0.5
#: m off its axis at which a payload is suggested.
_LEVER = 0.1


def plan(
    robot: Robot,
    *,
    minutes: float | None = None,
    prior: Estimate | None = None,
    payload: Payload | None = None,
    seed: int = 0,
    tell: Callable[[str], None] = lambda _: None,
) -> Plan:
    """Plan runs that show every parameter which the arm has, as well as the time allows, within its limits.

    First comes what every joint gets in any case (postures, speeds, whole ranges, replicates, runs ``heldout`` for
    judging), then the runs that make the predicted standard errors smallest for their time, with exchanges.

    Parameters
    ----------
    robot, minutes
        The arm; time that it may take, moves included, about four a joint where not given.
    prior, payload, seed, tell
        An earlier model of the arm, else several robots drawn from the geometry are planned for at once; kg, x, y, z
        (m) of what the last link carries; same seed, same plan; called with a word on what is done.

    Raises
    ------
    ModelError [plan-too-short], [plan-impossible], [plan-unsafe]
        The least experiment takes longer; a number out of range; nothing can be run without a collision.

    Examples
    --------
    >>> from pumaid import read_recipe
    >>> plan(read_recipe("puma560"), minutes=12, seed=1).unseen["gravity.l1.x"][:20]
    'joint 1 (waist) turn'
    """
    check_minutes(minutes)
    planner = Planner(
        robot,
        seconds=None if minutes is None else 60.0 * minutes,
        prior=prior_robots(robot, estimate=prior, payload=payload, seed=seed),
        seed=seed,
        tell=tell,
    )
    made = planner.plan()
    return _with_forecast(made, planner.prior, lack_notes(robot, made))


def check_plan(
    robot: Robot,
    given: Plan,
    *,
    prior: Estimate | None = None,
    payload: Payload | None = None,
    seed: int = 0,
    tell: Callable[[str], None] = lambda _: None,
) -> Plan:
    """The runs of a plan, edited or written by hand, with what they promise and notes on all that asks for attention.

    Other parameters are those of `plan`.
    """
    tell("looking at the runs")
    assumed = prior_robots(robot, estimate=prior, payload=payload, seed=seed)
    checked = _with_forecast(given, assumed, [*collision_notes(robot, given), *lack_notes(robot, given)])
    notes, absent = checked.notes, absent_names(robot)
    if dark := [name for name in checked.unseen if name not in absent]:
        text = (
            f"no run of this plan shows {', '.join(dark)}; add postures in which the outer links' load differs, or"
            " other speeds; compare with: pumaid plan"
        )
        notes = (*notes, Note("plan-dark", text))
    return replace(checked, notes=notes)


def _with_forecast(bare: Plan, prior: Prior, notes: Iterable[Note]) -> Plan:
    arm = prior.robots[0].robot
    names = shown_names(arm)
    promised = predicted_errors(prior.robots, bare.motions, names)
    noted = replace(bare, notes=(*notes, *unusable_notes(arm, bare)), assumptions=())
    unseen = dict.fromkeys(parameter_names(arm, names), "no run of this plan shows it")
    return with_forecast(noted, prior, promised, unseen=unseen, absent=absent_names(arm))


def with_forecast(
    bare: Plan, prior: Prior, promised: dict[str, float], *, unseen: Mapping[str, str], absent: Mapping[str, str]
) -> Plan:
    """A plan with the errors that it promises, its duration, assumptions and notes.

    `absent` parameters no plan shows, `unseen` (name -> why) this one where it promises nothing of them.
    """
    robot = prior.robots[0].robot
    return replace(
        bare,
        expected=promised,
        unseen={**absent, **{name: why for name, why in unseen.items() if name not in promised}},
        duration=duration(robot, bare),
        assumptions=(*prior.sentences, *bare.assumptions, *conditions(robot)),
        notes=(*bare.notes, *needs(prior, promised, absent)),
    )


def check_minutes(minutes: float | None) -> None:
    """Refuse a time that no plan may have."""
    if minutes is not None and not 0.0 < minutes <= _LONGEST:
        raise ModelError(
            "plan-impossible",
            f"{minutes:g} minutes are out of range",
            mend=f"give a number above 0, and {_LONGEST:g} at most",
        )


def needs(prior: Prior, promised: Mapping[str, float], hidden: Mapping[str, str]) -> Iterator[Note]:
    """What would show more than is promised: weight off the last axis the last gain ratio, a tilted base what is hidden
    by an upright one.
    """
    robot = prior.robots[0].robot
    n = robot.n_joints
    name = f"gain_ratio.{n - 1}.{n}"
    if name in promised and robot.joint(n).is_revolute:
        share = promised[name] / abs(float(np.median([t.parameters()[name] for t in prior.robots])))
        if share >= _WEAK:
            place = np.round(np.array(robot.tip)[:3] @ (_LEVER, 0.0, 0.0, 1.0), 6) + 0.0
            yield Note(
                "plan-needs-weight",
                f"{name} cannot be identified with the weight that this arm has: its predicted error is"
                f" {number(share, 2)} times its value. A payload {1e3 * _LEVER:g} mm off the axis shows it: --payload"
                f" 0.5,{','.join(f'{part:.3g}' for part in place)}",
                Where(joint=n),
            )
    first = next((joint for joint in robot.joints if joint.is_revolute), None)
    if first is not None and np.any(robot.gravity) and any(f".l{first.number}." in name for name in hidden):
        yield Note(
            "plan-needs-tilt",
            f"{', '.join(hidden)} cannot be seen while joint {first.number} ({first.name}) turns about the vertical."
            " With the base tilted by some 10 deg they can: plan and identify with a recipe whose gravity says so",
            Where(joint=first.number),
        )


def unusable_notes(robot: Robot, given: Plan) -> Iterator[Note]:
    """Runs that are too short or too slow to be found in a log; one note a joint."""
    for joint in robot.joints:
        places = [
            place
            for place, motion in enumerate(given.motions, start=1)
            if motion.joint == joint.number
            and (abs(motion.end - motion.start) < DEFAULTS.min_travel or motion.velocity <= DEFAULTS.rest_speed)
        ]
        if places:
            unit = joint.position_unit
            yield Note(
                "plan-unusable",
                f"{len(places)} run(s) of joint {joint.number} ({joint.name}) will not be found in the logs: a run must"
                f" go over {DEFAULTS.min_travel:g} {unit} or more, faster than {DEFAULTS.rest_speed:g} {unit}/s; the"
                f" first is run {places[0]}. Give it more room (its limits in the recipe) or speed",
                Where(joint=joint.number, field=f"runs[{places[0]}]"),
            )


def collision_notes(robot: Robot, given: Plan) -> Iterator[Note]:
    """Runs, and moves between them, that strike something; one note of all that come too near to the same."""
    collision, hits = Collision(robot), dict[str, list[Note]]()
    for step in trapezoids(robot, given):
        if (hit := collision.first_hit(step.start, step.end)) is not None:
            way = f"the move from run {step.number - 1} to run" if step.motion is None else "run"
            joint = None if step.motion is None else step.motion.joint
            note = Note("plan-strikes", f"{way} {step.number}: {hit}", Where(joint=joint, field=f"runs[{step.number}]"))
            hits.setdefault(hit.split(" than ")[0], []).append(note)
    for first, *rest in hits.values():
        yield replace(first, text=first.text + f"; and so in {len(rest)} more runs and moves" * bool(rest))


def lack_notes(robot: Robot, given: Plan) -> Iterator[Note]:
    """What diagnosis would miss: postures, speeds, replicates, runs for judging."""
    for joint in robot.joints:
        runs = [motion for motion in given.motions if motion.joint == joint.number]
        fitted = [
            (tuple(np.round(np.delete(m.hold, m.joint - 1), 4)), round(m.velocity, 4), m.start, m.end)
            for m in runs
            if m.purpose == "fit"
        ]
        holds, speeds = ({run[k] for run in fitted} for k in (0, 1))
        lacks = [
            (f"{len(holds)} of {POSTURES} postures", len(holds) < POSTURES and robot.n_joints > 1),
            (f"{len(speeds)} of {SPEEDS} speeds", len(speeds) < SPEEDS),
            ("no run is made twice", len(set(fitted)) == len(fitted)),
            ("no run is kept for judging", len(runs) == len(fitted)),
        ]
        faults = [text for text, is_lacking in lacks if is_lacking] if runs else ["it never runs"]
        if faults:
            yield Note(
                "plan-lacks", f"joint {joint.number} ({joint.name}): {'; '.join(faults)}", Where(joint=joint.number)
            )


def conditions(robot: Robot) -> Iterator[str]:
    """What a forecast takes for granted of limits, speeds and surroundings."""
    yield f"{RATE:g} samples a second; ramps reach the highest speed in 0.4 s."
    yield Collision(robot).sentence
    for joint, top in zip(robot.joints, highest_speeds(robot), strict=True):
        unit, label = "deg" if joint.is_revolute else "m", f"Joint {joint.number} ({joint.name}) states no"
        if joint.limits is None:
            low, high = (end / factor(unit) for end in span(joint))
            yield f"{label} limits: {low:.4g}..{high:.4g} {unit} taken."
        if joint.max_velocity is None:
            yield f"{label} max_velocity: {top / factor(unit):.3g} {unit}/s taken."
