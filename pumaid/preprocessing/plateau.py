"""Stretches of constant speed within a movement of one joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.maths.short import mean, median
from pumaid.preprocessing.edge import Window, leaving
from pumaid.preprocessing.movement import Stretch
from pumaid.preprocessing.options import SegmentOptions
from pumaid.preprocessing.settle import settled
from pumaid.preprocessing.speed import Ticks, at_least, slopes, whole

Floats = NDArray[np.float64]

#: s; longest straight line by which the speed of a slow or noisy movement is judged.
LONGEST_LINE = 1.0
#: Points through which a stretch's trend is looked at.
MOST_POINTS = 400
#: s; line before an edge on which the edge is found.
ANCHOR = 0.3
#: Standard deviations of the smoothed speed allowed beside the tolerance.
SPREAD = 3.0
#: Share of the speed by which a ramp must have changed it where one stops looking at it.
DEPARTED = 0.2
#: s; dropped at every edge found: a corner sharper than the noise can tell, or a current logged late. One sample of a
#: hard ramp draws many times the current of a run, and 10 ms at each end cost a run of a second 2 %.
GUARD = 0.010
#: The same as a share of the sampling interval.
GUARD_SHARE = 1.0
#: Share of a movement's largest acceleration above which a stretch is a slow ramp and no constant speed.
RAMPING = 0.25
#: Departure from one speed, in units of the tolerance, that does not end a run where the same speed goes on behind it.
HICCUP = 3.0
#: Samples of line and of departure that an edge needs to be found.
FEWEST = 8


@dataclass(frozen=True, slots=True)
class Plateau:
    """Samples [start, stop) at a constant speed of `level` (rad/s or m/s, signed)."""

    start: int
    stop: int
    level: float


@dataclass(frozen=True, eq=False, slots=True)
class _Edge:
    """One end of a candidate: what is looked at there, from sample `offset` on, and where the end is without a look."""

    window: Window | None
    offset: int
    fallback: int

    def found(self, left: float) -> int:
        """Index behind the last sample that is surely on the line, which is left at that time (s)."""
        if self.window is None:
            return self.fallback
        time = self.window.time
        guard = max(GUARD, GUARD_SHARE * float(time[-1] - time[0]) / len(time))
        return self.offset + (int(np.searchsorted(time, left - guard)) if left < time[-1] else len(time))


@dataclass(frozen=True, eq=False, slots=True)
class _Candidate:
    """A stretch that seems to be of one speed, `level`; `back` is looked at backwards from sample `behind` on."""

    level: float
    back: _Edge
    behind: int
    ahead: _Edge


@dataclass(frozen=True, eq=False, slots=True)
class _Movement:
    """A movement of one joint, with its speed at its ticks and what may be plateaus in it."""

    stretch: Stretch
    samples: tuple[Floats, Floats]
    speed: Floats
    absolute: float
    peak: float
    candidates: tuple[_Candidate, ...]


def plateaus(
    ticks: Ticks, stretches: Sequence[Stretch], samples: tuple[Floats, Floats], *, options: SegmentOptions
) -> list[list[Plateau]]:
    """Every stretch of constant speed of some movements, in order of time, edges to the sample.

    Parameters
    ----------
    ticks
        Means of all joints.
    stretches
        Movements of one joint each.
    samples
        (N,) times and (N, J) positions, to which the ticks' edges point.
    options
        Tolerances.
    """
    movements = [_movement(ticks, stretch, samples, options) for stretch in stretches]
    edges = [edge for movement in movements for one in movement.candidates for edge in (one.back, one.ahead)]
    left = iter(leaving([edge.window for edge in edges if edge.window is not None]))
    times = {id(edge): next(left) for edge in edges if edge.window is not None}
    return [_found(ticks, movement, times, options) for movement in movements]


def _movement(ticks: Ticks, stretch: Stretch, samples: tuple[Floats, Floats], options: SegmentOptions) -> _Movement:
    velocity, half = movement_speed(ticks, stretch, options)
    speed = np.abs(velocity)
    absolute = SPREAD * ticks.fit_error(stretch.joint, half)
    peak = float(np.abs(slopes(ticks.time[stretch.start : stretch.stop], velocity, 1)).max())
    reach = max(1, whole(0.7 * options.min_duration / ticks.interval))
    most = reach + half + whole(ANCHOR / ticks.interval)
    own = (samples[0], samples[1][:, stretch.joint - 1])
    candidates = []
    for start, stop in _cores(speed, reach, (options.speed_tolerance, absolute)):
        level = median(velocity[start:stop])
        core = (stretch.start + start, stretch.start + stop)
        seen = _seen(speed, (start, stop), most=most, absolute=absolute)
        beyond = (max(0, stretch.start + seen[0] - half), min(len(ticks), stretch.start + seen[1] + half))
        candidates.append(_candidate(ticks, own, core=core, seen=beyond, line=(level, half)))
    return _Movement(stretch, own, speed, absolute, peak, tuple(candidates))


def _found(ticks: Ticks, movement: _Movement, times: dict[int, float], options: SegmentOptions) -> list[Plateau]:
    """The candidates that are plateaus, given at what times (s) their edges leave the line."""
    time, position = movement.samples
    found: list[Plateau] = []
    # A swing of the speed may pass for a shorter one, and be joined to a run by mistake.
    shortest = 0.75 * options.min_duration
    for one in movement.candidates:
        first = one.behind - one.back.found(times.get(id(one.back), 0.0))
        last = one.ahead.found(times.get(id(one.ahead), 0.0))
        if last - first >= FEWEST and _is_level(movement.samples, (first, last), peak=movement.peak):
            begins, ends = settled(time[first:last], position[first:last])
            if ends - begins >= FEWEST and time[first + ends - 1] - time[first + begins] >= shortest:
                found.append(Plateau(first + begins, first + ends, one.level))
    places = ticks.edges[movement.stretch.start : movement.stretch.stop].astype(np.float64)
    typical = max((abs(plateau.level) for plateau in found), default=0.0)
    band = options.speed_tolerance * typical + movement.absolute
    return _apart(found, (places, movement.speed), band=band)


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
    steady = _spread(speed, width) <= 2.0 * (share * speed + absolute)
    found = []
    borders = np.flatnonzero(np.diff(np.concatenate([[0], steady.astype(np.int8), [0]])))
    waiting = [(int(a), int(b)) for a, b in borders.reshape(-1, 2)]
    while waiting:
        start, stop = waiting.pop()
        level = median(speed[start:stop])
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


def _spread(values: Floats, width: int) -> Floats:
    """(N,) largest less smallest of the `width` values (odd) around each; the outermost go on beyond the ends."""
    first, last = np.full(width // 2, values[0]), np.full(width // 2, values[-1])
    top = bottom = np.concatenate([first, values, last])
    reach = 1
    while reach < width:
        # Two neighbouring stretches of `reach` values, which may overlap, make a longer one.
        step = min(reach, width - reach)
        top, bottom = np.maximum(top[:-step], top[step:]), np.minimum(bottom[:-step], bottom[step:])
        reach += step
    return np.asarray(top - bottom)


def _candidate(
    ticks: Ticks,
    samples: tuple[Floats, Floats],
    *,
    core: tuple[int, int],
    seen: tuple[int, int],
    line: tuple[float, int],
) -> _Candidate:
    """The plateau whose ticks are `core`, where its departures are `seen` up to two other ticks.

    `line` is its speed and the ticks on either side of the straight lines by which that was told.
    """
    time, position = samples
    edges = ticks.edges
    first, last = int(edges[core[0]]), int(edges[core[1]])
    middle = (first + last) // 2
    level, half = line
    reach = max(at_least(ANCHOR / ticks.interval), 3 * half, 4) * int(edges[1])
    ahead, back, high = _Edge(None, 0, last), _Edge(None, 0, 0), first
    if seen[1] > core[1]:
        low, stop = max(middle, last - reach), int(edges[seen[1]])
        ahead = _edge(time[low:stop], position[low:stop], low, last)
    if seen[0] < core[0]:
        low, high = int(edges[seen[0]]), min(middle, first + reach)
        back = _edge(-time[low:high][::-1], position[low:high][::-1], 0, high - first)
    return _Candidate(level, back, high, ahead)


def _seen(speed: Floats, core: tuple[int, int], *, most: int, absolute: float) -> tuple[int, int]:
    """Ticks up to which a departure from the speed of ticks `core` is looked at: until it is large, `most` at most."""
    level = median(speed[core[0] : core[1]])
    far = np.abs(speed - level) > DEPARTED * level + absolute
    after, before = np.flatnonzero(far[core[1] :]), np.flatnonzero(far[: core[0]][::-1])
    ahead = int(after[0]) + 1 if len(after) else most
    behind = int(before[0]) + 1 if len(before) else most
    return max(0, core[0] - min(behind, most)), min(len(speed), core[1] + min(ahead, most))


def _is_level(samples: tuple[Floats, Floats], bounds: tuple[int, int], *, peak: float) -> bool:
    """Whether the speed has no trend near the movement's `peak` acceleration (rad/s2 or m/s2)."""
    time, position = (values[bounds[0] : bounds[1]] for values in samples)
    thin = max(1, len(time) // MOST_POINTS)
    x, q = time[::thin] - time[0], position[::thin] - position[0]
    x = x - mean(x)
    square = x * x
    # What of the square is no straight line.
    bend = square - mean(square) - (square @ x / (x @ x)) * x
    curvature = float(bend @ q) / float(bend @ bend)
    return abs(2.0 * curvature) <= RAMPING * peak


def _edge(time: Floats, position: Floats, offset: int, fallback: int) -> _Edge:
    if len(time) < FEWEST:
        return _Edge(None, offset, fallback)
    sure = max(0, min(fallback - offset, len(time) - FEWEST))
    return _Edge(Window(time, position, sure), offset, fallback)


def _apart(found: list[Plateau], course: tuple[Floats, Floats], *, band: float) -> list[Plateau]:
    """The same plateaus without overlap; those of one speed with at most a hiccup between them are one.

    `course` are first samples and speeds of the movement's ticks, `band` the spread (rad/s or m/s) of one speed.
    """
    out: list[Plateau] = []
    for plateau in found:
        last = out[-1] if out else None
        if last is not None and abs(plateau.level - last.level) <= band:
            between = (course[0] >= last.stop) & (course[0] < plateau.start)
            departure = np.abs(course[1][between] - abs(last.level)).max(initial=0.0)
            shorter = min(last.stop - last.start, plateau.stop - plateau.start)
            if departure <= HICCUP * band and plateau.start - last.stop <= shorter:
                out[-1] = Plateau(last.start, max(last.stop, plateau.stop), last.level)
                continue
        start = max(plateau.start, last.stop) if last is not None else plateau.start
        if plateau.stop > start:
            out.append(Plateau(start, plateau.stop, plateau.level))
    return out
