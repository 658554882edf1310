"""Checks behind `suspicion` of units, limits and order: a stream's sums to faults (`LogError`) and doubts (`Note`)."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import LogError, Note, Where
from pumaid.preprocessing.tally import WINDOW, Tally
from pumaid.robot import Robot
from pumaid.units import UNITS, factor, number

Floats = NDArray[np.float64]
Found = Iterator[LogError | Note]

#: Path (rad or m) from which a joint counts as moved: less is drift, or a test of the brakes.
MOVED = 0.2
#: Displacements and a velocity column that belong together agree this well (real logs: 0.99 and more).
AGREES = 0.95
#: Relative error within which a ratio is taken for the ratio of two units; scale errors of sensors are smaller.
UNIT_MATCH = 0.03
#: A ratio within this of one is right: real logs are within 0.015.
RATIO_FINE = 0.05
#: Intervals (s) at which no arm is logged: a second and more, or above 33 kHz.
SLOWEST, FASTEST = 1.0, 3e-5
#: s; ramps of an arm take 0.1 to 0.3 s: fewer samples do not show them.
COARSE = 0.05
#: Multiple of the limits' width that a range must exceed before the unit is in doubt.
BEYOND = 1.5
#: rad; an experiment in which no joint covers more than seven degrees shows next to nothing.
FEW_DEGREES = 0.12
#: The same of a slide, which no count of turns can shift.
FAR_SLIDE = 10.0
#: rad; two turns each way. One joint beyond may turn endlessly; two of an arm do not.
FAR = 4.0 * math.pi
#: Windows each way from which a joint's friction can be told from its gravity.
_FEWEST_WAYS = 30
#: Share of a current's variance beside gravity that the direction of another joint must explain (squared correlation).
_STRONG = 0.5
#: How much more the other joint's current must answer to the direction than the joint's own.
_STRONGER = 4.0


def of_units(tally: Tally) -> Found:
    """Time, positions and velocities against each other, against the limits, and against what arms do."""
    yield from _of_interval(tally)
    yield from [*_of_degrees(tally), *_of_radians(tally), *_of_millimetres(tally)] or _of_ratio(tally)


def _of_interval(tally: Tally) -> Found:
    interval = tally.rate_interval()
    unit = tally.robot.log.units.get("time", "s")
    where = Where(file=tally.origin, column=tally.robot.log.time)
    if interval >= SLOWEST or interval <= FASTEST:
        rate = (
            f"one sample every {number(interval)} s"
            if interval >= SLOWEST
            else f"{number(1 / interval)} samples a second"
        )
        ticks = interval / factor(unit)
        fitting = [
            f"units: {{time: {word}}} ({number(1.0 / (ticks * size))} samples a second)"
            for word, (dimension, size) in UNITS.items()
            if dimension == "time" and 2e-4 <= ticks * size <= 0.1
        ]
        hint = f"put {' or '.join(fitting)} into the recipe's log block" if fitting else "check the time column"
        if ticks == 1.0:
            hint += "; a count of rows is no time: then write the instants"
        yield LogError("time-unit", f"with time read in {unit} there is {rate}; no arm is logged so", where, hint)
    elif interval > COARSE:
        text = f"{number(1 / interval)} samples a second are too few to see where an arm speeds up and slows down"
        yield Note("rate-low", f"{text}; 50 or more are needed for good runs", where)


def _of_degrees(tally: Tally) -> Found:
    """Positions that are far too large as radians."""
    robot = tally.robot
    turning = [joint for joint in robot.joints if joint.is_revolute]
    furthest = np.maximum(np.abs(tally.lowest), np.abs(tally.highest))
    beyond = [j for j in turning if j.limits and _far_beyond(tally, j.number) and _fits_in_degrees(tally, j.number)]
    too_fast = [j for j in turning if j.max_velocity and _rms_speed(tally)[j.number - 1] > BEYOND * j.max_velocity]
    far = [j for j in turning if not j.limits and furthest[j.number - 1] > FAR]
    if robot.log.units.get("position", "rad") != "rad" or not (beyond or len(far) >= 1):
        return
    joint = (beyond or far)[0]
    index = joint.number - 1
    span = f"{number(tally.lowest[index])} to {number(tally.highest[index])}"
    if beyond and joint.limits:
        allowed = f"its limits are {number(joint.limits[0])} to {number(joint.limits[1])} rad"
        what = f"positions of joint {joint.number} run from {span}; {allowed}, and as degrees they would fit"
    else:
        what = f"positions of joint {joint.number} run from {span} rad, more than two turns"
    if too_fast:
        fast = too_fast[0]
        speed = number(_rms_speed(tally)[fast.number - 1])
        what += f"; joint {fast.number} would move at {speed} rad/s, its maximum is {number(fast.max_velocity or 0.0)}"
    where = Where(file=tally.origin, joint=joint.number, column=robot.log.column("position", joint.number))
    mend = "if they are degrees put units: {position: deg} into the recipe's log block"
    if beyond or len(far) >= 2 or too_fast:
        yield LogError("looks-like-degrees", what, where, mend)
    elif not _agreeing(tally)[index]:
        yield Note("looks-like-degrees", f"{what}; {mend}", where)


def _of_radians(tally: Tally) -> Found:
    """Positions that are far too small as degrees: no joint leaves a few of them, and as radians all would fit."""
    robot, deg = tally.robot, factor("deg")
    spans = tally.highest - tally.lowest
    turning = [j for j in robot.joints if j.is_revolute and j.limits and np.isfinite(spans[j.number - 1])]
    if robot.log.units.get("position", "rad") != "deg" or not turning:
        return
    low, high = tally.lowest / deg, tally.highest / deg
    slack = 0.05 * (turning[0].limits[1] - turning[0].limits[0])  # type: ignore[index]
    fits = all(
        j.limits[0] - slack <= low[j.number - 1] and high[j.number - 1] <= j.limits[1] + slack  # type: ignore[index]
        for j in turning
    )
    joint = max(turning, key=lambda j: float(spans[j.number - 1]))
    widest = float(spans[joint.number - 1]) / deg
    if fits and widest > MOVED and widest * deg < FEW_DEGREES:
        column = robot.log.column("position", joint.number)
        what = f"no position covers more than {number(widest)} degrees (joint {joint.number}); as radians all would fit"
        mend = "if they are radians take position: deg out of the units in the recipe's log block"
        yield LogError("looks-like-radians", what, Where(file=tally.origin, joint=joint.number, column=column), mend)


def _of_millimetres(tally: Tally) -> Found:
    """Positions of a slide that are a thousand times too large as metres."""
    robot, mm = tally.robot, factor("mm")
    if robot.log.units.get("prismatic_position", "m") != "m":
        return
    for joint in robot.joints:
        index, limits = joint.number - 1, joint.limits
        if joint.is_revolute or limits is None:
            continue
        low, high = float(tally.lowest[index]), float(tally.highest[index])
        width = limits[1] - limits[0]
        slack = 0.1 * width
        is_far = max(limits[0] - low, high - limits[1]) > FAR_SLIDE * width
        if is_far and mm * low >= limits[0] - slack and mm * high <= limits[1] + slack:
            yield LogError(
                "looks-like-millimetres",
                f"positions of joint {joint.number} run from {number(low)} to {number(high)}; its limits are"
                f" {number(limits[0])} to {number(limits[1])} m, and as millimetres they would fit",
                Where(file=tally.origin, joint=joint.number, column=robot.log.column("position", joint.number)),
                "if they are millimetres put units: {prismatic_position: mm} into the recipe's log block",
            )
            return


def _far_beyond(tally: Tally, joint: int) -> bool:
    limits = tally.robot.joint(joint).limits
    if limits is None:
        return False
    width = limits[1] - limits[0]
    outside = max(limits[0] - tally.lowest[joint - 1], tally.highest[joint - 1] - limits[1])
    # A whole turn off may be another count of turns, not another unit.
    return bool(outside > max((BEYOND - 1.0) * width, math.tau))


def _fits_in_degrees(tally: Tally, joint: int) -> bool:
    limits = tally.robot.joint(joint).limits
    if limits is None:
        return False
    slack = 0.1 * (limits[1] - limits[0])
    low, high = factor("deg") * tally.lowest[joint - 1], factor("deg") * tally.highest[joint - 1]
    return bool(low >= limits[0] - slack and high <= limits[1] + slack)


def _rms_speed(tally: Tally) -> Floats:
    """(J,) RMS speed while moving; no more than the maximum, whatever the motion."""
    return np.sqrt(tally.speed_squares / np.maximum(tally.seconds, 1e-12))


def _ratio(tally: Tally) -> Floats:
    """(J,) displacement per integrated velocity, NaN where a joint did not move or they do not belong together."""
    belongs = (np.abs(np.diag(tally.agreement())) > AGREES) & (tally.path > 0)
    return np.where(belongs, np.diag(tally.moved_by) / np.where(tally.integral > 0, tally.integral, 1.0), np.nan)


def _agreeing(tally: Tally) -> NDArray[np.bool_]:
    """(J,) whether the velocity column says what the positions say."""
    return np.abs(_ratio(tally) - 1.0) < RATIO_FINE


def _of_ratio(tally: Tally) -> Found:
    """The derivative of position against the velocity column."""
    ratio = _ratio(tally)
    moved = _really_moved(tally)
    for joint in tally.robot.joints:
        value = float(ratio[joint.number - 1])
        if not moved[joint.number - 1] or math.isnan(value) or abs(value - 1.0) < RATIO_FINE:
            continue
        column = tally.robot.log.column("velocity", joint.number)
        where = Where(file=tally.origin, joint=joint.number, column=column)
        what = f"position of joint {joint.number} changes {number(value)} times as fast as its velocity column says"
        fitting = _unit_changes(tally.robot, joint.number, value)
        if fitting:
            words = " or ".join(f"units: {{{quantity}: {unit}}}" for quantity, unit in fitting)
            mend = f"put {words} into the recipe's log block"
            if any(quantity in ("position", "prismatic_position", "time") for quantity, _ in fitting):
                yield LogError("units-disagree", what, where, mend)
            else:
                yield Note("units-disagree", f"{what}; {mend} (speeds are taken from position)", where)
        elif abs(value + 1.0) < RATIO_FINE:
            yield Note("velocity-sign", f"velocity of joint {joint.number} has the sign opposite to its motion", where)
        else:
            yield Note(
                "velocity-scale",
                f"{what}; speeds are taken from position and time{_gear(tally.robot, joint.number, value)}",
                where,
            )
        if fitting:
            return


def _really_moved(tally: Tally) -> NDArray[np.bool_]:
    """(J,) by displacement or, where a wrong unit makes that small, by the velocity column."""
    return (tally.path > MOVED) | ((tally.displacement > 0) & (tally.integral > (MOVED * WINDOW) ** 2))


def _unit_changes(robot: Robot, joint: int, ratio: float) -> list[tuple[str, str]]:
    """(key, unit word) of every single change of unit that brings the ratio to one."""
    turning = robot.joint(joint).is_revolute
    prefix = "" if turning else "prismatic_"
    dimensions = {
        "position": "angle" if turning else "length",
        "velocity": f"{'angular' if turning else 'linear'} velocity",
    }
    standard = {"position": "rad" if turning else "m", "velocity": "rad/s" if turning else "m/s", "time": "s"}
    found = []
    for quantity, power in (("position", 1), ("time", -1), ("velocity", -1)):
        key = quantity if quantity == "time" else prefix + quantity
        now = robot.log.units.get(key, robot.log.units.get(quantity, standard[quantity]))
        for word, (dimension, size) in UNITS.items():
            if dimension != dimensions.get(quantity, "time") or word == now:
                continue
            changed = abs(ratio) * (size / factor(now)) ** power
            if abs(changed - 1.0) < UNIT_MATCH:
                found.append((key, word))
    return found


def _gear(robot: Robot, joint: int, ratio: float) -> str:
    gear = robot.joint(joint).gear_ratio
    if gear and abs(abs(ratio * gear) - 1.0) < UNIT_MATCH:
        return f" (the ratio is that of the gear, {number(gear)}: the column is the motor's speed)"
    return ""


def of_limits(tally: Tally) -> Found:
    """Positions and speeds outside the recipe's limits, where the velocity column does not say what is wrong."""
    speed = _rms_speed(tally)
    for joint in tally.robot.joints:
        most, own = joint.max_velocity, float(speed[joint.number - 1])
        if most and own > BEYOND * most and tally.path[joint.number - 1] > MOVED:
            speeds = f"{number(own)} {joint.position_unit}/s (RMS), its maximum is {number(most)}"
            text = f"joint {joint.number} moves at {speeds}"
            where = Where(file=tally.origin, joint=joint.number, column=tally.robot.log.time)
            yield Note("beyond-speed", f"{text}: check the units of time and of position", where)
        if joint.limits is None:
            continue
        low, high = float(tally.lowest[joint.number - 1]), float(tally.highest[joint.number - 1])
        slack = 0.05 * (joint.limits[1] - joint.limits[0])
        if low < joint.limits[0] - slack or high > joint.limits[1] + slack:
            span = f"{number(low)} to {number(high)} {joint.position_unit}"
            allowed = f"{number(joint.limits[0])} to {number(joint.limits[1])}"
            column = tally.robot.log.column("position", joint.number)
            where = Where(file=tally.origin, joint=joint.number, column=column)
            text = f"joint {joint.number} runs from {span}, beyond its limits {allowed}: check zero, sign and unit"
            yield Note("beyond-limits", text, where)


def of_order(tally: Tally) -> Found:
    """A joint that moves while another draws the current.

    While joint a moves alone its friction changes sign with direction, and nobody else's does: gravity is a function of
    position. So the current that answers to a's direction, beside cos and sin of its angle, is the current of a.
    """
    answer, share = _answers(tally)
    moved_to: dict[int, int] = {}
    for joint in tally.robot.joints:
        a = joint.number - 1
        if np.isnan(answer[a, a]):
            continue
        b = int(np.nanargmax(np.abs(answer[a])))
        if b != a and share[a, b] > _STRONG and abs(answer[a, b]) > _STRONGER * abs(answer[a, a]):
            moved_to[a + 1] = b + 1
    if not moved_to:
        return
    pairs = "; ".join(
        f"when joint {a} moves, current {b} changes by {number(2 * abs(answer[a - 1, b - 1]), 2)} A with direction, "
        f"its own by {number(2 * abs(answer[a - 1, a - 1]), 2)} A"
        for a, b in moved_to.items()
    )
    first = next(iter(moved_to))
    where = Where(file=tally.origin, joint=first, column=tally.robot.log.column("position", first))
    mend = f"positions and currents are in different orders: put {_relabelled(tally.robot, moved_to)} into one order"
    if len(moved_to) >= 2 and len(set(moved_to.values())) == len(moved_to):
        yield LogError("joints-swapped", pairs, where, mend)
    else:
        yield Note("joints-swapped", f"{pairs}; perhaps {mend}", where)


def _relabelled(robot: Robot, moved_to: dict[int, int]) -> str:
    parts = [f"{robot.log.column('position', a)} beside {robot.log.column('current', b)}" for a, b in moved_to.items()]
    return ", ".join(parts)


def _answers(tally: Tally) -> tuple[Floats, Floats]:
    """(J, J) half difference of current b between a's directions (A), and the share of variance that it explains.

    Within each posture, so that gravity's change from posture to posture counts neither way. NaN where joint a did not
    move alone both ways long enough.
    """
    n = tally.robot.n_joints
    answer, share = np.full((n, n), np.nan), np.zeros((n, n))
    for a in range(n):
        if tally.ways[a].min() < _FEWEST_WAYS or tally.path[a] < MOVED:
            continue
        left = _beside_gravity(np.array([*tally.groups[a].values()]).reshape(-1, 4 + n, 4 + n)).sum(axis=0)
        if left[0, 0] < _FEWEST_WAYS:
            continue
        answer[a] = left[0, 1:] / left[0, 0]
        # What the direction explains of the variance that gravity leaves.
        share[a] = left[0, 1:] ** 2 / (left[0, 0] * np.maximum(np.diag(left)[1:], 1e-300))
        answer[a, ~np.isfinite(tally.levels.lowest) & (tally.path > MOVED)] = np.nan
    return answer, share


def _beside_gravity(sums: Floats) -> Floats:
    """(G, 1 + J, 1 + J) sums of direction and currents once 1, cos and sin are taken out of them, of G postures."""
    gravity, cross = sums[:, :3, :3], sums[:, :3, 3:]
    inverse = np.linalg.pinv(gravity, rcond=1e-9, hermitian=True)
    return np.asarray(sums[:, 3:, 3:] - cross.transpose(0, 2, 1) @ inverse @ cross)


def of_rest(tally: Tally) -> Found:
    """Joints that never move while others do."""
    still = [joint.number for joint in tally.robot.joints if tally.path[joint.number - 1] < MOVED]
    if still and len(still) < tally.robot.n_joints:
        listed = ", ".join(map(str, still))
        text = f"joint{'s' if len(still) > 1 else ''} {listed} never move{'' if len(still) > 1 else 's'} in these logs"
        yield Note("joint-at-rest", text, Where(file=tally.origin))
