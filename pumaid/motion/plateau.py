"""Stretches of constant speed within a movement of one joint."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from pumaid.motion.edge import leaving
from pumaid.motion.movement import Stretch
from pumaid.motion.options import SegmentOptions
from pumaid.motion.speed import Ticks, slopes

Floats = NDArray[np.float64]

#: s; longest straight line by which the speed of a slow or noisy movement is judged.
LONGEST_LINE = 1.0
#: s; line before an edge on which the edge is found.
ANCHOR = 0.3
#: Standard deviations of the smoothed speed allowed beside the tolerance.
SPREAD = 3.0
#: Samples of line and of departure that an edge needs to be found.
FEWEST = 8


@dataclass(frozen=True, slots=True)
class Plateau:
    """Samples [start, stop) at a constant speed of `level` (rad/s or m/s, signed)."""

    start: int
    stop: int
    level: float


def plateaus(
    ticks: Ticks, stretch: Stretch, samples: tuple[Floats, Floats], *, options: SegmentOptions
) -> list[Plateau]:
    """Every stretch of constant speed of one movement, in order of time, edges to the sample.

    Parameters
    ----------
    ticks
        Means of all joints.
    stretch
        The movement of one joint.
    samples
        (N,) times and (N,) positions of that joint, to which the ticks' edges point.
    options
        Tolerances.
    """
    joint = stretch.joint
    velocity, half = movement_speed(ticks, stretch, options)
    speed = np.abs(velocity)
    error = ticks.fit_error(joint, half)
    reach = max(1, round(0.7 * options.min_duration / ticks.interval))
    found: list[Plateau] = []
    for start, stop in _cores(speed, reach, (options.speed_tolerance, SPREAD * error)):
        level = float(np.median(velocity[start:stop]))
        core = (stretch.start + start, stretch.start + stop)
        first, last = _refined(ticks, stretch, samples, core=core, half=half)
        if last - first >= 2:
            found.append(Plateau(first, last, level))
    return _apart(found)


def movement_speed(ticks: Ticks, stretch: Stretch, options: SegmentOptions) -> tuple[Floats, int]:
    """Velocity (rad/s or m/s) at the movement's ticks, smoothed just enough to judge its constancy, and ticks used."""
    joint = stretch.joint
    position = ticks.position[:, joint - 1]
    way = abs(float(position[stretch.stop - 1] - position[stretch.start]))
    typical = way / max(ticks.interval, float(ticks.time[stretch.stop - 1] - ticks.time[stretch.start]))
    longest = min(LONGEST_LINE, 0.25 * (stretch.stop - stretch.start) * ticks.interval)
    half = ticks.half_width(joint, options.speed_tolerance * typical / SPREAD, longest)
    low, high = max(0, stretch.start - half), min(len(ticks), stretch.stop + half)
    velocity = slopes(ticks.time[low:high], position[low:high], half)
    return velocity[stretch.start - low : stretch.stop - low], half


def _cores(speed: Floats, reach: int, tolerance: tuple[float, float]) -> list[tuple[int, int]]:
    """Tick ranges in which the speed stays within share and absolute tolerance of its median."""
    share, absolute = tolerance
    if len(speed) <= reach:
        return []
    width = 2 * (reach // 2) + 1
    top = maximum_filter1d(speed, width, mode="nearest")
    bottom = minimum_filter1d(speed, width, mode="nearest")
    steady = top - bottom <= 2.0 * (share * speed + absolute)
    found = []
    borders = np.flatnonzero(np.diff(np.concatenate([[0], steady.astype(np.int8), [0]])))
    waiting = [(int(a), int(b)) for a, b in borders.reshape(-1, 2)]
    while waiting:
        start, stop = waiting.pop()
        level = float(np.median(speed[start:stop]))
        inside = np.abs(speed[start:stop] - level) <= share * level + absolute
        edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(np.int8), [0]]))).reshape(-1, 2)
        if not len(edges):
            continue
        first, last = (int(x) for x in edges[np.argmax(edges[:, 1] - edges[:, 0])])
        found.append((start + first, start + last))
        if first > reach:
            waiting.append((start, start + first))
        if stop - start - last > reach:
            waiting.append((start + last, stop))
    return sorted(found)


def _refined(
    ticks: Ticks, stretch: Stretch, samples: tuple[Floats, Floats], *, core: tuple[int, int], half: int
) -> tuple[int, int]:
    """Sample range of the plateau whose ticks are `core`."""
    time, position = samples
    edges = ticks.edges
    first, last = int(edges[core[0]]), int(edges[core[1]])
    middle = (first + last) // 2
    line = max(math.ceil(ANCHOR / ticks.interval), 3 * half, 4)
    size = int(edges[1] - edges[0])
    margin = (half + 2) * size
    if core[1] < stretch.stop or stretch.after is not None:
        low = max(middle, last - line * size)
        high = min(last + margin, int(edges[min(len(ticks), stretch.stop + 1)]))
        last = _edge(time[low:high], position[low:high], low, last)
    if core[0] > stretch.start or stretch.before is not None:
        low = max(first - margin, int(edges[max(0, stretch.start - 1)]))
        high = min(middle, first + line * size)
        flipped = slice(low, high)
        span = high - low
        back = _edge(-time[flipped][::-1], position[flipped][::-1], 0, span - (first - low))
        first = high - back
    return first, last


def _edge(time: Floats, position: Floats, offset: int, fallback: int) -> int:
    """Index (counted from `offset`) behind the last sample that is on the line."""
    if len(time) < FEWEST:
        return fallback
    return offset + int(np.searchsorted(time, leaving(time, position), side="right"))


def _apart(found: list[Plateau]) -> list[Plateau]:
    """The same plateaus without overlap."""
    out: list[Plateau] = []
    for plateau in found:
        start = max(plateau.start, out[-1].stop) if out else plateau.start
        if plateau.stop > start:
            out.append(Plateau(start, plateau.stop, plateau.level))
    return out
