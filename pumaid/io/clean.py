"""From a file's numbers to `Log` records: SI, bad rows out, time rising, positions without wraps."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import LogError, Where
from pumaid.io.columns import Columns
from pumaid.io.oddities import Oddities
from pumaid.records import Log
from pumaid.robot import Robot

Floats = NDArray[np.float64]
Rows = NDArray[np.int64]

#: No joint of an arm has a position, velocity or current beyond this (SI): what is, is garbage of the recorder.
ABSURD = 1e6
#: s; three thousand years, so that seconds since 1970 pass and nanoseconds taken for seconds do not.
ABSURD_TIME = 1e11
#: Rows that must follow a step back of time before it counts as a new recording and not as a faulty stamp.
SUSTAINED = 20
#: A recording shorter than this says too little to tell a restart from a fault.
_FEWEST_BEFORE_RESTART = 50
#: A jump is a wrap if what remains of it without the turn is within this share of a turn (or within the joint's speed).
_WRAP_SHARE = 0.02
#: rad/s; taken as the fastest possible where the recipe gives no maximum: a turn within a quarter second.
_FASTEST = 8.0 * math.pi


@dataclass(eq=False, slots=True)
class Cleaner:
    """Turns chunks of one file into logs; what it must know of earlier chunks it keeps.

    The result does not depend on where the chunks are cut.

    Attributes
    ----------
    robot, columns, name
        What the numbers mean, and the file's name for messages.
    follows
        Last time of the file before (s), None if there is none: a first time beyond it continues that clock.
    time_factor
        Seconds in one unit of the file's time where the file itself tells, else None.
    n_extra
        Columns that the user asked for, whether this file has them or not.
    odd
        What was found so far that is worth a note.
    """

    robot: Robot
    columns: Columns
    name: str
    follows: float | None = None
    time_factor: float | None = None
    n_extra: int = 0
    first_time: float = math.nan
    last_time: float = math.nan
    odd: Oddities = field(init=False)
    _clock_start: float = math.nan
    _clock_rows: int = 0
    _last: Floats | None = None
    _held: tuple[Rows, Floats] | None = None
    _turns: Floats | None = None
    _starts_clock: bool = False

    def __post_init__(self) -> None:
        names = self.columns.names
        self.odd = Oddities(self.name, names[0], tuple(names[k] for k in self.columns.places["current"][:, 1]))

    def take(self, rows: Rows, table: Floats, *, is_last: bool = False) -> list[Log]:
        """Logs from the next chunk: rows (N,), values (C, N) as the file holds them; none while rows are held back.

        The values are taken over: they are changed in place, and the logs are views of them.

        Raises
        ------
        LogError [time-not-rising]
            Time goes back and what follows is no new recording.
        """
        self._scale(table)
        if len(rows):
            rows, table = self._without_bad(rows, table)
        if self._held is not None:
            rows = np.concatenate([self._held[0], rows])
            table = np.concatenate([self._held[1], table], axis=1)
            self._held = None
        logs: list[Log] = []
        while len(rows):
            end, restarts = self._next_step_back(rows, table, is_last)
            if end:
                logs += self._emit(rows[:end], table[:, :end])
            rows, table = rows[end:], table[:, end:]
            if not restarts:
                self._held = (rows, table) if len(rows) else None
                break
            self._restart(int(rows[0]), float(table[0, 0]))
        return logs

    def finish(self) -> list[Log]:
        """What was held back; `odd` is complete afterwards.

        Raises
        ------
        LogError [time-not-rising]
            Time goes back.
        """
        empty = np.zeros((len(self.columns.names), 0))
        logs = self.take(np.zeros(0, dtype=np.int64), empty, is_last=True)
        self.odd.intervals.finish()
        return logs

    def _scale(self, table: Floats) -> None:
        factors = self.columns.factors.copy()
        if self.time_factor is not None:
            factors[0] = self.time_factor
        for column in np.flatnonzero(factors != 1.0):
            table[column] *= factors[column]

    def _without_bad(self, rows: Rows, table: Floats) -> tuple[Rows, Floats]:
        limits = np.full((len(table), 1), ABSURD)
        limits[0] = ABSURD_TIME
        places = self.columns.places
        self.odd.n_rows += len(rows)
        # A number that is none makes the smallest and the largest none, too.
        low, high = table.min(axis=1), table.max(axis=1)
        lacks = np.isnan(low)
        for index in np.flatnonzero(lacks):
            low[index], high[index] = np.fmin.reduce(table[index]), np.fmax.reduce(table[index])
        self._count_unknown(table, lacks)
        is_short = lacks[[0, *places["position"][:, 1]]].any()
        if not (is_short or (low < -limits[:, 0]).any() or (high > limits[:, 0]).any()):
            return rows, table
        warmth = places["temperature"][:, 1]
        fine = np.abs(table) <= limits
        # Temperature is a help, not a need: a bad one is unknown, its row stays. So is what the user asked for besides.
        table[warmth] = np.where(fine[warmth], table[warmth], np.nan)
        # So is a velocity, by which positions are only checked, and most currents are of joints that do not move. One
        # that is absurd, though, marks a row that is garbage.
        for index in (*places["velocity"][:, 1], *places["current"][:, 1]):
            fine[index] |= np.isnan(table[index])
        besides = places["extra"][:, 1]
        table[besides] = np.where(np.isfinite(table[besides]), table[besides], np.nan)
        idle = np.ones(len(table), dtype=np.bool_)
        idle[[0, *(k for q in ("position", "velocity", "current") for k in places[q][:, 1])]] = False
        fine[idle] = True
        good = fine.all(axis=0)
        if good.all():
            return rows, table
        self.odd.left_out(int(np.count_nonzero(~good)))
        for index in np.flatnonzero(~fine.all(axis=1)):
            self.odd.bad(self.columns.names[index], rows[~fine[index]])
        return rows[good], table[:, good]

    def _count_unknown(self, table: Floats, lacks: NDArray[np.bool_]) -> None:
        """Count the velocities and currents that are missing, of the columns (C,) in which numbers are."""
        for quantity in ("velocity", "current"):
            for index in self.columns.places[quantity][:, 1]:
                if lacks[index]:
                    self.odd.unknown(quantity, self.columns.names[index], int(np.count_nonzero(np.isnan(table[index]))))

    def _next_step_back(self, rows: Rows, table: Floats, is_last: bool) -> tuple[int, bool]:
        """Rows before the first step back of time (all, if none), and whether a new recording starts there."""
        time = table[0]
        last = time[0] if self._last is None else self._last[0]
        steps = np.diff(time, prepend=last)
        back = np.flatnonzero(steps < 0)
        if not len(back):
            return len(rows), False
        end = int(back[0])
        if len(rows) - end <= SUSTAINED and not is_last:
            return end, False
        before = float(last if end == 0 else time[end - 1])
        if not self._is_restart(time[end : end + SUSTAINED + 1], before, end, float(time[0])):
            self._refuse_time(int(rows[end]), before, float(time[end]))
        return end, True

    def _is_restart(self, following: Floats, before: float, end: int, first: float) -> bool:
        start = first if self._last is None or math.isnan(self._clock_start) else self._clock_start
        if self._clock_rows + end < _FEWEST_BEFORE_RESTART or len(following) < 2:
            return False
        near_start = abs(following[0] - start) <= 0.1 * (before - start)
        return bool(near_start and np.all(np.diff(following) >= 0) and following[-1] < before)

    def _refuse_time(self, row: int, before: float, after: float) -> None:
        what = f"time goes back from {before:.9g} s to {after:.9g} s"
        mend = f"sort the file by {self.columns.names[0]}, or split it there if two recordings were joined"
        raise LogError("time-not-rising", what, Where(file=self.name, row=row, column=self.columns.names[0]), mend)

    def _restart(self, row: int, time: float) -> None:
        self.odd.restart(row, time, float(self._last[0]))  # type: ignore[index]
        self._last, self._turns, self._starts_clock = None, None, True
        self._clock_start, self._clock_rows = math.nan, 0

    def _emit(self, rows: Rows, table: Floats) -> list[Log]:
        rows, table = self._without_ties(rows, table)
        if not len(rows):
            return []
        if math.isnan(self.first_time):
            self.first_time = float(table[0, 0])
            self._starts_clock = self.follows is not None and not self.first_time > self.follows
        if math.isnan(self._clock_start):
            self._clock_start = float(table[0, 0])
        before = self._last
        self.odd.intervals.take(rows, table[0], None if before is None else float(before[0]))
        self._last = table[:, -1].copy()
        self._unwrap(rows, table, before)
        self.last_time = float(table[0, -1])
        self._clock_rows += len(rows)
        log = self._log(rows, table)
        self._starts_clock = False
        return [log]

    def _without_ties(self, rows: Rows, table: Floats) -> tuple[Rows, Floats]:
        """Of rows that share a time the first is kept."""
        if self._last is None:
            same_time = np.concatenate([[False], table[0, 1:] == table[0, :-1]])
        else:
            same_time = np.diff(table[0], prepend=self._last[0]) == 0
        if not same_time.any():
            return rows, table
        before = np.concatenate([table[:, :1] if self._last is None else self._last[:, None], table[:, :-1]], axis=1)
        own = slice(len(table) - len(self.columns.places["extra"]))
        repeated = same_time & np.all((table[own] == before[own]) | np.isnan(table[own]), axis=0)
        self.odd.tied(rows[same_time], repeated=int(np.count_nonzero(repeated)))
        return rows[~same_time], table[:, ~same_time]

    def _unwrap(self, rows: Rows, table: Floats, before: Floats | None) -> None:
        """Take whole turns out of jumps that no motion explains, in place."""
        turning = [(j, c) for j, c in self.columns.places["position"] if self.robot.joints[j].is_revolute]
        if self._turns is None:
            self._turns = np.zeros(self.robot.n_joints)
        seconds = np.diff(table[0], prepend=table[0, 0] if before is None else before[0])
        for joint, column in turning:
            raw, last = table[column], table[column, 0] if before is None else before[column]
            if self._turns[joint] == 0 and max(raw.max(), last) - min(raw.min(), last) < math.pi:
                continue
            raw = raw.copy()
            jump = np.diff(raw, prepend=last)
            if self._turns[joint] == 0 and max(jump.max(), -jump.min()) < math.pi:
                continue
            fastest = self.robot.joints[joint].max_velocity or _FASTEST
            turns = np.round(jump / math.tau)
            rest = np.abs(jump - turns * math.tau)
            explained = np.maximum(_WRAP_SHARE * math.tau, np.minimum(1.2 * fastest * seconds, math.pi / 2))
            is_wrap = (turns != 0) & (rest <= explained) & (np.abs(jump) > 2.0 * fastest * seconds)
            if is_wrap.any():
                self.odd.wrapped(joint, rows[is_wrap])
            total = self._turns[joint] - np.cumsum(np.where(is_wrap, turns, 0.0))
            table[column] = raw + total * math.tau
            self._turns[joint] = total[-1]

    def _log(self, rows: Rows, table: Floats) -> Log:
        return Log(
            origin=self.name,
            rows=rows,
            time=table[0],
            position=self._by_joint("position", table),
            velocity=self._by_joint("velocity", table) if len(self.columns.places["velocity"]) else None,
            current=self._by_joint("current", table),
            temperature=self._by_joint("temperature", table) if len(self.columns.places["temperature"]) else None,
            starts_clock=self._starts_clock,
            extra=self._extra(table) if self.n_extra else None,
        )

    def _by_joint(self, quantity: str, table: Floats) -> Floats:
        """(N, J), joint after joint in memory; NaN where the file lacks a joint."""
        places = self.columns.places[quantity]
        if len(places) == self.robot.n_joints:
            first = int(places[0, 1])
            return table[first : first + len(places)].T
        values = np.full((self.robot.n_joints, table.shape[1]), np.nan)
        values[places[:, 0]] = table[places[:, 1]]
        return values.T

    def _extra(self, table: Floats) -> Floats:
        """(N, E); NaN where the file lacks a column."""
        values = np.full((self.n_extra, table.shape[1]), np.nan)
        places = self.columns.places["extra"]
        values[places[:, 0]] = table[places[:, 1]]
        return values.T
