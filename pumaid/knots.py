"""Smooth functions along runs from their values at a few instants of each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from pumaid.records import Loads, Samples

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]

#: What of some samples runs along with them.
COURSES = tuple(item.name for item in fields(Samples) if item.name not in ("joint", "loads"))

#: Instants of a run at which loads are computed: gravity is one harmonic of the position, so over a whole turn a cubic
#: between these is right to a few parts in a million.
KNOTS = 33


def spread(samples: Samples, sizes: Counts, loads: Callable[[Samples], Loads]) -> Loads:
    """Loads at all of M instants of R runs of `sizes` instants each, asked for at `KNOTS` of each."""
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    picks = [np.unique(np.round(np.linspace(0, size - 1, KNOTS)).astype(int)) for size in sizes]
    chosen = np.concatenate([start + pick for start, pick in zip(starts, picks, strict=True)])
    at_knots = loads(at(samples, chosen))
    names = [item.name for item in fields(Loads) if item.name != "gains"]
    table = np.column_stack([getattr(at_knots, name).reshape(len(chosen), -1) for name in names])
    out = np.empty((int(sizes.sum()), table.shape[1]))
    first = 0
    for start, size, pick in zip(starts, sizes, picks, strict=True):
        known = table[first : first + len(pick)]
        first += len(pick)
        here = slice(start, start + size)
        out[here] = known if len(pick) == size else _between(pick, known, size)
    parts = {}
    for name in names:
        shape = getattr(at_knots, name).shape[1:]
        width = int(np.prod(shape)) if shape else 1
        parts[name], out = out[:, :width].reshape(-1, *shape), out[:, width:]
    return Loads(**parts, gains=at_knots.gains)


def _between(pick: Counts, known: Floats, size: int) -> Floats:
    """(size, F) through (K, F) values at whole numbers; NaN columns stay NaN."""
    good = np.isfinite(known).all(axis=0)
    out = np.full((size, known.shape[1]), np.nan)
    if good.any():
        out[:, good] = CubicSpline(pick, known[:, good])(np.arange(size))
    return out


def at(samples: Samples, rows: Counts) -> Samples:
    """The instants `rows` of some samples, without loads."""
    parts = {name: getattr(samples, name) for name in COURSES}
    return Samples(samples.joint, **{n: part[rows] for n, part in parts.items() if part is not None and len(part)})
