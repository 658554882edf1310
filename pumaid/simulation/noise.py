"""Noise of motor currents: correlated from sample to sample, with a level that a whole run shares."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from pumaid.simulation.truth import Noise

Floats = NDArray[np.float64]


def correlation(noise: Noise, rate: float) -> float:
    """Correlation of one sample with the next at `rate` (Hz)."""
    return math.exp(-1.0 / (rate * noise.correlation_time)) if noise.correlation_time > 0 else 0.0


def coloured(rng: np.random.Generator, shape: tuple[int, ...], *, phi: float, start: Floats | None = None) -> Floats:
    """Stationary AR(1) noise of unit variance along the first axis.

    Parameters
    ----------
    rng
        Source of randomness.
    shape
        (N, ...) of the result.
    phi
        Correlation of one sample with the next.
    start
        The sample before the first, shaped as the other axes; drawn where not given.
    """
    white = rng.standard_normal(shape)
    if phi == 0.0:
        return white
    before = rng.standard_normal(shape[1:]) if start is None else start
    out, _ = lfilter([math.sqrt(1.0 - phi**2)], [1.0, -phi], white, axis=0, zi=phi * before[None])
    return np.asarray(out)
