"""Optimal experimental design: a criterion, the continuous optimum as its bound, and the greedy exchange algorithm."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pumaid.design.information import CandidateInformation
from pumaid.maths import Counts, Flags, Floats

#: Scaled information below this is rounding.
_RIDGE = 1e-9
#: Scores within this share of the best are equal, so that rounding does not decide between two candidates.
EQUAL = 1e-6
#: How often a candidate is taken at most.
_OFTEN = 4
#: Candidates that are evaluated exactly where slopes have ranked them.
_EVALUATED = 12
#: Least fall of the value that an exchange must bring, rounds at most, and removals tried a round.
_ENOUGH, _ROUNDS, _TRIED = 1e-4, 60, 6
#: Steps of the continuous design, how near its optimum it ends (of a logarithm), the power of a step, and the steps
#: after which candidates with less than a share of the mean candidate's time are dropped.
_STEPS, _NEAR, _STRIDE, _SORTED, _IDLE = 120, 0.005, 0.7, (8, 16, 28), 0.05


def rounded(scores: Floats) -> Floats:
    """Scores as multiples of `EQUAL` of the greatest."""
    return np.asarray(np.round(scores / (np.max(np.abs(scores), initial=0.0) or 1.0) / EQUAL))


@dataclass(frozen=True, eq=False, slots=True)
class Criterion:
    """Logarithm of the geometric mean of standard errors, averaged over prior robots; smaller is better.

    Source
    ------
    F. Pukelsheim, Optimal Design of Experiments, ch. 6 and 7 (D-optimality but for correlations).
    """

    size: Floats  # (p,) typical size of each parameter
    counted: Flags  # (p,) which parameters count

    def value(self, information: Floats) -> Floats:
        """(...) for information (..., G, p, p) of G robots."""
        logs = np.log(self.errors(information) / self.size)[..., self.counted]
        return np.asarray(logs.mean(axis=(-1, -2)))

    def slope(self, information: Floats) -> Floats:
        """(G, p, p): more information M lowers the value by half the sum of the products of its elements with M's."""
        inverse, share = _inverse(information), self.counted / np.count_nonzero(self.counted)
        variance = np.einsum("gpp->gp", inverse)
        return np.asarray(inverse @ ((share / variance)[..., None] * inverse)) / len(information)

    def errors(self, information: Floats) -> Floats:
        """(..., p) standard errors."""
        return np.sqrt(np.einsum("...pp->...p", _inverse(information)))


def _inverse(information: Floats) -> Floats:
    scale = np.sqrt(np.einsum("...pp->...p", information))
    scale = np.where(scale > 0, scale, 1.0)
    both = scale[..., :, None] * scale[..., None, :]
    return np.asarray(np.linalg.inv(information / both + _RIDGE * np.eye(information.shape[-1])) / both)


@dataclass(frozen=True, eq=False, slots=True)
class ContinuousDesign:
    """The optimum if candidates could be made in fractions."""

    counts: Floats  # (L,) how often each candidate is made
    bound: float  # value of the criterion below which no plan of these candidates gets in this time
    worth: Floats  # (L,) 0..1: what one second more of each candidate would bring, as a share of the best


def continuous_design(
    candidates: CandidateInformation, criterion: Criterion, total: float, *, steps: int = _STEPS
) -> ContinuousDesign:
    """Share out `total` s among candidates by the multiplicative algorithm.

    Source
    ------
    S. D. Silvey, D. M. Titterington and B. Torsney, Communications in Statistics A 7 (1978) 1379-1389; the bound is
    that of a convex function by its slopes.
    """
    active, part = np.arange(len(candidates)), candidates
    counts = np.full(len(candidates), total / float(np.sum(candidates.seconds)))
    for step in range(steps):
        if step in _SORTED:
            spent = counts * part.seconds
            is_used = spent > _IDLE * spent.mean()
            active, counts = active[is_used], counts[is_used]
            part = candidates.only(active)
        rate = np.maximum(part.products(criterion.slope(part.information(counts))), 0.0) / part.seconds * total
        if rate.max() < 1.0 + 2.0 * _NEAR and step > _SORTED[-1]:
            break
        counts = counts * rate**_STRIDE
        counts *= total / np.sum(counts * part.seconds)
    whole = np.zeros(len(candidates))
    whole[active] = counts
    information = candidates.information(whole)
    rate = candidates.products(criterion.slope(information)) / candidates.seconds
    bound = float(criterion.value(information)) - 0.5 * (float(rate.max()) * total - 1.0)
    return ContinuousDesign(whole, bound, rate / float(rate.max()))


@dataclass(frozen=True, eq=False, slots=True)
class Exchange:
    """Greedy choice and exchange of C candidate runs under a budget (s).

    Source
    ------
    V. V. Fedorov, Theory of Optimal Experiments, ch. 3 (exchange algorithm).
    """

    candidates: CandidateInformation
    criterion: Criterion
    opening: Floats  # (C,) s of the first candidate of its posture
    budget: float

    def value(self, counts: Counts) -> float:
        """The criterion of a set (C,)."""
        return float(self.criterion.value(self.candidates.information(counts)))

    def falls(self, counts: Counts) -> Floats:
        """(C,) about how much the criterion falls by one more of each candidate."""
        return 0.5 * self.candidates.products(self.criterion.slope(self.candidates.information(counts)))

    def cost(self, counts: Counts) -> float:
        """s of a set (C,)."""
        used = np.flatnonzero(counts)
        _, first = np.unique(self.candidates.posture[used], return_index=True)
        return float(counts[used] @ self.candidates.seconds[used] + self.opening[used[first]].sum())

    def filled(self, counts: Counts) -> Counts:
        """A set (C,) with candidates added until none fits into the budget."""
        while (best := self._best_addition(counts)) is not None:
            counts = _changed(counts, best, 1)
        return counts

    def exchanged(self, counts: Counts, *, required: Counts, tell: Callable[[float], None] = lambda _: None) -> Counts:
        """A set (C,) after exchanges, while they lower the value; `required` (C,) stay; `tell` gets each new value."""
        value = self.value(counts)
        for _ in range(_ROUNDS):
            free = np.flatnonzero(counts > required)
            worth = rounded((self.falls(counts) / self.candidates.seconds)[free])
            for candidate in free[np.argsort(worth, kind="stable")[:_TRIED]]:  # the least useful for their cost
                fewer = _changed(counts, candidate, -1)
                best = self._best_addition(fewer)
                if best is None or best == candidate:
                    continue
                trial = self.filled(_changed(fewer, best, 1))
                if self.value(trial) < value - _ENOUGH:
                    counts, value = trial, self.value(trial)
                    tell(value)
                    break
            else:
                break
        return counts

    def _best_addition(self, counts: Counts) -> int | None:
        """The candidate that lowers the value most for its cost, of those that fit; or None."""
        is_open = np.isin(self.candidates.posture, self.candidates.posture[counts > 0])
        costs = self.candidates.seconds + np.where(is_open, 0.0, self.opening)
        fits = (costs <= self.budget - self.cost(counts)) & (counts < _OFTEN)
        if not fits.any():
            return None
        rate = np.where(fits, self.falls(counts) / costs, -np.inf)
        top = np.flatnonzero(fits)
        top = top[np.argsort(-rounded(rate[top]), kind="stable")[:_EVALUATED]]
        more = self.candidates.information(counts) + self.candidates.each(top)
        gain = (self.value(counts) - self.criterion.value(more)) / costs[top]
        return int(top[np.argmax(rounded(gain))])


def _changed(counts: Counts, candidate: int, by: int) -> Counts:
    return counts + by * (np.arange(len(counts)) == candidate)
