"""Loads along runs from their values at a few instants of each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.records import Loads, Samples

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]

#: What of some samples runs along with them.
COURSES = tuple(item.name for item in fields(Samples) if item.name not in ("joint", "loads"))

#: Instants of a run at which loads are computed.
KNOTS = 33

#: Positions of a run from which two harmonics are known.
PLACES = 5

#: Singular values of a run's basis below this share of its largest are rounding.
FLAT = 1e-11

#: What loads have beyond one harmonic of the position, below this share of their size, is rounding.
ROUNDING = 1e-9


def spread(samples: Samples, sizes: Counts, loads: Callable[[Samples], Loads]) -> Loads:
    """Loads at all of M instants of R runs of `sizes` instants each, asked for at `KNOTS` of each.

    While one joint moves, gravity is one harmonic of its position (or linear in it, of a slide); what a load has beyond
    that and the course of speed and acceleration goes on smoothly between the knots. The other joints stand where they
    stood in the mean of the run, so that noise of their sensors is no load.
    """
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
    picks = [np.unique(np.round(np.linspace(0, size - 1, KNOTS)).astype(np.int64)) for size in sizes]
    chosen = np.concatenate([start + pick for start, pick in zip(starts, picks, strict=True)])
    counts = np.array([len(pick) for pick in picks])
    at_knots = loads(_held(at(samples, chosen), samples, starts=starts, sizes=sizes, counts=counts))
    names = [item.name for item in fields(Loads) if item.name != "gains"]
    table = np.column_stack([getattr(at_knots, name).reshape(len(chosen), -1) for name in names])
    basis, out = _basis(samples), np.empty((int(sizes.sum()), table.shape[1]))
    for count in np.unique(counts):
        alike = np.flatnonzero(counts == count)
        firsts = np.cumsum(np.append(0, counts))[alike]
        rows = firsts[:, None] + np.arange(count)
        solved = np.linalg.pinv(basis[chosen[rows]], rcond=FLAT) @ np.nan_to_num(table[rows])
        for number, known, weights in zip(alike, table[rows], solved, strict=True):
            here = slice(starts[number], starts[number] + sizes[number])
            out[here] = _between(basis[here], known, picks[number], weights)
    parts = {}
    for name in names:
        shape = getattr(at_knots, name).shape[1:]
        width = int(np.prod(shape)) if shape else 1
        parts[name], out = out[:, :width].reshape(-1, *shape), out[:, width:]
    return Loads(**parts, gains=at_knots.gains)


def swept(samples: Samples, sizes: Counts, table: Callable[[Samples], Floats], *, turns: bool) -> Floats:
    """A table's values at all of M instants of R runs of `sizes` instants each, asked for at `PLACES` of each.

    Exact for whatever is a direction of a link, a lever or a load, or a product of two of them, while one joint moves
    and the others stand: two harmonics of its position, or its square of a slide's.

    Parameters
    ----------
    samples, sizes
        Runs one after another; in each all joints but the moving one have one position throughout.
    table
        (K, F) at K instants.
    turns
        Whether the moving joint is revolute.

    Returns
    -------
    values
        (M, F); columns with a NaN in a run are NaN in all of it.
    """
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
    own = samples.joint - 1
    places = np.linspace(0.0, 2.0 * np.pi, PLACES, endpoint=False) if turns else np.linspace(-1.0, 1.0, PLACES)
    knots = at(samples, np.repeat(starts, PLACES))
    position = knots.position.copy()
    position[:, own] = np.tile(places, len(sizes))
    asked = table(replace(knots, position=position))
    parts = np.linalg.pinv(_harmonics(places, turns)) @ asked.reshape(len(sizes), PLACES, -1)
    basis, out = _harmonics(samples.position[:, own], turns), np.empty((len(samples), asked.shape[1]))
    for start, size, part in zip(starts, sizes, parts, strict=True):
        out[start : start + size] = basis[start : start + size] @ part
    return out


def _harmonics(q: Floats, turns: bool) -> Floats:
    """(M, 5) two harmonics of an angle, or (M, 3) powers of a displacement."""
    if turns:
        return np.column_stack([np.ones(len(q)), np.cos(q), np.sin(q), np.cos(2.0 * q), np.sin(2.0 * q)])
    return np.column_stack([np.ones(len(q)), q, q * q])


def _held(knots: Samples, samples: Samples, *, starts: Counts, sizes: Counts, counts: Counts) -> Samples:
    """The knots with all joints but the moving one at the mean of their run."""
    means = np.add.reduceat(samples.position, starts, axis=0) / sizes[:, None]
    position = np.repeat(means, counts, axis=0)
    position[:, samples.joint - 1] = knots.position[:, samples.joint - 1]
    return replace(knots, position=position)


def _basis(samples: Samples) -> Floats:
    """(M, 6) what gravity, friction and inertia of one run are made of."""
    q, v = samples.position[:, samples.joint - 1], samples.velocity[:, samples.joint - 1]
    return np.column_stack([np.ones(len(q)), np.cos(q), np.sin(q), q, v, samples.acceleration])


def _between(basis: Floats, known: Floats, pick: Counts, weights: Floats) -> Floats:
    """(size, F) from (K, F) values at `pick` and their parts (6, F) along the basis; columns with a NaN are NaN."""
    out = basis @ weights
    left = known - out[pick]
    size = np.maximum(np.abs(known).max(axis=0), ROUNDING)
    rough = np.flatnonzero(np.abs(left).max(axis=0) > ROUNDING * size)  # NaN is not
    if len(rough) and len(pick) > 3:
        # Most loads are smooth, and what it brings takes as long to load as all the rest of an identification.
        from scipy.interpolate import CubicSpline

        out[:, rough] += CubicSpline(pick, left[:, rough])(np.arange(len(basis)))
    out[:, np.isnan(known).any(axis=0)] = np.nan
    return out


def at(samples: Samples, rows: Counts) -> Samples:
    """The instants `rows` of some samples."""
    parts = {name: getattr(samples, name) for name in COURSES}
    known = {name: part[rows] for name, part in parts.items() if part is not None and len(part)}
    if samples.loads is None:
        return Samples(samples.joint, **known)
    loads = {item.name: getattr(samples.loads, item.name) for item in fields(Loads)}
    chosen = {name: part if name == "gains" else part[rows] for name, part in loads.items()}
    return Samples(samples.joint, **known, loads=Loads(**chosen))
