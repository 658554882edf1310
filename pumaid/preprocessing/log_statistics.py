"""Running statistics of logs, by which their columns are checked: sums that are fed batch by batch, and merged."""

import math
from collections import Counter
from collections.abc import Iterator
from typing import Any, Self

import numpy as np

from pumaid.dataset import Log, finite_means
from pumaid.maths import Counts, Flags, Floats
from pumaid.preprocessing.encodings import CLASSES, leaps, size_counts, spikes, strays
from pumaid.robot import Robot

#: s; displacements and mean currents are taken over windows of this: encoder noise averages out, a stroke has many.
WINDOW = 0.1
#: s; a longer window spans a gap and is left out.
LONGEST_WINDOW = 0.25
#: rad/s and m/s; below it a joint counts as held (noise of 1e-4 rad over a window is 1e-3 rad/s).
SLOW = {"revolute": 0.02, "prismatic": 0.005}
#: A joint moves alone where all others are this much slower, relative to its own speed.
ALONE = 0.05
#: rad or m; held positions that differ less are one posture; and windows a joint that are kept for such comparisons.
SAME_POSTURE, MOST_WINDOWS = 0.1, 6000
#: Share of a window's velocities that must be numbers, and of its positions that repeat where a position is held.
VELOCITIES, OFTEN = 0.5, 0.3
#: Fewest samples of a window that can be flat.
FLAT = 3
#: Samples that are looked at together whether they stand in another log, too; A, rad or m within which they are the
#: same; marks of a log that are kept; and what spreads numbers over all 64 bits, an odd one (of the golden ratio).
TOGETHER, SAME, MOST_MARKS, MIXER = 8, 1e-5, 256, np.int64(-7046029254386353131)
#: Totals of which the least or the largest of two parts counts, and what they begin with; all others add up from 0.
EXTREMES: dict[str, tuple[np.ufunc, float]] = {
    **dict.fromkeys(
        ("lowest", "least_current", "least_negative", "least_step", "least_change", "stray"), (np.fmin, math.inf)
    ),
    **dict.fromkeys(("highest", "most_current", "spike"), (np.fmax, -math.inf)),
}
#: Totals of each joint.
TOTALS = (
    *("lowest", "highest", "path", "seconds", "speed_squares", "windows", "held", "step_sum", "step_count"),
    *("least_step", "least_current", "most_current", "moving", "pairs", "same", "flat", "zeros"),
    *("ahead", "least_negative", "least_change", "jumps", "jump_sum", "jump_squares", "bounces"),
    *("strays", "stray", "noise", "rows", "spikes", "spike"),
)


class LogStatistics:
    """Running statistics of J joints, fed batch by batch; "moving" is by windows of 0.1 s.

    Attributes
    ----------
    totals
        By name: ``lowest``, ``highest`` (J,) positions, rad or m; ``path``, ``seconds``, ``speed_squares`` (J,) way,
        time and integral of the squared speed while moving; ``windows`` while moving and those ``held``, whose position
        often repeats, and there ``step_sum``, ``step_count``, ``least_step`` of its steps other than 0 (rad or m);
        over ``rows`` while moving the sum of the standard deviation of its ``noise`` (rad or m);
        ``least_current``, ``most_current`` (J,) A while moving, and samples with a current, ``moving``; ``pairs`` of
        neighbours while moving, those with the ``same`` current, windows in which all are, ``flat``, and ``zeros``
        while moving, in windows with other currents; windows moved ``ahead``; the ``least_negative`` size below zero
        and the ``least_change`` (A) of currents, and (J, C) counts of their ``sizes`` while moving; ``jumps`` of
        positions that move on, their ``jump_sum`` and ``jump_squares``, ``bounces`` at zero, and ``strays``, leaps to a
        number and back, with the least, ``stray``; ``spikes`` of currents, to the size ``spike``; ``products`` (2J, 2J)
        over windows of displacements and integrated velocity columns; ``copied``, ``compared`` (J, J) windows in which
        the mean currents of two joints are the same and not zero, and that have both.
    alone
        By joint (from 0), (W, 2J + 1) positions, speed and mean currents in windows in which it moves alone; of many
        every second, fourth ... stays.
    levels
        By joint: the two largest of positive currents, of the sizes of negative ones, and of minus the sizes of those
        that are not zero (A) while moving, and how often each occurs.
    intervals
        Median time steps (s) of files, as their readers give them.
    marks
        The least numbers that stand for a file's samples in motion (`sample_marks`), rising; at most `MOST_MARKS`.
    """

    def __init__(self, robot: Robot) -> None:
        n = robot.n_joints
        self.robot, self.origin = robot, ""
        self.totals = {name: np.full(n, EXTREMES.get(name, (None, 0.0))[1]) for name in TOTALS}
        self.totals |= {"products": np.zeros((2 * n, 2 * n)), "copied": np.zeros((n, n)), "compared": np.zeros((n, n))}
        self.totals["sizes"] = np.zeros((n, CLASSES))
        self.intervals: list[float] = []
        self.levels: list[list[Counter[float]]] = [[Counter(), Counter(), Counter()] for _ in range(n)]
        self.alone = [np.zeros((0, 2 * n + 1))] * n
        self._rest: Log | None = None
        self.marks = np.zeros(0, dtype=np.int64)

    def _add(self, joint: int | slice = slice(None), /, **parts: Any) -> None:
        for name, values in parts.items():
            merge, total = EXTREMES[name][0] if name in EXTREMES else np.add, self.totals[name]
            total[joint] = merge(total[joint], values)

    def take(self, log: Log) -> None:
        """Add a batch; windows that are whole are summed, the rest waits for the next of its clock."""
        if not len(log):
            return
        self.origin = self.origin or log.origin
        self._add(lowest=np.fmin.reduce(log.position), highest=np.fmax.reduce(log.position))
        marks = np.concatenate([self.marks, sample_marks(log)])
        limit = self.marks[-1] if len(self.marks) == MOST_MARKS else np.inf
        self.marks = np.unique(marks[marks <= limit])[:MOST_MARKS]
        if self._rest is not None and not log.starts_clock:
            log = Log.joined([self._rest, log])
        edges = np.concatenate([[0], np.flatnonzero(np.diff(np.floor(log.time / WINDOW))) + 1])
        self._rest = log.part(slice(int(edges[-1]), None))
        if len(edges) > 1:
            self._add_windows(log, edges)

    def absorb(self, other: Self) -> None:
        """Add the statistics of another file of the same robot, which must not be fed any more."""
        if not self.origin:  # whose columns its log names
            self.origin, self.robot = other.origin, other.robot
        self._add(**other.totals)
        self.intervals += other.intervals
        for j in range(self.robot.n_joints):
            self.levels[j] = [
                _largest(a + b, np.zeros(0)) for a, b in zip(self.levels[j], other.levels[j], strict=True)
            ]
            self._add_alone(j, other.alone[j])

    def interval(self) -> float:
        """Median time between samples (s), NaN if there is none."""
        return float(np.median(self.intervals)) if self.intervals else math.nan

    def _add_windows(self, log: Log, edges: Counts) -> None:
        starts, counts = edges[:-1], np.diff(edges)
        seconds, change = np.diff(log.time[edges])[:, None], np.diff(log.position[edges], axis=0)
        usable = (seconds <= LONGEST_WINDOW) & np.isfinite(change).all(axis=1, keepdims=True)
        speed = np.where(usable, change / seconds, 0.0)
        size = np.abs(speed)
        moves = size > np.array([SLOW[joint.kind] for joint in self.robot.joints])
        way = moves * size * seconds
        self._add(
            windows=moves.sum(axis=0),
            seconds=(moves * seconds).sum(axis=0),
            ahead=(moves & (change > 0.0)).sum(axis=0),
            path=way.sum(axis=0),
            speed_squares=(way * size).sum(axis=0),
        )
        middle = 0.5 * (log.position[edges[1:]] + log.position[starts])
        log = log.part(slice(0, int(edges[-1])))
        if log.velocity is not None:
            measured = _counts(np.isfinite(log.velocity), starts) > VELOCITIES * counts[:, None]
            both = np.hstack([change, finite_means(log.velocity, starts) * seconds])
            both = both[usable[:, 0] & measured.all(axis=1)]
            self._add(products=both.T @ both)
        joints = np.flatnonzero(moves.any(axis=0)).tolist()
        for j in joints:
            self._add(j, **leaps(log.time, log.position[:, j], SLOW[self.robot.joints[j].kind]))
            self._add(j, **strays(log.time, log.position[:, j]))
            self._add_steps(j, log.position[:, j], moves[:, j], starts)
            self._add_currents(j, log.current[:, j], moves[:, j], starts)
        if joints:
            self._add_directions(speed, moves, middle, finite_means(log.current, starts))

    def _add_steps(self, j: int, position: Floats, moves: Flags, starts: Counts) -> None:
        """Add the steps of a joint's (N,) positions in those of (W,) windows in which it `moves` and they repeat."""
        step, counts = np.abs(np.diff(position, prepend=position[0])), np.diff(starts, append=len(position))
        step[starts] = np.nan  # from another window
        often = moves & (_counts(step == 0.0, starts) >= OFTEN * counts)
        steps = step[(step > 0.0) & np.repeat(often, counts)]
        least, rows = steps.min(initial=math.inf), int(counts @ moves)
        # Motion leaves next to nothing in third differences, of independent noise 20 times its variance; the median of
        # normal sizes is 0.6745 of their standard deviation.
        thirds = np.abs(np.diff(position, n=3, prepend=position[:1].repeat(3)))[np.repeat(moves, counts)]
        self._add(
            j,
            held=often.sum(),
            step_count=len(steps),
            step_sum=steps.sum(),
            least_step=least,
            rows=rows,
            noise=rows * float(np.median(thirds)) / (0.6745 * math.sqrt(20.0)),
        )

    def _add_currents(self, j: int, current: Floats, moves: Flags, starts: Counts) -> None:
        """Add extremes, repeats and zeros of a joint's (N,) currents where they are measured while it `moves`, (W,)."""
        moving = np.repeat(moves, np.diff(starts, append=len(current))) & np.isfinite(current)
        both = moving[1:] & moving[:-1]
        both[starts[1:] - 1] = False  # of two windows
        same, values = both & (current[1:] == current[:-1]), current[moving]
        self._add(j, **spikes(values))
        self._add(j, moving=len(values), pairs=np.count_nonzero(both), same=np.count_nonzero(same))
        low = np.minimum.reduceat(np.where(moving, current, np.inf), starts)
        high = np.maximum.reduceat(np.where(moving, current, -np.inf), starts)
        counts, zeros = _counts(moving, starts), _counts(moving & (current == 0.0), starts)
        flat, zeros = (low == high) & (counts >= FLAT), np.where(zeros < counts, zeros, 0)
        change = np.abs(np.diff(current))[both & ~same]
        self._add(
            j,
            least_change=change.min(initial=math.inf),
            least_negative=-values[values < 0].max(initial=-math.inf),
            least_current=low.min(),
            most_current=high.max(),
            flat=flat.sum(),
            zeros=zeros.sum(),
        )
        sides = (values[values > 0], -values[values < 0], -np.abs(values[values != 0]))
        self.levels[j] = [_largest(a, b) for a, b in zip(self.levels[j], sides, strict=True)]
        self.totals["sizes"][j] += size_counts(sides[0])

    def _add_directions(self, speed: Floats, moves: Flags, middle: Floats, mean: Floats) -> None:
        """Add, by joint and posture, (W,) windows in which a joint moves alone; `mean` are (W, J) currents."""
        measured = np.isfinite(mean).astype(float)
        same = (mean[:, :, None] == mean[:, None, :]) & (mean != 0.0)[:, None, :]
        self._add(compared=measured.T @ measured, copied=same.sum(axis=0))
        size = np.abs(speed)
        for j in np.flatnonzero(moves.any(axis=0)).tolist():
            alone = moves[:, j] & (np.delete(size, j, axis=1).max(axis=1, initial=0.0) < ALONE * size[:, j])
            self._add_alone(j, np.column_stack([middle, speed[:, j], np.nan_to_num(mean)])[alone])

    def _add_alone(self, joint: int, more: Floats) -> None:
        rows = np.concatenate([self.alone[joint], more])
        self.alone[joint] = rows[:: 1 + len(rows) // MOST_WINDOWS]

    def postures(self, joint: int, scale: float = 1.0) -> Iterator[tuple[Floats, Floats]]:
        """Of each posture in which a joint (from 0) moves alone, (W, 5) 1, cos, sin, direction and speed, and (W, J)
        currents; with positions times `scale`.
        """
        n, rows = self.robot.n_joints, self.alone[joint]
        place = scale * rows[:, :n]
        held = np.round(np.delete(place, joint, axis=1) / SAME_POSTURE).astype(np.int64)
        angle, speed = place[:, joint], rows[:, n]
        columns = np.column_stack([np.ones(len(rows)), np.cos(angle), np.sin(angle), np.sign(speed), speed])
        _, which = np.unique(held, axis=0, return_inverse=True)
        for k in range(which.max(initial=-1) + 1):
            chosen = which.reshape(-1) == k
            yield columns[chosen], rows[chosen, n + 1 :]


def sample_marks(log: Log) -> Counts:
    """A number for each stretch of `TOGETHER` samples in motion: the same wherever, and whenever, these stand again."""
    place = log.position.sum(axis=1)
    rows = np.round(np.nan_to_num(place + math.pi * log.current.sum(axis=1)) / SAME).astype(np.int64)
    marks = np.convolve(rows, MIXER ** np.arange(TOGETHER))[TOGETHER - 1 : len(rows)]
    marks = marks[place[TOGETHER - 1 :] != place[: 1 - TOGETHER]]
    marks = MIXER * (marks ^ (marks >> 29))
    return np.asarray(marks ^ (marks >> 32))


def _counts(flags: Flags, starts: Counts) -> Counts:
    """(W,) or (W, J) of true (N,) or (N, J) flags from each start on."""
    return np.add.reduceat(flags, starts, axis=0, dtype=np.int64)


def _largest(total: Counter[float], values: Floats) -> Counter[float]:
    for _ in range(2):
        level = values.max(initial=-math.inf)
        total = total + Counter({float(level): int(np.count_nonzero(values == level))})
        values = values[values < level]
    return Counter(dict(sorted(total.items())[-2:]))
