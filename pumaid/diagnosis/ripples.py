"""Ripple with position: waves that keep their phase from run to run, looked for in a periodogram."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from pumaid.joint_bins import JointBins, typical

Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]
Labels = NDArray[np.int64]

#: Degree of the polynomial over a run's own travel that is taken out before: what is smooth is looked for elsewhere.
SMOOTH = 8
#: Waves over a run's travel from which it is a ripple.
FEWEST_WAVES = 5.0
#: Most points of a transform; finer runs are looked at up to the frequency that fits.
MOST_POINTS = 8192
#: Frequencies on either side that show how loud noise is at a frequency.
NEIGHBOURS = 16
#: Power over its neighbours' from which a frequency stands out: of noise one in ten thousand does.
PROMINENCE = 7.0
#: Forward and backward.
WAYS = (1.0, -1.0)
#: Frequencies on either side of a known ripple that are its own.
KNOWN = 5
#: Degree of the polynomial over the span by which the size of a ripple changes along a run, as where it meets a
#: resonance of the arm.
MODULATED = 12
#: Steps to either side at which the best frequency is looked for, twice.
STEPS = 12


@dataclass(frozen=True, eq=False, slots=True)
class Track:
    """The bins of one joint along its position.

    Attributes
    ----------
    place
        (N,) rad or m; of a turning joint each run is brought to the same turn.
    way, weight
        (N,) +1 or -1; samples.
    run, first, lengths
        (N,) number of the run, (R,) its first bin and how many it has.
    low, span, width
        (R,) rad or m: lowest place, travel, distance of two bins.
    """

    place: Floats
    way: Floats
    weight: Floats
    run: Labels
    first: Labels
    lengths: Labels
    low: Floats
    span: Floats
    width: Floats

    @classmethod
    def of(cls, bins: JointBins, *, is_revolute: bool) -> Track:
        """The bins of one joint's runs."""
        q, turn, first = bins.samples.position[:, bins.joint - 1], 2.0 * np.pi, bins.first
        low, high = np.minimum.reduceat(q, first), np.maximum.reduceat(q, first)
        back = turn * np.round(0.5 * (low + high) / turn) if is_revolute else np.zeros(len(low))
        span, lengths = high - low, np.diff(np.append(first, len(q)))
        width = span / np.maximum(lengths - 1, 1)
        place = q - np.repeat(back, lengths)
        run = np.repeat(np.arange(len(first)), lengths)
        return cls(place, bins.samples.direction, bins.count, run, first, lengths, low - back, span, width)

    def slow(self, residual: Floats) -> float:
        """Square (weight times A2) of a residual (N,) in each run's own polynomial, less what is due to fast noise."""
        fast = self.rough(residual)
        whole, rest = self.weight @ residual**2, self.weight @ fast**2
        degrees = np.minimum(SMOOTH, self.lengths // 2) + 1
        share = float(degrees.sum() / max(len(residual) - degrees.sum(), 1))
        return max(float(whole - rest * (1.0 + share)), 0.0)

    def rough(self, residual: Floats) -> Floats:
        """(N,) a residual less a polynomial of each run's own."""
        out = np.empty_like(residual)
        known = {int(length): _polynomials(int(length)) for length in np.unique(self.lengths)}
        for first, length in zip(self.first, self.lengths, strict=True):
            own, smooth = residual[first : first + length], known[int(length)]
            out[first : first + length] = own - smooth @ (own @ smooth)
        return out

    def waves(self, frequency: float, *, degree: int = 0) -> Floats:
        """(N, k) orthonormal waves of the place in each direction.

        Parameters
        ----------
        frequency
            rad of phase per rad or m.
        degree
            Of the polynomial over the joint's span by which their size changes.
        """
        low, high = float(self.place.min()), float(self.place.max())
        middle = (2.0 * self.place - low - high) / ((high - low) or 1.0)
        size = np.polynomial.legendre.legvander(middle, degree) * np.sqrt(self.weight)[:, None]
        angle = frequency * self.place[:, None]
        both = np.concatenate([size * np.cos(angle), size * np.sin(angle)], axis=1)
        out = np.zeros((len(both), 2 * both.shape[1]))
        for number, way in enumerate(WAYS):
            here = self.way == way
            if here.any():
                left, sizes, _ = np.linalg.svd(both[here], full_matrices=False)
                first = number * both.shape[1]
                out[here, first : first + np.count_nonzero(sizes > 1e-6 * sizes[0])] = left[:, sizes > 1e-6 * sizes[0]]
        return np.asarray(out[:, out.any(axis=0)] / np.sqrt(self.weight)[:, None])

    def refined(self, residual: Floats, frequency: float) -> float:
        """The frequency near `frequency` of which a residual (N,) holds most."""
        reach, best = np.pi / typical(self.span, self.span), frequency
        held = self.rough(residual) * self.weight
        for _ in range(2):
            tried = best + reach * np.linspace(-1.0, 1.0, 2 * STEPS + 1)
            turned = np.exp(-1j * np.outer(tried, self.place))
            found = sum(np.abs(turned[:, side] @ held[side]) ** 2 for side in (self.way > 0, self.way < 0))
            best, reach = float(tried[int(np.argmax(found))]), reach / STEPS
        return best


def _polynomials(length: int) -> Floats:
    """(length, K) orthonormal polynomials over equal steps, the constant too."""
    steps = np.linspace(-1.0, 1.0, length)
    columns = np.polynomial.legendre.legvander(steps, min(SMOOTH, length // 2))
    return np.asarray(np.linalg.qr(columns)[0])


@dataclass(frozen=True, eq=False, slots=True)
class Spectrum:
    """Each run's transform: (F,) rad of phase per rad (or m), (R, F) sums of weight x residual x exp(-i f q).

    `tapered` (R, F) are the same with the ends of each run weighed down, so that a wave does not leak into others;
    `way` (R,) is +1 or -1, `weight` (R,) samples, `loudness` (2, F) the square of a direction's sum by noise alone.
    """

    frequency: Floats
    sums: Complex
    tapered: Complex
    way: Floats
    weight: Floats
    loudness: Floats

    def height(self, signs: Floats) -> Floats:
        """(B, F) squares over noise with the runs' signs as given (B, R); each direction has its own phase."""
        total = np.zeros((len(signs), len(self.frequency)))
        for way, loud in zip(WAYS, self.loudness, strict=True):
            here = self.way == way
            if here.any():
                real, imaginary = signs[:, here] @ self.sums[here].real, signs[:, here] @ self.sums[here].imag
                total += (real**2 + imaginary**2) / loud
        return total

    def peak(self, known: Sequence[float]) -> tuple[float, float]:
        """The highest frequency among those that stand out from their neighbours, and its height; 0 where none does.

        What repeats at all frequencies alike is no ripple. Those at one that is `known` already are left out.
        """
        height = self.height(np.ones((1, len(self.way))))[0]
        power = np.zeros(len(height))
        for way in WAYS:
            power += np.abs(self.tapered[self.way == way].sum(axis=0)) ** 2
        around = _around(power)
        height[power <= PROMINENCE * around] = 0.0
        near = KNOWN * (self.frequency[1] - self.frequency[0])
        for frequency in known:
            height[np.abs(self.frequency - frequency) < near] = 0.0
        best = int(np.argmax(height))
        return float(self.frequency[best]), float(height[best])

    def squares(self, frequency: float) -> tuple[float, float]:
        """Square (A2 times samples) of the wave at a frequency of the grid, and what noise makes of it."""
        at = int(np.argmin(np.abs(self.frequency - frequency)))
        found = noise = 0.0
        for way, loud in zip(WAYS, self.loudness[:, at], strict=True):
            total = float(self.weight[self.way == way].sum())
            if total > 0.0:
                found += 2.0 * abs(complex(self.sums[self.way == way, at].sum())) ** 2 / total
                noise += 2.0 * float(loud) / total
        return found, noise

    def chance(self, height: float) -> float:
        """Chance of that height at any frequency by noise alone, as its neighbours tell: where runs are few."""
        ways = len(np.unique(self.way))
        one = float(special.fdtrc(2 * ways, 2 * NEIGHBOURS * len(self.way) / ways, height / ways))
        return -float(np.expm1(0.5 * len(self.frequency) * np.log1p(-min(one, 1.0 - 1e-12))))


def spectrum(track: Track, residual: Floats) -> Spectrum | None:
    """The periodogram of the residual (N,) of each run, its smooth part taken out; None where bins are too few."""
    moved = track.span > 0
    if not moved.any() or track.lengths.max() < 2 * SMOOTH:
        return None
    step = 0.5 * typical(track.width, track.span)
    points = min(int(2 ** np.ceil(np.log2(2.0 * track.span.max() / step + 2.0))), MOST_POINTS)
    frequency = np.asarray(2.0 * np.pi * np.fft.rfftfreq(points, step), dtype=np.float64)
    finest = np.pi / np.maximum(track.width, 1e-12)
    lowest = 2.0 * np.pi * FEWEST_WAVES / typical(track.span, track.span)
    seen = (frequency >= lowest) & (frequency <= typical(finest, track.span))
    if np.count_nonzero(seen) < NEIGHBOURS:
        return None
    frequency = frequency[seen]
    turned = np.exp(-1j * np.outer(track.low, frequency)) / np.sinc(0.5 * frequency * step / np.pi) ** 2
    turned[frequency[None, :] > 1.0001 * finest[:, None]] = 0.0
    place = (track.place - track.low[track.run]) / step
    rough = track.rough(residual) * track.weight
    within = (track.place - track.low[track.run]) / np.maximum(track.span[track.run], 1e-12)
    sums, tapered = (
        np.fft.rfft(_deposited(place, values, track.run, points), axis=1)[:, seen] * turned
        for values in (rough, rough * np.sin(np.pi * within) ** 2)
    )
    way = track.way[track.first]
    weight = np.add.reduceat(track.weight, track.first)
    return Spectrum(frequency, sums, tapered, way, weight, _loudness(sums, way))


def _deposited(place: Floats, values: Floats, run: Labels, points: int) -> Floats:
    """(R, points) values between two points of a grid, shared out to both; what lies beyond the grid is left out."""
    left = np.floor(place).astype(np.int64)
    part, rows = place - left, int(run[-1]) + 1
    out = np.zeros(rows * points)
    for at, amount in ((left, values * (1.0 - part)), (left + 1, values * part)):
        inside = at < points
        out += np.bincount((run * points + at)[inside], amount[inside], minlength=len(out))
    return out.reshape(rows, points)


def _loudness(sums: Complex, way: Floats) -> Floats:
    """(2, F) the median of neighbouring frequencies, which a ripple does not move."""
    out = np.ones((2, sums.shape[1]))
    for row, sign in enumerate(WAYS):
        power = np.sum(np.abs(sums[way == sign]) ** 2, axis=0)
        runs = max(int(np.count_nonzero(way == sign)), 1)
        typical = _around(power)
        # The median of a sum of `runs` exponentials against its mean (Wilson and Hilferty).
        out[row] = np.maximum(typical / (1.0 - 1.0 / (9.0 * runs)) ** 3, 1e-300)
    return out


def _around(power: Floats) -> Floats:
    """(F,) medians of the power at each frequency and its `NEIGHBOURS` on either side; the outermost go on beyond."""
    padded = np.pad(power, NEIGHBOURS, mode="edge")
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * NEIGHBOURS + 1), axis=1))
