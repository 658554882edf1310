"""Steps on short arrays, of which a run takes hundreds: numpy's own take longer to call than to compute."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def lengths(starts: NDArray[np.integer], size: int) -> NDArray[np.int64]:
    """(G,) lengths of consecutive groups of `size` things, of which one begins at each of (G,) starts."""
    out = np.empty(len(starts), dtype=np.int64)
    np.subtract(starts[1:], starts[:-1], out=out[:-1])
    if len(out):
        out[-1] = size - starts[-1]
    return out


def mean(values: NDArray[np.number]) -> float:
    """Mean of (N,) numbers, N at least 1."""
    return float(np.add.reduce(values)) / len(values)


def median(values: Floats) -> float:
    """Median of (N,) numbers, N at least 1, all of which are numbers."""
    low, high = (len(values) - 1) // 2, len(values) // 2
    ordered = np.partition(values, high if low == high else (low, high))
    return float(0.5 * (ordered[low] + ordered[high]))


def gradient(values: Floats) -> Floats:
    """(N,) slopes a step of (N,) numbers, N at least 2, to both neighbours where there are two."""
    out = np.empty(len(values))
    np.subtract(values[2:], values[:-2], out=out[1:-1])
    out[1:-1] *= 0.5
    out[0], out[-1] = values[1] - values[0], values[-1] - values[-2]
    return out
