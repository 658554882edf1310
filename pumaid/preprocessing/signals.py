"""Checks behind `suspicion` of single columns: velocities of something else, currents dead, cut off or copied."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from pumaid.errors import LogError, Note, Where
from pumaid.preprocessing.doubts import AGREES, MOVED
from pumaid.preprocessing.tally import Tally
from pumaid.robot import Joint
from pumaid.units import number

Found = Iterator[LogError | Note]

#: Correlation of a joint's motion with its velocity column below which they are not of one signal.
UNRELATED = 0.5
#: Share of a joint's samples, least number, and multiple of the next level's count, that make a flat top.
FLAT_SHARE, FLAT_COUNT, FLAT_RATIO = 0.01, 50, 5
#: Windows, and share of them, that make a signal that freezes again and again.
FLAT_WINDOWS, FLAT_TIME = 20, 0.05
#: Share of pairs of samples with the same current, and s between two changes, from which on a current is held.
HELD_SHARE, HELD = 0.6, 0.02
#: Share of the time a joint moves in which its position often stays, from which on it is looked at; how near to whole
#: counts of the smallest step an encoder's steps are, and the share of them that are if it is one.
STILL_TIME, COUNT_MATCH, MOST_COUNTS = 0.5, 0.1, 0.7
#: Samples, and share of them, that make lost values.
DROPPED_COUNT, DROPPED_SHARE = 5, 2e-4
#: Samples, share of them, and multiple of the next level's count, that make a dead band of currents that are zero. In
#: steps zero is half as often as one step away on either side: eight with one of those have a chance of 2e-6.
ZEROS, ZERO_SHARE, ZERO_RATIO = 8, 1e-3, 8
#: s; a current that stays the same to the digit for longer while its joint moves is frozen, or far too coarse.
FROZEN = 2.0
#: A; no motor of an arm draws so little or so much at most, but one whose unit is not what the recipe says does.
SMALL, LARGE = 0.02, 200.0
#: Mean squared difference of two currents, relative to their squares, from which on they are one.
SAME = 1e-12


def of_velocity(tally: Tally) -> Found:
    """A velocity column that follows another joint's position, or none."""
    if not tally.has_velocity:
        return
    match = np.abs(tally.agreement())
    moved = [j for j in tally.robot.joints if tally.path[j.number - 1] > MOVED and tally.integral[j.number - 1] > 0]
    others = {
        j.number: int(np.argmax(match[j.number - 1])) + 1
        for j in moved
        if match[j.number - 1, j.number - 1] < 0.3 and match[j.number - 1].max() > AGREES
    }
    if others:
        pairs = ", ".join(f"position {a} with velocity {b}" for a, b in others.items())
        what = f"velocity columns follow other joints than their own: {pairs}"
        mend = "put the columns into one order; if the positions are right, velocity: null in the recipe's log block"
        yield LogError("velocity-of-another", what, _where(tally, "velocity", next(iter(others))), mend)
        return
    for joint in moved:
        own = float(match[joint.number - 1, joint.number - 1])
        if own < UNRELATED:
            text = (
                f"the velocity column of joint {joint.number} does not follow its position (correlation {own:.2f}): one"
                " of them is another signal; speeds are taken from position"
            )
            yield Note("velocity-unrelated", text, _where(tally, "velocity", joint.number))


def of_position(tally: Tally) -> Found:
    """A position that is measured less often than it is logged; one of an encoder with few counts is none."""
    for joint in tally.robot.joints:
        windows, still = (int(many) for many in tally.still[joint.number - 1])
        if still < FLAT_WINDOWS or still < STILL_TIME * windows:
            continue
        steps = tally.jumps[joint.number - 1]
        counts = steps / np.quantile(steps, 0.02)
        if np.mean(np.abs(counts - np.round(counts)) < COUNT_MATCH) < MOST_COUNTS:
            what = f"position of joint {joint.number} often is that of the sample before while it moves, and then jumps"
            why = "it is measured less often than it is logged, or its log repeats samples"
            text = f"{what}: {why}; inertia and the ends of runs suffer"
            yield Note("position-held", text, _where(tally, "position", joint.number))


def of_current(tally: Tally) -> Found:
    """A current that stands still while its joint moves, is cut off, in another unit, or a copy of another's."""
    yield from _of_copies(tally)
    for joint in tally.robot.joints:
        k = joint.number - 1
        if tally.path[k] < MOVED or not np.isfinite(tally.levels.lowest[k]):
            continue
        where = _where(tally, "current", joint.number)
        low, high, total = float(tally.levels.lowest[k]), float(tally.levels.highest[k]), int(tally.levels.moving[k])
        if low == high and total >= FLAT_COUNT:
            what = f"current of joint {joint.number} is {number(low)} A in all {total} samples in which it moves"
            mend = (
                "name the column of the measured current; if there is none remove this one, the joint is then left out"
            )
            yield LogError("constant-current", what, where, mend)
            continue
        told = list(_of_top(tally, joint, where)) or list(_of_stale(tally, joint, where))
        yield from told
        lost = int(tally.levels.dropped[k])
        if lost >= max(DROPPED_COUNT, DROPPED_SHARE * total):
            text = (
                f"current of joint {joint.number} is exactly zero in {lost} of {total} moving samples, amid others that"
                " are far from it: values that were lost and written as 0"
            )
            yield Note("current-dropouts", f"{text}; leave those cells empty, such rows are then left out", where)
        elif not told:
            yield from _of_dead_band(tally, joint, where)
        largest = max(-low, high)
        if not SMALL <= largest <= LARGE:
            unlike = "more than an arm's motor draws" if largest > LARGE else "less than it takes to move an arm"
            text = f"current of joint {joint.number} is {number(largest)} A at most, {unlike}"
            yield Note("current-size", f"{text}: see units: {{current: ...}} in the recipe's log block", where)


def _of_dead_band(tally: Tally, joint: Joint, where: Where) -> Found:
    """A current that is zero far more often than next to zero; one in steps is as often one step away."""
    k, total = joint.number - 1, int(tally.levels.moving[joint.number - 1])
    zeros, beside = int(tally.levels.zeros[k]), int(tally.levels.least_count[k])
    if zeros >= max(ZEROS, ZERO_SHARE * total) and zeros >= ZERO_RATIO * beside:
        text = f"current of joint {joint.number} is exactly zero in {zeros} of {total} moving samples, and hardly ever"
        why = "the drive or the sensor cuts small currents off, or values that were lost were written as 0"
        yield Note("current-dead-band", f"{text} next to zero: {why}; friction and gravity come out wrong", where)


def _of_stale(tally: Tally, joint: Joint, where: Where) -> Found:
    """A current that is not measured anew at each sample; told once, in the plainest way."""
    k, interval = joint.number - 1, tally.rate_interval()
    pairs, same = (int(many) for many in tally.levels.same[k])
    windows, flat = (int(many) for many in tally.levels.flat[k])
    period = interval / max(1.0 - same / max(pairs, 1), 1e-9)
    name = f"current of joint {joint.number}"
    longest = tally.levels.frozen[k] * interval
    if tally.levels.frozen[k] >= FLAT_COUNT and longest > FROZEN:
        text = f"{name} stays the same to the digit for {longest:.1f} s of motion"
    elif same > HELD_SHARE * pairs and max(HELD, longest / 3.0) < period:
        text = f"{name} changes only every {1e3 * period:.0f} ms, and there is a sample every {1e3 * interval:.3g} ms"
        late = "it is held meanwhile, and so late by half of that on average, or its steps are too coarse"
        yield Note("current-held", f"{text}: {late}", where)
        return
    elif flat >= FLAT_WINDOWS and flat > FLAT_TIME * windows:
        text = f"{name} stays the same to the digit in {100 * flat / windows:.0f} % of the time in which it moves"
    else:
        return
    yield Note("current-frozen", f"{text}: the signal froze, or its steps are too coarse", where)


def _of_top(tally: Tally, joint: Joint, where: Where) -> Found:
    """A flat top on either side; told once, of the side with the larger current."""
    k, total = joint.number - 1, int(tally.levels.moving[joint.number - 1])
    for side in np.argsort(-tally.levels.top[k, :, 0], kind="stable"):
        count, below = (int(many) for many in tally.levels.top_count[k, side])
        if count >= max(FLAT_COUNT, FLAT_SHARE * total) and count >= FLAT_RATIO * below:
            limit = number(float(math.copysign(tally.levels.top[k, side, 0], 0.5 - side)))
            text = f"current of joint {joint.number} is at its limit, {limit} A, in {count} of {total} moving samples"
            yield Note(
                "current-saturated", f"{text}: cut off by the drive or the sensor; slower runs stay below", where
            )
            return


def _of_copies(tally: Tally) -> Found:
    """Two joints whose currents are the same numbers."""
    n = tally.robot.n_joints
    sums = np.zeros((n, n))
    for groups in tally.groups:
        for held in groups.values():
            sums += held[4:, 4:]
    square = np.diag(sums)
    for a in range(n):
        for b in range(a + 1, n):
            apart, size = square[a] + square[b] - 2.0 * sums[a, b], square[a] + square[b]
            if min(square[a], square[b]) > 0 and abs(apart) <= SAME * size:
                what = f"joints {a + 1} and {b + 1} have the same current in every sample"
                mend = "give each joint its own column; leave out one that was not measured"
                yield LogError("current-copied", what, _where(tally, "current", b + 1), mend)


def _where(tally: Tally, quantity: str, joint: int) -> Where:
    return Where(file=tally.origin, joint=joint, column=tally.robot.log.column(quantity, joint))
