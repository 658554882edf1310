"""How a session is put together: states at rest in which one stretch ends and the next begins."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.simulation.heat import AMBIENT, RISE, TIME_CONSTANT, Heat
from pumaid.simulation.physics.march import Course, March, Rest
from pumaid.simulation.timing import Stretch
from pumaid.simulation.truth import Truth

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Most stretches, and most samples, that march at once: what bounds memory.
MOST_STRETCHES, MOST_SAMPLES = 256, 400_000
#: A joint at rest is carried by stiction with anything up to this share of its Coulomb friction, either way.
STICTION_SHARE = 0.8
#: Executions before the one that counts, at most, and what begins elsewhere: rad or m, share of Coulomb friction.
ROUNDS, CLOSE, LIKE = 2, 2e-5, 0.02
#: s at the end of a stretch over which it is led into the beginning of the next.
LED = 0.2


@dataclass(frozen=True, eq=False, slots=True)
class Seams:
    """The arm at rest before each of K stretches and after the last: (K+1, J) positions, currents, degC."""

    position: Floats
    current: Floats
    warmth: Floats

    def rest(self, part: slice | Ints) -> Rest:
        """Where the stretches of `part` begin."""
        return Rest(self.position[part], self.current[part], np.zeros_like(self.current[part]))


def groups(stretches: Sequence[Stretch], rate: float) -> Iterator[slice]:
    """Parts of a session that fit into memory."""
    first = samples = 0
    for k, stretch in enumerate(stretches):
        count = stretch.samples(rate)
        if k > first and (k - first >= MOST_STRETCHES or samples + count > MOST_SAMPLES):
            yield slice(first, k)
            first, samples = k, 0
        samples += count
    if len(stretches) > first:
        yield slice(first, len(stretches))


class Rehearsal:
    """Executions of every stretch before the one that counts, which tell in which state each begins.

    The first is from the nominal postures. Each further one begins where the one before ended, and repeats only what
    then begins elsewhere. What is left is led over in the last rest of a stretch: see `led`.

    Parameters
    ----------
    truth
        The robot.
    stretches
        K of them.
    begin
        (K,) s of the session at which they begin.
    march
        What executes them.
    rate
        Samples a second.
    """

    def __init__(self, truth: Truth, stretches: Sequence[Stretch], begin: Floats, march: March, *, rate: float) -> None:
        self._truth, self._stretches, self._begin, self._march, self._rate = truth, stretches, begin, march, rate

    def seams(self, settled: Floats, heat: Heat | None) -> Seams:
        """States at rest; `settled` (J,) -1..1 is where in its stiction each joint begins, `heat` the cold motors."""
        start = np.array([[path.start for path in one.paths] for one in self._stretches])
        weight, band = self._truth.gravity_current(start), STICTION_SHARE * self._truth.coulomb
        position, current = (np.concatenate([values, values[-1:]]) for values in (start, weight))
        current[0] += settled * band
        squares, anew = np.zeros_like(start), np.ones(len(start), dtype=bool)
        ended, seams = np.zeros((3, *start.shape)), Seams(position, current, np.full_like(position, AMBIENT))
        for k in range(ROUNDS):
            self._repeat(np.flatnonzero(anew), seams, (ended, squares))
            anew = self._handed(position, current, ended, is_first=k == 0) | (heat is not None)
            seams = Seams(position, current, self._warmth(squares, heat))
            if not np.any(anew):
                break
        return seams

    def rising(self, seams: Seams) -> Floats:
        """(K, J) degC/s that the motors grow warmer in each stretch."""
        seconds = np.array([stretch.samples(self._rate) for stretch in self._stretches]) / self._rate
        return np.asarray(np.diff(seams.warmth, axis=0) / seconds[:, None])

    def _repeat(self, which: Ints, seams: Seams, kept: tuple[Floats, Floats]) -> None:
        """Execute stretches `which` anew; keep where they end (position, current, load) and mean square currents."""
        ended, squares = kept
        some = [self._stretches[k] for k in which]
        for part in groups(some, self._rate):
            rows = which[part]
            warmth = seams.warmth[rows], self.rising(seams)[rows]
            courses, end = self._march.run(some[part], self._begin[rows], rest=seams.rest(rows), warmth=warmth)
            ended[:, rows] = end.position, end.current, end.load
            squares[rows] = [np.mean(course.current**2, axis=0) for course in courses]

    def _handed(self, position: Floats, current: Floats, ended: Floats, *, is_first: bool) -> NDArray[np.bool_]:
        """Let every stretch begin where the one before ended, in place; (K,) those that so far began elsewhere.

        A joint that is held keeps the current with which it came to rest, as long as stiction carries what is left.
        """
        band, before = STICTION_SHARE * self._truth.coulomb, (position.copy(), current.copy())
        for k in range(len(position) - 1):
            place, drawn, load = ended[:, k]
            if is_first:
                stayed = place == before[0][k]
                place = np.where(stayed, position[k], place)
                low, high = np.minimum(load - band, drawn), np.maximum(load + band, drawn)
                drawn = np.clip(np.where(stayed, current[k], drawn), low, high)
            position[k + 1], current[k + 1] = place, drawn
        moved = np.abs(position - before[0]) > CLOSE
        changed = np.abs(current - before[1]) > LIKE * (self._truth.coulomb + LIKE)
        return np.asarray(np.any(moved | changed, axis=1)[:-1])

    def _warmth(self, squares: Floats, heat: Heat | None) -> Floats:
        """(K+1, J) degC between stretches whose motors' mean square currents are `squares` (K, J)."""
        out = np.full((len(squares) + 1, squares.shape[1]), AMBIENT)
        if heat is None:
            return out
        for k, stretch in enumerate(self._stretches):
            share = np.exp(-stretch.samples(self._rate) / self._rate / TIME_CONSTANT)
            wanted = AMBIENT + RISE * squares[k] / heat.usual**2
            out[k + 1] = wanted + share * (out[k] - wanted)
        return out


def led(course: Course, position: Floats, current: Floats, *, rate: float) -> Course:
    """The course whose last rest leads to `position` and `current` (J,), where the next stretch begins.

    A joint at rest stays there whatever its current is within its stiction; where it stands, it is moved by as little
    as two executions of the same stretch differ.
    """
    count = min(len(course.position), max(1, round(LED * rate)))
    share = np.linspace(0.0, 1.0, count + 1)[1:, None]
    share = share * share * (3.0 - 2.0 * share)
    place, drawn = course.position.copy(), course.current.copy()
    place[-count:] += share * (position - place[-1])
    drawn[-count:] += share * (current - drawn[-1])
    return Course(place, course.velocity, drawn)
