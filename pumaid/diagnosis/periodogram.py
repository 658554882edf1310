"""All frequencies of an effect that is periodic in the joint's position, in one go."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from pumaid.estimation.noise import NoiseModel
from pumaid.joint_bins import JointBins

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Counts = NDArray[np.int64]

#: Lowest frequency looked at, in periods over the longest run: below, gravity and friction that vary with position
#: absorb or mimic it.
FEWEST_PERIODS = 3.0
#: Steps of the frequency a resolution (2 pi / way from the lowest to the highest position): the peak is missed by at
#: most a tenth of a step's power.
OVERSAMPLING = 2.5
#: Share of the finest bins' Nyquist frequency that is looked at: bins are means, which damp what is near it.
HIGHEST = 0.9
#: Resolutions of a run about a wave that the model has already, in which there is no other: what is left there is that
#: wave, stronger or shifted in some runs.
SAME = 2.0
#: Points of the even grid that bins are shared out to, a period of the highest frequency: a wave there leaks 2 %.
POINTS = 8
#: Lengths that stand for the ways from bin to bin, which are unequal where the speed is.
WIDTHS = 8
#: Runs below which signs are flipped of pieces of runs, about so many in all: of so few whole runs, flips that change
#: nothing or all are more than one in fifty. Waves are looked at of which a piece holds this many: what is slower may
#: be noise that neighbouring pieces share.
FEWEST_RUNS, PIECES, A_PIECE = 8, 12, 2.0
#: Of the flips of pieces; a diagnosis is the same each time.
SEED = 20_262
#: Numbers held at once while flips are drawn.
AT_ONCE = 4_000_000


@dataclass(frozen=True, eq=False, slots=True)
class Spectrum:
    """Scores of one joint at F frequencies (1/rad or 1/m: phase by position).

    `scores` (S, F) are complex, cosine and sine part of each run's score, or of each piece's where runs are few
    (`is_pieces`); `information` (F,) is that of either part, since both are alike and do not mix.
    """

    frequency: Floats
    scores: Complexes
    information: Floats
    is_pieces: bool = False

    def statistic(self) -> Floats:
        """(F,) twice the gain in log likelihood."""
        return np.asarray(np.abs(self.scores.sum(axis=0)) ** 2 / self.information)

    def peak(self) -> float:
        """Frequency of the largest statistic, by a parabola through it and its neighbours."""
        statistic = self.statistic()
        top = int(np.clip(np.argmax(statistic), 1, len(statistic) - 2))
        before, at, after = statistic[top - 1 : top + 2]
        bend = before - 2.0 * at + after
        shift = 0.0 if bend >= 0.0 else float(np.clip(0.5 * (before - after) / bend, -1.0, 1.0))
        return float(self.frequency[top] + shift * (self.frequency[top] - self.frequency[top - 1]))

    def highest(self, signs: Floats) -> Floats:
        """(B,) the largest statistic of all frequencies, the signs of runs being those of `signs` (B, R).

        The size of `signs`, by which scores of slow effects are corrected for the fit, means nothing here: the fit
        takes nothing from so fast a wave. Where runs are few, other flips are drawn, of pieces.
        """
        rng, flips, out = np.random.default_rng(SEED), np.sign(signs), np.empty(len(signs))
        if self.is_pieces:
            flips = rng.choice([-1.0, 1.0], size=(len(signs), len(self.scores)))
        batch, scale = max(AT_ONCE // len(self.frequency), 1), 1.0 / np.sqrt(self.information)
        parts = [self.scores.real * scale, self.scores.imag * scale]
        for start in range(0, len(flips), batch):
            squares = [(flips[start : start + batch] @ part) ** 2 for part in parts]
            out[start : start + batch] = (squares[0] + squares[1]).max(axis=1)
        return out


def spectrum(
    bins: JointBins,
    noise: NoiseModel,
    white: Floats,
    *,
    scale: float = 1.0,
    without: Sequence[float] = (),
    fewest_periods: float = FEWEST_PERIODS,
) -> Spectrum | None:
    """Scores of cos(f q) and sin(f q) at all frequencies that the bins can show.

    Bins lie at uneven places where the speed is not constant, so each is shared out to the two nearest points of an
    even grid, whose transform gives all frequencies at once. What the base model would absorb is left out of account:
    nothing of it varies so fast.

    Parameters
    ----------
    bins, noise
        A joint at its finest bins, and what their noise is like.
    white
        (N,) whitened residual.
    scale
        Variance of a whitened residual at these bins, as a share of that by which statistics are divided.
    without
        Frequencies of waves that the model has.
    fewest_periods
        Lowest frequency, in periods over the longest run.

    Returns
    -------
    spectrum
        None where runs are too short for any frequency.

    Source
    ------
    J. D. Scargle, Astrophys. J. 263 (1982) 835-853, for the periodogram as least squares; W. H. Press and
    G. B. Rybicki, Astrophys. J. 338 (1989) 277-280, for sharing out to a grid, here by straight lines, whose transform
    is divided out.
    """
    q, lengths = bins.samples.position[:, bins.joint - 1], bins.lengths
    low, high = np.minimum.reduceat(q, bins.first), np.maximum.reduceat(q, bins.first)
    way = high - low
    usable, is_pieces = (lengths > 4) & (way > 0), len(bins.runs) < FEWEST_RUNS
    if not usable.any():
        return None
    piece = _pieces(bins, np.where(usable, way, 0.0)) if is_pieces else bins.run
    top = HIGHEST * np.pi / float(np.median(way[usable] / (lengths[usable] - 1)))
    slow = fewest_periods / way.max()
    lowest = 2.0 * np.pi * (max(slow, A_PIECE * PIECES / way[usable].sum()) if is_pieces else slow)
    extent = float(high[usable].max() - low[usable].min())
    step = 2.0 * np.pi / (POINTS * top)
    points = fft.next_fast_len(int(np.ceil(OVERSAMPLING * extent / step)), real=True)
    frequency = np.asarray(2.0 * np.pi * np.fft.rfftfreq(points, step), dtype=np.float64)
    in_range = (frequency >= lowest) & (frequency <= top)
    if np.count_nonzero(in_range) < 3:
        return None
    frequency = frequency[in_range]
    back = noise.unwhiten(bins, white) * usable[bins.run]
    shared = _shared((q - low[usable].min()) / step, back, piece=piece, points=points)
    scores = np.conj(fft.rfft(shared, axis=1)[:, in_range]) / np.sinc(0.5 * frequency * step / np.pi) ** 2
    information = np.zeros(len(frequency))
    for number in np.flatnonzero(usable):
        places = q[bins.first[number] : bins.first[number] + lengths[number]]
        rho, spread = noise.correlation[number], noise.spread[number]
        power = 1.0 - 2.0 * rho * _likeness(np.abs(np.diff(places)), frequency) + rho**2
        information += 0.5 * lengths[number] * power / (spread**2 * (1.0 - rho**2))
    turned = scores * np.exp(1j * frequency * low[usable].min())
    for wave in without:
        turned[:, np.abs(frequency - wave) < SAME * 2.0 * np.pi / way.max()] = 0.0
    return Spectrum(frequency, turned / scale, information / scale, is_pieces)


def _pieces(bins: JointBins, way: Floats) -> Counts:
    """(N,) number from 0 of the piece of a run that each bin is in."""
    parts = np.maximum(np.round(way / way.sum() * PIECES), 1.0).astype(np.int64)
    within = (np.arange(len(bins)) - bins.first[bins.run]) * parts[bins.run] // bins.lengths[bins.run]
    return np.asarray((np.cumsum(parts) - parts)[bins.run] + within)


def _shared(place: Floats, values: Floats, *, piece: Counts, points: int) -> Floats:
    """(S, points) values at places between the points of an endless grid of that period, shared out to both sides."""
    lower = np.floor(place).astype(np.int64)
    part, row, many = place - lower, piece * points, int(piece[-1] + 1) * points
    out = np.bincount(row + lower % points, values * (1.0 - part), minlength=many)
    out += np.bincount(row + (lower + 1) % points, values * part, minlength=many)
    return np.asarray(out.reshape(-1, points), dtype=np.float64)


def _likeness(ways: Floats, frequency: Floats) -> Floats:
    """(F,) mean cosine of the phase from one bin to the next."""
    widths = np.quantile(ways, (np.arange(WIDTHS) + 0.5) / WIDTHS)
    if widths[-1] - widths[0] < 0.05 * widths[-1]:
        widths = widths[WIDTHS // 2 : WIDTHS // 2 + 1]
    return np.asarray(np.cos(np.outer(widths, frequency)).mean(axis=0))
