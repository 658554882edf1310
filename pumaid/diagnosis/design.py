"""Which runs to make: laps chosen one by one and exchanged, while the rivals look for shapes that come nearer."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.diagnosis.feasible import CELLS, Lap, ahead, bins_for, laps
from pumaid.diagnosis.prospect import Duel, Prospect
from pumaid.effect_spec import EffectTerm
from pumaid.effects import Trace
from pumaid.estimation.fit import Fit
from pumaid.trajectory import Motion

Floats = NDArray[np.float64]
Age = tuple[float, float]

#: Laps from which a set is chosen, and those that are left after the first look.
TRIED, KEPT = 240, 32
#: Rounds of exchanging a lap for a better one, and of letting the rivals find better shapes.
EXCHANGES, SHARPENINGS = 3, 3
#: A new posture must tell this much more than a known one: nobody has seen yet that its way is free.
CAUTION = 1.15
#: Sets that differ by less than this share are as good.
EQUAL = 1e-6
#: How often each lap is made: what it shows is believed when it repeats, and only then is its noise known.
REPLICATES = 2
#: A late run must tell this much more than one of a new recording: it takes the whole time before it.
LATE = 1.5


@dataclass(frozen=True, slots=True)
class Goal:
    """What a set of runs is for.

    Attributes
    ----------
    duels
        D of them on some laps.
    worth
        (D, M) gains of M sets to (M,) what each is worth: twice the gains are about twice as much.
    needed
        Worth of a set that needs no more runs.
    picked
        Distinct laps of a set at most.
    """

    duels: Callable[[Prospect], tuple[Duel, ...]]
    worth: Callable[[Floats], Floats]
    needed: float
    picked: int


@dataclass(frozen=True, eq=False, slots=True)
class Choice:
    """A set of runs: distinct laps, (L,) how often each is made, when, the duels on these laps, and what for."""

    laps: tuple[Lap, ...]
    weights: Floats
    age: Age
    duels: tuple[Duel, ...]
    goal: Goal

    @property
    def gains(self) -> Floats:
        """(D,)"""
        return self.times(1)[:, 0]

    @property
    def worth(self) -> float:
        """By its goal."""
        return float(self.goal.worth(self.times(1))[0])

    @property
    def made(self) -> dict[Lap, int]:
        """How often each lap is made."""
        return {lap: int(count) for lap, count in zip(self.laps, self.weights, strict=True) if count}

    @property
    def motions(self) -> tuple[Motion, ...]:
        """All runs in rounds, so that those made again lie apart in time."""
        rounds = range(max(self.made.values()))
        return tuple(motion for k in rounds for lap, count in self.made.items() if count > k for motion in lap.motions)

    def sharpened(self) -> Choice:
        """With the shapes with which rivals come nearest."""
        for duel in self.duels:
            duel.allow(duel.nearest(self.weights))
        return self

    def times(self, count: int) -> Floats:
        """(D, count) gains of one to `count` sets."""
        each = np.outer(np.arange(1, count + 1), self.weights)
        return np.array([duel.gains(each) for duel in self.duels])

    def pruned(self) -> Choice:
        """Without runs that the goal does not need, those in new postures first."""
        out = self
        for place in sorted(range(len(self.laps)), key=lambda k: not self.laps[k].is_new):
            for _ in range(int(self.weights[place]) // REPLICATES):
                fewer = replace(out, weights=out.weights - REPLICATES * np.eye(len(out.weights))[place])
                if not fewer.weights.any() or fewer.sharpened().worth < self.goal.needed:
                    break
                out = fewer
        return out


def best(solved: Fit, added: Sequence[EffectTerm], goal: Goal) -> Choice | None:
    """The best set of runs in which some effects act; None where no joint can move so.

    A set is one of a new recording, or of the end of one where that is much better; runs that the goal does not need
    are left out, those in new postures first.
    """
    joints = [
        row.bins.joint
        for row in solved.joints
        if any(np.any(one.linear(solved.model.robot, row.bins.samples)) for one in added)
    ]
    tried = [lap for joint in joints for lap in laps(solved, joint)]
    bins = bins_for(solved, added)
    most = max(TRIED * CELLS // bins, KEPT)
    if len(tried) > most:
        rng = np.random.default_rng(len(tried))
        tried = [tried[k] for k in np.sort(rng.permutation(len(tried))[:most])]
    if not tried:
        return None
    found = [_Search(solved, tried, age=age, goal=goal, bins=bins).best() for age in _ages(solved, added)]
    first, *late = found
    better = [one for one in late if one.worth > LATE * first.worth]
    return (better[0] if better else first).pruned()


def _ages(solved: Fit, added: Sequence[EffectTerm]) -> list[Age]:
    """When runs can begin: as a new recording's first; for effects of time also at the end of one like the longest."""
    if not any(ages(one) for one in added):
        return [(0.0, 0.0)]
    ends = [max(float(getattr(row.bins.samples, name).max()) for row in solved.joints) for name in ("time", "elapsed")]
    return [(0.0, 0.0), (ends[0], ends[1])]


def ages(added: EffectTerm) -> bool:
    """Whether an effect comes and goes with every recording, unlike what changed for good at an instant."""
    return Trace.TIME in added.effect.trace and "time" not in added.shape


class _Search:
    """Sets of laps that all begin at one age."""

    def __init__(self, solved: Fit, tried: Sequence[Lap], *, age: Age, goal: Goal, bins: int) -> None:
        self.solved, self.age, self.goal, self.bins = solved, age, goal, bins
        self.pool, self.wide = list(tried), self._duels(tried)
        worth = self._worth(np.eye(len(tried)))
        order = np.argsort(-worth, kind="stable")
        first, kept = tried[order[0]], set(order[:KEPT].tolist())
        self.pool = [
            lap for k, lap in enumerate(tried) if k in kept or (lap.joint, lap.hold) == (first.joint, first.hold)
        ]
        self.wide = self._duels(self.pool)

    def _duels(self, some: Sequence[Lap]) -> tuple[Duel, ...]:
        groups = itertools.groupby(some, key=lambda lap: lap.joint)
        rows = [ahead(self.solved, list(group), age=self.age, bins=self.bins) for _, group in groups]
        return self.goal.duels(Prospect(self.solved, rows))

    def best(self) -> Choice:
        """Exchanges from several starts; again as long as rivals find shapes that the set does not tell apart."""
        chosen = self._exchanged(self._starts())
        found = [self._fought(chosen)]
        for _ in range(SHARPENINGS):
            before, chosen = chosen, self._exchanged([chosen])
            if chosen == before:
                break
            found.append(self._fought(chosen))
        for one in found[:-1]:
            self._learn(one)
        return max(found, key=lambda one: one.worth)

    def _learn(self, one: Choice) -> None:
        """Shapes that rivals found after other sets."""
        for few, many in zip(one.duels, self.wide, strict=True):
            few.allow([shape for shape in many.shapes if shape not in few.shapes])

    def _fought(self, chosen: Sequence[int]) -> Choice:
        """The set, with the shapes that come nearest after it; the pool's rivals learn them."""
        counts = sorted(Counter(chosen).items())
        some, weights = (
            tuple(self.pool[k] for k, _ in counts),
            np.array([float(REPLICATES * count) for _, count in counts]),
        )
        found = Choice(some, weights, self.age, self._duels(some), self.goal)
        self._learn(found)
        found.sharpened()
        for few, many in zip(found.duels, self.wide, strict=True):
            many.allow(few.shapes[len(many.shapes) :])
        return found

    def _worth(self, weights: Floats) -> Floats:
        """(M,) worth of sets of laps, new postures counting less; multiples of `EQUAL` of the largest."""
        gains = np.array([duel.gains(REPLICATES * weights) for duel in self.wide])
        caution = np.array([1.0 / CAUTION if lap.is_new else 1.0 for lap in self.pool])
        worth = self.goal.worth(gains) * (weights @ caution) / weights.sum(axis=1)
        unit = EQUAL * (worth.max(initial=0.0) or 1.0)
        return np.asarray(np.round(worth / unit) * unit)

    def _starts(self) -> list[list[int]]:
        """Where exchanges begin: laps picked one by one; in one posture speeds spread evenly, and the extremes.

        One by one alone would miss runs that tell something only together.
        """
        each, chosen, count = np.eye(len(self.pool)), list[int](), self.goal.picked
        for _ in range(count):
            chosen.append(int(np.argmax(self._worth(each[chosen].sum(axis=0) + each))))
        first = self.pool[chosen[0]]
        alike = [k for k, lap in enumerate(self.pool) if (lap.joint, lap.hold) == (first.joint, first.hold)]
        alike.sort(key=lambda k: self.pool[k].speed)
        spread = np.linspace(0, len(alike) - 1, count).round().astype(int)
        extreme = np.where(np.arange(count) % 2, len(alike) - 1, 0)
        return [chosen, *([alike[k] for k in places] for places in (spread, extreme))]

    def _exchanged(self, starts: Sequence[Sequence[int]]) -> list[int]:
        """The best set after each lap of each start has been exchanged for the best in its place until none is."""
        each, found = np.eye(len(self.pool)), list[tuple[float, list[int]]]()
        for start in starts:
            out, best = list(start), -1.0
            for _ in range(EXCHANGES):
                before = best
                for place in range(len(out)):
                    worth = self._worth(each[out[:place] + out[place + 1 :]].sum(axis=0) + each)
                    better = int(np.argmax(worth))
                    out[place] = better if worth[better] > worth[out[place]] else out[place]
                    best = float(worth[out[place]])
                if best <= before * (1.0 + EQUAL):
                    break
            found.append((best, sorted(out)))
        return max(found, key=lambda one: one[0])[1]
