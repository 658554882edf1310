"""Which laps are made: a plan's least coverage first, then whatever tells most for its time, then exchanges."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pumaid.design.criterion import Criterion
from pumaid.design.menu import Menu

Floats = NDArray[np.float64]

#: Turns that are looked at exactly where slopes have ranked them.
_LOOKED_AT = 12
#: Scores closer than this share of the best are equal: machines differ in the last digits of a sum, and a plan must
#: not depend on which machine made it.
EQUAL = 1e-6
#: By how much a lap that is made in another pass, too, is preferred: replicates tell the noise.
_AGAIN = 1.03
#: Improvement of the criterion (a logarithm) below which exchanging ends, and rounds at most.
_ENOUGH, _ROUNDS = 1e-4, 60
#: Turns, and blocks, a round that are tried for removal, worst first.
_TRIED = 6
#: How often a lap is made in a pass at most.
MOST = 2


@dataclass(eq=False, slots=True)
class Draft:
    """Laps of a plan while they are chosen.

    A plan is some passes over the arm, of one or two kinds that alternate. A *turn* is a lap in the passes of one kind:
    number ``kind * L + lap``.

    Attributes
    ----------
    menu, criterion
        What there is to choose from, and what for.
    times
        How often each kind of pass is made.
    opening
        (L,) s that it costs to go to a lap's posture.
    pool
        Laps that are worth a look, rising; `few` is the menu of them.
    chosen
        Turns, each at most `MOST` times.
    kept
        Of these, those that are needed whatever they tell.
    """

    menu: Menu
    criterion: Criterion
    times: tuple[int, ...]
    opening: Floats
    pool: NDArray[np.int64]
    chosen: list[int] = field(default_factory=list)
    kept: set[int] = field(default_factory=set)
    few: Menu = field(init=False)

    def __post_init__(self) -> None:
        self.few = self.menu.only(self.pool)

    def laps(self, kind: int) -> list[int]:
        """Laps of a kind of pass."""
        return [turn % len(self.menu) for turn in self.chosen if turn // len(self.menu) == kind]

    def put(self, laps: Sequence[int], kind: int) -> None:
        """Laps that a kind of pass must have."""
        turns = [kind * len(self.menu) + lap for lap in laps]
        self.chosen += [turn for turn in turns if turn not in self.kept]
        self.kept.update(turns)

    def seconds(self, chosen: Sequence[int] | None = None) -> float:
        """s of all passes."""
        some = self.chosen if chosen is None else chosen
        opened: dict[tuple[int, int, int], float] = {}
        total = 0.0
        for turn in some:
            kind, lap = divmod(turn, len(self.menu))
            total += self.times[kind] * float(self.menu.seconds[lap])
            opened[(kind, *self.menu.block_of(lap))] = self.times[kind] * float(self.opening[lap])
        return total + sum(opened.values())

    def information(self, chosen: Sequence[int] | None = None) -> Floats:
        """(G, p, p) of all passes."""
        weights = np.zeros(len(self.menu))
        for turn in self.chosen if chosen is None else chosen:
            kind, lap = divmod(turn, len(self.menu))
            weights[lap] += self.times[kind]
        return self.menu.information(weights)

    def value(self, chosen: Sequence[int] | None = None) -> float:
        """Of the criterion."""
        return float(self.criterion.value(self.information(chosen)))

    def costs(self, chosen: Sequence[int]) -> Floats:
        """(K P,) s that each turn of the pool would add, kind by kind; infinite where it is made often enough."""
        menu, count = self.menu, len(self.menu)
        out = []
        for kind, often in enumerate(self.times):
            laps = [turn % count for turn in chosen if turn // count == kind]
            is_open = np.zeros((int(menu.joint.max()) + 1, int(menu.hold.max()) + 1), dtype=bool)
            is_open[menu.joint[laps], menu.hold[laps]] = True
            cost = menu.seconds + np.where(is_open[menu.joint, menu.hold], 0.0, self.opening)
            cost[np.bincount(laps, minlength=count) >= MOST] = np.inf
            out.append(often * cost[self.pool])
        return np.concatenate(out)

    def best_addition(self, chosen: Sequence[int], spare: float) -> int | None:
        """The turn that lowers the criterion most for its time, of those that fit into `spare` s, or None."""
        costs = self.costs(chosen)
        fits = costs <= spare
        if not np.any(fits):
            return None
        count, kinds = len(self.menu), len(self.times)
        times = np.repeat(np.asarray(self.times, dtype=float), len(self.pool))
        turns = np.concatenate([kind * count + self.pool for kind in range(kinds)])
        information = self.information(chosen)
        worth = np.tile(self.few.worth(self.criterion.pull(information)), kinds) * times
        known = np.zeros(count, dtype=bool)
        known[[turn % count for turn in chosen]] = True
        liked = np.where(np.tile(known[self.pool], kinds), _AGAIN, 1.0)
        rate = np.where(fits, worth * liked / costs, 0.0)
        some = np.argsort(-settled(rate), kind="stable")[:_LOOKED_AT]
        some = some[fits[some]]
        added = information + times[some][:, None, None, None] * self.menu.each((turns[some] % count).tolist())
        gain = (float(self.criterion.value(information)) - self.criterion.value(added)) * liked[some] / costs[some]
        return int(turns[some[np.argmax(settled(gain))]])

    def fill(self, budget: float) -> None:
        """Add turns as long as one fits into `budget` s."""
        while (turn := self.best_addition(self.chosen, budget - self.seconds())) is not None:
            self.chosen.append(turn)

    def exchange(self, budget: float, tell: Callable[[float], None]) -> None:
        """Take out the turn that tells least for its time and put in what tells most, as long as that helps.

        Parameters
        ----------
        budget
            s of all passes.
        tell
            Called with the criterion after each round.
        """
        value = self.value()
        for _ in range(_ROUNDS):
            if not any(self._refilled(turns, budget, value) for turns in self._removals()):
                return
            value = self.value()
            tell(value)

    def _removals(self) -> list[tuple[int, ...]]:
        """Turns, and whole blocks, that may go, least worth for their time first."""
        count = len(self.menu)
        used = np.unique([turn % count for turn in self.chosen])
        worth = np.zeros(count)
        worth[used] = self.menu.only(used).worth(self.criterion.pull(self.information()))
        groups: dict[tuple[int, ...], list[int]] = {}
        for turn in self.chosen:
            groups.setdefault((turn // count, *self.menu.block_of(turn % count)), []).append(turn)
        free = [turns for turns in groups.values() if not self.kept.intersection(turns)]
        rates = [
            float(np.sum(worth[laps]) / (np.sum(self.menu.seconds[laps]) + self.opening[laps[0]]))
            for laps in ([turn % count for turn in turns] for turns in free)
        ]
        blocks = [tuple(free[k]) for k in np.argsort(settled(np.array(rates)), kind="stable")[:_TRIED]] if free else []
        single = np.array(sorted({turn for turn in self.chosen if self._may_go(turn)}), dtype=np.int64)
        if not len(single):
            return blocks
        order = np.argsort(settled((worth / self.menu.seconds)[single % count]), kind="stable")
        return [*((int(turn),) for turn in single[order[:_TRIED]]), *blocks]

    def _may_go(self, turn: int) -> bool:
        return turn not in self.kept or self.chosen.count(turn) > 1

    def _refilled(self, turns: tuple[int, ...], budget: float, value: float) -> bool:
        """Whether the criterion falls where turns are replaced by the best that then fit; if so they are."""
        trial = list(self.chosen)
        for turn in turns:
            trial.remove(turn)
        while (added := self.best_addition(trial, budget - self.seconds(trial))) is not None:
            if (added,) == turns:
                return False
            trial.append(added)
        if self.value(trial) > value - _ENOUGH:
            return False
        self.chosen = trial
        return True


def settled(scores: Floats) -> Floats:
    """Scores as multiples of `EQUAL` of the greatest, so that rounding decides between no two of them."""
    return np.asarray(np.round(scores / (np.max(np.abs(scores)) or 1.0) / EQUAL))
