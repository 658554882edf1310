"""Checks of logs that do not mean what the recipe says: a table of slug, test, message and fix.

Each test looks at the statistics of one file, or of all, and yields the figures of each finding.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import LogError, Note, Where
from pumaid.preprocessing.log_statistics import WINDOW, LogStatistics
from pumaid.robot import Joint, Robot
from pumaid.units import UNITS, factor, number

Floats = NDArray[np.float64]
#: What a test yields: figures of the message, and `joint` (from 1) where it is one joint's, `fault` where not the rule.
Found = Iterator[dict[str, Any]]

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
#: A; what motors of arms draw at most lies between.
SMALL, LARGE = 0.02, 200.0


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
    items = [item for check in UNIT_CHECKS for item in check.run(sums)]
    if not any(isinstance(item, LogError) for item in items):
        items += [item for check in OTHER_CHECKS for item in check.run(sums)]
    return items


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
    if interval >= SLOWEST or interval <= FASTEST:
        fitting = _other_units(sums.robot, "time", "s", lambda scale: USUAL[0] <= interval * scale <= USUAL[1])
        fix = f"put {' or '.join(fitting)} into the recipe's log block" if fitting else "check the time column"
        fix += "; a count of rows is no time: then write the instants" if interval == factor(unit) else ""
        rate = f"one sample every {number(interval)} s" if interval > 1 else f"{number(1 / interval)} samples a second"
        yield {"unit": unit, "rate": rate, "fix": fix}


def _rate_low(sums: LogStatistics) -> Found:
    if COARSE < sums.interval() < SLOWEST:
        yield {"rate": number(1 / sums.interval())}


def _position_unit(sums: LogStatistics, *, read: str, meant: str) -> Found:
    """Positions that would fit the limits in another unit, while as read they are far beyond or hardly change.

    Without limits, those of many turns.
    """
    is_angle, scale = read != "m", factor(meant) / factor(read)
    key = "position" if is_angle else "prismatic_position"
    joints = [(joint, k) for joint, k in _joints(sums, moved=False) if joint.is_revolute == is_angle]
    limited = [(joint, k) for joint, k in joints if joint.limits]
    if sums.robot.log.units.get(key, read) != read:
        return
    suspects = [(joint, k) for joint, k in limited if _outside(sums, joint, scale) <= 0.1]
    if scale > 1.0:
        suspects.sort(key=lambda item: sums.lowest[item[1]] - sums.highest[item[1]])
        widest = max((sums.highest[k] - sums.lowest[k] for _, k in limited), default=math.inf)
        is_still = len(suspects) == len(limited) and widest < FEW_DEGREES and scale * widest > MOVED
        suspects = suspects if is_still else []
    else:
        # A whole turn off may be another count of turns, not another unit.
        far = (max(BEYOND - 1.0, math.tau / (np.ptp(_limits(joint)))) for joint, _ in suspects)
        suspects = [item for item, share in zip(suspects, far, strict=True) if _outside(sums, item[0]) > share]
    furthest = np.maximum(np.abs(sums.lowest), np.abs(sums.highest))
    turning = [(joint, k) for joint, k in joints if meant == "deg" and not joint.limits and furthest[k] > FAR]
    is_sure = bool(suspects) or len(turning) >= 2
    for joint, k in (suspects or turning)[:1]:
        why = (
            f"its limits are {_span(*_limits(joint))}, and as {meant} they would fit" if suspects else "over two turns"
        )
        if is_sure or not abs(_ratio(sums)[k] - 1.0) < RATIO_FINE:
            span = f"{_span(sums.lowest[k], sums.highest[k])} {joint.position_unit}"
            figures = {"read": read, "meant": meant, "key": key, "span": span, "why": why}
            yield figures | {"joint": joint.number, "fault": is_sure}


def _units_disagree(sums: LogStatistics) -> Found:
    """The derivative of position against the velocity column, by a factor between two units."""
    for joint, ratio in _off_ratios(sums):
        changes, speeds = _unit_changes(sums.robot, joint, ratio)
        if changes or speeds:
            words = f"{' or '.join(changes + speeds)} into the recipe's log block"
            words += "" if changes else " (speeds are taken from position)"
            yield {"joint": joint.number, "ratio": number(ratio), "words": words, "fault": bool(changes)}
            return


def _velocity_sign(sums: LogStatistics) -> Found:
    yield from ({"joint": joint.number} for joint, ratio in _off_ratios(sums) if abs(ratio + 1.0) < RATIO_FINE)


def _velocity_unrelated(sums: LogStatistics) -> Found:
    """A velocity column of another scale, or of another signal."""
    ratios = {joint.number: ratio for joint, ratio in _off_ratios(sums)}
    if any(any(_unit_changes(sums.robot, sums.robot.joint(joint), ratio)) for joint, ratio in ratios.items()):
        return
    for joint, k in _joints(sums, moved=False):
        ratio = ratios.get(joint.number, -1.0)
        match, moved = abs(float(sums.agreement()[k, k])), sums.path[k] > MOVED
        if abs(ratio + 1.0) >= RATIO_FINE:
            how = f"the position changes {number(ratio)} times as fast"
            if joint.gear_ratio and abs(abs(ratio * joint.gear_ratio) - 1.0) < UNIT_MATCH:
                how += f" (the ratio is that of the gear, {number(joint.gear_ratio)}: the column is the motor's speed)"
            yield {"joint": joint.number, "how": how}
        elif moved and _integral(sums)[k] > 0 and match < UNRELATED:
            yield {"joint": joint.number, "how": f"their correlation is {match:.2f}"}


def _beyond_limits(sums: LogStatistics) -> Found:
    speed = np.sqrt(sums.speed_squares / np.maximum(sums.seconds, 1e-12))
    for joint, k in _joints(sums, moved=False):
        unit, limit = joint.position_unit, joint.max_velocity
        if limit and speed[k] > BEYOND * limit and sums.path[k] > MOVED:
            what = f"moves at {number(speed[k])} {unit}/s (RMS), its maximum is {number(limit)}"
            yield {"joint": joint.number, "what": what, "fix": "check the units of time and of position"}
        if _outside(sums, joint) > 0.05:
            span = _span(sums.lowest[k], sums.highest[k])
            what = f"runs from {span} {unit}, beyond its limits {_span(*_limits(joint))}"
            yield {"joint": joint.number, "what": what, "fix": "check zero, sign and unit"}


def _velocities_swapped(sums: LogStatistics) -> Found:
    """Velocity columns that follow the positions of other joints."""
    match = np.abs(sums.agreement())
    followed = {
        joint.number: int(np.argmax(match[k])) + 1
        for joint, k in _joints(sums)
        if _integral(sums)[k] > 0 and match[k, k] < ANOTHER and match[k].max() > AGREES
    }
    if followed:
        pairs = ", ".join(f"position {a} with velocity {b}" for a, b in followed.items())
        yield {"joint": next(iter(followed)), "pairs": pairs}


def _currents_swapped(sums: LogStatistics) -> Found:
    """A joint that moves while another draws the current.

    While joint a moves alone its friction changes sign with direction, and no other joint's does: gravity is a function
    of position. So the current that answers to a's direction, beside cos and sin of its angle, is the current of a.
    Postures are taken one by one, so that gravity's change from one to the next counts neither way.
    """
    moved_to: dict[int, int] = {}
    changes = []
    is_measured, n = (sums.moving > 0) | (sums.path <= MOVED), sums.robot.n_joints
    for a in np.flatnonzero((sums.path >= MOVED) & is_measured).tolist():
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
            changes.append(
                f"when joint {a + 1} moves, current {b + 1} changes by {by} A with direction, its own by {least} A"
            )
    log = sums.robot.log
    pairs = ", ".join(f"{log.column('position', a)} beside {log.column('current', b)}" for a, b in moved_to.items())
    is_sure = len(moved_to) >= 2 and len(set(moved_to.values())) == len(moved_to)
    if moved_to:
        figures = {"what": "; ".join(changes), "perhaps": "" if is_sure else "perhaps ", "pairs": pairs}
        yield figures | {"joint": next(iter(moved_to)), "fault": is_sure}


def _position_held(sums: LogStatistics) -> Found:
    """A position that is measured less often than it is logged; one of an encoder with few counts is none."""
    for joint, k in _joints(sums, moved=False):
        is_often = sums.held[k] >= max(FLAT_WINDOWS, STILL_TIME * sums.windows[k])
        if is_often and sums.step_sum[k] > UNEQUAL * sums.least_step[k] * sums.step_count[k]:
            yield {"joint": joint.number}


def _current_constant(sums: LogStatistics) -> Found:
    for joint, k in _measured(sums, constant=True):
        yield {"joint": joint.number, "level": number(sums.least_current[k]), "total": int(sums.moving[k])}


def _current_copied(sums: LogStatistics) -> Found:
    """Two joints whose currents are the same numbers."""
    same = (sums.copied > FLAT_WINDOWS) & (sums.copied >= (1.0 - FLAT_TIME) * sums.compared)
    yield from ({"joint": int(b) + 1, "other": int(a) + 1} for a, b in np.argwhere(np.triu(same, 1)))


def _current_saturated(sums: LogStatistics) -> Found:
    """A flat top on either side; the side with the larger current is told."""
    for joint, k in _measured(sums):
        sides = [(max(counts), sign, counts) for sign, counts in zip((1, -1), sums.levels[k], strict=False) if counts]
        for level, sign, counts in sorted(sides, key=lambda side: -side[0]):
            count, below = counts[level], sum(counts.values()) - counts[level]
            if count >= max(FLAT_COUNT, FLAT_SHARE * sums.moving[k], FLAT_RATIO * below):
                limit = number(sign * level)
                yield {"joint": joint.number, "limit": limit, "count": count, "total": int(sums.moving[k])}
                break


def _current_frozen(sums: LogStatistics) -> Found:
    """A current that is not measured anew at each sample."""
    interval, saturated = sums.interval(), {figures["joint"] for figures in _current_saturated(sums)}
    for joint, k in _measured(sums):
        period = interval / max(1.0 - sums.same[k] / max(sums.pairs[k], 1), 1e-9)
        if joint.number in saturated:
            continue
        if sums.same[k] > HELD_SHARE * sums.pairs[k] and period > HELD:
            how = f"changes only every {1e3 * period:.0f} ms, and there is a sample every {1e3 * interval:.3g} ms"
            yield {"joint": joint.number, "how": how}
        elif sums.flat[k] >= FLAT_WINDOWS and sums.flat[k] > FLAT_TIME * sums.windows[k]:
            share = 100 * sums.flat[k] / sums.windows[k]
            yield {"joint": joint.number, "how": f"stays the same to the digit in {share:.0f} % of the time it moves"}


def _current_zeros(sums: LogStatistics) -> Found:
    """A current that is zero far more often than next to zero; one in steps is as often one step away."""
    flagged = {figures["joint"] for figures in (*_current_saturated(sums), *_current_frozen(sums))}
    for joint, k in _measured(sums):
        nearest = sums.levels[k][2]
        beside = nearest[max(nearest)] if nearest else 0
        is_many = sums.zeros[k] >= max(ZEROS, ZERO_SHARE * sums.moving[k], ZERO_RATIO * beside)
        if is_many and joint.number not in flagged:
            yield {"joint": joint.number, "count": int(sums.zeros[k]), "total": int(sums.moving[k])}


def _current_size(sums: LogStatistics) -> Found:
    for joint, k in _measured(sums):
        largest = max(-sums.least_current[k], sums.most_current[k])
        if not SMALL <= largest <= LARGE:
            unlike = "more than an arm's motor draws" if largest > LARGE else "less than it takes to move an arm"
            yield {"joint": joint.number, "largest": number(largest), "unlike": unlike}


def _at_rest(sums: LogStatistics) -> Found:
    moved = {joint.number for joint, _ in _joints(sums)}
    still = [joint.number for joint in sums.robot.joints if joint.number not in moved]
    if still and moved:
        listed = ", ".join(map(str, still))
        yield {"which": f"joints {listed} never move" if len(still) > 1 else f"joint {listed} never moves"}


#: Units first, since wrong ones cause much of what follows: where one is refused, the other checks are not made.
UNIT_CHECKS = (
    Check("time-unit", _time_unit, "with time read in {unit} there is {rate}, no rate of an arm", "{fix}",
          column="time", fault=True),
    Check("rate-low", _rate_low, "{rate} samples a second are too few to see where an arm speeds up and slows down",
          "50 or more are needed for good runs", column="time"),
    *(
        Check(slug, partial(_position_unit, read=read, meant=meant),
              "positions of joint {joint}, read as {read}, run from {span}; {why}",
              "if they are {meant} put units: {{{key}: {meant}}} into the recipe's log block")
        for slug, read, meant in (
            ("looks-like-degrees", "rad", "deg"), ("units-disagree", "deg", "rad"), ("units-disagree", "m", "mm"),
        )
    ),
    Check("units-disagree", _units_disagree, "position of joint {joint} changes {ratio} times as fast as its velocity "
          "column says", "put {words}", column="velocity"),
    Check("velocity-sign", _velocity_sign, "velocity of joint {joint} has the sign opposite to its motion",
          "speeds are taken from position", column="velocity"),
)  # fmt: skip
OTHER_CHECKS = (
    Check("beyond-limits", _beyond_limits, "joint {joint} {what}", "{fix}"),
    Check("joints-swapped", _velocities_swapped, "velocity columns follow other joints than their own: {pairs}",
          "put the columns into one order; if the positions are right, velocity: null in the recipe's log block",
          column="velocity", fault=True),
    Check("velocity-unrelated", _velocity_unrelated,
          "the velocity column of joint {joint} does not follow its position: {how}",
          "speeds are taken from position and time", column="velocity"),
    Check("position-held", _position_held, "position of joint {joint} often repeats while it moves, and then jumps: it "
          "is measured less often than it is logged, or its log repeats samples",
          "inertia and the ends of runs suffer"),
    Check("current-copied", _current_copied, "joints {other} and {joint} have the same current in every sample",
          "give each joint its own column; leave out one that was not measured", column="current", fault=True),
    Check("constant-current", _current_constant, "current of joint {joint} is {level} A in all {total} samples in "
          "which it moves", "name the column of the measured current; if there is none remove this one, the joint is "
          "then left out", column="current", fault=True),
    Check("current-saturated", _current_saturated, "current of joint {joint} is at its limit, {limit} A, in {count} of "
          "{total} moving samples", "it is cut off by the drive or the sensor; slower runs stay below",
          column="current"),
    Check("current-frozen", _current_frozen, "current of joint {joint} {how}",
          "the signal froze, is held and so late, or its steps are too coarse", column="current"),
    Check("current-dropouts", _current_zeros, "current of joint {joint} is exactly zero in {count} of {total} moving "
          "samples, and hardly ever next to zero: values that were lost were written as 0, or the drive or the sensor "
          "cuts small currents off", "leave lost values empty; small ones that are cut off spoil friction and gravity",
          column="current"),
    Check("current-size", _current_size, "current of joint {joint} is {largest} A at most, {unlike}",
          "see units: {{current: ...}} in the recipe's log block", column="current"),
    Check("joints-swapped", _currents_swapped, "{what}",
          "{perhaps}positions and currents are in different orders: put {pairs} into one order"),
    Check("joint-at-rest", _at_rest, "{which} in these logs", ""),
)  # fmt: skip


def _joints(sums: LogStatistics, *, moved: bool = True) -> Iterator[tuple[Joint, int]]:
    """Joints with their index, those that moved only."""
    for joint in sums.robot.joints:
        if not moved or sums.path[joint.number - 1] > MOVED:
            yield joint, joint.number - 1


def _measured(sums: LogStatistics, *, constant: bool = False) -> Iterator[tuple[Joint, int]]:
    """Joints that moved and have a current that changes, or one that is constant."""
    for joint, k in _joints(sums):
        is_constant = sums.least_current[k] == sums.most_current[k] and sums.moving[k] >= FLAT_COUNT
        if sums.moving[k] and is_constant == constant:
            yield joint, k


def _span(low: float, high: float) -> str:
    return f"{number(low)} to {number(high)}"


def _limits(joint: Joint) -> tuple[float, float]:
    """The joint's limits, rad or m; infinite without."""
    return joint.limits or (-math.inf, math.inf)


def _outside(sums: LogStatistics, joint: Joint, scale: float = 1.0) -> float:
    """How far positions times `scale` leave the joint's limits, as a share of their width; negative inside."""
    (low, high), k = _limits(joint), joint.number - 1
    return float(max(low - scale * sums.lowest[k], scale * sums.highest[k] - high)) / (high - low)


def _integral(sums: LogStatistics) -> Floats:
    """(J,) sums of squares of the integrated velocity columns, zero without one."""
    return np.diag(sums.products)[sums.robot.n_joints :]


def _ratio(sums: LogStatistics) -> Floats:
    """(J,) displacement per integrated velocity, NaN where a joint did not move or they do not belong together."""
    integral, both = _integral(sums), np.diag(sums.products, sums.robot.n_joints)
    belongs = (np.abs(np.diag(sums.agreement())) > AGREES) & (sums.path > 0)
    return np.where(belongs, both / np.where(integral > 0, integral, 1.0), np.nan)


def _off_ratios(sums: LogStatistics) -> Iterator[tuple[Joint, float]]:
    """Joints that moved, by position or by their velocity column, and whose ratio of the two is not one."""
    moved = (sums.path > MOVED) | (_integral(sums) > (MOVED * WINDOW) ** 2)
    for joint, ratio in zip(sums.robot.joints, _ratio(sums).tolist(), strict=True):
        if moved[joint.number - 1] and abs(ratio - 1.0) >= RATIO_FINE:
            yield joint, ratio


def _unit_changes(robot: Robot, joint: Joint, ratio: float) -> tuple[list[str], list[str]]:
    """Single changes of unit that bring the ratio to one: of position or time, and of the velocity column."""
    prefix, usual = ("", "rad") if joint.is_revolute else ("prismatic_", "m")

    def changes(key: str, usual: str, power: int) -> list[str]:
        return _other_units(robot, key, usual, lambda scale: abs(abs(ratio) * scale**power - 1.0) < UNIT_MATCH)

    first = changes(f"{prefix}position", usual, 1) + changes("time", "s", -1)
    return first, changes(f"{prefix}velocity", f"{usual}/s", -1)
