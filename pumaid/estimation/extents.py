"""What the runs of a joint, or of all, cover: where a shape can be looked for."""

from __future__ import annotations

import numpy as np

from pumaid.dataset import Run
from pumaid.estimation.views import Sights
from pumaid.kinematics import apart
from pumaid.model import SAME_POSTURE
from pumaid.records import Extent
from pumaid.sight import Sight

#: Speeds within this share are one speed.
SAME_SPEED = 0.03


def extent(sights: Sights, joint: int) -> Extent:
    """Of the runs of `joint` (from 1), or of all (0) of those in `sights`."""
    chosen = [sights[joint]] if joint in sights else list(sights.values())
    runs = [run for sight in chosen for run in sight.runs]
    ends = [value for run in runs for value in run.span]
    widths = [abs(run.span[1] - run.span[0]) / max(len(run.bins), 1) for run in runs]
    times = [sight.samples.time if joint else sight.samples.elapsed for sight in chosen]
    starts = [float(t[sight.grain * first]) for t, sight in zip(times, chosen, strict=True) for first in sight.starts]
    return Extent(
        joint=joint or None,
        speeds=_distinct([abs(run.speed) for run in runs]),
        position=(min(ends), max(ends)),
        finest=2.0 * float(np.median(widths)),
        travel=max(float(sight.samples.travel.max()) for sight in chosen),
        starts=tuple(sorted(starts)),
        duration=max(float(t.max()) for t in times),
        current=max(_drawn(sight) for sight in chosen),
        postures=_postures(runs),
    )


def _distinct(speeds: list[float]) -> tuple[float, ...]:
    out: list[float] = []
    for speed in sorted(speeds):
        if not out or speed > out[-1] * (1.0 + SAME_SPEED):
            out.append(speed)
    return tuple(out)


def _drawn(sight: Sight) -> float:
    """Largest current (A) of the bins, by the model where it is known."""
    loads = sight.samples.loads
    if loads is not None:
        return float(np.abs(loads.drawn).max())
    return max(float(np.abs(run.bins.current).max()) for run in sight.runs)


def _postures(runs: list[Run]) -> int:
    held: list[np.ndarray] = []
    for run in runs:
        if all(np.any(np.nan_to_num(apart(run.posture, other)) > SAME_POSTURE) for other in held):
            held.append(run.posture)
    return len(held)
