"""One dependence after the other is taken out of a residual, the surest first, until only noise is left."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.diagnosis.flips import Basis, Design, chances, flipped
from pumaid.diagnosis.laid import View
from pumaid.diagnosis.repeats import Repeats
from pumaid.diagnosis.ripples import MODULATED, Track, spectrum
from pumaid.diagnosis.traces import TERMS, fitted

Floats = NDArray[np.float64]
Labels = NDArray[np.int64]

#: Chance that anything at a joint is called more than noise where all is noise.
FALSE_ALARM = 0.05
#: Sign flips, always the same ones.
FLIPS, SEED = 399, 20
#: Most dependences and ripples taken out of one joint.
MOST_FOUND = 16
#: A dependence worth a part takes at least this share of the error's square, a hundredth of the error: less is what a
#: smooth curve leaves of another one. Ripples come in numbers, and nothing leaves them: each may be smaller.
LEAST, LEAST_RIPPLE = 0.02, 0.004
#: Ripples not worth telling after which no further one is looked for: the surest need not be the largest.
MOST_SMALL = 6
#: Fewest runs whose signs, flipped, can show anything at `FALSE_ALARM`.
FEWEST_RUNS = 6

#: Keys of what is no term: ripples, a ripple that changes its size along the run, and what repeats without a name.
RIPPLE, SWELL, REPEAT = ("fast", "position"), ("fast", "size"), ("unassigned", "")

Key = tuple[str, str]


@dataclass(frozen=True, eq=False, slots=True)
class Found:
    """What was taken out.

    Attributes
    ----------
    key
        Part and variable.
    chance
        Of as much by noise, everything at the joint considered.
    fall, noise
        By how much the square fell, and how much noise brings into these directions, A2 times samples.
    basis
        Its directions; None of a ripple.
    frequency
        rad of phase per rad or m; 0 of what is no ripple.
    """

    key: Key
    chance: float
    fall: float
    noise: float
    basis: Basis | None = None
    frequency: float = 0.0


@dataclass(frozen=True, eq=False, slots=True)
class _Seen:
    """How rare a dependence is alone, and each of its flipped draws (B,); its square and what noise makes of it.

    `basis` are its directions; where it is a ripple, `frequency` says them.
    """

    chance: float
    rare: Floats
    square: float
    noise: float
    basis: Basis | None = None
    frequency: float = 0.0


class Search:
    """The residual of one joint while it is taken apart.

    Parameters
    ----------
    at
        All N bins.
    starts
        First bins of the groups in which all but ripples are looked for.
    track
        The same bins along the position.
    repeats
        Runs that ought to agree.
    is_fitted
        Whether a fit to these very runs has taken out what every model has.

    Attributes
    ----------
    found
        What was taken out, in this order.
    chance
        Part and variable -> chance of as much by noise.
    left
        (N,) A.
    """

    def __init__(self, at: View, starts: Labels, track: Track, *, repeats: Repeats, is_fitted: bool) -> None:
        self.at, self.thin, self.track, self.repeats = at, at.coarse(starts), track, repeats
        self.found: tuple[Found, ...] = ()
        self.chance: dict[Key, float] = {}
        self.left = np.zeros(len(at))
        self._starts, self._whole, self._small = starts, 0.0, list[float]()
        base = fitted(self.thin)
        self._makers: list[Callable[[View], Floats]] = [fitted]
        self._blocks = [np.arange(base.shape[1])]
        self._open: dict[Key, Labels] = {RIPPLE: np.zeros(0, dtype=np.int64)}
        pieces = [base]
        for term in TERMS:
            columns = term.columns(self.thin)
            if np.isfinite(columns).all() and np.any(columns):
                block = np.arange(columns.shape[1]) + self._blocks[-1][-1] + 1
                self._open[term.key] = block
                self._makers.append(term.columns)
                self._blocks.append(block)
                pieces.append(columns)
        first = np.searchsorted(self.thin.run, np.arange(len(track.first)))
        self._design = Design.of(np.concatenate(pieces, axis=1), self.thin.weight, first)
        self._taken = self._blocks[0] if is_fitted else np.zeros(0, dtype=np.int64)

    def run(self, residual: Floats, *, inside: float) -> None:
        """Take (N,) A apart until nothing in it is more than noise; `inside` (A2 times samples) varies within bins."""
        self.left, runs = residual.copy(), len(self.track.first)
        self._whole = self._square(residual) + inside
        rng = np.random.default_rng(SEED)
        signs = rng.choice([-1.0, 1.0], (FLIPS, runs))
        for _ in range(MOST_FOUND):
            if not (self._step(signs) if runs >= FEWEST_RUNS else self._step_of_few()):
                break
        self.found = tuple(replace(one, noise=self._noise(one)) for one in self.found)

    def thin_left(self) -> Floats:
        """What is left, in the means of the thin view."""
        return np.asarray(np.add.reduceat(self.at.weight * self.left, self._starts) / self.thin.weight)

    def is_worth(self, gain: float, *, least: float = LEAST) -> bool:
        """Whether a square (A2 times samples) is large enough to be told: at least this share of what was there."""
        return gain >= least * self._whole

    def _step(self, signs: Floats) -> bool:
        """Look at everything once; take out the largest of what is more than noise. False where nothing is."""
        by_run = self._design.scores(self.thin_left())
        seen: dict[Key, _Seen] = {}
        for key, block in self._open.items():
            basis = self._design.basis(block, self._taken)
            if basis is not None:
                observed = float(np.sum((by_run @ basis.mixing).sum(axis=0) ** 2))
                drawn = flipped(signs, basis.scores(by_run))
                seen[key] = _Seen(*chances(observed, drawn), observed, float(drawn.mean()), basis=basis)
        waves = spectrum(self.track, self.left) if RIPPLE in self._open else None
        if waves is not None:
            frequency, height = waves.peak([*self._small, *(one.frequency for one in self.found)])
            rare = chances(height, waves.height(signs).max(axis=1))
            seen[RIPPLE] = _Seen(*rare, *waves.squares(frequency), frequency=frequency)
        if SWELL in self._open:
            seen[SWELL] = self._swelling(signs)
        if self.repeats.groups:
            products, own = self.repeats.products(self.at, self.left)
            drawn = own + np.einsum("br,br->b", signs @ products, signs)
            seen[REPEAT] = _Seen(*chances(own + float(products.sum()), drawn), 0.0, own)
        best = self._largest(seen)
        if best is not None:
            self._take(best, seen[best])
        return best is not None

    def _swelling(self, signs: Floats) -> _Seen:
        """Whether the strongest ripple changes its size along the run."""
        frequency = max((one for one in self.found if one.key == RIPPLE), key=lambda one: one.fall).frequency
        columns = self.track.waves(frequency, degree=MODULATED)
        scores = np.add.reduceat(columns * (self.at.weight * self.left)[:, None], self.track.first, axis=0)
        observed, drawn = float(np.sum(scores.sum(axis=0) ** 2)), flipped(signs, scores)
        return _Seen(*chances(observed, drawn), observed, float(drawn.mean()), frequency=frequency)

    def _step_of_few(self) -> bool:
        """Where runs are few only a ripple can be told from noise: by the frequencies beside it."""
        waves = spectrum(self.track, self.left) if RIPPLE in self._open else None
        if waves is None:
            return False
        frequency, height = waves.peak([*self._small, *(one.frequency for one in self.found)])
        chance = waves.chance(height)
        if not self.found:
            self.chance[RIPPLE] = chance
        if chance <= FALSE_ALARM:
            self._take(RIPPLE, _Seen(chance, np.zeros(0), *waves.squares(frequency), frequency=frequency))
        return chance <= FALSE_ALARM

    def _largest(self, seen: dict[Key, _Seen]) -> Key | None:
        """What takes out most of what is more than noise, directions counted against it; chances are noted."""
        if not seen:
            return None
        smallest = np.min([one.rare for one in seen.values()], axis=0)
        chance = {
            key: float((1 + np.count_nonzero(smallest <= one.chance)) / (1 + len(smallest)))
            for key, one in seen.items()
        }
        found = {one.key for one in self.found}
        self.chance |= {key: value for key, value in chance.items() if key not in found}
        cost = np.log(len(self.track.first))
        worth = {
            key: one.square - cost * one.noise
            for key, one in seen.items()
            if key != REPEAT and chance[key] <= FALSE_ALARM
        }
        return max(worth, key=lambda key: worth[key], default=None)

    def _take(self, key: Key, seen: _Seen) -> None:
        """Take a dependence out, if it is worth it, and look at it no more; at ripples until several were not."""
        frequency = self.track.refined(self.left, seen.frequency) if key == RIPPLE else seen.frequency
        if seen.basis is not None:
            columns = self._columns(seen.basis)
        else:
            columns = self.track.waves(frequency, degree=MODULATED if key == SWELL else 0)
        before = self.left
        self.left = before - columns @ (columns.T @ (self.at.weight * before))
        fall = self._square(before) - self._square(self.left)
        one = Found(key, self.chance[key], fall, seen.noise, seen.basis, frequency)
        is_worth = self.is_worth(fall - self._noise(one), least=LEAST_RIPPLE if key == RIPPLE else LEAST)
        if is_worth:
            self.found = (*self.found, one)
            self._taken = np.append(self._taken, self._open[key])
        else:
            self.left = before
            self._small += [frequency, seen.frequency] if key == RIPPLE else []
        if key != RIPPLE or len(self._small) > 2 * MOST_SMALL:
            del self._open[key]
        elif is_worth and SWELL not in self.chance:
            self._open[SWELL] = self._open[RIPPLE]

    def _columns(self, basis: Basis) -> Floats:
        """(N, k) a basis of the design at all bins."""
        used = np.any(basis.mixing != 0.0, axis=1)
        pairs = [(make, block) for make, block in zip(self._makers, self._blocks, strict=True) if used[block].any()]
        return np.asarray(np.sum([make(self.at) @ basis.mixing[block] for make, block in pairs], axis=0))

    def _noise(self, one: Found) -> float:
        """Square (A2 times samples) that noise brought into what was taken out, by what each run has left there."""
        return one.noise if one.basis is None else one.basis.noise(self._design.scores(self.thin_left()))

    def _square(self, values: Floats) -> float:
        return float(self.at.weight @ values**2)
