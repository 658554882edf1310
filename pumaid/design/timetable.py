"""In which order a plan's runs are made: replicates far apart in time, blocks in random order, moves short and free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.clearance import Clearance
from pumaid.design.laps import Course
from pumaid.design.moves import explained, struck
from pumaid.errors import ModelError, Where
from pumaid.records import Motion
from pumaid.robot import Robot
from pumaid.trajectory import MOVE_SHARE, highest_speeds

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

#: Random orders of a pass that are shortened, and of which the shortest is taken.
_STARTS = 30
#: Passes up to which each joint's highest speed is asked for early; the first of more is early by itself.
_FEW = 2


@dataclass(frozen=True, eq=False, slots=True)
class Block:
    """One joint, one posture (J,), some courses."""

    joint: int
    hold: tuple[float, ...]
    courses: tuple[Course, ...]
    purpose: str = "fit"


@dataclass(frozen=True, eq=False, slots=True)
class _Leg:
    """The runs of a block as they are made once, and the arm's posture (J,) before and after."""

    runs: tuple[Motion, ...]
    begin: Floats
    end: Floats


def timetable(
    robot: Robot, passes: Sequence[Sequence[Block]], *, clearance: Clearance, rng: np.random.Generator
) -> tuple[Motion, ...]:
    """Motions in the order in which they are made.

    Each pass holds its blocks in an order of its own (so the replicates of a run are a pass apart): thirty random
    orders are shortened by putting each block where it makes the moves shortest, and the shortest of them whose moves
    strike nothing is taken. Where passes are few, every joint is fast before any is done with: what changes with time
    and what changes with speed would look alike where slow runs come early and fast ones late.

    Parameters
    ----------
    robot
        Highest speeds.
    passes
        Blocks of each pass.
    clearance
        What must not be struck.
    rng
        Source of the orders.

    Raises
    ------
    ModelError [plan-unsafe]
        A posture cannot be reached from any other without striking something.
    """
    early = _early(passes)
    if len(early) > len(passes):
        try:
            return _in_order(robot, early, clearance=clearance, rng=rng)
        except ModelError:
            pass  # Fewer blocks at a time leave fewer ways between them.
    return _in_order(robot, passes, clearance=clearance, rng=rng)


def _in_order(
    robot: Robot, passes: Sequence[Sequence[Block]], *, clearance: Clearance, rng: np.random.Generator
) -> tuple[Motion, ...]:
    """Motions of one pass after the other, each in the shortest of many orders whose moves strike nothing."""
    out: list[Motion] = []
    now: Floats | None = None
    parts = [[_leg(block, rng) for block in blocks] for blocks in passes]
    for legs, later in zip(parts, [*parts[1:], []], strict=True):
        costs, first = _costs(robot, legs, now)
        orders = [_shortened(rng.permutation(len(legs)).tolist(), costs, first) for _ in range(_STARTS)]
        orders.sort(key=lambda order, c=costs, f=first: _length(order, c, f))  # type: ignore[misc]
        order = orders[0] if clearance.is_free else _safe(orders, legs, now, later, clearance=clearance)
        for k in order:
            out += legs[k].runs
            now = legs[k].end
    return tuple(out)


def _early(passes: Sequence[Sequence[Block]]) -> list[Sequence[Block]]:
    """Passes; of a few, the first in two parts, a block with its highest speed of every joint in the first of them."""
    if len(passes) > _FEW or not passes:
        return list(passes)
    first: dict[int, int] = {}
    for place, block in enumerate(passes[0]):
        best = first.get(block.joint)
        if block.purpose == "fit" and (best is None or _speed(block) > _speed(passes[0][best])):
            first[block.joint] = place
    parts = [[passes[0][k] for k in range(len(passes[0])) if (k in first.values()) == is_first] for is_first in (1, 0)]
    return [part for part in parts if part] + list(passes[1:])


def _speed(block: Block) -> float:
    """Highest speed of its courses."""
    return max(course.speed for course in block.courses)


def _leg(block: Block, rng: np.random.Generator) -> _Leg:
    """A block's runs, courses in random order; each begins and ends where the joint is held."""
    shuffled = [block.courses[k] for k in rng.permutation(len(block.courses))]
    runs = [motion for one in shuffled for motion in one.motions(block.hold, purpose=block.purpose)]
    begin, end = np.array(block.hold), np.array(block.hold)
    begin[block.joint - 1], end[block.joint - 1] = runs[0].start, runs[-1].end
    return _Leg(tuple(runs), begin, end)


def _costs(robot: Robot, legs: Sequence[_Leg], now: Floats | None) -> tuple[Floats, Floats]:
    """(B, B) s from the end of one block to the begin of another, and (B,) from where the arm stands to each."""
    pace = MOVE_SHARE * highest_speeds(robot)
    begins, ends = np.array([leg.begin for leg in legs]), np.array([leg.end for leg in legs])
    between = np.max(np.abs(ends[:, None] - begins) / pace, axis=2)
    first = np.zeros(len(legs)) if now is None else np.max(np.abs(begins - now) / pace, axis=1)
    # To the microsecond: an order and its reverse may take equally long, and rounding must not choose between them.
    return np.round(between, 6), np.round(first, 6)


def _length(order: Sequence[int], costs: Floats, first: Floats) -> float:
    return round(float(first[order[0]] + np.sum(costs[order[:-1], order[1:]])), 6)


def _shortened(order: list[int], costs: Floats, first: Floats) -> list[int]:
    """A random order after each block has been put where it makes the way shortest, twice."""
    for block in 2 * list(order) if len(order) > 1 else ():
        rest = [k for k in order if k != block]
        before, after = np.array(rest), np.array(rest)
        added = np.empty(len(order))
        added[0] = first[block] + costs[block, after[0]] - first[after[0]]
        added[1:-1] = costs[before[:-1], block] + costs[block, after[1:]] - costs[before[:-1], after[1:]]
        added[-1] = costs[before[-1], block]
        place = int(np.argmin(np.round(added, 6)))
        order = [*rest[:place], block, *rest[place:]]
    return order


def _moves(legs: Sequence[_Leg], now: Floats | None) -> tuple[Floats, Floats]:
    """(M, J) postures between which the arm moves from block to block."""
    before = ([] if now is None else [now]) + [leg.end for leg in legs[:-1]]
    after = [leg.begin for leg in (legs if now is not None else legs[1:])]
    return np.array(before), np.array(after)


def _safe(
    orders: Sequence[list[int]],
    legs: Sequence[_Leg],
    now: Floats | None,
    later: Sequence[_Leg],
    *,
    clearance: Clearance,
) -> list[int]:
    """The first order whose moves strike nothing; else one that is built from free moves only.

    Its last block can be left for one of those that come `later`.

    Raises
    ------
    ModelError [plan-unsafe]
        No order was found; it tells of a block that most orders could not place.
    """
    way_out: Bools = np.ones(len(legs), dtype=bool)
    if later:
        way_out = np.asarray(_free_moves(legs, later, clearance).any(axis=1))
    for order in orders:
        if way_out[order[-1]] and _is_free([legs[k] for k in order], now, clearance):
            return order
    between = _free_moves(legs, legs, clearance)
    here: Bools = np.ones(len(legs), dtype=bool)
    if now is not None:
        here = ~np.asarray(struck(clearance, np.tile(now, (len(legs), 1)), np.array([leg.begin for leg in legs])))
    stuck: list[int] = []
    for order in orders:
        found, left = _threaded(order, between, here, way_out)
        if not left:
            return found
        stuck += left
    worst = max(sorted(set(stuck)), key=stuck.count)
    motion, others = legs[worst].runs[0], [leg.end for k, leg in enumerate(legs) if k != worst]
    other = now if now is not None or not others else others[0]
    why = "" if other is None else f": {explained(clearance, other, legs[worst].begin)}"
    raise ModelError(
        "plan-unsafe",
        f"no way leads to the posture of joint {motion.joint} without a collision{why}",
        Where(joint=motion.joint),
        "narrow the limits, give fewer postures, or mend the recipe's boxes and spheres",
    )


def _is_free(legs: Sequence[_Leg], now: Floats | None, clearance: Clearance) -> bool:
    """Whether the moves to and between blocks strike nothing."""
    starts, ends = _moves(legs, now)
    return not len(starts) or not np.any(struck(clearance, starts, ends))


def _free_moves(legs: Sequence[_Leg], after: Sequence[_Leg], clearance: Clearance) -> Bools:
    """(B, C) whether the move from the end of each block to the begin of each that may come after it is free."""
    begins, ends = np.array([leg.begin for leg in after]), np.array([leg.end for leg in legs])
    hit = struck(clearance, np.repeat(ends, len(begins), axis=0), np.tile(begins, (len(ends), 1)))
    return ~np.asarray(hit).reshape(len(ends), len(begins))


def _threaded(order: Sequence[int], between: Bools, first: Bools, last: Bools) -> tuple[list[int], list[int]]:
    """An order in which each block is entered by a free move, and the blocks for which it has no place.

    What cannot come next is put in elsewhere or later; one of those that may come `last` is put there.
    """
    end = next((k for k in reversed(order) if last[k]), None)
    if end is None:
        return [], list(order)
    out = [end]
    left = [k for k in order if k != end]
    while left:
        waiting = [k for k in left if not _put_in(out, k, between, first)]
        if len(waiting) == len(left):
            break
        left = waiting
    return (out, left) if left or first[out[0]] else ([], list(order))


def _put_in(out: list[int], k: int, between: Bools, first: Bools) -> bool:
    """Put a block before the last where it is entered and left by free moves; late places first, to keep the order."""
    for place in range(len(out) - 1, -1, -1):
        # What stands first may yet be preceded: only the last that is put there must be entered from where the arm is.
        entered = place == 0 or between[out[place - 1], k]
        if entered and between[k, out[place]] and (place > 0 or first[k] or not first[out[0]]):
            out.insert(place, k)
            return True
    return False
