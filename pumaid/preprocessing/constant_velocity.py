"""Stretches of constant velocity within a movement of one joint, and the instants at which they begin and end."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.preprocessing.differentiate import Ticks, round_half_up, slopes
from pumaid.preprocessing.options import SegmentOptions

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

#: s; longest straight line by which the speed of a slow or noisy movement is judged.
LONGEST_LINE = 1.0
#: Standard deviations of the smoothed speed allowed beside the tolerance.
SPREAD = 3.0
#: s of a stretch before its end from which the line is taken that the end departs from.
ANCHOR = 0.3
#: Share of the speed by which a ramp has changed it where the search for its beginning ends.
DEPARTED = 0.2
#: s (and sampling intervals) dropped at every end: a corner that hides in the noise, or a current logged late.
GUARD, GUARD_SAMPLES = 0.010, 1.0
#: Share of a movement's largest acceleration above which a stretch is a slow ramp.
RAMPING = 0.25
#: Departure from a speed, in units of the tolerance, that does not end a run where the same speed goes on behind it.
HICCUP = 3.0
#: Fewest samples of a line and of a departure from it.
FEWEST = 8

#: Points to which line and departure are thinned, and instants tried for the departure, then around the best of them.
LINE_POINTS, DEPARTURE_POINTS = 40, 80
COARSE, FINE = 32, 20
#: Rise of the misfit, in mean squares, up to which an instant is compatible with the best, and fall that proves one.
COMPATIBLE, PROVEN = 4.0, 25.0
#: Mean square about the line, in units of the sure part's, above which position does not stay on it.
SWINGING = 5.0
#: rad2 or m2; misfit of data without noise.
TINY = 1e-18

#: s; means over it resolve a ringing of up to 40 Hz.
STEP = 0.005
#: Steps on either side of the lines for speed: few for fast ringing, more for weak ringing.
HALVES = (2, 5)
#: s within which a ringing returns, and the share of its time that is dropped beyond its last swing.
RETURN, AGAIN = 0.1, 0.3
#: Standard deviations of the middle's speed, and share of the speed, above which an end still rings.
UNSETTLED, NEGLIGIBLE = 4.5, 0.005
#: Fewest steps whose middle half shows a spread.
FEWEST_STEPS = 24


@dataclass(frozen=True, slots=True)
class ConstantVelocity:
    """Samples [start, stop) at a constant `velocity` (rad/s or m/s, signed)."""

    start: int
    stop: int
    velocity: float


def constant_velocities(
    ticks: Ticks, movement: tuple[int, int], samples: tuple[Floats, Floats], *, joint: int, options: SegmentOptions
) -> list[ConstantVelocity]:
    """Every stretch of constant velocity of one movement, in order of time.

    Ticks whose smoothed speed stays within the tolerance make the core of a stretch; its ends are then found to the
    sample, as the latest instants at which position is surely still on a straight line, and ringing is dropped.

    Parameters
    ----------
    ticks
        Of all joints.
    movement
        First tick of the movement and the one behind its last.
    samples
        (N,) times and (N,) positions of the moving joint, to which the ticks' edges point.
    joint
        The moving joint, from 1.
    options
        Tolerances.
    """
    time, position = samples
    velocity, half = movement_velocity(ticks, movement, joint=joint, options=options)
    speed, error = np.abs(velocity), SPREAD * ticks.slope_error(joint, half)
    peak = float(np.abs(slopes(ticks.time[slice(*movement)], velocity, 1)).max())
    reach = max(1, round_half_up(0.7 * options.min_duration / ticks.interval))
    runs: list[ConstantVelocity] = []
    for core in _cores(speed, reach, tolerance=(options.speed_tolerance, error)):
        level = float(np.median(velocity[slice(*core)]))
        outside = _departed(speed, core, farthest=reach + half + round_half_up(ANCHOR / ticks.interval), error=error)
        beyond = (max(0, movement[0] + outside[0] - half), min(len(ticks), movement[0] + outside[1] + half))
        first, last = _ends(ticks, samples, (movement[0] + core[0], movement[0] + core[1]), beyond=beyond, half=half)
        if last - first < FEWEST or _is_ramp(time[first:last], position[first:last], peak=peak):
            continue
        begin, end = settled(time[first:last], position[first:last])
        # A swing of the speed may look like a shorter one, and would be joined to a run by mistake.
        if end - begin >= FEWEST and time[first + end - 1] - time[first + begin] >= 0.75 * options.min_duration:
            runs.append(ConstantVelocity(first + begin, first + end, level))
    band = options.speed_tolerance * max((abs(run.velocity) for run in runs), default=0.0) + error
    return _without_overlap(runs, (ticks.edges[slice(*movement)], speed), band=band)


def movement_velocity(
    ticks: Ticks, movement: tuple[int, int], *, joint: int, options: SegmentOptions
) -> tuple[Floats, int]:
    """Velocity (rad/s or m/s) at the movement's ticks, smoothed as little as noise allows, and ticks on each side."""
    start, stop = movement
    position = ticks.position[:, joint - 1]
    duration = max(ticks.interval, float(ticks.time[stop - 1] - ticks.time[start]))
    typical = abs(float(position[stop - 1] - position[start])) / duration
    longest = min(LONGEST_LINE, 0.25 * (stop - start) * ticks.interval)
    half = ticks.half_width(joint, options.speed_tolerance * typical / SPREAD, longest)
    low, high = max(0, start - half), min(len(ticks), stop + half)
    velocity = slopes(ticks.time[low:high], position[low:high], half)
    return velocity[start - low : stop - low], half


def _cores(speed: Floats, reach: int, *, tolerance: tuple[float, float]) -> list[tuple[int, int]]:
    """Tick ranges longer than `reach` in which the speed stays within relative and absolute tolerance of its median."""
    share, absolute = tolerance
    if len(speed) <= reach:
        return []
    width = 2 * (reach // 2) + 1
    around = np.lib.stride_tricks.sliding_window_view(np.pad(speed, width // 2, mode="edge"), width)
    steady = around.max(axis=1) - around.min(axis=1) <= 2.0 * (share * speed + absolute)
    cores, waiting = [], _true_ranges(steady)
    while waiting:
        start, stop = waiting.pop()
        level = float(np.median(speed[start:stop]))
        inside = _true_ranges(np.abs(speed[start:stop] - level) <= share * level + absolute)
        if not inside:
            continue
        first, last = max(inside, key=lambda part: part[1] - part[0])
        if stop - start - last > reach:
            waiting.append((start + last, stop))
        if first > reach:
            waiting.append((start, start + first))
        cores.append((start + first, start + last))
    return sorted(cores)


def _true_ranges(values: Bools) -> list[tuple[int, int]]:
    """[start, stop) of every run of true values."""
    borders = np.flatnonzero(np.diff(values.astype(np.int8), prepend=0, append=0))
    return [(int(a), int(b)) for a, b in borders.reshape(-1, 2)]


def _departed(speed: Floats, core: tuple[int, int], *, farthest: int, error: float) -> tuple[int, int]:
    """Ticks before and behind a core at which its speed is clearly left, `farthest` away at most."""
    level = float(np.median(speed[core[0] : core[1]]))
    far = np.abs(speed - level) > DEPARTED * level + error
    before, behind = np.flatnonzero(far[: core[0]][::-1]), np.flatnonzero(far[core[1] :])
    back = min(int(before[0]) + 1 if len(before) else farthest, farthest)
    ahead = min(int(behind[0]) + 1 if len(behind) else farthest, farthest)
    return max(0, core[0] - back), min(len(speed), core[1] + ahead)


def _ends(
    ticks: Ticks, samples: tuple[Floats, Floats], core: tuple[int, int], *, beyond: tuple[int, int], half: int
) -> tuple[int, int]:
    """Samples [first, last) of a core's stretch, whose departures lie between ticks `beyond`; cores end to the tick."""
    time, position = samples
    edges = ticks.edges
    first, last = int(edges[core[0]]), int(edges[core[1]])
    middle = (first + last) // 2
    reach = max(math.ceil(ANCHOR / ticks.interval), 3 * half, 4) * int(edges[1])
    if beyond[1] > core[1]:
        low, stop = max(middle, last - reach), int(edges[beyond[1]])
        last = low + _length_on_line(time[low:stop], position[low:stop], sure=last - low)
    if beyond[0] < core[0]:
        start, high = int(edges[beyond[0]]), min(middle, first + reach)
        first = high - _length_on_line(-time[start:high][::-1], position[start:high][::-1], sure=high - first)
    return first, last


def _length_on_line(time: Floats, position: Floats, *, sure: int) -> int:
    """How many samples are on the straight line with which they begin, less a guard; `sure` of them anyway, nearly."""
    if len(time) < FEWEST:
        return sure
    leaves = departure(time, position, sure=max(0, min(sure, len(time) - FEWEST)))
    if leaves >= time[-1]:
        return len(time)
    guard = max(GUARD, GUARD_SAMPLES * float(time[-1] - time[0]) / len(time))
    return int(np.searchsorted(time, leaves - guard))


def departure(time: Floats, position: Floats, *, sure: int) -> float:
    """Latest time up to which position surely follows the straight line that it later leaves; the last if it stays.

    Line plus ``max(0, t - onset)^p`` is fitted for many onsets and p = 1, 2, 3; of the onsets whose misfit is not
    significantly worse than the best one's, the earliest is returned.

    Parameters
    ----------
    time, position
        (N,) s and rad or m; the line comes first, the departure last.
    sure
        Samples at the front that are on the line.
    """
    points = _thinned(time, position, sure)
    earliest, onset, is_described = _onset(*points)
    was_described = is_described
    # Where no curve describes the departure (a ramp that ends in view), less of it is looked at, and once more: what
    # ended in view may hide in the noise.
    while not was_described:
        line = int(np.searchsorted(points[0], onset))
        size = line + max(6, (len(points[0]) - line) // 2)
        if size >= len(points[0]) or line < FEWEST:
            break
        points = (points[0][:size], points[1][:size], points[2][:size])
        was_described = is_described
        again, onset, is_described = _onset(*points)
        earliest = min(earliest, again)
    if earliest < points[0][-1]:
        return earliest
    return float(time[sure] if sure < len(time) and _swings(*points, end=float(time[sure])) else time[-1])


def _swings(time: Floats, position: Floats, weight: Floats, *, end: float) -> bool:
    """Whether position swings about the straight line through what lies before `end` (s) more behind it than before."""
    before = time < end
    if before.sum() < FEWEST or before.all():
        return False
    line = np.polyfit(time[before] - end, position[before], 1, w=weight[before])
    square = ((position - np.polyval(line, time - end)) * weight) ** 2
    return bool(square[~before].mean() > SWINGING * square[before].mean() + TINY)


def _thinned(time: Floats, position: Floats, sure: int) -> tuple[Floats, Floats, Floats]:
    """Times, positions and weights (roots of counts) of at most 120 means."""
    line, rest = -(-max(1, sure) // LINE_POINTS), -(-max(1, len(time) - sure) // DEPARTURE_POINTS)
    starts = np.concatenate([np.arange(0, sure, line), np.arange(sure, len(time), rest)])
    counts = np.diff(starts, append=len(time))
    mean_time = time[0] + np.add.reduceat(time - time[0], starts) / counts
    return mean_time, np.add.reduceat(position - position[0], starts) / counts, np.sqrt(counts)


def _onset(time: Floats, position: Floats, weight: Floats) -> tuple[float, float, bool]:
    """Earliest compatible and best time of a departure, and whether the curve fits it as the line fits the rest."""
    t = time - time[0]
    line = np.linalg.qr(np.column_stack([weight, weight * t]))[0]
    rest = weight * position
    rest = rest - line @ (line.T @ rest)
    whole = float(rest @ rest)
    onsets = np.linspace(0.1 * t[-1], t[-2], COARSE)
    misfit = whole - _explained(t, weight, rest, line=line, onsets=onsets)[0]
    best = int(misfit.min(axis=0).argmin())
    closer = np.clip(onsets[best] + np.linspace(-2.0, 2.0, FINE) * (onsets[1] - onsets[0]), 0.1 * t[-1], t[-2])
    gain, shape = _explained(t, weight, rest, line=line, onsets=closer)
    misfit, onsets = np.concatenate([misfit, whole - gain], axis=1), np.concatenate([onsets, closer])
    least = float(misfit.min())
    share = max(least, 0.0) / max(1, len(t) - 4) + TINY
    if whole - least < PROVEN * share:
        return float(time[-1]), float(time[-1]), True
    earliest = float(onsets[(misfit <= least + COMPATIBLE * share).any(axis=0)].min())
    onset = float(onsets[int(misfit.min(axis=0).argmin())])
    power, place = np.unravel_index(int((whole - gain).argmin()), gain.shape)
    square = (rest - shape[power, place] * (shape[power, place] @ rest)) ** 2
    return time[0] + earliest, time[0] + onset, _is_described(square, before=t < 2.0 * onset - t[-1])


def _explained(t: Floats, weight: Floats, rest: Floats, *, line: Floats, onsets: Floats) -> tuple[Floats, Floats]:
    """(3, G) squares that a departure of each power explains from each of (G,) onsets on, and its (3, G, n) shape."""
    ramp = np.maximum(0.0, t - onsets[:, None])
    # By a step of speed, of acceleration, of jerk.
    shape = weight * np.stack([ramp, ramp * ramp, ramp * ramp * ramp])
    size = np.sqrt((shape * shape).sum(axis=2))
    shape = shape - (shape @ line) @ line.T
    bent = np.sqrt((shape * shape).sum(axis=2))
    shape = shape / np.where(bent > 1e-5 * size, bent, np.inf)[:, :, None]
    return (shape @ rest) ** 2, shape


def _is_described(square: Floats, *, before: Bools) -> bool:
    """Whether squared residuals are as small near and behind the onset as far before it."""
    far, near = square[before], square[~before]
    if len(far) < FEWEST or not len(near):
        return True
    usual = 1.0 + 2.5 * math.sqrt(2.0 / len(near) + 2.0 / len(far))
    return bool(near.mean() <= usual * far.mean() + TINY)


def _is_ramp(time: Floats, position: Floats, *, peak: float) -> bool:
    """Whether the speed has a trend near the movement's `peak` acceleration (rad/s2 or m/s2)."""
    x = time - time.mean()
    square = x * x
    bend = square - square.mean() - (square @ x / (x @ x)) * x
    return abs(2.0 * float(bend @ (position - position[0])) / float(bend @ bend)) > RAMPING * peak


def _without_overlap(
    found: list[ConstantVelocity], course: tuple[NDArray[np.int64], Floats], *, band: float
) -> list[ConstantVelocity]:
    """The stretches without overlap; those of one speed with at most a hiccup between them are joined.

    `course` are first samples and speeds of the movement's ticks, `band` the spread (rad/s or m/s) of one speed.
    """
    out: list[ConstantVelocity] = []
    for run in found:
        last = out[-1] if out else None
        if last is not None and abs(run.velocity - last.velocity) <= band:
            between = (course[0] >= last.stop) & (course[0] < run.start)
            largest = np.abs(course[1][between] - abs(last.velocity)).max(initial=0.0)
            shorter = min(last.stop - last.start, run.stop - run.start)
            if largest <= HICCUP * band and run.start - last.stop <= shorter:
                out[-1] = ConstantVelocity(last.start, max(last.stop, run.stop), last.velocity)
                continue
        start = max(run.start, last.stop) if last is not None else run.start
        if run.stop > start:
            out.append(ConstantVelocity(start, run.stop, run.velocity))
    return out


def settled(time: Floats, position: Floats) -> tuple[int, int]:
    """Samples [start, stop) of a stretch of constant velocity between which it rings no more than in its middle.

    Parameters
    ----------
    time, position
        (N,) s and rad or m.
    """
    size = max(1, round_half_up(STEP * (len(time) - 1) / max(1e-9, float(time[-1] - time[0]))))
    starts = np.arange(0, len(time) - size + 1, size)
    if len(starts) < FEWEST_STEPS:
        return 0, len(time)
    counts = np.diff(starts, append=len(time))
    t = np.add.reduceat(time - time[0], starts) / counts
    q = np.add.reduceat(position - position[0], starts) / counts
    reach = max(1, round_half_up(RETURN * len(t) / max(1e-9, float(t[-1] - t[0]))))
    front = back = 0
    for half in HALVES:
        far = _unsettled(t, slopes(t, q, half), half)
        front = max(front, _ringing(far[: len(t) // 2], reach))
        back = max(back, _ringing(far[::-1][: len(t) // 2], reach))
    return front * size, len(time) - back * size


def _unsettled(t: Floats, speed: Floats, half: int) -> Bools:
    """(M,) where the speed leaves the middle's straight line by more than the middle's own spread allows."""
    quarter = len(t) // 4
    middle = slice(quarter, len(t) - quarter)
    x, level = t - t[middle].mean(), float(speed[middle].mean())
    trend = float(x[middle] @ (speed[middle] - level)) / float(x[middle] @ x[middle])
    away = np.abs(speed - level - trend * x)
    far = away > max(UNSETTLED * math.sqrt(float(np.mean(away[middle] ** 2))), NEGLIGIBLE * abs(level))
    # Lines at the ends have fewer neighbours and so more noise.
    far[:half] = far[-half:] = False
    return far


def _ringing(far: Bools, reach: int) -> int:
    """Steps from the front to the last departure that follows another within `reach`, and a share of that again."""
    last = -1
    for step in np.flatnonzero(far).tolist():
        if step - last > reach:
            break
        last = step
    return 0 if last < 0 else min(len(far), round((last + 1) * (1.0 + AGAIN)) + HALVES[0])
