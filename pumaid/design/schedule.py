"""The order of a plan's runs: replicates far apart in time, blocks in random order, moves short and free."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pumaid.design.candidate_runs import Block
from pumaid.design.collision import Collision, Hit
from pumaid.errors import ModelError, Where
from pumaid.robot import Robot
from pumaid.trajectory import MOVE_SHARE, Motion, highest_speeds

Floats = NDArray[np.float64]

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
        parts = [*_fastest_first(passes[0]), *passes[1:]]
    parts = [[_shuffled(block, rng) for block in part] for part in parts if part]
    out: list[Motion] = []
    now: Floats | None = None
    for part, later in zip(parts, [*parts[1:], []], strict=True):
        order = _Order(robot, part, now, later, collision=collision).shortest(rng)
        out += [motion for k in order for motion in part[k].motions]
        now = np.array(part[order[-1]].hold)
    return tuple(out)


def _fastest_first(blocks: Sequence[Block]) -> tuple[list[Block], list[Block]]:
    """The block with the highest speed of every joint, and the others."""
    fastest: dict[int, Block] = {}
    for block in blocks:
        if block.purpose == "fit" and _top_speed(block) > _top_speed(fastest.get(block.joint)):
            fastest[block.joint] = block
    first = [block for block in blocks if block is fastest.get(block.joint)]
    return first, [block for block in blocks if block is not fastest.get(block.joint)]


def _top_speed(block: Block | None) -> float:
    """Highest speed of its sweeps, rad/s or m/s."""
    return max(sweep.speed for sweep in block.sweeps) if block else 0.0


def _shuffled(block: Block, rng: np.random.Generator) -> Block:
    return replace(block, sweeps=tuple(block.sweeps[k] for k in rng.permutation(len(block.sweeps))))


class _Order:
    """Orders of a pass's B blocks, by the time of the moves to, between and from them."""

    def __init__(
        self, robot: Robot, blocks: Sequence[Block], now: Floats | None, later: Sequence[Block], *, collision: Collision
    ) -> None:
        self.blocks, self.now, self.collision = blocks, now, collision
        pace, self.places = MOVE_SHARE * highest_speeds(robot), np.array([block.hold for block in blocks])
        self.later = [np.array(block.hold) for block in later]
        # To the microsecond: an order and its reverse take equally long, and rounding must not choose between them.
        self.between = np.round(np.max(np.abs(self.places[:, None] - self.places) / pace, axis=2), 6)
        self.into, self.out_of = np.zeros(len(blocks)), np.zeros(len(blocks))
        if now is not None:
            self.into = np.round(np.max(np.abs(self.places - now) / pace, axis=1), 6)
        self.struck: Counter[int] = Counter()
        self.hit: Hit | None = None

    def shortest(self, rng: np.random.Generator) -> list[int]:
        """The shortest order whose moves are free of collisions."""
        for _ in range(1 if self.collision.is_free else _ROUNDS):
            orders = [self._improved(rng.permutation(len(self.blocks)).tolist()) for _ in range(_STARTS)]
            orders.sort(key=self._length)
            free = next((order for order in orders if self._is_free(order)), None)
            if free is not None:
                return free
        (block, _), *_ = self.struck.most_common(1)
        joint, hit = self.blocks[block].joint, self.hit
        assert hit is not None
        raise ModelError(
            "plan-unsafe",
            f"no way leads to or from a posture of joint {joint} without a collision: {self.collision.describe(hit)}",
            Where(joint=joint),
            "narrow the limits, give fewer postures, or correct the recipe's boxes and spheres",
        )

    def _length(self, order: Sequence[int]) -> float:
        way = self.into[order[0]] + np.sum(self.between[order[:-1], order[1:]]) + self.out_of[order[-1]]
        return round(float(way), 6)

    def _improved(self, order: list[int]) -> list[int]:
        """An order after each block has been put where it makes the way shortest, twice."""
        between = self.between
        for block in 2 * list(order) if len(order) > 1 else ():
            rest = [k for k in order if k != block]
            added = np.empty(len(order))
            added[0] = self.into[block] + between[block, rest[0]] - self.into[rest[0]]
            added[1:-1] = between[rest[:-1], block] + between[block, rest[1:]] - between[rest[:-1], rest[1:]]
            added[-1] = between[rest[-1], block] + self.out_of[block] - self.out_of[rest[-1]]
            place = int(np.argmin(np.round(added, 6)))
            order = [*rest[:place], block, *rest[place:]]
        return order

    def _is_free(self, order: Sequence[int]) -> bool:
        """Whether the moves of an order are free; those that are not become expensive."""
        if self.collision.is_free:
            return True
        if self._length(order) >= _STRUCK:
            return False
        first, last, places = order[0], order[-1], self.places
        if self.now is not None and self._strikes(self.now, places[first], first):
            self.into[first] = _STRUCK
        for before, after in itertools.pairwise(order):
            if self._strikes(places[before], places[after], after):
                self.between[before, after] = _STRUCK
        if self.later and all(self._strikes(places[last], place, last) for place in self.later):
            self.out_of[last] = _STRUCK
        return self._length(order) < _STRUCK

    def _strikes(self, start: Floats, end: Floats, block: int) -> bool:
        hit = self.collision.first_hit(start, end)
        if hit is not None:
            self.hit = hit
            self.struck[block] += 1
        return hit is not None
