"""In which order a plan's runs are made: replicates far apart in time, blocks in random order, moves short and free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.clearance import Clearance
from pumaid.errors import ModelError, Where
from pumaid.planning.laps import Course
from pumaid.planning.moves import explained, struck
from pumaid.records import Motion, Robot
from pumaid.virtual.timing import MOVE_SHARE, highest_speeds

Floats = NDArray[np.float64]

#: Random orders of a pass that are shortened, and of which the shortest is taken.
_STARTS = 30


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
    strike nothing is taken.

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
    out: list[Motion] = []
    now: Floats | None = None
    for blocks in passes:
        legs = [_leg(block, rng) for block in blocks]
        costs, first = _costs(robot, legs, now)
        orders = [_shortened(rng.permutation(len(legs)).tolist(), costs, first) for _ in range(_STARTS)]
        orders.sort(key=lambda order, c=costs, f=first: _length(order, c, f))  # type: ignore[misc]
        order = orders[0] if clearance.is_free else _safe(orders, legs, now, clearance)
        for k in order:
            out += legs[k].runs
            now = legs[k].end
    return tuple(out)


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


def _safe(orders: Sequence[list[int]], legs: Sequence[_Leg], now: Floats | None, clearance: Clearance) -> list[int]:
    """The first order whose moves strike nothing; else one that is built from free moves only."""
    for order in orders:
        if _is_free([legs[k] for k in order], now, clearance):
            return order
    return _threaded(orders[0], legs, now, clearance)


def _is_free(legs: Sequence[_Leg], now: Floats | None, clearance: Clearance) -> bool:
    """Whether the moves to and between blocks strike nothing."""
    starts, ends = _moves(legs, now)
    return not len(starts) or not np.any(struck(clearance, starts, ends))


def _threaded(order: list[int], legs: Sequence[_Leg], now: Floats | None, clearance: Clearance) -> list[int]:
    """An order in which each block is entered by a free move: what cannot come next is put in elsewhere or later."""
    out: list[int] = []
    left = list(order)
    while left:
        waiting = [k for k in left if not _put_in(out, k, legs, now, clearance=clearance)]
        if len(waiting) == len(left):
            motion = legs[left[0]].runs[0]
            other = legs[out[-1]].end if out or now is None else now
            raise ModelError(
                "plan-unsafe",
                f"no way leads to the posture of joint {motion.joint} without a collision: "
                f"{explained(clearance, other, legs[left[0]].begin)}",
                Where(joint=motion.joint),
                "narrow the limits, give fewer postures, or mend the recipe's boxes and spheres",
            )
        left = waiting
    return out


def _put_in(out: list[int], k: int, legs: Sequence[_Leg], now: Floats | None, *, clearance: Clearance) -> bool:
    """Put a block where it is entered and left by free moves; late places first, to leave the random order as it is."""
    for place in range(len(out), -1, -1):
        trial = [*out[:place], k, *out[place:]]
        near = [legs[one] for one in trial[max(place - 1, 0) : place + 2]]
        if _is_free(near, now if place == 0 else None, clearance):
            out.insert(place, k)
            return True
    return False
