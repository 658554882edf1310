"""Sums over a file's samples by which `log_checks` judges whether its columns mean what the recipe says."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Log, finite_means
from pumaid.robot import Robot

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

#: s; displacements and mean currents are taken over windows of this: encoder noise averages out, a stroke has many.
WINDOW = 0.1
#: s; a longer window spans a gap and is left out.
LONGEST_WINDOW = 0.25
#: rad/s and m/s; below it a joint counts as held (noise of 1e-4 rad over a window is 1e-3 rad/s).
SLOW = {"revolute": 0.02, "prismatic": 0.005}
#: A joint moves alone where all others are this much slower, relative to its own speed.
ALONE = 0.05
#: rad or m; held positions that differ less are one posture; and postures a joint that are distinguished.
SAME_POSTURE, POSTURES = 0.1, 300
#: Share of a window's velocities that must be numbers.
VELOCITIES = 0.5
#: Share of a window's samples that repeat the one before where a position is held, and steps that are remembered.
OFTEN, STEPS = 0.3, 2000
#: Intervals from which the sampling rate is taken.
INTERVALS = 20_000
#: Fewest samples of a window that can be flat.
FLAT = 3

#: Attributes of which the least or the largest of two files counts; all other arrays add up.
EXTREMES = {"lowest": np.fmin, "least_current": np.fmin, "highest": np.fmax, "most_current": np.fmax}


class LogStatistics:
    """Sums per joint (J), fed batch by batch.

    Attributes
    ----------
    lowest, highest
        (J,) positions, rad or m.
    path, seconds, speed_squares
        (J,) way, time and integral of the squared speed over the windows in which each joint moves.
    moved_by
        (J, J): sum over windows of displacement of joint a times integrated velocity column b.
    displacement, integral
        (J,) sums of their squares.
    ways
        (J, 2) windows in which a joint moves alone, forwards and backwards.
    groups
        Per joint a and posture of the others: sums over the windows in which a moves alone, (4 + J, 4 + J) of
        (1, cos, sin, direction, all mean currents).
    held, steps
        (J, 2) windows in which each joint moves, and those in which its position often repeats; its steps in the
        latter (rad or m).
    least_current, most_current, moving
        (J,) A over the samples in which each joint moves, and how many these are.
    tops
        Per joint and side (positive, negative): the two largest currents while moving (A), and how often they occur.
    same, flat
        (J, 2) pairs of neighbouring samples, and windows, while moving; and those whose currents are all equal.
    zeros, beside
        (J,) zero currents in windows with other currents; per joint the smallest of these and how often it occurs.
    intervals
        First time steps (s).
    """

    def __init__(self, robot: Robot) -> None:
        n = robot.n_joints
        self.robot, self.origin, self.has_velocity = robot, "", False
        self.lowest, self.least_current = np.full(n, np.inf), np.full(n, np.inf)
        self.highest, self.most_current = np.full(n, -np.inf), np.full(n, -np.inf)
        self.path, self.seconds, self.speed_squares = np.zeros(n), np.zeros(n), np.zeros(n)
        self.moved_by, self.displacement, self.integral = np.zeros((n, n)), np.zeros(n), np.zeros(n)
        self.ways, self.held, self.same, self.flat = (np.zeros((n, 2)) for _ in range(4))
        self.moving, self.zeros, self.intervals = np.zeros(n), np.zeros(n), np.zeros(0)
        self.steps = [np.zeros(0)] * n
        self.tops: list[list[dict[float, int]]] = [[{}, {}] for _ in range(n)]
        self.beside: list[dict[float, int]] = [{} for _ in range(n)]
        self.groups: list[dict[tuple[int, ...], Floats]] = [{} for _ in range(n)]
        self._rest: Log | None = None

    def take(self, log: Log) -> None:
        """Add a batch; whole windows are summed, the rest waits for the next batch of the same clock."""
        if not len(log):
            return
        self.origin = self.origin or log.origin
        missing = INTERVALS - len(self.intervals)
        self.intervals = np.concatenate([self.intervals, np.diff(log.time[: missing + 1])])
        self.lowest = np.fmin(self.lowest, np.fmin.reduce(log.position))
        self.highest = np.fmax(self.highest, np.fmax.reduce(log.position))
        if self._rest is not None and not log.starts_clock:
            log = Log.joined([self._rest, log])
        edges = np.concatenate([[0], np.flatnonzero(np.diff(np.floor(log.time / WINDOW))) + 1])
        self._rest = log.part(slice(int(edges[-1]), None))
        if len(edges) > 1:
            self._sum(log, edges)

    def absorb(self, other: LogStatistics) -> None:
        """Add the sums of another file of the same robot, which must not be fed any more."""
        self.origin = self.origin or other.origin
        self.has_velocity |= other.has_velocity
        for name, values in vars(other).items():
            if isinstance(values, np.ndarray) and name != "intervals":
                setattr(self, name, EXTREMES.get(name, np.add)(getattr(self, name), values))
        self.intervals = np.concatenate([self.intervals, other.intervals])[:INTERVALS]
        for j in range(self.robot.n_joints):
            self.steps[j] = np.concatenate([self.steps[j], other.steps[j]])[:STEPS]
            self.beside[j] = _largest(self.beside[j], other.beside[j], levels=1)
            for side in (0, 1):
                self.tops[j][side] = _largest(self.tops[j][side], other.tops[j][side], levels=2)
            for posture, sums in other.groups[j].items():
                self._add_group(j, posture, sums)

    def interval(self) -> float:
        """Median time between samples (s), NaN if there is none."""
        return float(np.median(self.intervals)) if len(self.intervals) else float("nan")

    def agreement(self) -> Floats:
        """(J, J) correlation of the displacement of joint a with velocity column b; 0 where nothing shows."""
        scale = np.sqrt(np.outer(self.displacement, self.integral))
        return np.divide(self.moved_by, scale, out=np.zeros_like(scale), where=scale > 0)

    def _sum(self, log: Log, edges: Ints) -> None:
        last = int(edges[-1])
        seconds, steps = np.diff(log.time[edges]), np.diff(log.position[edges], axis=0)
        usable = (seconds <= LONGEST_WINDOW) & np.isfinite(steps).all(axis=1)
        if log.velocity is not None and np.isfinite(log.velocity).any():
            self._sum_velocity(log, edges, steps[usable], usable)
        slow = np.array([SLOW[joint.kind] for joint in self.robot.joints])
        speed = np.where(usable[:, None], steps / seconds[:, None], 0.0)
        moves = np.abs(speed) > slow
        self.path += np.where(moves, np.abs(speed) * seconds[:, None], 0.0).sum(axis=0)
        self.seconds += (moves * seconds[:, None]).sum(axis=0)
        self.speed_squares += np.where(moves, speed * speed * seconds[:, None], 0.0).sum(axis=0)
        window = np.repeat(np.arange(len(edges) - 1), np.diff(edges))
        for j in np.flatnonzero(moves.any(axis=0)).tolist():
            inside = moves[window, j]
            self._sum_position(j, log.position[:last, j][inside], window[inside])
            measured = inside & np.isfinite(log.current[:last, j])
            if measured.any():
                self._sum_current(j, log.current[:last, j][measured], window[measured])
        middle = 0.5 * (log.position[edges[1:]] + log.position[edges[:-1]])
        self._sum_directions(speed, moves, middle, finite_means(log.current[:last], edges[:-1]))

    def _sum_velocity(self, log: Log, edges: Ints, moved: Floats, usable: Bools) -> None:
        assert log.velocity is not None
        self.has_velocity = True
        last = int(edges[-1])
        time, velocity = log.time[: last + 1], log.velocity[: last + 1].copy()
        measured = np.isfinite(velocity)
        counts = np.add.reduceat(measured[:-1], edges[:-1], axis=0, dtype=np.int64)
        enough = counts > VELOCITIES * np.diff(edges)[:, None]
        for column, good in zip(velocity.T, measured.T, strict=True):
            if good.any() and not good.all():
                column[~good] = np.interp(time[~good], time[good], column[good])
        covered = 0.5 * (velocity[1:] + velocity[:-1]) * np.diff(time)[:, None]
        covered = np.where(enough, np.add.reduceat(np.nan_to_num(covered), edges[:-1], axis=0), 0.0)[usable]
        complete = enough[usable].all(axis=1)
        moved, covered = moved[complete], covered[complete]
        self.moved_by += moved.T @ covered
        self.displacement += (moved**2).sum(axis=0)
        self.integral += (covered**2).sum(axis=0)

    def _sum_position(self, j: int, values: Floats, window: Ints) -> None:
        """Of (N,) positions in windows in which the joint moves: windows that often repeat one, and their steps."""
        starts, counts = _groups(window)
        inside = window[1:] == window[:-1]
        same = np.append(inside & (values[1:] == values[:-1]), False)
        often = np.add.reduceat(same, starts, dtype=np.int64) >= OFTEN * counts
        self.held[j] += len(starts), np.count_nonzero(often)
        if often.any() and len(self.steps[j]) < STEPS:
            chosen = np.repeat(often, counts)[:-1] & inside & ~same[:-1]
            self.steps[j] = np.concatenate([self.steps[j], np.abs(np.diff(values))[chosen]])[:STEPS]

    def _sum_current(self, j: int, values: Floats, window: Ints) -> None:
        """Of (N,) currents in windows in which the joint moves: extremes, repeats, and what stands beside zeros."""
        starts, counts = _groups(window)
        low, high = np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)
        self.moving[j] += len(values)
        self.least_current[j] = min(self.least_current[j], low.min())
        self.most_current[j] = max(self.most_current[j], high.max())
        for side, size in enumerate((values, -values)):
            self.tops[j][side] = _largest(self.tops[j][side], _counted(size[size > 0], levels=2), levels=2)
        inside = window[1:] == window[:-1]
        self.same[j] += np.count_nonzero(inside), np.count_nonzero(inside & (values[1:] == values[:-1]))
        self.flat[j] += len(starts), np.count_nonzero((low == high) & (counts >= FLAT))
        size = np.where(values == 0.0, np.nan, np.abs(values))
        zeros = np.add.reduceat(values == 0.0, starts, dtype=np.int64)
        mixed = (zeros > 0) & (zeros < counts)
        self.zeros[j] += zeros[mixed].sum()
        beside = size[np.repeat(mixed, counts) & np.isfinite(size)]
        # The smallest current is the largest of the negative ones.
        self.beside[j] = _largest(self.beside[j], _counted(-beside, levels=1), levels=1)

    def _sum_directions(self, speed: Floats, moves: Bools, middle: Floats, mean: Floats) -> None:
        size = np.abs(speed)
        for j in np.flatnonzero(moves.any(axis=0)).tolist():
            alone = moves[:, j] & (np.delete(size, j, axis=1).max(axis=1, initial=0.0) < ALONE * size[:, j])
            if not alone.any():
                continue
            way, angle = np.sign(speed[alone, j]), middle[alone, j]
            self.ways[j] += np.count_nonzero(way > 0), np.count_nonzero(way < 0)
            rows = np.column_stack([np.ones(len(way)), np.cos(angle), np.sin(angle), way, np.nan_to_num(mean[alone])])
            held = np.round(np.delete(middle[alone], j, axis=1) / SAME_POSTURE).astype(np.int64)
            postures, which = np.unique(held, axis=0, return_inverse=True)
            for k, posture in enumerate(postures):
                part = rows[which.reshape(-1) == k]
                self._add_group(j, tuple(posture.tolist()), part.T @ part)

    def _add_group(self, j: int, posture: tuple[int, ...], sums: Floats) -> None:
        groups = self.groups[j]
        if posture in groups or len(groups) < POSTURES:
            groups[posture] = groups.get(posture, 0.0) + sums


def _groups(window: Ints) -> tuple[Ints, Ints]:
    """Where (N,) rising window numbers change, from 0 on, and how many samples each window has."""
    starts = np.concatenate([[0], np.flatnonzero(np.diff(window)) + 1])
    return starts, np.diff(starts, append=len(window))


def _counted(values: Floats, *, levels: int) -> dict[float, int]:
    """The largest few of (N,) values, and how often each occurs."""
    out: dict[float, int] = {}
    for _ in range(levels):
        if len(values):
            largest = float(values.max())
            out[largest] = int(np.count_nonzero(values == largest))
            values = values[values < largest]
    return out


def _largest(first: dict[float, int], second: dict[float, int], *, levels: int) -> dict[float, int]:
    """The largest few of two counts together."""
    largest = sorted({*first, *second}, reverse=True)[:levels]
    return {level: first.get(level, 0) + second.get(level, 0) for level in largest}
