"""Checks of logs that do not mean what the recipe says: running statistics, and a table of slug, test, message and fix.

Each test looks at the statistics of one file, or of all, and yields the figures of each finding.
"""

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, Self

import numpy as np

from pumaid.dataset import Log, finite_means
from pumaid.errors import LogError, Note, Where
from pumaid.maths import Counts, Flags, Floats
from pumaid.preprocessing.encodings import CLASSES, leaps, lost_sign, size_counts
from pumaid.robot import Joint, Robot
from pumaid.units import UNITS, factor, number

#: What a test yields: figures of the message, and `joint` (from 1) where it is one joint's, `fault` where not the rule.
Found = Iterator[dict[str, Any]]

#: s; displacements and mean currents are taken over windows of this: encoder noise averages out, a stroke has many.
WINDOW = 0.1
#: s; a longer window spans a gap and is left out.
LONGEST_WINDOW = 0.25
#: rad/s and m/s; below it a joint counts as held (noise of 1e-4 rad over a window is 1e-3 rad/s).
SLOW = {"revolute": 0.02, "prismatic": 0.005}
#: A joint moves alone where all others are this much slower, relative to its own speed.
ALONE = 0.05
#: rad or m; held positions that differ less are one posture; and postures a joint that are distinguished.
SAME_POSTURE, POSTURES = 0.1, 300
#: Share of a window's velocities that must be numbers, and of its positions that repeat where a position is held.
VELOCITIES, OFTEN = 0.5, 0.3
#: Fewest samples of a window that can be flat.
FLAT = 3

#: Totals of which the least or the largest of two parts counts, and what they begin with; all others add up from 0.
EXTREMES: dict[str, tuple[np.ufunc, float]] = {
    **dict.fromkeys(("lowest", "least_current", "least_step", "least_change"), (np.fmin, math.inf)),
    **dict.fromkeys(("highest", "most_current"), (np.fmax, -math.inf)),
}
#: Totals of each joint.
TOTALS = (
    *("lowest", "highest", "path", "seconds", "speed_squares", "windows", "held", "step_sum", "step_count"),
    *("least_step", "least_current", "most_current", "moving", "pairs", "same", "flat", "zeros"),
    *("ahead", "least_change", "jumps", "jump_sum", "jump_squares", "bounces"),
)

#: Path (rad or m) from which a joint counts as moved: less is drift, or a test of the brakes.
MOVED = 0.2
#: Displacements and a velocity column that belong together agree this well (real logs: 0.99 and more).
AGREES, UNRELATED, ANOTHER = 0.95, 0.5, 0.3
#: Relative error within which a ratio is that of two units, and within which it is one (real logs: within 0.015).
UNIT_MATCH, RATIO_FINE = 0.03, 0.05
#: Time steps (s) with which no arm is logged, a step that does not show ramps, which take 0.1 to 0.3 s, and usual ones.
SLOWEST, FASTEST, COARSE, USUAL = 1.0, 3e-5, 0.05, (2e-4, 0.1)
#: Multiple of the limits that a range must exceed before the unit is in doubt.
BEYOND = 1.5
#: rad; two turns each way: one joint beyond may turn endlessly, two of an arm do not. And less than any experiment.
FAR, FEW_DEGREES = 4.0 * math.pi, 0.12
#: Windows each way from which a joint's friction can be told from its gravity; share of a current's variance that
#: another joint's direction must explain, and how much more than its own joint's.
FEWEST_WAYS, STRONG, STRONGER = 30, 0.5, 4.0
#: Share of a joint's samples, least number, and multiple of the next level's count, that make a flat top.
FLAT_SHARE, FLAT_COUNT, FLAT_RATIO = 0.01, 50, 5
#: Windows, and share of them, that make a signal that freezes again and again.
FLAT_WINDOWS, FLAT_TIME = 20, 0.05
#: Share of pairs of samples with the same current, and s between two changes, from which on a current is held.
HELD_SHARE, HELD = 0.6, 0.02
#: Share of windows with repeated positions, and mean step over the least one; an encoder's slow steps are one count.
STILL_TIME, UNEQUAL = 0.5, 2.0
#: Samples, and share of them, that are zero, and zeros per current next to zero, that are not measured.
ZEROS, ZERO_SHARE, ZERO_RATIO = 8, 1e-3, 8
#: Jumps, and turns at zero, that tell; and the scatter of their sizes below which they are one size.
JUMPS, ONE_SIZE = 3, 0.02
#: A; what motors of arms draw at most lies between.
SMALL, LARGE = 0.02, 200.0


class LogStatistics:
    """Running statistics of J joints, fed batch by batch; "moving" is by windows of 0.1 s.

    Attributes
    ----------
    totals
        By name: ``lowest``, ``highest`` (J,) positions, rad or m; ``path``, ``seconds``, ``speed_squares`` (J,) way,
        time and integral of the squared speed while moving; ``windows`` while moving and those ``held``, whose position
        often repeats, and there ``step_sum``, ``step_count``, ``least_step`` of its steps other than 0 (rad or m);
        ``least_current``, ``most_current`` (J,) A while moving, and samples with a current, ``moving``; ``pairs`` of
        neighbours while moving, those with the ``same`` current, windows in which all are, ``flat``, and ``zeros``
        while moving, in windows with other currents; windows moved ``ahead``; the ``least_change`` (A) of currents and
        (J, C) counts of their ``sizes`` while moving; ``jumps`` of positions that move on, their ``jump_sum`` and
        ``jump_squares``, and ``bounces`` at zero; ``products`` (2J, 2J) over windows of displacements and integrated
        velocity columns; ``copied``, ``compared`` (J, J) windows in which the mean currents of two joints are the same
        and not zero, and that have both.
    groups
        By joint (from 0) and posture of the others, over windows in which it moves alone, (4 + J, 4 + J) sums of
        products of (1, cos, sin, direction, all mean currents).
    levels
        By joint: the two largest of positive currents, of the sizes of negative ones, and of minus the sizes of those
        that are not zero (A) while moving, and how often each occurs.
    intervals
        Median time steps (s) of files, as their readers give them.
    """

    def __init__(self, robot: Robot) -> None:
        n = robot.n_joints
        self.robot, self.origin = robot, ""
        self.totals = {name: np.full(n, EXTREMES.get(name, (None, 0.0))[1]) for name in TOTALS}
        self.totals |= {"products": np.zeros((2 * n, 2 * n)), "copied": np.zeros((n, n)), "compared": np.zeros((n, n))}
        self.totals["sizes"] = np.zeros((n, CLASSES))
        self.intervals: list[float] = []
        self.levels: list[list[Counter[float]]] = [[Counter(), Counter(), Counter()] for _ in range(n)]
        self.groups: defaultdict[int, dict[tuple[int, ...], Floats]] = defaultdict(dict)
        self._rest: Log | None = None

    def _add(self, joint: int | slice = slice(None), /, **parts: Any) -> None:
        """Add totals of one joint (from 0), or of all."""
        for name, values in parts.items():
            merge, total = EXTREMES[name][0] if name in EXTREMES else np.add, self.totals[name]
            total[joint] = merge(total[joint], values)

    def take(self, log: Log) -> None:
        """Add a batch; windows that are whole are summed, the rest waits for the next of its clock."""
        if not len(log):
            return
        self.origin = self.origin or log.origin
        self._add(lowest=np.fmin.reduce(log.position), highest=np.fmax.reduce(log.position))
        if self._rest is not None and not log.starts_clock:
            log = Log.joined([self._rest, log])
        edges = np.concatenate([[0], np.flatnonzero(np.diff(np.floor(log.time / WINDOW))) + 1])
        self._rest = log.part(slice(int(edges[-1]), None))
        if len(edges) > 1:
            self._add_windows(log, edges)

    def absorb(self, other: Self) -> None:
        """Add the statistics of another file of the same robot, which must not be fed any more."""
        self.origin = self.origin or other.origin
        self._add(**other.totals)
        self.intervals += other.intervals
        for j in range(self.robot.n_joints):
            self.levels[j] = [
                _largest(a + b, np.zeros(0)) for a, b in zip(self.levels[j], other.levels[j], strict=True)
            ]
            self._add_groups(j, other.groups[j])

    def interval(self) -> float:
        """Median time between samples (s), NaN if there is none."""
        return float(np.median(self.intervals)) if self.intervals else math.nan

    def _add_windows(self, log: Log, edges: Counts) -> None:
        """Add the windows between `edges`; what follows the last edge is no whole window."""
        starts, counts = edges[:-1], np.diff(edges)
        seconds, change = np.diff(log.time[edges])[:, None], np.diff(log.position[edges], axis=0)
        usable = (seconds <= LONGEST_WINDOW) & np.isfinite(change).all(axis=1, keepdims=True)
        speed = np.where(usable, change / seconds, 0.0)
        size = np.abs(speed)
        moves = size > np.array([SLOW[joint.kind] for joint in self.robot.joints])
        way = moves * size * seconds
        self._add(windows=moves.sum(axis=0), seconds=(moves * seconds).sum(axis=0))
        self._add(ahead=(moves & (change > 0.0)).sum(axis=0))
        self._add(path=way.sum(axis=0), speed_squares=(way * size).sum(axis=0))
        middle = 0.5 * (log.position[edges[1:]] + log.position[starts])
        log = log.part(slice(0, int(edges[-1])))
        if log.velocity is not None:
            measured = _counts(np.isfinite(log.velocity), starts) > VELOCITIES * counts[:, None]
            both = np.hstack([change, finite_means(log.velocity, starts) * seconds])
            both = both[usable[:, 0] & measured.all(axis=1)]
            self._add(products=both.T @ both)
        joints = np.flatnonzero(moves.any(axis=0)).tolist()
        for j in joints:
            self._add(j, **leaps(log.time, log.position[:, j], SLOW[self.robot.joints[j].kind]))
            self._add_steps(j, log.position[:, j], moves[:, j], starts)
            self._add_currents(j, log.current[:, j], moves[:, j], starts)
        if joints:
            self._add_directions(speed, moves, middle, finite_means(log.current, starts))

    def _add_steps(self, j: int, position: Floats, moves: Flags, starts: Counts) -> None:
        """Add the steps of a joint's (N,) positions in those of (W,) windows in which it `moves` and they repeat."""
        step, counts = np.abs(np.diff(position, prepend=position[0])), np.diff(starts, append=len(position))
        step[starts] = np.nan  # from another window
        often = moves & (_counts(step == 0.0, starts) >= OFTEN * counts)
        steps = step[(step > 0.0) & np.repeat(often, counts)]
        least = steps.min(initial=math.inf)
        self._add(j, held=often.sum(), step_count=len(steps), step_sum=steps.sum(), least_step=least)

    def _add_currents(self, j: int, current: Floats, moves: Flags, starts: Counts) -> None:
        """Add extremes, repeats and zeros of a joint's (N,) currents where they are measured while it `moves`, (W,)."""
        moving = np.repeat(moves, np.diff(starts, append=len(current))) & np.isfinite(current)
        both = moving[1:] & moving[:-1]
        both[starts[1:] - 1] = False  # of two windows
        same, values = both & (current[1:] == current[:-1]), current[moving]
        self._add(j, moving=len(values), pairs=np.count_nonzero(both), same=np.count_nonzero(same))
        low = np.minimum.reduceat(np.where(moving, current, np.inf), starts)
        high = np.maximum.reduceat(np.where(moving, current, -np.inf), starts)
        counts, zeros = _counts(moving, starts), _counts(moving & (current == 0.0), starts)
        flat, zeros = (low == high) & (counts >= FLAT), np.where(zeros < counts, zeros, 0)
        change = np.abs(np.diff(current))[both & ~same]
        self._add(j, least_change=change.min(initial=math.inf))
        self._add(j, least_current=low.min(), most_current=high.max(), flat=flat.sum(), zeros=zeros.sum())
        sides = (values[values > 0], -values[values < 0], -np.abs(values[values != 0]))
        self.levels[j] = [_largest(a, b) for a, b in zip(self.levels[j], sides, strict=True)]
        self.totals["sizes"][j] += size_counts(sides[0])

    def _add_directions(self, speed: Floats, moves: Flags, middle: Floats, mean: Floats) -> None:
        """Add, by joint and posture, (W,) windows in which a joint moves alone; `mean` are (W, J) currents."""
        measured = np.isfinite(mean).astype(float)
        same = (mean[:, :, None] == mean[:, None, :]) & (mean != 0.0)[:, None, :]
        self._add(compared=measured.T @ measured, copied=same.sum(axis=0))
        size = np.abs(speed)
        for j in np.flatnonzero(moves.any(axis=0)).tolist():
            alone = moves[:, j] & (np.delete(size, j, axis=1).max(axis=1, initial=0.0) < ALONE * size[:, j])
            way, angle = np.sign(speed[alone, j]), middle[alone, j]
            rows = np.column_stack([np.ones(len(way)), np.cos(angle), np.sin(angle), way, np.nan_to_num(mean[alone])])
            held = np.round(np.delete(middle[alone], j, axis=1) / SAME_POSTURE).astype(np.int64)
            postures, which = np.unique(held, axis=0, return_inverse=True)
            parts = [rows[which.reshape(-1) == k] for k in range(len(postures))]
            sums = [part.T @ part for part in parts]
            self._add_groups(j, dict(zip(map(tuple, postures.tolist()), sums, strict=True)))

    def _add_groups(self, j: int, more: Mapping[tuple[int, ...], Floats]) -> None:
        groups = self.groups[j]
        for posture, sums in more.items():
            if posture in groups or len(groups) < POSTURES:
                groups[posture] = groups.get(posture, 0.0) + sums


def _counts(flags: Flags, starts: Counts) -> Counts:
    """(W,) or (W, J) of true (N,) or (N, J) flags from each start on."""
    return np.add.reduceat(flags, starts, axis=0, dtype=np.int64)


def _largest(total: Counter[float], values: Floats) -> Counter[float]:
    """The two largest of counted levels and of (N,) values, and how often each occurs."""
    for _ in range(2):
        level = values.max(initial=-math.inf)
        total = total + Counter({float(level): int(np.count_nonzero(values == level))})
        values = values[values < level]
    return Counter(dict(sorted(total.items())[-2:]))


@dataclass(frozen=True, slots=True)
class Check:
    """One line of the table.

    `test` yields the figures of each finding, in braces in `text` (what is wrong) and `fix`. `column` is the quantity
    whose column is named. With `fault` wrong numbers would certainly follow: then the logs are refused.
    """

    slug: str
    test: Callable[[LogStatistics], Found]
    text: str
    fix: str
    column: str = "position"
    fault: bool = False

    def run(self, sums: LogStatistics) -> Iterator[LogError | Note]:
        """What the check finds in a file or in all."""
        for figures in self.test(sums):
            joint = figures.get("joint")
            log = sums.robot.log
            column = log.time if self.column == "time" else log.column(self.column, joint) if joint else ""
            where = Where(file=sums.origin, joint=joint, column=column or None)
            text, fix = self.text.format(**figures), self.fix.format(**figures)
            if figures.get("fault", self.fault):
                yield LogError(self.slug, text, where, fix)
            else:
                yield Note(self.slug, f"{text}; {fix}" if fix else text, where)


def findings(sums: LogStatistics) -> list[LogError | Note]:
    """What the table finds, in the order in which a user should look at it."""
    items: list[LogError | Note] = []
    for table in (POSITION_CHECKS, UNIT_CHECKS, OTHER_CHECKS):
        if not any(isinstance(item, LogError) for item in items):
            items += [item for check in table for item in check.run(sums)]
    return items


class JointSignals:
    """One joint's statistics (each by its name), and what predicates and messages make of them."""

    def __init__(self, sums: LogStatistics, joint: Joint) -> None:
        k, n = joint.number - 1, sums.robot.n_joints
        self.sums, self.joint, self.k = sums, joint, k
        self.low, self.high = joint.limits or (-math.inf, math.inf)
        self.span = f"{number(self.lowest)} to {number(self.highest)} {joint.position_unit}"
        self.limits = f"{number(self.low)} to {number(self.high)}"
        self.has_moved = bool(self.path > MOVED)
        self.speed = math.sqrt(self.speed_squares / max(self.seconds, 1e-12))
        products = sums.totals["products"]
        self.integral, displaced = products[n + k, n + k], np.abs(products[k, n:])
        scale = np.sqrt(products[k, k] * np.diag(products)[n:])
        self.match = np.divide(displaced, scale, out=np.zeros(n), where=scale > 0)
        self.agrees = float(self.match[k])  # correlation of displacement and velocity column
        #: Displacement per integrated velocity, NaN where the joint did not move or they do not belong together.
        is_known = self.agrees > AGREES and self.path > 0
        self.ratio = float(products[k, n + k] / self.integral) if is_known else math.nan
        self.is_off = (self.has_moved or self.integral > (MOVED * WINDOW) ** 2) and abs(self.ratio - 1.0) >= RATIO_FINE
        self.is_constant = self.least_current == self.most_current and self.moving >= FLAT_COUNT
        self.is_measured = self.has_moved and self.moving > 0 and not self.is_constant
        self.largest = max(-self.least_current, self.most_current)
        #: Another joint (from 1) whose position the velocity column follows, and one whose current this joint's is.
        is_astray = self.has_moved and self.integral > 0 and self.agrees < ANOTHER and self.match.max() > AGREES
        self.follows = int(np.argmax(self.match)) + 1 if is_astray else 0
        is_same = (self.copied > FLAT_WINDOWS) & (self.copied >= (1.0 - FLAT_TIME) * self.compared)
        self.copy_of = int(np.argmax(is_same[:k])) + 1 if is_same[:k].any() else 0

    def __getattr__(self, name: str) -> Any:
        return self.sums.totals[name][self.k]

    @cached_property
    def lost_sign(self) -> str:
        """How the sign of the current was lost, where the joint moves both ways and it is never negative."""
        is_bothways = min(self.ahead, self.windows - self.ahead) >= FEWEST_WAYS
        return lost_sign(self.sizes, self.least_change) if is_bothways and self.least_current >= 0.0 else ""

    @property
    def jump(self) -> float:
        """Size (rad or m) by which the position jumps again and again while it moves on, 0 if it does not."""
        size = self.jump_sum / max(self.jumps, 1.0)
        scatter = self.jump_squares / max(self.jumps, 1.0) - size**2
        return float(size) if self.jumps >= JUMPS and scatter < (ONE_SIZE * size) ** 2 else 0.0

    @property
    def is_folded(self) -> bool:
        """Whether positions turn back at zero at full speed and never pass it."""
        return bool(self.bounces >= JUMPS and (self.lowest >= 0.0 or self.highest <= 0.0))

    def outside(self, scale: float = 1.0) -> float:
        """How far positions times `scale` leave the joint's limits, as a share of their width; negative inside."""
        return float(max(self.low - scale * self.lowest, scale * self.highest - self.high)) / (self.high - self.low)

    def unit_changes(self) -> tuple[list[str], list[str]]:
        """Single changes of unit that bring the ratio to one: of position or time, and of the velocity column."""
        prefix, usual = ("", "rad") if self.joint.is_revolute else ("prismatic_", "m")

        def changes(key: str, usual: str, power: int) -> list[str]:
            robot, size = self.sums.robot, abs(self.ratio) if self.is_off else math.nan
            return _other_units(robot, key, usual, lambda scale: abs(size * scale**power - 1.0) < UNIT_MATCH)

        first = changes(f"{prefix}position", usual, 1) + changes("time", "s", -1)
        return first, changes(f"{prefix}velocity", f"{usual}/s", -1)

    @cached_property
    def flat_top(self) -> tuple[str, int] | None:
        """Level (A) of a flat top on either side, and how many samples have it; the side with the larger current."""
        both = zip((1, -1), self.sums.levels[self.k], strict=False)
        sides = [(max(counts), sign, counts) for sign, counts in both if counts]
        for level, sign, counts in sorted(sides, key=lambda side: -side[0]):
            below = sum(counts.values()) - counts[level]
            if counts[level] >= max(FLAT_COUNT, FLAT_SHARE * self.moving, FLAT_RATIO * below):
                return number(sign * level), counts[level]
        return None

    @cached_property
    def frozen(self) -> str:
        """How the current is not measured anew at each sample, if so."""
        interval = self.sums.interval()
        period = interval / max(1.0 - self.same / max(self.pairs, 1), 1e-9)
        if self.same > HELD_SHARE * self.pairs and period > HELD:
            return f"changes only every {1e3 * period:.0f} ms, and there is a sample every {1e3 * interval:.3g} ms"
        if self.flat >= FLAT_WINDOWS and self.flat > FLAT_TIME * self.windows:
            return f"stays the same to the digit in {100 * self.flat / self.windows:.0f} % of the time it moves"
        return ""

    @property
    def has_zeros(self) -> bool:
        """Whether zeros are far more than currents next to zero; one in steps is as often one step away."""
        nearest = self.sums.levels[self.k][2]
        beside = nearest[max(nearest)] if nearest else 0
        return bool(self.zeros >= max(ZEROS, ZERO_SHARE * self.moving, ZERO_RATIO * beside))


def _signals(sums: LogStatistics) -> list[JointSignals]:
    return [JointSignals(sums, joint) for joint in sums.robot.joints]


def _each(predicate: Callable[[JointSignals], object]) -> Callable[[LogStatistics], Found]:
    """A test of each joint by itself."""
    return lambda sums: ({"joint": j.joint.number, "j": j} for j in _signals(sums) if predicate(j))


def _first(predicate: Callable[[JointSignals], object]) -> Callable[[LogStatistics], Found]:
    """A test of each joint by itself, told of the first with the numbers of the others."""

    def test(sums: LogStatistics) -> Found:
        chosen = [j for j in _signals(sums) if predicate(j)]
        beside = ", ".join(str(j.joint.number) for j in chosen[1:])
        for j in chosen[:1]:
            yield {"joint": j.joint.number, "j": j, "alike": f" (and of {beside})" if beside else ""}

    return test


def _other_units(robot: Robot, key: str, usual: str, fits: Callable[[float], bool]) -> list[str]:
    """Words for the recipe by which a quantity's unit changes to one whose ratio to that of the recipe `fits`."""
    now = robot.log.units.get(key, usual)
    return [
        f"units: {{{key}: {word}}}"
        for word, (dimension, size) in UNITS.items()
        if dimension == UNITS[now][0] and word != now and fits(size / factor(now))
    ]


def _time_unit(sums: LogStatistics) -> Found:
    interval, unit = sums.interval(), sums.robot.log.units.get("time", "s")
    is_impossible = interval >= SLOWEST or interval <= FASTEST
    if is_impossible or interval > COARSE:
        fitting = _other_units(sums.robot, "time", "s", lambda scale: USUAL[0] <= interval * scale <= USUAL[1])
        fix = f"put {' or '.join(fitting)} into the recipe's log block" if fitting else "check the time column"
        rate = f"one sample every {number(interval)} s" if interval > 1 else f"{number(1 / interval)} samples a second"
        why = "no rate of an arm" if is_impossible else "too few to see where an arm speeds up; log 50 or more"
        yield {"unit": unit, "rate": rate, "why": why, "fix": fix, "fault": is_impossible}


def _position_unit(sums: LogStatistics, *, read: str, meant: str) -> Found:
    """Positions that would fit the limits in another unit, while as read they are far beyond or hardly change.

    Without limits, those of many turns.
    """
    is_angle, scale = read != "m", factor(meant) / factor(read)
    key = "position" if is_angle else "prismatic_position"
    joints = [j for j in _signals(sums) if j.joint.is_revolute == is_angle]
    limited = [j for j in joints if j.joint.limits]
    suspects = [j for j in limited if j.outside(scale) <= 0.1]
    if scale > 1.0:
        suspects.sort(key=lambda j: j.lowest - j.highest)
        widest = max((j.highest - j.lowest for j in limited), default=math.inf)
        is_still = len(suspects) == len(limited) and widest < FEW_DEGREES and scale * widest > MOVED
        suspects = suspects if is_still else []
    else:
        # A whole turn off may be another count of turns, not another unit.
        suspects = [j for j in suspects if j.outside() > max(BEYOND - 1.0, math.tau / (j.high - j.low))]
    turning = [j for j in joints if meant == "deg" and not j.joint.limits and max(-j.lowest, j.highest) > FAR]
    is_sure = bool(suspects) or len(turning) >= 2
    for j in (suspects or turning)[:1] if sums.robot.log.units.get(key, read) == read else ():
        if is_sure or not abs(j.ratio - 1.0) < RATIO_FINE:
            why = f"its limits are {j.limits}, and as {meant} they would fit" if suspects else "over two turns"
            figures = {"read": read, "meant": meant, "key": key, "j": j, "why": why}
            yield figures | {"joint": j.joint.number, "fault": is_sure}


def _units_disagree(sums: LogStatistics) -> Found:
    """The derivative of position against the velocity column, by a factor between two units."""
    for j in _signals(sums):
        changes, speeds = j.unit_changes()
        if changes or speeds:
            words = f"{' or '.join(changes + speeds)} into the recipe's log block"
            words += "" if changes else " (speeds are taken from position)"
            yield {"joint": j.joint.number, "ratio": number(j.ratio), "words": words, "fault": bool(changes)}
            return


def _unlike_clock(sums: LogStatistics) -> Found:
    """Velocity columns off by no unit's factor: the clock, which all joints share, or these columns."""
    signals = [j for j in _signals(sums) if not math.isnan(j.ratio)]
    off = [j for j in signals if j.is_off and abs(j.ratio + 1.0) >= RATIO_FINE and not any(j.unit_changes())]
    ratios = [j.ratio for j in off]
    if off and len(off) == len(signals) and max(ratios) < (1.0 + RATIO_FINE) * min(ratios):
        ratio = float(np.median(ratios))
        larger = f"{max(ratio, 1.0 / ratio):.3g} times as {'large' if ratio > 1.0 else 'small'} as these times say"
        what = (
            f"positions change {ratio:.4g} times as fast as velocity columns say, at each joint: either the clock is"
            f" wrong, and then speeds are {ratio:.3g} times too fast: viscous friction is {larger}, inertia"
            f" {ratio**2:.3g} times; or the velocity columns are, and then all numbers hold"
        )
        clock = f"times {ratio:.4g} times as long if it is the clock"
        fix = f"write {clock}; velocity: null in the recipe's log block if it is the columns; --trust takes the clock"
        yield {"joint": off[0].joint.number, "what": what, "fix": fix, "fault": True}
        return
    for j in off:
        what = f"the velocity column of joint {j.joint.number} does not follow its position, which changes"
        what += f" {j.ratio:.4g} times as fast" + ("; other joints' do" if len(signals) > len(off) else "")
        yield {"joint": j.joint.number, "what": what, "fix": "speeds are taken from position and time"}


def _currents_swapped(sums: LogStatistics) -> Found:
    """A joint that moves while another draws the current.

    While joint a moves alone its friction changes sign with direction, and no other joint's does: gravity is a function
    of position. So the current that answers to a's direction, beside cos and sin of its angle, is the current of a.
    Postures are taken one by one, so that gravity's change from one to the next counts neither way.
    """
    moved_to: dict[int, int] = {}
    what = ""
    (path, moving), n = (sums.totals[name] for name in ("path", "moving")), sums.robot.n_joints
    is_measured = (moving > 0) | (path <= MOVED)
    for a in np.flatnonzero((path >= MOVED) & is_measured).tolist():
        groups = np.array([*sums.groups[a].values()]).reshape(-1, 4 + n, 4 + n)
        gravity = np.linalg.pinv(groups[:, :3, :3], rcond=1e-9, hermitian=True)
        cross = groups[:, :3, 3:]
        rest = (groups[:, 3:, 3:] - cross.transpose(0, 2, 1) @ gravity @ cross).sum(axis=0)
        windows = 0.5 * (groups[:, 0, 0].sum() - abs(groups[:, 0, 3].sum()))
        if min(windows, rest[0, 0]) < FEWEST_WAYS:
            continue
        answer = np.where(is_measured, np.abs(rest[0, 1:]) / rest[0, 0], 0.0)
        share = rest[0, 1:] ** 2 / (rest[0, 0] * np.maximum(np.diag(rest)[1:], 1e-300))
        b = int(np.argmax(answer))
        if b != a and share[b] > STRONG and answer[b] > STRONGER * answer[a]:
            moved_to[a + 1] = b + 1
            by, least = number(2 * answer[b], 2), number(2 * answer[a], 2)
            what += (
                f"when joint {a + 1} moves, current {b + 1} changes by {by} A with direction, its own by {least} A\n"
            )
    log = sums.robot.log
    pairs = ", ".join(f"{log.column('position', a)} beside {log.column('current', b)}" for a, b in moved_to.items())
    is_sure = len(moved_to) >= 2 and len(set(moved_to.values())) == len(moved_to)
    if moved_to:
        figures = {"what": "; ".join(what.splitlines()), "perhaps": "" if is_sure else "perhaps ", "pairs": pairs}
        yield figures | {"joint": next(iter(moved_to)), "fault": is_sure}


def _at_rest(sums: LogStatistics) -> Found:
    still = [str(j.joint.number) for j in _signals(sums) if not j.has_moved]
    if still and len(still) < sums.robot.n_joints:
        yield {"which": f"joints {', '.join(still)} never move" if len(still) > 1 else f"joint {still[0]} never moves"}


#: Signs of positions, then units, since wrong ones cause much of what follows: where one is refused, the checks of
#: later tables are not made.
POSITION_CHECKS = (
    Check("sign-lost", _first(lambda j: j.jump),
          "the position of joint {joint}{alike} jumps by {j.jump:.5g} {j.joint.position_unit} {j.jumps:.0f} times "
          "while it moves on: the encoder's range is no turn in this unit, or a sign was lost",
          "write positions with their sign, which go on where the range ends", fault=True),
    Check("sign-lost", _first(lambda j: j.is_folded and not j.jump),
          "the position of joint {joint}{alike} turns back at zero at full speed, {j.bounces:.0f} times: its sign was "
          "lost", "write positions with their sign", fault=True),
)  # fmt: skip
UNIT_CHECKS = (
    Check("time-unit", _time_unit, "with time read in {unit} there is {rate}, {why}", "{fix}", column="time"),
    *(
        Check("units-disagree", partial(_position_unit, read=read, meant=meant),
              "positions of joint {joint}, read as {read}, run from {j.span}; {why}",
              "if they are {meant} put units: {{{key}: {meant}}} into the recipe's log block")
        for read, meant in (("rad", "deg"), ("deg", "rad"), ("m", "mm"))
    ),
    Check("units-disagree", _units_disagree, "position of joint {joint} changes {ratio} times as fast as its velocity "
          "column says", "put {words}", column="velocity"),
    Check("velocity-unrelated", _each(lambda j: j.is_off and abs(j.ratio + 1.0) < RATIO_FINE),
          "velocity of joint {joint} has the sign opposite to its motion", "speeds are taken from position",
          column="velocity"),
)  # fmt: skip
OTHER_CHECKS = (
    Check("beyond-limits",
          _each(lambda j: j.has_moved and j.joint.max_velocity and j.speed > BEYOND * j.joint.max_velocity),
          "joint {joint} moves at {j.speed:.4g} {j.joint.position_unit}/s (RMS), its maximum is "
          "{j.joint.max_velocity:.4g}", "check the units of time and of position"),
    Check("beyond-limits", _each(lambda j: j.outside() > 0.05),
          "joint {joint} runs from {j.span}, beyond its limits {j.limits}", "check zero, sign and unit"),
    Check("joints-swapped", _each(lambda j: j.follows),
          "the velocity column of joint {joint} follows the position of joint {j.follows}",
          "put the columns into one order; if the positions are right, velocity: null in the recipe's log block",
          column="velocity", fault=True),
    Check("velocity-unrelated", _unlike_clock, "{what}", "{fix}", column="velocity"),
    Check("velocity-unrelated", _each(lambda j: j.has_moved and j.integral > 0 and j.agrees < UNRELATED),
          "the velocity column of joint {joint} does not follow its position; their correlation is {j.agrees:.2f}",
          "speeds are taken from position and time", column="velocity"),
    Check("position-held",
          _each(lambda j: j.held >= max(FLAT_WINDOWS, STILL_TIME * j.windows)
                and j.step_sum > UNEQUAL * j.least_step * j.step_count),
          "position of joint {joint} often repeats while it moves, and then jumps: it is measured less often than it "
          "is logged, or its log repeats samples", "inertia and the ends of runs suffer"),
    Check("current-unmeasured", _each(lambda j: j.copy_of),
          "joints {j.copy_of} and {joint} have the same current in every sample",
          "give each joint its own column; leave out one that was not measured", column="current", fault=True),
    Check("current-unmeasured", _each(lambda j: j.has_moved and j.is_constant),
          "current of joint {joint} is {j.least_current:.4g} A in all {j.moving:.0f} samples in which it moves",
          "name the column of the measured current; if there is none remove this one, the joint is then left out",
          column="current", fault=True),
    Check("sign-lost", _first(lambda j: j.is_measured and j.lost_sign),
          "the current of joint {joint}{alike} is never negative although it moves both ways, and looks like "
          "{j.lost_sign}", "write it with its sign", column="current", fault=True),
    Check("current-saturated", _each(lambda j: j.is_measured and j.flat_top),
          "current of joint {joint} is at its limit, {j.flat_top[0]} A, in {j.flat_top[1]} of {j.moving:.0f} moving "
          "samples", "it is cut off by the drive or the sensor; slower runs stay below", column="current"),
    Check("current-frozen", _each(lambda j: j.is_measured and not j.flat_top and j.frozen),
          "current of joint {joint} {j.frozen}", "the signal froze, is held and so late, or its steps are too coarse",
          column="current"),
    Check("current-dropouts", _each(lambda j: j.is_measured and j.has_zeros and not j.flat_top and not j.frozen),
          "current of joint {joint} is exactly zero in {j.zeros:.0f} of {j.moving:.0f} moving samples, and hardly ever "
          "next to zero: values that were lost were written as 0, or the drive or the sensor cuts small currents off",
          "leave lost values empty; small ones that are cut off spoil friction and gravity", column="current"),
    Check("units-disagree", _each(lambda j: j.is_measured and not SMALL <= j.largest <= LARGE),
          "current of joint {joint} is {j.largest:.4g} A at most, and an arm's motor draws more than "
          f"{SMALL:g} and less than {LARGE:g} A",
          "see units: {{current: ...}} in the recipe's log block", column="current"),
    Check("joints-swapped", _currents_swapped, "{what}",
          "{perhaps}positions and currents are in different orders: put {pairs} into one order"),
    Check("joint-at-rest", _at_rest, "{which} in these logs", ""),
)  # fmt: skip
