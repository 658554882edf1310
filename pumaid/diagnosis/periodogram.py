"""All frequencies of an effect that is periodic in the joint's position, in one go."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from pumaid.diagnosis.field import Field
from pumaid.diagnosis.noise import Noise

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

#: Lowest frequency looked at, in periods over the longest run: below, gravity and friction that vary with position
#: absorb or mimic it.
FEWEST_PERIODS = 3.0
#: Steps of the frequency a resolution (2 pi / span): the peak is missed by at most a tenth of a step's power.
OVERSAMPLING = 2.5
#: Share of the finest cells' Nyquist frequency that is looked at: cells are means, which damp what is near it.
HIGHEST = 0.9


@dataclass(frozen=True, eq=False, slots=True)
class Spectrum:
    """Scores of one joint at F frequencies.

    Attributes
    ----------
    frequency
        (F,) 1/rad or 1/m: phase by position.
    scores
        (R, F) complex: cosine and sine part of each run's score.
    information
        (F,) of either part; both are alike and do not mix.
    """

    frequency: Floats
    scores: Complexes
    information: Floats

    def statistic(self, signs: Floats | None = None) -> Floats:
        """(F,) or (B, F) twice the gain in log likelihood, runs' scores multiplied by `signs` (B, R) where given."""
        total = self.scores.sum(axis=0) if signs is None else signs @ self.scores
        return np.asarray(np.abs(total) ** 2 / self.information)


def spectrum(field: Field, noise: Noise, residual: Floats) -> Spectrum | None:
    """Scores of cos(f q) and sin(f q) at all frequencies that the cells can show.

    Within a run at constant speed cells are equally spaced in position, so one chirp-z transform a run gives all
    frequencies at once. What the base model would absorb is left out of account: nothing of it varies so fast.

    Parameters
    ----------
    field
        Of a joint, at its finest cells.
    noise
        Of these cells.
    residual
        (N,) whitened misfit at these cells.

    Returns
    -------
    spectrum
        None where runs are too short for any frequency.

    Source
    ------
    J. D. Scargle, Astrophys. J. 263 (1982) 835-853, for the periodogram as least squares; L. R. Rabiner, R. W. Schafer
    and C. M. Rader, Bell Syst. Tech. J. 48 (1969) 1249-1292, for the transform.
    """
    q = field.samples.position[:, field.joint - 1]
    lengths = field.lengths
    steps = np.array([_step(q[a : a + n]) for a, n in zip(field.first, lengths, strict=True)])
    usable = (lengths > 4) & (np.abs(steps) > 0)
    if not usable.any():
        return None
    span = float(np.max(np.abs(steps[usable]) * lengths[usable]))
    resolution = 2.0 * np.pi / span
    top = HIGHEST * np.pi / float(np.median(np.abs(steps[usable])))
    frequency = np.arange(FEWEST_PERIODS * resolution, top, resolution / OVERSAMPLING)
    if len(frequency) < 2:
        return None
    back = noise.unwhiten(field, residual)
    scores = np.zeros((len(field.runs), len(frequency)), dtype=complex)
    information = np.zeros(len(frequency))
    delta = frequency[1] - frequency[0]
    for number in np.flatnonzero(usable):
        part = slice(int(field.first[number]), int(field.first[number] + lengths[number]))
        step = steps[number]
        middle = float(q[part].mean()) - 0.5 * step * (lengths[number] - 1)
        turned = signal.czt(back[part], len(frequency), np.exp(1j * delta * step), np.exp(-1j * frequency[0] * step))
        scores[number] = turned * np.exp(1j * frequency * middle)
        rho, spread = noise.correlation[number], noise.spread[number]
        power = 1.0 - 2.0 * rho * np.cos(frequency * step) + rho**2
        information += 0.5 * lengths[number] * power / (spread**2 * (1.0 - rho**2))
    return Spectrum(frequency, scores, information)


def _step(q: Floats) -> float:
    return float((q[-1] - q[0]) / (len(q) - 1)) if len(q) > 1 else 0.0
