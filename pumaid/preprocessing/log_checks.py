"""Checks of logs that do not mean what the recipe says: running statistics, and a table of slug, test, message and fix.

Each test looks at the statistics of one file, or of all, and yields the figures of each finding.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from pumaid.errors import LogError, Note, Where, listed
from pumaid.io.column_names import log_block
from pumaid.preprocessing.joint_signals import (
    FARTHEST,
    FEWEST_WAYS,
    FLAT_WINDOWS,
    JUMPS,
    MOST_AMPERES,
    MOVED,
    RATIO_FINE,
    STRONG,
    STRONGER,
    UNRELATED,
    JointSignals,
    calibrated_range,
    current_encoding,
    other_units,
    position_counts,
    signals_of,
)
from pumaid.preprocessing.log_statistics import LogStatistics
from pumaid.preprocessing.parallel_filter import LONGEST_CELL
from pumaid.units import CURRENTS_IN, factor, number

#: What a test yields: figures of the message, and `joint` (from 1) where it is one joint's, `fault` where not the rule.
Found = Iterator[dict[str, Any]]

#: Time steps (s) with which no arm is logged, a step that does not show ramps, which take 0.1 to 0.3 s, and usual ones.
SLOWEST, FASTEST, COARSE, USUAL = 1.0, 3e-5, 0.05, (2e-4, 0.1)
#: Multiple of the limits that a range must exceed before the unit is in doubt.
BEYOND = 1.5
#: rad; two turns each way: one joint beyond may turn endlessly, two of an arm do not. And less than any experiment.
FAR, FEW_DEGREES = 4.0 * math.pi, 0.12
#: Share of windows with repeated positions, and mean step over the least one; an encoder's slow steps are one count.
#: Steps in a cell, at a joint's RMS speed, below which noise of accelerations makes inertia too small.
STILL_TIME, UNEQUAL, FEWEST_STEPS = 0.5, 2.0, 10
#: Displacement over integrated velocity below which velocities are of motors before gears, and no clock is so wrong.
GEARED = 0.05
#: What currents are in where their unit is another.
SHOWN = {"Nm": "N m", "mNm": "N m", "percent": "rated torque", "permille": "rated torque", "raw": "counts"}
#: A; what motors of arms draw at most is more.
SMALL = 0.02


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


def _each(predicate: Callable[[JointSignals], object]) -> Callable[[LogStatistics], Found]:
    return lambda sums: ({"joint": j.joint.number, "j": j} for j in signals_of(sums) if predicate(j))


def _first(
    predicate: Callable[[JointSignals], object], mend: Callable[[Sequence[JointSignals]], str] = lambda signals: ""
) -> Callable[[LogStatistics], Found]:
    """A test of each joint by itself, told of the first with the numbers of the others, and how to `mend` them."""

    def test(sums: LogStatistics) -> Found:
        chosen = [j for j in signals_of(sums) if predicate(j)]
        beside = ", ".join(str(j.joint.number) for j in chosen[1:])
        alike = f" (and of {beside})" if beside else ""
        for j in chosen[:1]:
            yield {"joint": j.joint.number, "j": j, "alike": alike, "mend": mend(chosen)}

    return test


def _time_unit(sums: LogStatistics) -> Found:
    interval, unit = sums.interval(), sums.robot.log.units.get("time", "s")
    is_impossible = interval >= SLOWEST or interval <= FASTEST
    if is_impossible or interval > COARSE:
        fitting = other_units(sums.robot, "time", "s", fits=lambda scale: USUAL[0] <= interval * scale <= USUAL[1])
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
    joints = [j for j in signals_of(sums) if j.joint.is_revolute == is_angle]
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
            mend = _other_unit(suspects or turning, joints, key=key, meant=meant, scale=scale)
            figures = {"read": read, "meant": meant, "mend": mend, "j": j, "why": why}
            yield figures | {"joint": j.joint.number, "fault": is_sure}


def _other_unit(
    wrong: Sequence[JointSignals], joints: Sequence[JointSignals], *, key: str, meant: str, scale: float
) -> str:
    """The unit for the recipe of all joints; and of the `wrong` ones only, where others would hardly move in it."""
    log, numbers = wrong[0].sums.robot.log, [j.joint.number for j in wrong]
    beside = [j for j in joints if j.has_moved and j.joint.number not in numbers]
    mend = f"if they are {meant} put units: {{{key}: {meant}}} into the recipe's log block"
    if not any(scale * (j.highest - j.lowest) < FEW_DEGREES for j in beside):
        return mend
    meanings = [(k, log.conversion("position", k)) for k in range(1, wrong[0].sums.robot.n_joints + 1)]
    scaled = tuple(replace(item, scale=item.scale * (scale if k in numbers else 1.0)) for k, item in meanings)
    block = log_block(replace(log, conversions={**log.conversions, "position": scaled}))
    return f"{mend}; if of joint {listed(sorted(map(str, numbers)))} only, this in place of that block:\n{block}"


def _units_disagree(sums: LogStatistics) -> Found:
    for j in signals_of(sums):
        changes, speeds = j.unit_changes()
        if changes or speeds:
            words = f"{' or '.join(changes + speeds)} into the recipe's log block"
            words += "" if changes else " (speeds are taken from position)"
            yield {"joint": j.joint.number, "ratio": number(j.ratio), "words": words, "fault": bool(changes)}
            return


def _unlike_clock(sums: LogStatistics) -> Found:
    signals = [j for j in signals_of(sums) if not math.isnan(j.ratio)]
    off = [j for j in signals if j.is_off and abs(j.ratio + 1.0) >= RATIO_FINE and not any(j.unit_changes())]
    ratios = [j.ratio for j in off]
    is_one = bool(off) and len(off) == len(signals) and max(ratios) < (1.0 + RATIO_FINE) * min(ratios)
    if is_one and min(ratios) > GEARED:
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
        what += " (is it the motor's, before the gear?)" if abs(j.ratio) < GEARED else ""
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
        rows = [np.hstack([columns[:, :4], currents]) for columns, currents in sums.postures(a)]
        groups = np.array([part.T @ part for part in rows]).reshape(-1, 4 + n, 4 + n)
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


#: Signs of positions, then units, since wrong ones cause much of what follows: where one is refused, the checks of
#: later tables are not made.
POSITION_CHECKS = (
    Check("units-disagree", _first(lambda j: j.normalised, mend=calibrated_range),
          "positions of joint {joint}{alike} run from {j.normalised[0]:g} to 100 in the log, exactly and no farther: "
          "hundredths of a calibrated range (LeRobot's, without use_degrees), no angles", "{mend}", fault=True),
    Check("sign-lost", _first(lambda j: j.jump, mend=position_counts),
          "the position of joint {joint}{alike} jumps by {j.jump:.5g} {j.joint.position_unit} {j.jumps:.0f} times "
          "while it moves on: the encoder's range is no turn in this unit, or a sign was lost", "{mend}", fault=True),
    Check("bad-samples", _first(lambda j: j.strays and not j.jump),
          "the position of joint {joint}{alike} leaps away and back faster than any arm, to {j.stray:.5g} for one "
          "(leaps: {j.strays:.0f}): where it was lost, another number was written",
          "leave lost positions empty; their rows are left out, up to one in twenty", fault=True),
    Check("units-disagree", _first(lambda j: j.is_impossible and not (j.jump or j.strays), mend=position_counts),
          "positions of joint {joint}{alike} run from {j.span}, where no joint can be: counts of an encoder, or in "
          "another unit", "{mend}", fault=True),
    Check("sign-lost", _first(lambda j: j.bounces >= JUMPS and max(j.lowest, -j.highest) >= 0.0
                              and not (j.jump or j.is_impossible or j.strays)),
          "the position of joint {joint}{alike} turns back at zero at full speed, {j.bounces:.0f} times: its sign was "
          "lost", "write positions with their sign", fault=True),
)  # fmt: skip
UNIT_CHECKS = (
    Check("time-unit", _time_unit, "with time read in {unit} there is {rate}, {why}", "{fix}", column="time"),
    *(
        Check("units-disagree", partial(_position_unit, read=read, meant=meant),
              "positions of joint {joint}, read as {read}, run from {j.span}; {why}",
              "{mend}")
        for read, meant in (("rad", "deg"), ("deg", "rad"), ("m", "mm"))
    ),
    Check("units-disagree", _units_disagree, "position of joint {joint} changes {ratio} times as fast as its velocity "
          "column says", "put {words}", column="velocity"),
    Check("velocity-unrelated", _each(lambda j: j.is_off and abs(j.ratio + 1.0) < RATIO_FINE),
          "velocity of joint {joint} has the sign opposite to its motion", "speeds are taken from position",
          column="velocity"),
)  # fmt: skip
OTHER_CHECKS = (
    Check("units-disagree",
          _first(lambda j: not j.joint.is_revolute and j.joint.limits is not None and j.outside() > FARTHEST),
          "joint {joint} slides, and its positions run from {j.span}, far beyond its limits {j.limits}",
          "write their unit into the recipe's log block, as in units: {{prismatic_position: mm}}, or right limits into "
          "the recipe", fault=True),
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
    Check("position-coarse", _first(lambda j: j.speed * LONGEST_CELL < FEWEST_STEPS * j.step
                                     and (not j.step_count or j.step_sum <= UNEQUAL * j.least_step * j.step_count)),
          "positions of joint {joint}{alike} have steps or noise of {j.step:.3g} {j.joint.position_unit}, "
          f"over 1/{FEWEST_STEPS} of its way in {LONGEST_CELL:g} s at its usual speed",
          "where several joints move inertia comes out too small; write more digits, or take a finer encoder"),
    Check("current-unmeasured", _each(lambda j: j.copy_of),
          "joints {j.copy_of} and {joint} have the same current in every sample",
          "give each joint its own column; leave out one that was not measured", column="current", fault=True),
    Check("current-unmeasured", _each(lambda j: j.has_moved and j.is_constant),
          "current of joint {joint} is {j.least_current:.4g} A in all {j.moving:.0f} samples in which it moves",
          "name the column of the measured current; if there is none remove this one, the joint is then left out",
          column="current", fault=True),
    Check("sign-lost", _first(lambda j: j.is_measured and j.lost_sign[0], mend=current_encoding),
          "the current of joint {joint}{alike} {j.lost_sign[0]}", "{mend}", column="current", fault=True),
    Check("current-dropouts", _each(lambda j: j.mark),
          "current of joint {joint} is exactly {j.mark[0]} A in {j.mark[1]} of {j.moving:.0f} moving samples, "
          f"and no arm's motor draws more than {MOST_AMPERES:g} A: values that were lost were written so",
          "leave lost values empty", column="current", fault=True),
    Check("current-saturated", _each(lambda j: j.is_measured and j.flat_top and not j.mark),
          "current of joint {joint} is at its limit, {j.flat_top[0]} A, in {j.flat_top[1]} of {j.moving:.0f} moving "
          "samples", "it is cut off by the drive or the sensor; slower runs stay below", column="current"),
    Check("current-spikes", _each(lambda j: j.is_measured and j.spikes and not (j.mark or j.has_zeros)),
          "current of joint {joint} leaps to {j.spike:.4g} A and back within a sample, farther than all others are "
          "apart (leaps: {j.spikes:.0f} in {j.moving:.0f} moving samples)",
          "errors come out too large, and spikes to one side bias friction and gravity: leave these cells empty",
          column="current"),
    Check("current-frozen", _each(lambda j: j.is_measured and not j.flat_top and j.frozen),
          "current of joint {joint} {j.frozen}", "the signal froze, is held and so late, or its steps are too coarse",
          column="current"),
    Check("current-dropouts", _each(lambda j: j.is_measured and j.has_zeros and not j.flat_top and not j.frozen),
          "current of joint {joint} is exactly zero in {j.zeros:.0f} of {j.moving:.0f} moving samples, and hardly ever "
          "next to zero: values that were lost were written as 0, or the drive or the sensor cuts small currents off",
          "leave lost values empty; small ones that are cut off spoil friction and gravity", column="current"),
    Check("units-disagree", _first(lambda j: j.is_counted and not j.lost_sign[0]),
          "currents of joint {joint}{alike} are whole numbers, up to {j.largest:.4g}: counts of a driver, not A",
          "put units: {{current: raw}} into the recipe's log block: ratios of gains hold, and all else is in counts; "
          "or say there what a count is (mA, permille, percent, or a scale)", column="current", fault=True),
    Check("units-disagree", _first(lambda j: j.is_measured and j.is_large and not (j.is_counted or j.mark)),
          "current of joint {joint}{alike} is {j.largest:.4g} A at most, and no arm's motor draws more than "
          f"{MOST_AMPERES:g} A",
          "put units: {{current: mA}} (or percent, permille, Nm; raw where nobody knows) into the recipe's log block; "
          "where only some joints are in it, current: {{column: {j.sums.robot.log.current}, scale: [1, 0.001, ...]}}, "
          "a factor for each joint",
          column="current", fault=True),
    Check("units-disagree", _each(lambda j: j.is_measured and j.is_ampere and not (j.is_large or j.mark or j.spikes)
          and not SMALL <= j.largest <= MOST_AMPERES),
          "current of joint {joint} is {j.largest:.4g} A at most, and an arm's motor draws more than "
          f"{SMALL:g} and less than {MOST_AMPERES:g} A",
          "see units: {{current: ...}} in the recipe's log block", column="current"),
    Check("joints-swapped", _currents_swapped, "{what}",
          "{perhaps}positions and currents are in different orders: put {pairs} into one order"),
    Check("unit-shown",
          lambda sums: ({"shown": SHOWN[unit]} for unit in {sums.robot.log.units.get("current", "A")} & {*SHOWN}),
          f"{CURRENTS_IN}{{shown}}; JSON and files of tables, figures and code say A for it", ""),
    Check("unit-shown", _first(lambda j: j.is_measured and "current" not in j.sums.robot.log.units
          and any(word in j.sums.robot.log.current.lower() for word in ("effort", "load"))),
          "{j.sums.robot.log.current} is read as A, and drivers write N m, A, mA or a share of a rated torque there: "
          "weight and friction are in its unit, whatever results say",
          "say effort: current, effort: torque or units: {{current: ...}} in the recipe's log block", column="current"),
    Check("unit-shown", _first(lambda j: j.has_moved and max(-j.lowest, j.highest) < 100.0 * factor("deg")
          and j.sums.robot.log.units.get("position") == "deg"
          and any(word in j.sums.robot.log.position for word in (".pos", "observation.state"))),
          "positions are read as degrees, and none is beyond 100: LeRobot without use_degrees writes hundredths of a "
          "joint's calibrated range so", "if these are such, weights and friction are wrong: write their scale"),
    Check("joint-at-rest",
          lambda sums: ({"which": f"joint{'s' * bool(still[1:])} {', '.join(still)} never move{'s' * (not still[1:])}"}
              for still in [[str(j.joint.number) for j in signals_of(sums) if not j.has_moved]]
              if 0 < len(still) < sums.robot.n_joints),
          "{which} in these logs", ""),
)  # fmt: skip
