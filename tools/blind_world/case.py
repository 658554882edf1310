"""One experiment of the benchmark: what is hidden, in which arm, how large; drawn by its own key and seed."""

import itertools
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from blind_world.arms import KINDS, Arm
from blind_world.effects import CATALOGUE, OUTSIDE
from blind_world.hidden import Hidden, Strokes, Unfit, applied, sized
from blind_world.motion import motion_of
from blind_world.oracle import Oracle
from blind_world.world import State, World, draw_world, noises

SIZES, PAIR_SIZE, OUTSIDE_SIZES, THIN_SIZE = (0.7, 1.0, 1.5, 2.0, 3.0), 2.5, (3.0, 5.0), 2.0
#: Effects of the whole arm, whichever joint they are asked for.
WHOLE = ("tilt", "payload")
#: Different arms of a kind that one seed has.
ARMS = 4
#: Joints and shapes that are tried before an effect is given up at a size.
DRAWS = 12
#: Pairs of effects of different families; both are hidden at PAIR_SIZE.
PAIRS = (
    ("stribeck", "ripple"),
    ("load_friction", "spring"),
    ("warmup", "position_friction"),
    ("tilt", "friction_step"),
    ("counterbalance", "presliding"),
    ("torque_constant_drift", "ripple"),
    ("zero_offset", "warmup"),
    ("saturation", "position_friction"),
    ("payload", "ripple"),
    ("flexibility", "friction_step"),
)


@dataclass(frozen=True)
class Case:
    """What to do."""

    group: str  # effect, clean, outside, pair or thin
    effects: tuple[str, ...]  # names of what is hidden
    kind: str  # of the arm
    size: float  # multiple of the detection limit
    number: int  # of several like it
    seed: int  # of the benchmark

    @property
    def key(self) -> str:
        """Names the case in the file of results."""
        return f"{self.seed}/{self.group}/{'+'.join(self.effects) or 'none'}/{self.kind}/{self.size:g}/{self.number}"


@dataclass(frozen=True, eq=False)
class Experiment:
    """A case with everything drawn."""

    case: Case
    world: World
    oracle: Oracle
    hidden: tuple[tuple[Hidden, float], ...]  # each effect with its amplitude
    state: State  # true currents and positions
    noise: np.ndarray[Any, np.dtype[np.float64]]  # (N, J) A to be added


def cases(seeds: Sequence[int], clean: int) -> Iterator[Case]:
    """Every case of the whole benchmark, for each of its seeds; `clean` experiments of a seed hide nothing."""
    kinds = tuple(KINDS)
    for seed in seeds:
        for name, kind, size in itertools.product(CATALOGUE, kinds, SIZES):
            yield Case("effect", (name,), kind, size, 0, seed)
        for number in range(clean):
            yield Case("clean", (), kinds[number % len(kinds)], 0.0, number, seed)
        for name, kind, size in itertools.product(OUTSIDE, kinds, OUTSIDE_SIZES):
            yield Case("outside", (name,), kind, size, 0, seed)
        for pair, kind in itertools.product(PAIRS, kinds):
            yield Case("pair", pair, kind, PAIR_SIZE, 0, seed)
        for name, kind in itertools.product(CATALOGUE, kinds):
            yield Case("thin", (name,), kind, THIN_SIZE, 0, seed)
        for number in range(clean // 10):
            yield Case("thin", (), kinds[number % len(kinds)], 0.0, number, seed)


def drawn(case: Case) -> Experiment:
    """The case as an experiment, or `Unfit`, with every joint's reason, where an effect cannot be seen."""
    own = zlib.crc32(case.key.encode())
    rng = np.random.default_rng([case.seed, own])
    arm, campaign, motion = motion_of(case.kind, case.seed * ARMS + own % ARMS, is_thin=case.group == "thin")
    world = draw_world(arm, campaign, motion, rng=rng)
    if "thermal_friction" in case.effects:
        world = replace(world, has_temperature=True)
    oracle = Oracle(world)
    hidden = tuple(_sized(case, name, world, oracle, rng) for name in case.effects)
    return Experiment(case, world, oracle, hidden, applied(world, hidden), noises(world, rng))


def _sized(case: Case, name: str, world: World, oracle: Oracle, rng: np.random.Generator) -> tuple[Hidden, float]:
    build, reasons = {**CATALOGUE, **OUTSIDE}[name], Counter[str]()
    for joint in _joints(name, world.arm, rng):
        try:
            hidden = build(Strokes(world, joint), rng)
            return hidden, sized(world, oracle, hidden, case.size)[0]
        except Unfit as why:
            reasons[str(why)] += 1
    raise Unfit("; ".join(f"{why} ({count})" for why, count in sorted(reasons.items())))


def _joints(name: str, arm: Arm, rng: np.random.Generator) -> list[int]:
    """Joints to be tried, each twice with other shapes; an effect of the whole arm has none of its own."""
    if name in WHOLE:
        return [0, 0, 0]
    return [int(joint) for _ in range(DRAWS // arm.n) for joint in rng.permutation(arm.n)]
