"""What a new column could still explain when all that is fitted already is refitted: where shapes are looked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.chosen import Chosen
from pumaid.equations import Block
from pumaid.estimation.rows import Row, plausible
from pumaid.estimation.system import Fitted
from pumaid.maths.joint_fit import prior_rows
from pumaid.maths.levels import Levels
from pumaid.maths.recursion import LARGEST_RATIO
from pumaid.robot import Robot
from pumaid.sight import Sight

Floats = NDArray[np.float64]

#: Share of a column's squares beyond what is fitted already, below which there is only rounding.
NOTHING = 1e-9

#: Bins of a period of the highest frequency of a periodogram, and of its resolution.
BINS = 8


@dataclass(frozen=True, eq=False, slots=True)
class _Place:
    """One joint of a fit.

    Attributes
    ----------
    sight, row, here
        Its runs, their equations, and where these stand in the system.
    bases
        (R, b, c) the triangles' regressors in each run's first equations.
    frames
        (N, e) directions in the bins that each run's further equations are along; zero where it has fewer.
    first
        (R,) number of the first of these equations.
    left
        (N,) current (A) beyond all equations.
    """

    sight: Sight
    row: Row
    here: slice
    bases: Floats
    frames: Floats
    first: NDArray[np.int64]
    left: Floats

    @classmethod
    def of(cls, sight: Sight, row: Row, *, blocks: Sequence[Block], here: slice) -> _Place:
        """From the blocks of the joint, in the order of its runs."""
        first = np.array([len(block.basis) for block in blocks])
        bases = np.zeros((len(blocks), int(first.max()), sight.basis.shape[1]))
        frames = np.zeros((len(sight.weight), max(block.frame.shape[1] for block in blocks)))
        for number, block in enumerate(blocks):
            bins = slice(sight.starts[number], sight.starts[number] + sight.sizes[number])
            bases[number, : first[number], : block.basis.shape[1]] = block.basis
            if block.frame.shape[1]:
                frames[bins, : block.frame.shape[1]] = block.frame
        bare = cls(sight, row, here, bases, frames, first, sight.left)
        return replace(bare, left=bare.beyond(sight.left[:, None])[1][:, 0])

    def noise(self, levels: Levels) -> Floats:
        """(N,) standard deviation of a sample in each bin."""
        return np.repeat(np.sqrt(levels.sample) * self.row.loudness(levels), self.sight.sizes)

    def beyond(self, rest: Floats) -> tuple[Floats, Floats]:
        """(N, p) in the bins as (R, e, p) along the further equations' directions and (N, p) what is left."""
        parts = []
        for frame in self.frames.T:
            along = self.sight.per_run(frame[:, None] * rest)
            rest = rest - frame[:, None] * np.repeat(along, self.sight.sizes, axis=0)
            parts.append(along)
        return np.array(parts).reshape(len(parts), len(self.first), rest.shape[1]).swapaxes(0, 1), rest


@dataclass(frozen=True, eq=False, slots=True)
class Refit:
    """An effect added to a fit.

    Attributes
    ----------
    gain
        Fall of the weighted squares.
    values, half
        (p,) its linear parameters and (p, k) half of their covariance: ``half half'``.
    shift
        (P, p): by how much all that was fitted before moves with each of them.
    """

    gain: float
    values: Floats
    half: Floats
    shift: Floats


@dataclass(frozen=True, eq=False, slots=True)
class Ground:
    """A fit linearised.

    Attributes
    ----------
    fitted, places
        The fit, and the joints on which effects may act.
    taken, back
        (N, r) orthonormal, what the fit can change in its equations; (r, p + edges) the parameters that do.
    residual
        (N,) what it leaves.
    """

    fitted: Fitted
    places: Mapping[int, _Place]
    taken: Floats
    back: Floats
    residual: Floats

    @classmethod
    def of(cls, fitted: Fitted, blocks: Sequence[Block], sights: Mapping[int, Sight]) -> Ground:
        """Of a fit whose equations are `blocks`, and the joints that `sights` show."""
        places, start = {}, 0
        for row in fitted.rows:
            here = slice(start, start + row.target.size)
            start = here.stop
            if row.joint in sights:
                own = [block for block in blocks if block.run.joint == row.joint]
                places[row.joint] = _Place.of(sights[row.joint], row, blocks=own, here=here)
        solution = fitted.solution
        prior = prior_rows(fitted.held, np.sqrt(fitted.pull))
        limit = np.concatenate([fitted.limit, np.full(len(fitted.gains.edges), LARGEST_RATIO)])
        left, singular, right = np.linalg.svd(np.vstack([solution.jacobian, prior]) * limit, full_matrices=False)
        kept = singular > 1.0
        back = right[kept] * limit / singular[kept, None]
        return cls(fitted, places, left[: len(solution.jacobian), kept], back, solution.residual)

    def gain(self, one: Chosen, robot: Robot) -> float:
        """Fall of the weighted squares by an effect, all else refitted."""
        return self.fit(one, robot).gain

    def fit(self, one: Chosen, robot: Robot, *, limits: Floats | None = None) -> Refit:
        """An effect added, all else refitted, its parameters held by priors as in every fit.

        Parameters
        ----------
        one
            The effect, its shape filled in; what it has of derivatives is left out.
        robot
            The arm.
        limits
            (p,) prior deviations of the linear parameters; where not given, those that a fit with this shape has.
        """
        bare, found, peaks = replace(one, fitted=()), [], []
        for joint, place in self.places.items():
            if not one.touches(joint):
                continue
            columns = bare.columns(robot, place.sight.samples)
            peaks.append((place.row, np.abs(columns).max(axis=0)))
            inside, rest = self._parts(place, columns)
            left = place.left / place.noise(self.fitted.levels[joint])
            gram = inside.T @ inside + rest.T @ rest
            cross = inside.T @ self.residual[place.here] + rest.T @ left
            found.append((gram, cross, self.taken[place.here].T @ inside))
        gram, cross, seen = (np.sum(part, axis=0) for part in zip(*found, strict=True))
        left, raw = gram - seen.T @ seen, np.diag(gram)
        size = np.sqrt(np.where(raw > 0, raw, 1.0))
        if limits is None:
            limits = _limits(peaks, [column.span for column in bare.parts(robot, 0)])
        scaled = left / np.outer(size, size) + np.diag((1.0 / np.maximum(limits * size, NOTHING)) ** 2)
        values, vectors = np.linalg.eigh(scaled)
        kept = values > NOTHING
        half = (vectors[:, kept] / np.sqrt(values[kept])) / size[:, None]
        solution = half @ (half.T @ cross)
        return Refit(float(solution @ cross), solution, half, -self.back.T @ seen)

    def power(self, joint: int, frequencies: Floats) -> Floats:
        """(F,) squared sum of what is left in the bins of `joint` (from 1) against exp(i f q)."""
        place = self.places[joint]
        q = place.sight.samples.position[:, joint - 1]
        step = 2.0 * np.pi / (BINS * float(frequencies.max()))
        low = float(q.min())
        where = np.round((q - low) / step).astype(np.int64)
        size = 2 ** int(np.ceil(np.log2((where.max() + 1) * BINS)))
        line = np.bincount(where, weights=place.sight.weight * place.left, minlength=size)
        spectrum = np.abs(np.fft.rfft(line)) ** 2
        at = np.round(frequencies * step * size / (2.0 * np.pi)).astype(np.int64)
        return np.asarray(spectrum[np.minimum(at, len(spectrum) - 1)])

    def _parts(self, place: _Place, columns: Floats) -> tuple[Floats, Floats]:
        """Whitened: (n, p) in the joint's equations, and (N, p) in its bins beyond them."""
        along, rest = place.sight.split(columns)
        levels, row = self.fitted.levels[place.row.joint], place.row
        inside = np.zeros((*row.target.shape, columns.shape[1]))
        inside[:, : place.bases.shape[1]] = place.bases @ along
        further, rest = place.beyond(rest)
        runs = np.arange(len(place.first))
        for number in range(further.shape[1]):
            exists = place.first + number < row.counts
            inside[runs[exists], (place.first + number)[exists]] = further[exists, number]
        return row.whitened(levels, inside), rest / place.noise(levels)[:, None]


def _limits(peaks: Sequence[tuple[Row, Floats]], spans: Sequence[float]) -> Floats:
    """(p,) sizes that parameters may have before any data, from (p,) what a unit of each draws at most in each row."""
    every = [[(row, float(peak[k])) for row, peak in peaks] for k in range(len(spans))]
    return np.array([plausible(each, span) for each, span in zip(every, spans, strict=True)])
