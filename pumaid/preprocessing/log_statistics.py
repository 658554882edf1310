"""Running statistics of a log by which `log_checks` judges whether its columns mean what the recipe says."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import numpy as np

from pumaid.dataset import Log, finite_means
from pumaid.maths import Counts, Flags, Floats
from pumaid.robot import Robot

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
#: Share of a window's velocities that must be numbers, and of its positions that repeat where a position is held.
VELOCITIES, OFTEN = 0.5, 0.3
#: Intervals from which the sampling rate is taken.
INTERVALS = 20_000
#: Fewest samples of a window that can be flat.
FLAT = 3

#: No values.
_NONE = np.zeros(0)

#: Attributes of which the least or the largest of two files counts; all other arrays add up.
EXTREMES = {
    **dict.fromkeys(("lowest", "least_current", "least_step"), np.fmin),
    **dict.fromkeys(("highest", "most_current"), np.fmax),
}


class LogStatistics:
    """Running statistics of J joints, fed batch by batch; "moving" is by windows of 0.1 s.

    Attributes
    ----------
    lowest, highest
        (J,) positions, rad or m.
    path, seconds, speed_squares
        (J,) way, time and integral of the squared speed while moving.
    products
        (2J, 2J) sums over windows of products of displacements and integrated velocity columns.
    groups
        Per joint, by posture of the others, over windows in which it moves alone, (4 + J, 4 + J) sums of products of
        (1, cos, sin, direction, all mean currents).
    windows, held, step_sum, step_count, least_step
        (J,) windows while moving, and those whose position often repeats; there, its steps other than 0 (rad or m).
    least_current, most_current, moving
        (J,) A while moving, and samples with a current.
    levels
        Per joint: the two largest of positive currents, of the sizes of negative ones, and of minus the sizes of those
        that are not zero (A) while moving, and how often each occurs.
    pairs, same, flat, zeros
        (J,) neighbouring samples while moving, those whose currents are equal, and windows in which all are; zero
        currents while moving, in windows with other currents.
    copied, compared
        (J, J) windows in which the mean currents of two joints are the same and not zero, and that have both.
    intervals
        First time steps (s).
    """

    def __init__(self, robot: Robot) -> None:
        n = robot.n_joints
        self.robot, self.origin = robot, ""
        self.lowest, self.least_current, self.least_step = np.full((3, n), np.inf)
        self.highest, self.most_current = np.full((2, n), -np.inf)
        self.path, self.seconds, self.speed_squares = np.zeros((3, n))
        self.windows, self.held, self.step_sum, self.step_count = np.zeros((4, n))
        self.moving, self.pairs, self.same, self.flat, self.zeros = np.zeros((5, n))
        self.copied, self.compared = np.zeros((2, n, n))
        self.products, self.intervals = np.zeros((2 * n, 2 * n)), np.zeros(0)
        self.levels: list[list[dict[float, int]]] = [[{}, {}, {}] for _ in range(n)]
        self.groups: list[dict[tuple[int, ...], Floats]] = [{} for _ in range(n)]
        self._rest: Log | None = None

    def take(self, log: Log) -> Log:
        """Add a batch and hand it on; windows that are whole are summed, the rest waits for the next of its clock."""
        batch = log
        if not len(log):
            return log
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
            self._add_windows(log, edges)
        return batch

    def absorb(self, other: LogStatistics) -> None:
        """Add the statistics of another file of the same robot, which must not be fed any more."""
        self.origin = self.origin or other.origin
        for name, values in vars(other).items():
            if isinstance(values, np.ndarray) and name != "intervals":
                setattr(self, name, EXTREMES.get(name, np.add)(getattr(self, name), values))
        self.intervals = np.concatenate([self.intervals, other.intervals])[:INTERVALS]
        for j in range(self.robot.n_joints):
            self.levels[j] = [_largest(*both) for both in zip(self.levels[j], other.levels[j], strict=True)]
            for posture, sums in other.groups[j].items():
                self._add_group(j, posture, sums)

    def interval(self) -> float:
        """Median time between samples (s), NaN if there is none."""
        return float(np.median(self.intervals)) if len(self.intervals) else float("nan")

    def agreement(self) -> Floats:
        """(J, J) correlation of the displacement of joint a with velocity column b; 0 where nothing shows."""
        n, squares = self.robot.n_joints, np.diag(self.products)
        scale = np.sqrt(np.outer(squares[:n], squares[n:]))
        return np.divide(self.products[:n, n:], scale, out=np.zeros_like(scale), where=scale > 0)

    def _add_windows(self, log: Log, edges: Counts) -> None:
        """Add the windows between `edges`; what follows the last edge is no whole window."""
        starts, counts = edges[:-1], np.diff(edges)
        seconds, change = np.diff(log.time[edges])[:, None], np.diff(log.position[edges], axis=0)
        usable = (seconds <= LONGEST_WINDOW) & np.isfinite(change).all(axis=1, keepdims=True)
        speed = np.where(usable, change / seconds, 0.0)
        size = np.abs(speed)
        moves = size > np.array([SLOW[joint.kind] for joint in self.robot.joints])
        self.windows += moves.sum(axis=0)
        self.path += (moves * size * seconds).sum(axis=0)
        self.seconds += (moves * seconds).sum(axis=0)
        self.speed_squares += (moves * size**2 * seconds).sum(axis=0)
        middle = 0.5 * (log.position[edges[1:]] + log.position[starts])
        log = log.part(slice(0, int(edges[-1])))
        if log.velocity is not None:
            measured = _counts(np.isfinite(log.velocity), starts) > VELOCITIES * counts[:, None]
            both = np.hstack([change, finite_means(log.velocity, starts) * seconds])
            both = both[usable[:, 0] & measured.all(axis=1)]
            self.products += both.T @ both
        follows = np.ones((len(log), 1), np.bool_)  # another sample of its window
        follows[starts] = False
        step = np.abs(np.diff(log.position, axis=0, prepend=log.position[:1]))
        often = moves & (_counts(follows & (step == 0.0), starts) >= OFTEN * counts[:, None])
        self.held += often.sum(axis=0)
        if often.any():
            chosen = follows & (step > 0.0) & np.repeat(often, counts, axis=0)
            self.step_sum += np.where(chosen, step, 0.0).sum(axis=0)
            self.step_count += chosen.sum(axis=0)
            self.least_step = np.fmin(self.least_step, np.where(chosen, step, np.inf).min(axis=0))
        if moves.any():
            sampled = np.repeat(moves, counts, axis=0) & np.isfinite(log.current)
            self._add_currents(log.current, sampled, follows, starts)
            self._add_directions(speed, moves, middle, finite_means(log.current, starts))

    def _add_currents(self, current: Floats, moving: Flags, follows: Flags, starts: Counts) -> None:
        """Add extremes, repeats and zeros of (N, J) currents where they are measured while `moving`."""
        self.moving += moving.sum(axis=0)
        both = follows[1:] & moving[1:] & moving[:-1]
        self.pairs += both.sum(axis=0)
        self.same += (both & (current[1:] == current[:-1])).sum(axis=0)
        low = np.minimum.reduceat(np.where(moving, current, np.inf), starts)
        high = np.maximum.reduceat(np.where(moving, current, -np.inf), starts)
        self.least_current = np.fmin(self.least_current, low.min(axis=0))
        self.most_current = np.fmax(self.most_current, high.max(axis=0))
        counts, zeros = _counts(moving, starts), _counts(moving & (current == 0.0), starts)
        self.flat += ((low == high) & (counts >= FLAT)).sum(axis=0)
        self.zeros += np.where(zeros < counts, zeros, 0).sum(axis=0)
        for j in np.flatnonzero(moving.any(axis=0)).tolist():
            values = current[moving[:, j], j]
            sides = (values[values > 0], -values[values < 0], -np.abs(values[values != 0]))
            self.levels[j] = [_largest(a, values=b) for a, b in zip(self.levels[j], sides, strict=True)]

    def _add_directions(self, speed: Floats, moves: Flags, middle: Floats, mean: Floats) -> None:
        """Add, by joint and posture, (W,) windows in which a joint moves alone; `mean` are (W, J) currents."""
        measured = np.isfinite(mean).astype(float)
        self.compared += measured.T @ measured
        self.copied += ((mean[:, :, None] == mean[:, None, :]) & (mean != 0.0)[:, None, :]).sum(axis=0)
        size = np.abs(speed)
        for j in np.flatnonzero(moves.any(axis=0)).tolist():
            alone = moves[:, j] & (np.delete(size, j, axis=1).max(axis=1, initial=0.0) < ALONE * size[:, j])
            way, angle = np.sign(speed[alone, j]), middle[alone, j]
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


def _counts(flags: Flags, starts: Counts) -> Counts:
    """(W, J) of true (N, J) flags from each start on."""
    return np.add.reduceat(flags, starts, axis=0, dtype=np.int64)


def _largest(*counts: Mapping[float, int], values: Floats = _NONE) -> dict[float, int]:
    """The two largest levels of several counts and of (N,) values, and how often each occurs."""
    total = Counter[float]()
    while len(values) and len(total) < 2:
        level = float(values.max())
        total[level] = int(np.count_nonzero(values == level))
        values = values[values < level]
    for count in counts:
        total.update(count)
    return dict(sorted(total.items())[-2:])
