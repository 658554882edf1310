"""The order of a plan's runs: replicates far apart in time, blocks in random order, moves short and clear."""

import itertools
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pumaid.design.candidate_runs import Block
from pumaid.design.collision import Collision
from pumaid.errors import ModelError, Where
from pumaid.maths import Floats
from pumaid.robot import Robot
from pumaid.trajectory import (
    MOVE_SHARE,
    Motion,
    highest_speeds,
)

#: Random orders of a pass that are improved, and of which the shortest is taken.
_STARTS = 30
#: Rounds in which orders avoid the moves that were found to strike something.
_ROUNDS = 60
#: s that a move costs which strikes something.
_STRUCK = 1e6
#: Passes up to which each joint's highest speed is asked for early.
_FEW = 2


def schedule(
    robot: Robot, passes: Sequence[Sequence[Block]], *, collision: Collision, rng: np.random.Generator
) -> tuple[Motion, ...]:
    """Motions in the order in which they are made.

    Each pass has its own order, so that replicates are a pass apart: the shortest of thirty random orders after each
    block has been moved to its best place. Of few passes the first begins with the fastest block of every joint, since
    what changes with time and what changes with speed look alike where slow runs come early and fast ones late.

    Raises
    ------
    ModelError [plan-unsafe]
        A posture cannot be reached without a collision.
    """
    parts = list(passes)
    if 0 < len(passes) <= _FEW and collision.is_free:  # with obstacles, fewer blocks at a time leave fewer free ways
        fits = sorted(
            (block for block in passes[0] if block.purpose == "fit"),
            key=lambda block: max(sweep.speed for sweep in block.sweeps),
        )
        fastest = {block.joint: block for block in fits}
        parts = [[b for b in passes[0] if (b is fastest.get(b.joint)) is first] for first in (True, False)]
        parts += passes[1:]
    parts = [part for part in parts if part]
    out: list[Motion] = []
    now: Sequence[float] | None = None
    for part, later in zip(parts, [*parts[1:], []], strict=True):
        order = _shortest(robot, part, [now, *(block.hold for block in later)], collision=collision, rng=rng)
        for block in (part[k] for k in order):
            out += replace(block, sweeps=tuple(block.sweeps[k] for k in rng.permutation(len(block.sweeps)))).motions
        now = part[order[-1]].hold
    return tuple(out)


def _shortest(
    robot: Robot,
    blocks: Sequence[Block],
    around: Sequence[Sequence[float] | None],
    *,
    collision: Collision,
    rng: np.random.Generator,
) -> list[int]:
    """The shortest order of B blocks whose moves are free of collisions.

    `around` are the posture in which the arm stands (None: in any) and those to one of which it goes afterwards.
    """
    count, (now, *later) = len(blocks), around
    places = np.array([*(block.hold for block in blocks), blocks[0].hold if now is None else now])
    # s of moves between blocks, from the start (node B) and to the end (node B + 1), which costs nothing. To the
    # microsecond: an order and its reverse take equally long, and rounding must not choose between them.
    cost, pace = np.zeros((count + 2, count + 2)), MOVE_SHARE * highest_speeds(robot)
    cost[:-1, :-1] = np.round(np.max(np.abs(places[:, None] - places) / pace, axis=2), 6)
    cost[count] *= now is not None
    struck, hit = Counter[int](), ""

    def first_hit(before: int, after: int) -> str | None:
        ends = [places[after]] if after <= count else [np.array(place) for place in later]
        hits = [collision.first_hit(places[before], end) for end in ends]
        return hits[0] if hits and all(hits) else None

    def length(path: Sequence[int]) -> float:
        return round(float(np.sum(cost[path[:-1], path[1:]])), 6)

    for _ in range(1 if collision.is_free else _ROUNDS):
        paths = [_improved(cost, rng.permutation(count).tolist()) for _ in range(_STARTS)]
        for path in sorted(paths, key=length):
            if length(path) >= _STRUCK:
                continue
            moves = list(itertools.pairwise(path if now is not None else path[1:]))
            for move, where in {move: where for move in moves if (where := first_hit(*move))}.items():
                cost[move], hit = _STRUCK, where
                before, after = move
                struck[after if after <= count else before] += 1
            if length(path) < _STRUCK:
                return path[1:-1]
    ((block, _),) = struck.most_common(1)
    raise ModelError(
        "plan-unsafe",
        f"no way leads to or from a posture of joint {blocks[block].joint} without a collision: {hit}",
        Where(joint=blocks[block].joint),
        "narrow the limits, give fewer postures, or correct the recipe's boxes and spheres",
    )


def _improved(cost: Floats, order: list[int]) -> list[int]:
    """The path from the start over all blocks to the end, each put where it makes the way shortest, twice."""
    start, end = len(order), len(order) + 1
    for block in 2 * list(order):
        rest = [k for k in order if k != block]
        before, after = [start, *rest], [*rest, end]
        place = int(np.argmin(np.round(cost[before, block] + cost[block, after] - cost[before, after], 6)))
        order = [*rest[:place], block, *rest[place:]]
    return [start, *order, end]
