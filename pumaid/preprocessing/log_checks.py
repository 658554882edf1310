"""Checks of logs that do not mean what the recipe says: a table of slug, test, message and fix.

Each test looks at the statistics of one file, or of all, and yields the figures of each finding.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
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
#: Time steps (s) with which no arm is logged, and a step that does not show ramps, which take 0.1 to 0.3 s.
SLOWEST, FASTEST, COARSE = 1.0, 3e-5, 0.05
#: Multiple of the limits (of a slide, of their width) that a range must exceed before the unit is in doubt.
BEYOND, FAR_SLIDE = 1.5, 10.0
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
    if not any(item.slug in ("looks-like-degrees", "units-disagree") for item in items):
        items += [item for check in RATIO_CHECKS for item in check.run(sums)]
    if not any(isinstance(item, LogError) for item in items):
        items += [item for check in OTHER_CHECKS for item in check.run(sums)]
    return items


def _time_unit(sums: LogStatistics) -> Found:
    interval, unit = sums.interval(), sums.robot.log.units.get("time", "s")
    if not (interval >= SLOWEST or interval <= FASTEST):
        return
    ticks = interval / factor(unit)
    fitting = [
        f"units: {{time: {word}}} ({number(1.0 / (ticks * size))} samples a second)"
        for word, (dimension, size) in UNITS.items()
        if dimension == "time" and 2e-4 <= ticks * size <= 0.1
    ]
    fix = f"put {' or '.join(fitting)} into the recipe's log block" if fitting else "check the time column"
    fix += "; a count of rows is no time: then write the instants" if ticks == 1.0 else ""
    rate = f"one sample every {number(interval)} s" if interval > 1 else f"{number(1 / interval)} samples a second"
    yield {"unit": unit, "rate": rate, "fix": fix}


def _rate_low(sums: LogStatistics) -> Found:
    if COARSE < sums.interval() < SLOWEST:
        yield {"rate": number(1 / sums.interval())}


def _degrees(sums: LogStatistics) -> Found:
    """Positions that are far too large as radians: beyond limits that they would fit as degrees, or of many turns."""
    if sums.robot.log.units.get("position", "rad") != "rad":
        return
    turning = [(joint, k) for joint, k in _joints(sums, moved=False) if joint.is_revolute]
    furthest = np.maximum(np.abs(sums.lowest), np.abs(sums.highest))
    far = [(joint, k) for joint, k in turning if not joint.limits and furthest[k] > FAR]
    # A whole turn off may be another count of turns, not another unit.
    beyond = [
        (joint, k)
        for joint, k in turning
        if _outside(sums, joint) > max((BEYOND - 1.0) * _width(joint), math.tau) and _fits(sums, joint, factor("deg"))
    ]
    is_sure = bool(beyond or len(far) >= 2)
    for joint, k in (beyond or far)[:1]:
        why = f"its limits are {_span(joint.limits)} rad, and as degrees they would fit" if beyond else "over two turns"
        if is_sure or not abs(_ratio(sums)[k] - 1.0) < RATIO_FINE:
            yield {"joint": joint.number, "span": _range(sums, k), "why": why, "fault": is_sure}


def _radians(sums: LogStatistics) -> Found:
    """Radians that are read as degrees."""
    deg, spans = factor("deg"), sums.highest - sums.lowest
    turning = [(j, k) for j, k in _joints(sums, moved=False) if j.is_revolute and j.limits]
    if sums.robot.log.units.get("position", "rad") != "deg" or not turning:
        return
    joint, k = max(turning, key=lambda item: float(spans[item[1]]))
    if all(_fits(sums, j, 1 / deg) for j, _ in turning) and spans[k] / deg > MOVED and spans[k] < FEW_DEGREES:
        yield {"joint": joint.number, "span": number(spans[k] / deg)}


def _millimetres(sums: LogStatistics) -> Found:
    """A slide's millimetres that are read as metres."""
    if sums.robot.log.units.get("prismatic_position", "m") != "m":
        return
    for joint, k in _joints(sums, moved=False):
        is_far = not joint.is_revolute and _outside(sums, joint) > FAR_SLIDE * _width(joint)
        if is_far and _fits(sums, joint, factor("mm")):
            yield {"joint": joint.number, "span": _range(sums, k), "limits": _span(joint.limits)}
            return


def _units_disagree(sums: LogStatistics) -> Found:
    """The derivative of position against the velocity column, by a factor between two units."""
    for joint, value in _off_ratios(sums):
        fitting = _unit_changes(sums.robot, joint, value)
        if fitting:
            words = " or ".join(f"units: {{{quantity}: {unit}}}" for quantity, unit in fitting)
            is_sure = any(not quantity.endswith("velocity") for quantity, _ in fitting)
            words += " into the recipe's log block" + ("" if is_sure else " (speeds are taken from position)")
            yield {"joint": joint.number, "ratio": number(value), "words": words, "fault": is_sure}
            return


def _velocity_sign(sums: LogStatistics) -> Found:
    yield from ({"joint": joint.number} for joint, ratio in _off_ratios(sums) if abs(ratio + 1.0) < RATIO_FINE)


def _velocity_unrelated(sums: LogStatistics) -> Found:
    """A velocity column of another scale, or of another signal."""
    ratios = list(_off_ratios(sums))
    if any(_unit_changes(sums.robot, joint, value) for joint, value in ratios):
        return
    for joint, value in ratios:
        how = f"the position changes {number(value)} times as fast"
        if joint.gear_ratio and abs(abs(value * joint.gear_ratio) - 1.0) < UNIT_MATCH:
            how += f" (the ratio is that of the gear, {number(joint.gear_ratio)}: the column is the motor's speed)"
        if abs(value + 1.0) >= RATIO_FINE:
            yield {"joint": joint.number, "how": how}
    for joint, k in _joints(sums):
        match = abs(float(sums.agreement()[k, k]))
        if sums.has_velocity and sums.integral[k] > 0 and match < UNRELATED:
            yield {"joint": joint.number, "how": f"their correlation is {match:.2f}"}


def _beyond_limits(sums: LogStatistics) -> Found:
    speed = _rms_speed(sums)
    for joint, k in _joints(sums, moved=False):
        unit, limit = joint.position_unit, joint.max_velocity
        if limit and speed[k] > BEYOND * limit and sums.path[k] > MOVED:
            what = f"moves at {number(speed[k])} {unit}/s (RMS), its maximum is {number(limit)}"
            yield {"joint": joint.number, "what": what, "fix": "check the units of time and of position"}
        if _outside(sums, joint) > 0.05 * _width(joint):
            what = f"runs from {_range(sums, k)} {unit}, beyond its limits {_span(joint.limits)}"
            yield {"joint": joint.number, "what": what, "fix": "check zero, sign and unit"}


def _velocities_swapped(sums: LogStatistics) -> Found:
    """Velocity columns that follow the positions of other joints."""
    match = np.abs(sums.agreement())
    followed = {
        joint.number: int(np.argmax(match[k])) + 1
        for joint, k in _joints(sums)
        if sums.integral[k] > 0 and match[k, k] < ANOTHER and match[k].max() > AGREES
    }
    if followed:
        pairs = ", ".join(f"position {a} with velocity {b}" for a, b in followed.items())
        yield {"joint": next(iter(followed)), "pairs": pairs}


def _currents_swapped(sums: LogStatistics) -> Found:
    """A joint that moves while another draws the current.

    While joint a moves alone its friction changes sign with direction, and no other joint's does: gravity is a function
    of position. So the current that answers to a's direction, beside cos and sin of its angle, is the current of a.
    """
    answer, share = _answers(sums)
    moved_to: dict[int, int] = {}
    for a in np.flatnonzero(~np.isnan(np.diag(answer))).tolist():
        b = int(np.nanargmax(np.abs(answer[a])))
        if b != a and share[a, b] > STRONG and abs(answer[a, b]) > STRONGER * abs(answer[a, a]):
            moved_to[a + 1] = b + 1
    if not moved_to:
        return
    what = "; ".join(
        f"when joint {a} moves, current {b} changes by {number(2 * abs(answer[a - 1, b - 1]), 2)} A with direction, "
        f"its own by {number(2 * abs(answer[a - 1, a - 1]), 2)} A"
        for a, b in moved_to.items()
    )
    log = sums.robot.log
    pairs = ", ".join(f"{log.column('position', a)} beside {log.column('current', b)}" for a, b in moved_to.items())
    is_sure = len(moved_to) >= 2 and len(set(moved_to.values())) == len(moved_to)
    perhaps = "" if is_sure else "perhaps "
    yield {"joint": next(iter(moved_to)), "what": what, "perhaps": perhaps, "pairs": pairs, "fault": is_sure}


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
    Check("looks-like-degrees", _degrees, "positions of joint {joint} run from {span}; {why}",
          "if they are degrees put units: {{position: deg}} into the recipe's log block"),
    Check("units-disagree", _radians, "no position covers more than {span} degrees (joint {joint}); as radians all "
          "would fit", "take position: deg out of the units in the recipe's log block", fault=True),
    Check("units-disagree", _millimetres, "positions of joint {joint} run from {span}; its limits are {limits} m, and "
          "as millimetres they would fit", "put units: {{prismatic_position: mm}} into the recipe's log block",
          fault=True),
)  # fmt: skip
#: The derivative of position against the velocity column; where positions are in doubt, it is not asked.
RATIO_CHECKS = (
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


def _span(ends: tuple[float, float] | None) -> str:
    low, high = ends or (math.nan, math.nan)
    return f"{number(low)} to {number(high)}"


def _range(sums: LogStatistics, k: int) -> str:
    return _span((sums.lowest[k], sums.highest[k]))


def _width(joint: Joint) -> float:
    """Of the joint's limits, rad or m; infinite without."""
    return joint.limits[1] - joint.limits[0] if joint.limits else math.inf


def _outside(sums: LogStatistics, joint: Joint) -> float:
    """How far positions leave the joint's limits (rad or m), negative inside."""
    low, high = joint.limits or (-math.inf, math.inf)
    return float(max(low - sums.lowest[joint.number - 1], sums.highest[joint.number - 1] - high))


def _fits(sums: LogStatistics, joint: Joint, scale: float) -> bool:
    """Whether positions times `scale` fit the limits, but for a tenth of their width."""
    low, high = joint.limits or (-math.inf, math.inf)
    k, slack = joint.number - 1, 0.1 * (high - low)
    return bool(scale * sums.lowest[k] >= low - slack and scale * sums.highest[k] <= high + slack)


def _rms_speed(sums: LogStatistics) -> Floats:
    """(J,) RMS speed while moving; no more than the maximum, whatever the motion."""
    return np.sqrt(sums.speed_squares / np.maximum(sums.seconds, 1e-12))


def _ratio(sums: LogStatistics) -> Floats:
    """(J,) displacement per integrated velocity, NaN where a joint did not move or they do not belong together."""
    belongs = (np.abs(np.diag(sums.agreement())) > AGREES) & (sums.path > 0)
    return np.where(belongs, np.diag(sums.moved_by) / np.where(sums.integral > 0, sums.integral, 1.0), np.nan)


def _off_ratios(sums: LogStatistics) -> Iterator[tuple[Joint, float]]:
    """Joints that moved, by displacement or by their velocity column, and whose ratio of the two is not one."""
    moved = (sums.path > MOVED) | ((sums.displacement > 0) & (sums.integral > (MOVED * WINDOW) ** 2))
    for joint, value in zip(sums.robot.joints, _ratio(sums).tolist(), strict=True):
        if moved[joint.number - 1] and abs(value - 1.0) >= RATIO_FINE:
            yield joint, value


def _unit_changes(robot: Robot, joint: Joint, ratio: float) -> list[tuple[str, str]]:
    """(key, unit word) of every single change of unit that brings the ratio to one."""
    prefix, per = ("", "angular") if joint.is_revolute else ("prismatic_", "linear")
    quantities = (
        (f"{prefix}position", "angle" if joint.is_revolute else "length", "rad" if joint.is_revolute else "m", 1),
        ("time", "time", "s", -1),
        (f"{prefix}velocity", f"{per} velocity", "rad/s" if joint.is_revolute else "m/s", -1),
    )
    changes = []
    for key, dimension, standard, power in quantities:
        now = robot.log.units.get(key, robot.log.units.get(key.removeprefix("prismatic_"), standard))
        for word, (of, size) in UNITS.items():
            scaled = abs(ratio) * (size / factor(now)) ** power
            if of == dimension and word != now and abs(scaled - 1.0) < UNIT_MATCH:
                changes.append((key, word))
    return changes


def _answers(sums: LogStatistics) -> tuple[Floats, Floats]:
    """(J, J) half difference of current b between a's directions (A), and the share of variance that it explains.

    Within each posture, so that gravity's change from posture to posture counts neither way. NaN where joint a did not
    move alone both ways long enough.
    """
    n = sums.robot.n_joints
    answer, share = np.full((n, n), np.nan), np.zeros((n, n))
    for a in range(n):
        if sums.ways[a].min() < FEWEST_WAYS or sums.path[a] < MOVED:
            continue
        rest = _beside_gravity(np.array([*sums.groups[a].values()])).sum(axis=0)
        if rest[0, 0] < FEWEST_WAYS:
            continue
        answer[a] = rest[0, 1:] / rest[0, 0]
        share[a] = rest[0, 1:] ** 2 / (rest[0, 0] * np.maximum(np.diag(rest)[1:], 1e-300))
        answer[a, (sums.moving == 0) & (sums.path > MOVED)] = np.nan
    return answer, share


def _beside_gravity(sums: Floats) -> Floats:
    """(G, 1 + J, 1 + J) sums of direction and currents once 1, cos and sin are taken out of them, of G postures."""
    inverse = np.linalg.pinv(sums[:, :3, :3], rcond=1e-9, hermitian=True)
    cross = sums[:, :3, 3:]
    return np.asarray(sums[:, 3:, 3:] - cross.transpose(0, 2, 1) @ inverse @ cross)
