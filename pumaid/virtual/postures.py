"""Which postures of the other joints show what a joint's current carries: chosen by measuring what each would tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.virtual.forecast import gravity_names, run_moments, run_slopes
from pumaid.virtual.ranges import candidates, reference, span
from pumaid.virtual.truth import Truth

Floats = NDArray[np.float64]

#: Candidate postures drawn a joint.
_DRAWN = 160
#: Seconds and samples a second of the run by which candidates are judged; their ranking hardly depends on either.
_SECONDS, _RATE = 5.0, 100.0
#: Slopes below this share of the greatest are rounding.
_NOTHING = 1e-9
#: A posture serves a parameter whose error without it is this many times as large; from the second on it is not seen.
_HALF_MORE, _UNSEEN = 1.5, 1e3
#: What a turn of half a circle of one held joint may cost, as a share of the criterion: breaks ties toward short moves.
_LAZINESS = 0.01
#: Scores closer than this share of the best are equal: machines differ in the last digits of a sum, symmetric postures
#: in nothing else, and a plan must not depend on which machine made it.
_EQUAL = 1e-6
#: Scaled information below this is rounding; and what stands for nothing where sets of too few postures are compared.
_ROUNDING, _RIDGE = 1e-9, 1e-3


@dataclass(frozen=True, eq=False, slots=True)
class Choice:
    """The postures of one joint.

    Attributes
    ----------
    joint
        From 1.
    fitted
        (P, J) postures for the fit.
    heldout
        (J,) a posture for judging only.
    serves
        For each fitted posture the parameters whose standard error rises by half or more without it, and how many times
        as large it would be (infinite where the parameter would not be seen at all).
    wanted
        Parameters that this joint's runs are to show: its own and the ratios that outer joints cannot.
    """

    joint: int
    fitted: Floats
    heldout: Floats
    serves: tuple[dict[str, float], ...]
    wanted: tuple[str, ...]


class _Worth:
    """What each candidate posture tells of one joint's wanted parameters, on each of several assumed robots."""

    def __init__(self, truths: Sequence[Truth], joint: int, holds: Floats, wanted: Sequence[str]) -> None:
        robot = truths[0].robot
        every = gravity_names(robot)
        keep = [every.index(name) for name in wanted]
        self.width = len(keep)
        moments = [
            run_moments(span(robot.joint(joint)), _SECONDS, truth.noise, joint=joint, rate=_RATE) for truth in truths
        ]
        both = np.zeros((len(truths), len(holds), self.width + 2, self.width + 2))
        for g, truth in enumerate(truths):
            slopes = run_slopes(robot, truth.constants, joint=joint, holds=holds)[:, :, keep]
            for friction in range(2):
                wide = np.zeros((len(holds), 3, self.width + 2))
                wide[:, :, : self.width] = slopes
                wide[:, 2, self.width + friction] = 1.0
                both[g] += np.einsum("kap,ab,kbq->kpq", wide, moments[g], wide)
        size = np.sqrt(np.mean(np.einsum("gkpp->gkp", both), axis=1))
        self.information = both / (size[:, None, :, None] * size[:, None, None, :])

    def of(self, sets: Sequence[Sequence[int]]) -> Floats:
        """(S,) smallest singular value that is left of the scaled wanted columns once friction has taken its share."""
        smallest = self._values(sets)[..., 0]
        return np.asarray(np.sqrt(np.where(smallest > _ROUNDING, smallest, 0.0)).mean(axis=1))

    def spread(self, sets: Sequence[Sequence[int]]) -> Floats:
        """(S,) geometric mean of what is left in all directions: ranks sets too small to show every wanted column."""
        return np.asarray(np.exp(np.log(np.maximum(self._values(sets), 0.0) + _RIDGE).mean(axis=(1, 2))))

    def _values(self, sets: Sequence[Sequence[int]]) -> Floats:
        total = np.stack([self.information[:, list(chosen)].sum(axis=1) for chosen in sets])
        return np.asarray(np.linalg.eigvalsh(self._left(total)))

    def errors(self, chosen: Sequence[int]) -> Floats:
        """(w,) standard errors of the wanted parameters, in one unit all through, from the postures `chosen`."""
        left = self._left(self.information[:, list(chosen)].sum(axis=1))
        values, vectors = np.linalg.eigh(left)
        inverse = 1.0 / np.maximum(values, 1e-12)
        return np.asarray(np.median(np.sqrt(np.einsum("gpk,gk->gp", vectors**2, inverse)), axis=0))

    def _left(self, total: Floats) -> Floats:
        w = self.width
        own, cross, friction = total[..., :w, :w], total[..., :w, w:], total[..., w:, w:]
        return np.asarray(own - cross @ np.linalg.solve(friction, np.swapaxes(cross, -1, -2)))


def choose(truths: Sequence[Truth], *, names: Sequence[str], count: int, rng: np.random.Generator) -> list[Choice]:
    """Postures for every joint, so that every parameter that the arm has is seen.

    For each joint from n to 1 the wanted columns are its own gravity parameters and the ratios that no joint outward of
    it has shown; scaled, and cleared of what friction shares with them, their smallest singular value is made as large
    as it gets by choosing postures one by one and then exchanging them.

    Parameters
    ----------
    truths
        Assumed robots: the choice is good for all of them, not for one.
    names
        Gravity parameters and ratios that the arm has.
    count
        Postures a joint for the fit; joints that carry no weight get fewer.
    rng
        Source of the candidates.

    Returns
    -------
    choices
        One a joint, in order of joints.

    Source
    ------
    S.-K. Lin, on persistently exciting runs: joint i not parallel to gravity; outer joints differing between postures.
    """
    robot = truths[0].robot
    shown: set[str] = set()
    choices = []
    for joint in range(robot.n_joints, 0, -1):
        free = [number for number in _that_matter(truths[0], joint, rng) if number != joint]
        holds = candidates(robot, joint, free=free, count=_DRAWN, rng=rng)
        wanted = _wanted(truths[0], joint, holds, [name for name in names if name not in shown])
        shown.update(wanted)
        choices.append(_choose(truths, joint, holds, wanted=wanted, count=count, rng=rng))
    return choices[::-1]


def _choose(
    truths: Sequence[Truth], joint: int, holds: Floats, *, wanted: Sequence[str], count: int, rng: np.random.Generator
) -> Choice:
    robot = truths[0].robot
    if not wanted:
        anything = [number for number in range(1, robot.n_joints + 1) if number != joint]
        holds = candidates(robot, joint, free=anything, count=8, rng=rng)
        fitted = np.vstack([holds[:1], holds[-1:]])[: min(count, 2, len(holds))]
        return Choice(joint, fitted, holds[max(len(holds) - 2, 0)], ({},) * len(fitted), ())
    worth = _Worth(truths, joint, holds, wanted)
    lazy = 1.0 - _LAZINESS * np.sum(np.abs(holds - reference(robot)), axis=1) / np.pi
    chosen = _exchange(worth, lazy, min(count, len(holds)))
    serves = tuple(_served(worth, chosen, place=place, wanted=wanted) for place in range(len(chosen)))
    return Choice(joint, holds[chosen], holds[_apart(worth, chosen, rng)], serves, tuple(wanted))


def _exchange(worth: _Worth, lazy: Floats, count: int) -> list[int]:
    """Candidates chosen one by one, then each exchanged for a better one until none is."""
    chosen: list[int] = []
    everything = range(len(lazy))
    for _ in range(count):
        found = worth.spread([[*chosen, k] for k in everything]) * lazy
        found[chosen] = -1.0
        chosen.append(_best(found))
    best = float(worth.of([chosen])[0] * lazy[chosen].mean())
    is_improving = True
    while is_improving:
        is_improving = False
        for place in range(count):
            others = chosen[:place] + chosen[place + 1 :]
            found = worth.of([[*others, k] for k in everything])
            found *= np.array([lazy[[*others, k]].mean() for k in everything])
            found[others] = -1.0
            better = _best(found)
            if found[better] > best * (1 + 2 * _EQUAL):
                best, chosen[place], is_improving = float(found[better]), better, True
    return chosen


def _best(scores: Floats) -> int:
    """The first of the scores that equal the greatest."""
    return int(np.argmax(_settled(scores)))


def _settled(scores: Floats) -> Floats:
    """Scores as multiples of `_EQUAL` of the greatest, so that rounding decides between no two of them."""
    return np.asarray(np.round(scores / (np.max(scores) or 1.0) / _EQUAL))


def _served(worth: _Worth, chosen: Sequence[int], *, place: int, wanted: Sequence[str]) -> dict[str, float]:
    """Wanted parameters whose error rises by half or more without the posture at `place`, and by what factor."""
    if len(chosen) == 1:
        return dict.fromkeys(wanted, float("inf"))
    rises = worth.errors([*chosen[:place], *chosen[place + 1 :]]) / worth.errors(chosen)
    found = {name: float(rise) for name, rise in zip(wanted, rises, strict=True) if rise >= _HALF_MORE}
    return {name: rise if rise < _UNSEEN else float("inf") for name, rise in found.items()}


def _apart(worth: _Worth, chosen: Sequence[int], rng: np.random.Generator) -> int:
    """A posture for judging: not fitted, drawn from the better half of those that feel the weight."""
    felt = np.einsum("gkpp->k", worth.information[:, :, : worth.width, : worth.width])
    felt[list(chosen)] = -1.0
    better = np.argsort(_settled(felt), kind="stable")[-max(1, (len(felt) - len(chosen)) // 2) :]
    return int(rng.choice(better))


def _that_matter(truth: Truth, joint: int, rng: np.random.Generator) -> list[int]:
    """Joints (from 1) whose position changes what the moving joint's runs tell."""
    robot = truth.robot
    postures = rng.uniform(-1.0, 1.0, (12, robot.n_joints)) * np.where(robot.is_revolute, np.pi, 0.5)
    before = run_slopes(robot, truth.constants, joint=joint, holds=postures)
    scale = np.max(np.abs(before)) or 1.0
    found = []
    for number in range(1, robot.n_joints + 1):
        turned = postures.copy()
        turned[:, number - 1] += 0.7
        if np.max(np.abs(run_slopes(robot, truth.constants, joint=joint, holds=turned) - before)) > _NOTHING * scale:
            found.append(number)
    return found


def _wanted(truth: Truth, joint: int, holds: Floats, names: Sequence[str]) -> tuple[str, ...]:
    """Names, among those not shown yet, on which the joint's current depends in some candidate posture."""
    every = gravity_names(truth.robot)
    size = np.max(np.abs(run_slopes(truth.robot, truth.constants, joint=joint, holds=holds)), axis=(0, 1))
    scale = np.max(size) or 1.0
    return tuple(name for name in names if size[every.index(name)] > _NOTHING * scale)
