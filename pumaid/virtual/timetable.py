"""In which order a plan's runs are made: replicates far apart in time, blocks in random order, moves kept short."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.records import Joint, Motion, Robot
from pumaid.units import factor
from pumaid.virtual.ranges import span
from pumaid.virtual.timing import MOVE_SHARE, RAMP_TIME, accelerations, highest_speeds

Floats = NDArray[np.float64]

#: Speeds that a plan uses are shares of a joint's highest speed, which counts up to this: rad/s, m/s.
QUICKEST_TURN, QUICKEST_SLIDE = 1.75, 0.25
#: A run keeps its speed over at least this share of its span; the ramps take the rest.
_LEAST_CRUISE = 0.6
#: s that a run takes at most: what its samples share does not shrink with its length, so a slow run over part of the
#: span tells as much of friction as one over all of it.
_LONGEST = 6.0
#: ... but at least this share of the span: gravity must be told from a constant within the run.
_LEAST_PART = 0.3
#: Random orders of a pass from which the one with the shortest moves is taken.
_ORDERS = 40


@dataclass(frozen=True, eq=False, slots=True)
class Block:
    """One joint, one posture (J,), some speeds (rad/s or m/s), each there and back from one end of the span.

    Runs start at the high end where `is_high`, else at the low end; fast ones cover the span, slow ones part of it.
    """

    joint: int
    hold: Floats
    speeds: tuple[float, ...]
    purpose: str = "fit"
    is_high: bool = False


def speeds(robot: Robot, joint: int, shares: Sequence[float]) -> tuple[float, ...]:
    """Speeds of a joint's runs, rising, rounded to whole degrees or millimetres a second, each once.

    Parameters
    ----------
    robot, joint
        Its limits and highest speed; joint from 1.
    shares
        0..1 of the speed that the joint may have: its highest, at most 1.75 rad/s or 0.25 m/s, and less where the span
        is so short that ramps would fill it.
    """
    arm = robot.joint(joint)
    low, high = span(arm)
    ramp = float(accelerations(robot)[joint - 1])
    room = np.sqrt((1.0 - _LEAST_CRUISE) * (high - low) * ramp)
    most = min(float(highest_speeds(robot)[joint - 1]), room, QUICKEST_TURN if arm.is_revolute else QUICKEST_SLIDE)
    step = factor("deg") if arm.is_revolute else 1e-3
    rounded = {_rounded(share * most, step) for share in shares}
    return tuple(sorted(rounded))


def _rounded(speed: float, step: float) -> float:
    return float(np.floor(speed / step + 1e-9) * step) if speed >= 4 * step else speed


def timetable(robot: Robot, passes: Sequence[Sequence[Block]], rng: np.random.Generator) -> tuple[Motion, ...]:
    """Motions in the order in which they are made.

    Each pass holds every block once (so the replicates of a run are a pass apart), its blocks in random order: of forty
    random orders the one with the shortest moves between postures. Inside a block speeds come in random order, each
    there and back.

    Parameters
    ----------
    robot
        Spans.
    passes
        Blocks of each pass.
    rng
        Source of the orders.
    """
    out: list[Motion] = []
    now: Floats | None = None
    for blocks in passes:
        orders = [rng.permutation(len(blocks)) for _ in range(_ORDERS)]
        best = min(orders, key=lambda order, at=now: _moving(robot, [blocks[k] for k in order], at))  # type: ignore[misc]
        for k in best:
            block = blocks[k]
            out += _runs(robot.joint(block.joint), block, rng)
            now = _begin(robot, block)
    return tuple(out)


def _runs(joint: Joint, block: Block, rng: np.random.Generator) -> list[Motion]:
    low, high = span(joint)
    hold = tuple(block.hold.tolist())
    runs = []
    for speed in rng.permutation(block.speeds).tolist():
        way = max(_LEAST_PART * (high - low), speed * _LONGEST)
        step = factor("deg") if joint.is_revolute else 1e-3
        whole = min(high - low, float(np.ceil(way / step)) * step)
        first, last = (high, high - whole) if block.is_high else (low, low + whole)
        for start, end in ((first, last), (last, first)):
            runs.append(Motion(block.joint, hold, start, end, speed, block.purpose))
    return runs


def _begin(robot: Robot, block: Block) -> Floats:
    """Every block begins and ends at its end of the span."""
    posture = block.hold.copy()
    posture[block.joint - 1] = span(robot.joint(block.joint))[int(block.is_high)]
    return posture


def _moving(robot: Robot, blocks: Sequence[Block], now: Floats | None) -> float:
    places = np.array(([] if now is None else [now]) + [_begin(robot, block) for block in blocks])
    pace = MOVE_SHARE * highest_speeds(robot)
    # To the microsecond: an order and its reverse may take equally long, and rounding must not choose between them.
    return round(float(np.sum(np.max(np.abs(np.diff(places, axis=0)) / pace + RAMP_TIME, axis=1))), 6)
