"""From a file's numbers to `Log` records: SI, bad rows left out, time rising, positions without wraps."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Log
from pumaid.errors import LogError, Note, Where
from pumaid.io.columns import Columns
from pumaid.io.row_faults import Intervals, RowFaults
from pumaid.robot import Robot

Floats = NDArray[np.float64]
Rows = NDArray[np.int64]

#: No joint of an arm has a position, velocity or current beyond this (SI): what is, is garbage of the recorder.
ABSURD = 1e6
#: s; three thousand years, so that seconds since 1970 pass and nanoseconds taken for seconds do not.
ABSURD_TIME = 1e11
#: Rows that are looked at behind a step back of time, and rows that a recording has at least before it starts anew.
_BEHIND, _FEWEST_BEFORE = 20, 50
#: A jump is a wrap if what remains of it without the turn is within this share of a turn (or within the joint's speed).
_WRAP_SHARE = 0.02
#: rad/s; taken as the fastest possible where the recipe gives no maximum: a turn within a quarter second.
_FASTEST = 8.0 * math.pi


@dataclass(eq=False, slots=True)
class Cleaner:
    """Turns the batches of one file into logs.

    Attributes
    ----------
    robot, columns, name
        What the numbers mean, and the file's name for messages.
    n_extra
        Columns that the user asked for, whether this file has them or not.
    time_factor
        Seconds in one unit of the file's time where the file itself states it, else None.
    follows
        Last time of the file before (s), None if there is none: a first time beyond it continues that clock.
    faults, intervals
        What was found so far that is worth a note.
    first_time, last_time
        s, of the samples so far.
    """

    robot: Robot
    columns: Columns
    name: str
    n_extra: int = 0
    time_factor: float | None = None
    follows: float | None = None
    first_time: float = math.nan
    last_time: float = math.nan
    faults: RowFaults = field(init=False)
    intervals: Intervals = field(default_factory=Intervals)
    _clock_start: float = math.nan
    _clock_rows: int = 0
    _last: Floats | None = None
    _turns: Floats = field(init=False)

    def __post_init__(self) -> None:
        self.faults, self._turns = RowFaults(self.name, self.columns), np.zeros(self.robot.n_joints)

    def take(self, rows: Rows, table: Floats) -> Iterator[Log]:
        """Logs from the next batch: rows (N,), values (C, N) as the file holds them, which are changed in place.

        Raises
        ------
        LogError [time-not-rising]
            Time goes back and what follows is no new recording.
        """
        factors = self.columns.factors.copy()
        factors[0] = self.time_factor or factors[0]
        table *= factors[:, None]
        rows, table = self._without_bad(rows, table)
        starts_clock = False
        while len(rows):
            end = self._step_back(rows, table)
            log = self._log(rows[:end], table[:, :end], starts_clock=starts_clock)
            if log is not None:
                yield log
            if end == len(rows):
                return
            starts_clock = self._restarted(rows[end:], table[0, end:])
            rows, table = rows[end:], table[:, end:]

    def notes(self) -> list[Note]:
        """What a user is told of the file's rows.

        Raises
        ------
        LogError [no-current, bad-samples, clock-too-coarse]
            There is no current at all, too many rows are bad, or time stands still.
        """
        return [*self.faults.notes(), *self.intervals.notes(self.name)]

    def _without_bad(self, rows: Rows, table: Floats) -> tuple[Rows, Floats]:
        """Rows whose time, positions and known velocities and currents are what an arm can have."""
        self.faults.n_rows += len(rows)
        limits = np.full((len(table), 1), ABSURD)
        limits[0] = ABSURD_TIME
        if len(rows) and (table.min(axis=1) >= -limits[:, 0]).all() and (table.max(axis=1) <= limits[:, 0]).all():
            return rows, table
        places = self.columns.places
        is_number = ~np.isnan(table)
        good = np.abs(table) <= limits
        # Temperature and what was asked for besides are a help, not a need; a velocity only checks positions, and most
        # currents are of joints that do not move. Of these an absent one costs no row, but an absurd one marks garbage.
        for quantity in ("temperature", "extra"):
            at = places[quantity][:, 1]
            table[at] = np.where(np.isfinite(table[at]) & (good[at] | (quantity == "extra")), table[at], np.nan)
            good[at] = True
        for quantity in ("velocity", "current"):
            for index in places[quantity][:, 1]:
                good[index] |= ~is_number[index]
                self.faults.unknown(quantity, index, int(np.count_nonzero(~is_number[index])))
        is_good = good.all(axis=0)
        if is_good.all():
            return rows, table
        self.faults.left_out(rows, good)
        return rows[is_good], table[:, is_good]

    def _step_back(self, rows: Rows, table: Floats) -> int:
        """How many rows come before the first step back of time; all, if there is none."""
        last = table[0, 0] if self._last is None else self._last[0]
        back = np.flatnonzero(np.diff(table[0], prepend=last) < 0)
        return int(back[0]) if len(back) else len(rows)

    def _restarted(self, rows: Rows, time: Floats) -> bool:
        """Begin another recording at a row whose time steps back, if what follows looks like one.

        Raises
        ------
        LogError [time-not-rising]
            It does not.
        """
        assert self._last is not None
        before, behind = float(self._last[0]), time[: _BEHIND + 1]
        is_near_start = abs(behind[0] - self._clock_start) <= 0.1 * (before - self._clock_start)
        rises = bool(np.all(np.diff(behind) >= 0)) and behind[-1] < before
        if self._clock_rows < _FEWEST_BEFORE or not is_near_start or not rises:
            column = self.columns.names[0]
            what = f"time goes back from {before:.9g} s to {time[0]:.9g} s"
            mend = f"sort the file by {column}, or split it there if two recordings were joined"
            raise LogError("time-not-rising", what, Where(file=self.name, row=int(rows[0]), column=column), mend)
        self.faults.restart(int(rows[0]), float(time[0]), before)
        self._last, self._clock_start, self._clock_rows = None, math.nan, 0
        self._turns[:] = 0.0
        return True

    def _log(self, rows: Rows, table: Floats, *, starts_clock: bool) -> Log | None:
        """The samples of rows whose time rises; of rows that share a time the first is kept."""
        if not len(rows):
            return None
        rows, table = self._without_ties(rows, table)
        if not len(rows):
            return None
        before = self._last
        self._last = table[:, -1].copy()
        self.intervals.take(rows, table[0], None if before is None else float(before[0]))
        self._unwrap(rows, table, before)
        if math.isnan(self.first_time):
            self.first_time = float(table[0, 0])
            starts_clock = self.follows is not None and not self.first_time > self.follows
        if math.isnan(self._clock_start):
            self._clock_start = float(table[0, 0])
        self.last_time = float(table[0, -1])
        self._clock_rows += len(rows)
        has = {quantity: len(at) > 0 for quantity, at in self.columns.places.items()}
        return Log(
            origin=self.name,
            rows=rows,
            time=table[0],
            position=self._by_place("position", table),
            velocity=self._by_place("velocity", table) if has["velocity"] else None,
            current=self._by_place("current", table),
            temperature=self._by_place("temperature", table) if has["temperature"] else None,
            starts_clock=starts_clock,
            extra=self._by_place("extra", table) if self.n_extra else None,
        )

    def _without_ties(self, rows: Rows, table: Floats) -> tuple[Rows, Floats]:
        before = table[:, :1] - 1.0 if self._last is None else self._last[:, None]
        before = np.concatenate([before, table[:, :-1]], axis=1)
        is_tied = table[0] == before[0]
        if not is_tied.any():
            return rows, table
        measured = slice(len(table) - len(self.columns.places["extra"]))
        is_same = np.all((table[measured] == before[measured]) | np.isnan(table[measured]), axis=0)
        self.faults.tied(rows[is_tied], n_repeated=int(np.count_nonzero(is_tied & is_same)))
        return rows[~is_tied], table[:, ~is_tied]

    def _unwrap(self, rows: Rows, table: Floats, before: Floats | None) -> None:
        """Take whole turns out of jumps that no motion explains, in place."""
        before = table[:, 0] if before is None else before
        seconds = np.diff(table[0], prepend=before[0])
        for joint, column in self.columns.places["position"]:
            if not self.robot.joints[joint].is_revolute:
                continue
            jump = np.diff(table[column], prepend=before[column])
            if self._turns[joint] == 0 and np.abs(jump).max() < math.pi:
                continue
            fastest = self.robot.joints[joint].max_velocity or _FASTEST
            turns = np.round(jump / math.tau)
            rest = np.abs(jump - turns * math.tau)
            explained = np.maximum(_WRAP_SHARE * math.tau, np.minimum(1.2 * fastest * seconds, math.pi / 2))
            is_wrap = (turns != 0) & (rest <= explained) & (np.abs(jump) > 2.0 * fastest * seconds)
            if is_wrap.any():
                self.faults.wrapped(int(joint), rows[is_wrap])
            total = self._turns[joint] - np.cumsum(np.where(is_wrap, turns, 0.0))
            table[column] += total * math.tau
            self._turns[joint] = total[-1]

    def _by_place(self, quantity: str, table: Floats) -> Floats:
        """(N, J) of a quantity, or (N, E) of the extra columns; column after column, NaN where one is absent."""
        width = self.n_extra if quantity == "extra" else self.robot.n_joints
        values = np.full((width, table.shape[1]), np.nan)
        places = self.columns.places[quantity]
        values[places[:, 0]] = table[places[:, 1]]
        return values.T
