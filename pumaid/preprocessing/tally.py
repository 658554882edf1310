"""Sums over the stream of samples from which `suspicion` judges whether the columns mean what the recipe says."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import LogError
from pumaid.preprocessing.levels import Levels
from pumaid.records import Log
from pumaid.robot import Robot

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

#: s; displacements and mean currents are taken over this: noise of encoders averages out, a stroke has many.
WINDOW = 0.1
#: s; a longer window spans a gap and is left out.
LONGEST_WINDOW = 0.25
#: rad/s and m/s; below it a joint counts as held (noise of 1e-4 rad over a window is 1e-3 rad/s).
SLOW = {"revolute": 0.02, "prismatic": 0.005}
#: A joint moves alone where all others are this much slower, relative to its own speed.
_ALONE = 0.05
#: rad or m; held positions that differ less are one posture.
_SAME_POSTURE = 0.1
#: Postures a joint that are kept apart; later ones add nothing that these do not show.
_MOST_POSTURES = 300
#: Share of a window's velocities that must be numbers.
_MOST_KNOWN = 0.5
#: Share of a window's samples that often means, and steps from which it is told what they are.
_OFTEN, _MOST_JUMPS = 0.3, 2000
#: Intervals from which the sampling rate is taken.
_RATE_PROBE = 20_000

#: What simply adds up from log to log.
_SUMS = ("path", "seconds", "speed_squares", "moved_by", "displacement", "integral", "ways", "still")


@dataclass(eq=False, slots=True)
class Tally:
    """Sums per joint, fed batch by batch; J joints, W windows.

    Attributes
    ----------
    lowest, highest
        (J,) positions.
    path, seconds, speed_squares
        (J,) path (rad or m), time (s) and integral of the squared speed over the windows in which each joint moves.
    moved_by
        (J, J): sum over windows of displacement of joint a times integrated velocity column b.
    displacement, integral
        (J,) sums of their squares.
    intervals
        First intervals (s).
    levels
        What each joint's current is while the joint moves.
    still
        (J, 2) windows in which each joint moves, and those in which its position often is that of the sample before.
    jumps
        Per joint, sizes of the steps between in the latter (rad or m), `_MOST_JUMPS` or so.
    groups
        Per joint a and posture of the others: sums over the windows in which a moves alone, (4 + J, 4 + J) of
        (1, cos, sin, direction, all mean currents).
    ways
        (J, 2) windows alone forwards and backwards.
    faults
        What the sums show, where somebody has judged them since the last sample was added.
    """

    robot: Robot
    origin: str = ""
    lowest: Floats = field(init=False)
    highest: Floats = field(init=False)
    path: Floats = field(init=False)
    seconds: Floats = field(init=False)
    speed_squares: Floats = field(init=False)
    moved_by: Floats = field(init=False)
    displacement: Floats = field(init=False)
    integral: Floats = field(init=False)
    intervals: list[Floats] = field(default_factory=list)
    levels: Levels = field(init=False)
    still: NDArray[np.int64] = field(init=False)
    jumps: list[Floats] = field(init=False)
    groups: list[dict[tuple[int, ...], Floats]] = field(init=False)
    ways: NDArray[np.int64] = field(init=False)
    has_velocity: bool = False
    faults: list[LogError] | None = None
    _n_intervals: int = 0
    _carry: Log | None = None

    def __post_init__(self) -> None:
        n = self.robot.n_joints
        self.lowest, self.highest = np.full(n, np.inf), np.full(n, -np.inf)
        self.levels, self.still = Levels(n), np.zeros((n, 2), dtype=np.int64)
        self.jumps = [np.zeros(0)] * n
        self.path, self.seconds, self.speed_squares = np.zeros(n), np.zeros(n), np.zeros(n)
        self.moved_by, self.displacement, self.integral = np.zeros((n, n)), np.zeros(n), np.zeros(n)
        self.ways = np.zeros((n, 2), dtype=np.int64)
        self.groups = [{} for _ in range(n)]

    def take(self, log: Log) -> None:
        """Add a batch; whole windows are summed, the rest waits for the next batch of the same clock."""
        if not len(log):
            return
        self.faults = None
        self.origin = self.origin or log.origin
        if self._n_intervals < _RATE_PROBE:  # here, since a time in days fills no window
            self.intervals.append(np.diff(log.time[: _RATE_PROBE - self._n_intervals + 1]))
            self._n_intervals += len(self.intervals[-1])
        self.lowest = np.fmin(self.lowest, np.fmin.reduce(log.position))
        self.highest = np.fmax(self.highest, np.fmax.reduce(log.position))
        carry, self._carry = self._carry, None
        if carry is None or log.starts_clock or (carry.velocity is None) != (log.velocity is None):
            self._windows(log)
            return
        # Only the window that was cut is joined; what comes behind it stays where it is.
        edges = _edges(log.time)
        first = int(edges[1]) if len(edges) > 1 else len(log)
        self._windows(_joined(carry, _part(log, slice(0, first + 1))))
        if first < len(log):
            self._windows(_part(log, slice(first, None)))

    def _windows(self, log: Log) -> None:
        """Sum the whole windows of some samples and keep a copy of the last one, which may go on."""
        edges = _edges(log.time)
        last = _part(log, slice(int(edges[-1]), None))
        self._carry = replace(
            last,
            time=last.time.copy(),
            position=last.position.copy(),
            velocity=None if last.velocity is None else last.velocity.copy(),
            current=last.current.copy(),
        )
        if len(edges) > 1:
            self._sum(log, edges)

    def absorb(self, other: Tally) -> None:
        """Add the sums of other logs of the same robot.

        Parameters
        ----------
        other
            Sums of samples that this tally has not seen; it must not be fed any more.
        """
        self.origin, self.faults = self.origin or other.origin, None
        self.lowest, self.highest = np.fmin(self.lowest, other.lowest), np.fmax(self.highest, other.highest)
        self.levels.absorb(other.levels)
        for name in _SUMS:
            setattr(self, name, getattr(self, name) + getattr(other, name))
        if self._n_intervals < _RATE_PROBE:
            self.intervals += other.intervals
            self._n_intervals += other._n_intervals
        self.has_velocity |= other.has_velocity
        for j, theirs in enumerate(other.groups):
            if len(self.jumps[j]) < _MOST_JUMPS:
                self.jumps[j] = np.concatenate([self.jumps[j], other.jumps[j]])
            for posture, sums in theirs.items():
                self._hold(j, posture, sums)

    def rate_interval(self) -> float:
        """Median interval between samples (s), NaN if there is none."""
        return float(np.median(np.concatenate(self.intervals))) if self._n_intervals else float("nan")

    def agreement(self) -> Floats:
        """(J, J) correlation of the displacement of joint a with velocity column b; 0 where nothing can be told."""
        scale = np.sqrt(np.outer(self.displacement, self.integral))
        return np.divide(self.moved_by, scale, out=np.zeros_like(scale), where=scale > 0)

    def _sum(self, log: Log, edges: NDArray[np.int64]) -> None:
        last = int(edges[-1])
        seconds = np.diff(log.time[edges])
        steps = np.diff(log.position[edges], axis=0)
        usable = (seconds <= LONGEST_WINDOW) & np.isfinite(steps).all(axis=1)
        counts = np.diff(edges)
        mean = np.add.reduceat(log.current[:last], edges[:-1], axis=0) / counts[:, None]
        if np.isnan(mean).any():
            mean = _known_means(log.current[:last], edges)
        middle = 0.5 * (log.position[edges[1:]] + log.position[edges[:-1]])
        if log.velocity is not None:
            self._hold_velocity(log, edges, steps, usable)
        steps, seconds, mean, middle = steps[usable], seconds[usable], mean[usable], middle[usable]
        speed = steps / seconds[:, None]
        moves = np.abs(speed) > np.array([SLOW[joint.kind] for joint in self.robot.joints])
        self.path += np.where(moves, np.abs(steps), 0.0).sum(axis=0)
        self.seconds += (moves * seconds[:, None]).sum(axis=0)
        self.speed_squares += np.where(moves, steps * speed, 0.0).sum(axis=0)
        self._stand(log.position[:last], edges, np.flatnonzero(usable), moves)
        self.levels.take(log.current[:last], edges, usable=usable, moves=moves)
        self._directions(speed, moves, mean, middle)

    def _hold_velocity(self, log: Log, edges: NDArray[np.int64], steps: Floats, usable: Bools) -> None:
        assert log.velocity is not None
        self.has_velocity = True
        last = int(edges[-1])
        half = 0.5 * np.diff(log.time[: last + 1])
        covered = np.empty((len(edges) - 1, self.robot.n_joints))
        for j, velocity in enumerate(log.velocity[: last + 1].T):
            covered[:, j] = np.add.reduceat((velocity[1:] + velocity[:-1]) * half, edges[:-1])
            if np.isnan(covered[:, j]).any():
                whole, is_known = _filled(log.time[: last + 1], velocity, edges)
                covered[:, j] = np.add.reduceat((whole[1:] + whole[:-1]) * half, edges[:-1])
                usable = usable & is_known
        covered, moved = covered[usable], steps[usable]
        self.moved_by += moved.T @ covered
        self.displacement += (moved**2).sum(axis=0)
        self.integral += (covered**2).sum(axis=0)

    def _stand(self, position: Floats, edges: NDArray[np.int64], usable: NDArray[np.intp], moves: Bools) -> None:
        """Windows in which a joint moves although its position often stays, and its steps there."""
        counts = np.diff(edges)
        for j in np.flatnonzero(moves.any(axis=0)).tolist():
            own, values = usable[moves[:, j]], position[:, j]
            same = np.append(values[1:] == values[:-1], False)
            same[edges[1:] - 1] = False
            often = own[np.add.reduceat(same, edges[:-1], dtype=np.int64)[own] >= _OFTEN * counts[own]]
            self.still[j] += len(own), len(often)
            if len(often) and len(self.jumps[j]) < _MOST_JUMPS:
                steps = np.concatenate([np.diff(values[edges[w] : edges[w + 1]]) for w in often[:_MOST_JUMPS].tolist()])
                self.jumps[j] = np.concatenate([self.jumps[j], np.abs(steps[steps != 0.0])])

    def _directions(self, speed: Floats, moves: Bools, mean: Floats, middle: Floats) -> None:
        size = np.abs(speed)
        for a in np.flatnonzero(moves.any(axis=0)):
            others = np.delete(size, a, axis=1).max(axis=1, initial=0.0)
            alone = moves[:, a] & (others < _ALONE * size[:, a])
            if not alone.any():
                continue
            way, angle, response = np.sign(speed[alone, a]), middle[alone, a], np.nan_to_num(mean[alone])
            rows = np.column_stack([np.ones(len(way)), np.cos(angle), np.sin(angle), way, response])
            held = np.round(np.delete(middle[alone], a, axis=1) / _SAME_POSTURE).astype(np.int64)
            for posture, own in _by_posture(held, rows):
                self._hold(int(a), posture, own.T @ own)
            self.ways[a] += [int(np.count_nonzero(way > 0)), int(np.count_nonzero(way < 0))]

    def _hold(self, a: int, posture: tuple[int, ...], sums: Floats) -> None:
        groups = self.groups[a]
        if posture in groups:
            groups[posture] = groups[posture] + sums
        elif len(groups) < _MOST_POSTURES:
            groups[posture] = sums


def _by_posture(held: NDArray[np.int64], rows: Floats) -> Iterator[tuple[tuple[int, ...], Floats]]:
    """Each of (W, J-1) postures with those of (W, q) rows that are in it."""
    if (held == held[0]).all():  # as a rule; sorting takes longer than all the rest
        yield tuple(held[0].tolist()), rows
        return
    postures, which = np.unique(held, axis=0, return_inverse=True)
    for k, posture in enumerate(postures):
        yield tuple(posture.tolist()), rows[which.reshape(-1) == k]


def _known_means(values: Floats, edges: NDArray[np.int64]) -> Floats:
    """(W, J) means of the windows' numbers, NaN where there is none."""
    known = np.isfinite(values)
    count = np.add.reduceat(known, edges[:-1], axis=0, dtype=np.int64)
    sums = np.add.reduceat(np.where(known, values, 0.0), edges[:-1], axis=0)
    return np.divide(sums, count, out=np.full(sums.shape, np.nan), where=count > 0)


def _filled(time: Floats, values: Floats, edges: NDArray[np.int64]) -> tuple[Floats, Bools]:
    """(N,) values with straight lines where they are no numbers, and the windows in which most of them are numbers."""
    known = np.isfinite(values)
    shares = np.add.reduceat(known[:-1], edges[:-1], dtype=np.int64) / np.diff(edges)
    if not known.any():
        return np.zeros(len(values)), np.zeros(len(shares), dtype=np.bool_)
    return np.interp(time, time[known], values[known]), shares > _MOST_KNOWN


def _edges(time: Floats) -> NDArray[np.int64]:
    """Where windows begin: the first sample, and each in another window than the one before."""
    return np.concatenate([[0], np.flatnonzero(np.diff(np.floor(time / WINDOW))) + 1])


def _joined(one: Log, other: Log) -> Log:
    """Two batches of one clock as one."""

    def both(name: str) -> Floats:
        return np.concatenate([getattr(one, name), getattr(other, name)])

    return replace(
        other,
        rows=np.concatenate([one.rows, other.rows]),
        time=both("time"),
        position=both("position"),
        velocity=None if other.velocity is None else both("velocity"),
        current=both("current"),
        temperature=None,
        extra=None,
    )


def _part(log: Log, part: slice) -> Log:
    """Some of the samples, without what no sum is made of."""
    return replace(
        log,
        rows=log.rows[part],
        time=log.time[part],
        position=log.position[part],
        velocity=None if log.velocity is None else log.velocity[part],
        current=log.current[part],
        temperature=None,
        extra=None,
        starts_clock=False,
    )
