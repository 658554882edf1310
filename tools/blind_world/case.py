"""One experiment of the benchmark: what is hidden, in which arm, how large; drawn by its own key and seed."""

import itertools
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from blind_world.arms import KINDS
from blind_world.busy import DESIGNS, disturbed, draw_effects
from blind_world.effects import CATALOGUE, OUTSIDE
from blind_world.hidden import Hidden, Strokes, Unfit, applied, sized
from blind_world.motion import FULL, THIN, motion_of
from blind_world.oracle import Oracle
from blind_world.world import State, World, draw_world, noises

SIZES, OUTSIDE_SIZES = (0.7, 1.0, 1.5, 2.0, 3.0), (3.0, 5.0)
#: Group of arms with several effects at a joint.
BUSY = "busy"
#: Effects of the whole arm, whichever joint they are asked for.
WHOLE = ("tilt", "payload")
#: Different arms of a kind that one seed has.
ARMS = 4
#: Joints and shapes that are tried before an effect is given up at a size.
DRAWS = 12


@dataclass(frozen=True)
class Case:
    """What to do."""

    group: str  # effect, clean, outside, thin or busy
    effects: tuple[str, ...]  # names of what is hidden
    kind: str  # of the arm
    size: float  # multiple of the detection limit
    number: int  # of several like it
    seed: int  # of the benchmark
    design: str = FULL  # of a busy arm

    @property
    def key(self) -> str:
        """Names the case in the file of results."""
        if self.group == BUSY:
            return f"{self.seed}/{BUSY}/{self.design}/{self.kind}"
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


def busy_cases(first_seed: int, count: int) -> list[Case]:
    """An experiment a seed; kinds of arms and designs take turns."""
    kinds, designs = tuple(KINDS), tuple(DESIGNS)
    seeds = range(first_seed, first_seed + count)
    return [Case(BUSY, (), kinds[seed % 3], 0.0, 0, seed, designs[seed % 4]) for seed in seeds]


def drawn(case: Case) -> Experiment:
    """The case as an experiment, or `Unfit`, with every joint's reason, where an effect cannot be seen."""
    own = zlib.crc32(case.key.encode())
    rng = np.random.default_rng([case.seed, own])
    if case.group == BUSY:
        rates, joints = DESIGNS[case.design]
        rate = float(rng.choice(rates))
        world = draw_world(*motion_of(case.kind, case.seed, case.design, rate=rate, joints=joints), rng=rng)
        world = disturbed(world, rng)
        hidden = draw_effects(world, rng)
        return Experiment(case, world, Oracle(world), hidden, applied(world, hidden), noises(world, rng))
    design = THIN if case.group == "thin" else FULL
    arm, campaign, motion = motion_of(case.kind, case.seed * ARMS + own % ARMS, design)
    world = draw_world(arm, campaign, motion, rng=rng)
    if "thermal_friction" in case.effects:
        world = replace(world, has_temperature=True)
    oracle = Oracle(world)
    hidden = tuple(_sized(case, name, world, oracle, rng) for name in case.effects)
    return Experiment(case, world, oracle, hidden, applied(world, hidden), noises(world, rng))


def _sized(case: Case, name: str, world: World, oracle: Oracle, rng: np.random.Generator) -> tuple[Hidden, float]:
    build, reasons = {**CATALOGUE, **OUTSIDE}[name], Counter[str]()
    # Each joint is tried twice with other shapes; an effect of the whole arm has no joint of its own.
    rounds = 0 if name in WHOLE else DRAWS // world.arm.n
    for joint in [int(joint) for _ in range(rounds) for joint in rng.permutation(world.arm.n)] or [0, 0, 0]:
        try:
            hidden = build(Strokes(world, joint), rng)
            return hidden, sized(world, oracle, hidden, case.size)[0]
        except Unfit as why:
            reasons[str(why)] += 1
    raise Unfit("; ".join(f"{why} ({count})" for why, count in sorted(reasons.items())))
