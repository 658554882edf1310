"""What repeats between runs that ought to agree, and by how much they differ."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.diagnosis.laid import View

Floats = NDArray[np.float64]
Labels = NDArray[np.int64]

#: Most bins over the span in which runs are laid side by side.
MOST_BINS = 512
#: Least share of two runs' bins that is taken for common: of fewer bins no more is concluded.
LEAST_COMMON = 0.3


@dataclass(frozen=True, eq=False, slots=True)
class Repeats:
    """Runs in groups whose members ought to leave the same.

    Attributes
    ----------
    groups
        Numbers of the runs (from 0); each with two or more.
    levels
        Whether the runs' means ought to agree too, as those of replicates do.
    samples
        (R,) of each run.
    """

    groups: tuple[tuple[int, ...], ...]
    levels: bool
    samples: Floats

    @property
    def members(self) -> Labels:
        """Numbers of all runs that are in a group."""
        return np.array([run for group in self.groups for run in group], dtype=np.int64)

    @property
    def scale(self) -> float:
        """All samples against those in groups."""
        inside = float(self.samples[self.members].sum())
        return float(self.samples.sum()) / inside if inside > 0 else 0.0

    def products(self, at: View, residual: Floats) -> tuple[Floats, float]:
        """What runs of one group leave at the same positions, multiplied.

        Returns
        -------
        products
            (R, R), so scaled that their sum is the square (A2 times samples) that all members share; zero on the
            diagonal and between groups.
        own
            Sum of what the diagonal would hold.
        """
        runs = len(self.samples)
        bins = int(min(np.median(np.bincount(at.run)), MOST_BINS))
        cell = at.run * bins + np.minimum((at.share * bins).astype(np.int64), bins - 1)
        weight = np.bincount(cell, at.weight, minlength=runs * bins).reshape(runs, bins)
        total = np.bincount(cell, at.weight * residual, minlength=runs * bins).reshape(runs, bins)
        mean = np.divide(total, weight, out=np.zeros_like(total), where=weight > 0)
        if not self.levels:
            mean -= (total.sum(axis=1) / weight.sum(axis=1))[:, None]
        root = np.sqrt(weight)
        out = np.zeros((runs, runs))
        for group in self.groups:
            own = np.array(group)
            both = root[own] @ root[own].T
            size = np.sqrt(np.diag(both))
            # Where one run has a cell and the other none they share nothing, which is no disagreement.
            common = np.maximum(both / np.outer(size, size), LEAST_COMMON)
            left = root[own] * mean[own]
            out[np.ix_(own, own)] = left @ left.T / common / (len(own) - 1.0)
        diagonal = float(np.trace(out))
        np.fill_diagonal(out, 0.0)
        return out, diagonal

    def level(self, halves: Floats) -> float:
        """Mean square (A2 times samples) of the level that each run has for itself.

        `halves` (R, 2) are means of a run's first and second half: their product holds what both halves share, and no
        noise inside the run but what lasts that long.
        """
        total = 0.0
        for group in self.groups:
            own = np.array(group)
            off = halves[own] - halves[own].mean(axis=0)
            total += float(np.sum(self.samples[own] * off[:, 0] * off[:, 1])) * len(own) / (len(own) - 1.0)
        return max(total, 0.0)


def halves(at: View, residual: Floats) -> Floats:
    """(R, 2) mean of a residual (N,) over the first and the second half of each run's cells."""
    runs = int(at.run[-1]) + 1
    first = np.searchsorted(at.run, np.arange(runs))
    length = np.bincount(at.run)
    late = np.arange(len(at)) - first[at.run] >= length[at.run] / 2.0
    label = 2 * at.run + late
    weight = np.bincount(label, at.weight, minlength=2 * runs)
    total = np.bincount(label, at.weight * residual, minlength=2 * runs)
    return np.divide(total, weight, out=np.zeros_like(total), where=weight > 0).reshape(runs, 2)


def alike(at: View) -> tuple[tuple[int, ...], ...]:
    """Runs of one posture and direction, whatever their speed: what stands in where no run is repeated."""
    first = np.searchsorted(at.run, np.arange(int(at.run[-1]) + 1))
    groups: dict[tuple[int, float], list[int]] = {}
    for run, cell in enumerate(first):
        groups.setdefault((int(at.posture[cell]), float(at.way[cell])), []).append(run)
    return tuple(tuple(group) for group in groups.values() if len(group) > 1)
