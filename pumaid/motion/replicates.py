"""Runs that repeat one another, and the noise floor that they show."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pumaid.maths.frames import apart
from pumaid.records import Run

Floats = NDArray[np.float64]

#: Held positions within this (rad or m) are the same posture to a controller: hundreds of encoder counts, and gravity
#: differs by less than 1 %.
SAME_POSITION = 0.01
#: Speeds within this share are the same speed.
SAME_SPEED = 0.03
#: Share of the shorter run's travel that two replicates must have in common.
OVERLAP = 0.8


def replicates(runs: Sequence[Run]) -> list[list[int]]:
    """Groups of indices into `runs` that repeat one another: same joint, kind, posture, speed, direction and span."""
    groups: list[list[int]] = []
    for number, run in enumerate(runs):
        for group in groups:
            if _repeats(runs[group[0]], run):
                group.append(number)
                break
        else:
            groups.append([number])
    return [group for group in groups if len(group) > 1]


def _repeats(first: Run, second: Run) -> bool:
    if (first.joint, first.kind) != (second.joint, second.kind):
        return False
    if abs(second.speed - first.speed) > SAME_SPEED * abs(first.speed):
        return False
    if np.any(np.delete(apart(first.posture, second.posture), first.joint - 1) > SAME_POSITION):
        return False
    turns = _turns(first, second)
    low = max(min(first.span), min(second.span) + turns)
    high = min(max(first.span), max(second.span) + turns)
    shorter = min(abs(run.span[1] - run.span[0]) for run in (first, second))
    return high - low >= OVERLAP * shorter


def noise_floor(runs: Sequence[Run]) -> tuple[float | None, str | None]:
    """The RMSE (A, of samples) that no model of position, posture, speed and direction can go below, or why unknown.

    Half the mean squared difference of replicates at the same positions, plus the variance inside cells.

    Source
    ------
    G. E. P. Box, W. G. Hunter and J. S. Hunter, Statistics for Experimenters, ch. 3: pure error from replicates.
    """
    pairs = [(group[0], other) for group in replicates(runs) for other in group[1:]]
    if not pairs:
        return None, "no run is repeated (same posture, speed, direction), so noise cannot be told from missing physics"
    squares = [_difference(runs[first], runs[second]) for first, second in pairs]
    weights = np.array([len(runs[first].cells) for first, _ in pairs], dtype=float)
    between = 0.5 * float(np.average(squares, weights=weights))
    inside = [_inside(run) for pair in pairs for run in (runs[pair[0]], runs[pair[1]])]
    return float(np.sqrt(between + np.mean(inside))), None


def _turns(first: Run, second: Run) -> float:
    """Whole turns (rad) that bring the second run's travel to the first's."""
    return float(2.0 * np.pi * np.round((sum(first.span) - sum(second.span)) / (4.0 * np.pi)))


def _curve(run: Run) -> tuple[Floats, Floats, Floats]:
    """Cells' position, current and the run's own first harmonic (A) there."""
    own = run.joint - 1
    q, current = run.cells.position[:, own], run.cells.current[:, own]
    basis = np.column_stack([np.cos(q), np.sin(q), np.ones(len(q)), run.cells.acceleration])
    return q, current, basis @ np.linalg.lstsq(basis, current, rcond=1e-6)[0]


def _difference(first: Run, second: Run) -> float:
    """Mean squared difference (A2) of two runs at the same positions, slopes within a cell taken out."""
    q_a, i_a, smooth_a = _curve(first)
    q_b, i_b, _ = _curve(second)
    q_b = q_b + _turns(first, second)
    order = np.argsort(q_a)
    inside = (q_b >= q_a.min()) & (q_b <= q_a.max())
    if not inside.any():
        return 0.0
    nearest = order[np.searchsorted(q_a[order], q_b[inside]).clip(1, len(order) - 1)]
    at_b = np.interp(q_b[inside], q_a[order], smooth_a[order])
    return float(np.mean((i_b[inside] - at_b - (i_a[nearest] - smooth_a[nearest])) ** 2))


def _inside(run: Run) -> float:
    """Mean variance (A2) inside the run's cells, less what the current's slope makes of a cell's width."""
    q, _, smooth = _curve(run)
    if len(q) < 2:
        return float(np.mean(run.cells.variance))
    slope = np.gradient(smooth)
    return max(float(np.mean(run.cells.variance - slope**2 / 12.0)), 0.0)
