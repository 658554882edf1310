"""Logs of any format, read batch by batch as samples in SI: bad rows left out, time rising, positions without wraps.

No step holds a file.
"""

import hashlib
import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from pumaid.dataset import FileFacts, Log
from pumaid.errors import LogError, Note, Where, listed, nearest
from pumaid.io.columns import ALIKE, Columns, resolve
from pumaid.io.formats import HEAD_BYTES, LogSource, log_format
from pumaid.io.paths import STDIN, LogPath, is_remote, local_copy
from pumaid.maths import Counts, Floats
from pumaid.robot import Robot

Rows = Counts

#: No joint of an arm has a position, velocity or current beyond this (SI): what is, is garbage of the recorder.
ABSURD = 1e6
#: s; three thousand years, so that seconds since 1970 pass and nanoseconds taken for seconds do not.
ABSURD_TIME = 1e11
#: A log with a larger share of bad rows is not one with faults but a faulty one.
MAX_BAD = 0.05
#: Rows that are looked at behind a step back of time, and rows that a recording has at least before it starts anew.
_BEHIND, _FEWEST_BEFORE = 20, 50
#: A jump is a wrap if what remains of it without the turn is within this share of a turn (or within the joint's speed).
_WRAP_SHARE = 0.02
#: rad/s; taken as the fastest possible where the recipe gives no maximum: a turn within a quarter second.
_FASTEST = 8.0 * math.pi
#: Intervals from which the median is taken: enough for any jitter, few enough to hold.
_PROBE = 100_000
#: A gap is this many median intervals: one or two lost packets are jitter, five are a hole ...
_GAP_INTERVALS = 5.0
#: ... and at least this long (s): shorter ones are within what a ramp of an arm takes, and harm no mean.
_GAP_SECONDS = 0.05
#: s, and share of the median: times between samples that vary by more (RMS) blur where an arm speeds up and slows down.
_JITTER_SECONDS, _JITTER_SHARE = 0.005, 0.1
#: What the absence of a quantity means where a part of its numbers, and where all are absent.
_ABSENCE = {
    "velocity": ("speeds are taken from position there", "these velocities are derived from position"),
    "current": (
        "these samples show nothing of their joints, and are not fitted",
        "the runs of these joints show no current and are not identified",
    ),
}


class LogReader:
    """The samples of some logs, in SI, as an iterable of `Log` batches in the order of the files.

    A file whose first time follows the last time of the file before shares its clock; else its first batch has
    `starts_clock` set. After the pass `files` and `notes` tell what was read.

    Parameters
    ----------
    paths
        Files as `pumaid.io.paths.expand` gives them; ``-`` is standard input.
    robot
        Its `log` names the columns, their units and signs.
    extra
        Columns to read besides what the recipe names, as the files call them; they arrive as `Log.extra`, unknown in a
        file that lacks them.

    Raises
    ------
    LogError
        While iterating: [column-missing, column-doubled, no-current, no-header, not-a-log, damaged-log, unreadable-log,
        not-a-number, ragged-row, bad-samples, time-not-rising, clock-too-coarse].
    """

    def __init__(self, paths: Iterable[LogPath], robot: Robot, *, extra: Sequence[str] = ()) -> None:
        self._paths = tuple(path if is_remote(path) else Path(path) for path in paths)
        self._robot = robot
        self.extra = tuple(dict.fromkeys(extra))
        self.files: tuple[FileFacts, ...] = ()
        self.notes: tuple[Note, ...] = ()

    def __iter__(self) -> Iterator[Log]:
        self.files, self.notes = (), ()
        for path in self._paths:
            name = "<stdin>" if path == STDIN else str(path)
            with local_copy(path) as file:
                yield from self._samples(file, name)

    def check_extra(self) -> None:
        """Look for the extra columns in the files' headers, but not in standard input, which can be read once.

        Raises
        ------
        LogError [column-missing]
            No file has one of them; with the nearest names.
        """
        if not self.extra or STDIN in self._paths:
            return
        have: dict[str, None] = {}
        for path in self._paths:
            with local_copy(path) as file:
                have |= dict.fromkeys(column.name for column in log_source(file, str(path)).schema())
        missing = [column for column in self.extra if column not in have]
        if missing:
            hints = [
                f"did you mean {near} for {name}?" for name in missing if (near := nearest(name, have, cutoff=ALIKE))
            ]
            what = f"no log has a column {listed(missing)}; there are {listed(list(have), 12)}"
            mend = "; ".join(hints) or "name a column as the logs' header does"
            raise LogError("column-missing", what, Where(str(self._paths[0]), row=1, column=missing[0]), mend)

    def _samples(self, file: Path, name: str) -> Iterator[Log]:
        before = file.stat()
        with file.open("rb") as stream:
            digest = hashlib.file_digest(cast(Any, stream), "sha256").hexdigest()
        source = log_source(file, name)
        columns = resolve(source.schema(), self._robot, name, extra=self.extra)
        follows = next((facts.last_time for facts in reversed(self.files) if facts.rows), None)
        cleaner = Cleaner(self._robot, columns, name, n_extra=len(self.extra), follows=follows)
        for rows, values in source.batches(columns.names):
            yield from cleaner.take(rows, values)
        notes = [*columns.notes, *cleaner.notes(), *source.notes]
        if not cleaner.n_rows:
            notes.append(Note("empty-log", "the log has a header but no row", Where(file=name)))
        after = file.stat()
        # Else the digest is of another content.
        if (after.st_size, after.st_mtime_ns) != (before.st_size, before.st_mtime_ns):
            what, mend = f"{name} changed while it was read", "read it again when the recording has ended"
            raise LogError("unreadable-log", what, Where(file=name), mend)
        times = (cleaner.interval, cleaner.first_time, cleaner.last_time)
        self.files = (*self.files, FileFacts(name, digest, cleaner.n_rows, *times))
        self.notes = (*self.notes, *notes)


def log_source(file: Path, name: str) -> LogSource:
    """A file on this machine as a log of the format that its first bytes show; `name` is for messages.

    Raises
    ------
    LogError [not-a-log]
        It is of no format that is read.
    """
    with file.open("rb") as stream:
        head = stream.read(HEAD_BYTES)
    return log_format(head, name)(file, name)


@dataclass(slots=True)
class RowCount:
    """How many rows have a fault, and the first of them."""

    count: int = 0
    first: int = 0

    def add(self, rows: Rows) -> None:
        """Count (N,) rows."""
        self.first = self.first or int(rows[0]) if len(rows) else self.first
        self.count += len(rows)


class Cleaner:
    """Turns the batches of one file into logs, and counts what is worth a note.

    `columns` say what the numbers mean, `n_extra` how many columns the user asked for, whether this file has them or
    not. A first time beyond `follows`, the last time of the file before (s), continues that clock. `n_rows` counts bad
    rows, too; `first_time` and `last_time` (s) are of the samples so far.
    """

    def __init__(self, robot: Robot, columns: Columns, name: str, *, n_extra: int, follows: float | None) -> None:
        self.robot, self.columns, self.name, self.n_extra, self.follows = robot, columns, name, n_extra, follows
        self.n_rows, self._n_bad, self._n_repeated = 0, 0, 0
        self.first_time = self.last_time = math.nan
        self._begin_clock()
        self._restarts: list[Note] = []
        self._bad: dict[str, RowCount] = defaultdict(RowCount)
        self._unknown: Counter[int] = Counter()
        self._ties = RowCount()
        self._wraps: dict[int, RowCount] = defaultdict(RowCount)
        self._steps = np.zeros(0)
        self._long = np.zeros((3, 0))

    def _begin_clock(self) -> None:
        self._last: Floats | None = None
        self._clock_start, self._clock_rows = math.nan, 0
        self._turns = np.zeros(self.robot.n_joints)

    @property
    def interval(self) -> float:
        """Median of the first times between samples, s."""
        return float(np.median(self._steps)) if len(self._steps) else math.nan

    def take(self, rows: Rows, table: Floats) -> Iterator[Log]:
        """Logs from the next batch: rows (N,), values (C, N) as the file holds them, which are changed in place.

        Raises
        ------
        LogError [time-not-rising]
            Time goes back and what follows is no new recording.
        """
        table *= self.columns.factors[:, None]
        rows, table = self._without_bad(rows, table)
        starts_clock = False
        while len(rows):
            last = table[0, 0] if self._last is None else self._last[0]
            back = np.flatnonzero(np.diff(table[0], prepend=last) < 0)
            end = int(back[0]) if len(back) else len(rows)
            log = self._log(rows[:end], table[:, :end], starts_clock=starts_clock)
            if log is not None:
                yield log
            rows, table = rows[end:], table[:, end:]
            if len(rows):
                self._restart(rows, table[0])
                starts_clock = True

    def _without_bad(self, rows: Rows, table: Floats) -> tuple[Rows, Floats]:
        """Rows whose time, positions and measured velocities and currents are what an arm can have."""
        self.n_rows += len(rows)
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
        for index in (*places["velocity"][:, 1], *places["current"][:, 1]):
            good[index] |= ~is_number[index]
            self._unknown[int(index)] += int(np.count_nonzero(~is_number[index]))
        is_good = good.all(axis=0)
        self._n_bad += int(np.count_nonzero(~is_good))
        for index in np.flatnonzero(~good.all(axis=1)):
            self._bad[self.columns.names[index]].add(rows[~good[index]])
        return rows[is_good], table[:, is_good]

    def _restart(self, rows: Rows, time: Floats) -> None:
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
        text = f"time starts anew at {time[0]:.6g} s after {before:.6g} s: taken for another recording"
        self._restarts.append(Note("clock-restarts", text, Where(file=self.name, row=int(rows[0]))))
        self._begin_clock()

    def _log(self, rows: Rows, table: Floats, *, starts_clock: bool) -> Log | None:
        """The samples of rows whose time rises; of rows that share a time the first stays."""
        if len(rows):
            rows, table = self._without_ties(rows, table)
        if not len(rows):
            return None
        before, self._last = self._last, table[:, -1].copy()
        self._count_steps(rows, table[0], before)
        self._unwrap(rows, table, before)
        if math.isnan(self.first_time):
            self.first_time = float(table[0, 0])
            starts_clock = self.follows is not None and not self.first_time > self.follows
        if not self._clock_rows:
            self._clock_start = float(table[0, 0])
        self.last_time = float(table[0, -1])
        self._clock_rows += len(rows)
        quantities = {quantity: self._by_place(quantity, table) for quantity in self.columns.places}
        return Log(self.name, rows, table[0], starts_clock=starts_clock, **quantities)

    def _without_ties(self, rows: Rows, table: Floats) -> tuple[Rows, Floats]:
        last = table[:, :1] - 1.0 if self._last is None else self._last[:, None]
        before = np.concatenate([last, table[:, :-1]], axis=1)
        is_tied = table[0] == before[0]
        if not is_tied.any():
            return rows, table
        measured = slice(len(table) - len(self.columns.places["extra"]))
        is_same = np.all((table[measured] == before[measured]) | np.isnan(table[measured]), axis=0)
        self._ties.add(rows[is_tied])
        self._n_repeated += int(np.count_nonzero(is_tied & is_same))
        return rows[~is_tied], table[:, ~is_tied]

    def _count_steps(self, rows: Rows, time: Floats, before: Floats | None) -> None:
        """Take in the times between samples; those that may be gaps are held until the median stands."""
        steps = np.diff(time, prepend=time[0] if before is None else before[0])
        room = _PROBE - len(self._steps)
        self._steps = np.concatenate([self._steps, steps[before is None :][:room]])
        is_long = steps > _GAP_SECONDS
        if is_long.any():
            self._long = np.hstack([self._long, [rows[is_long], time[is_long] - steps[is_long], steps[is_long]]])
            if len(self._steps) == _PROBE:
                self._long = self._long[:, self._long[2] > _GAP_INTERVALS * self.interval]

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
                self._wraps[int(joint)].add(rows[is_wrap])
            total = self._turns[joint] - np.cumsum(np.where(is_wrap, turns, 0.0))
            table[column] += total * math.tau
            self._turns[joint] = total[-1]

    def _by_place(self, quantity: str, table: Floats) -> Any:
        """(N, J) of a quantity, or (N, E) of the extra columns, column after column, NaN where one is absent.

        None where there is no velocity, no temperature, or nothing extra was asked for.
        """
        width = self.n_extra if quantity == "extra" else self.robot.n_joints
        places = self.columns.places[quantity]
        if not width or (not len(places) and quantity in ("velocity", "temperature")):
            return None
        values = np.full((width, table.shape[1]), np.nan)
        values[places[:, 0]] = table[places[:, 1]]
        return values.T

    def notes(self) -> list[Note]:
        """What is worth a note about the file's rows.

        Raises
        ------
        LogError [no-current, bad-samples, clock-too-coarse]
            There is no current at all, too many rows are bad, or time stands still.
        """
        notes = [*self._restarts, *self._bad_rows()]
        for quantity, (of_part, of_all) in _ABSENCE.items():
            counts = {self.columns.names[at]: self._unknown[int(at)] for at in self.columns.places[quantity][:, 1]}
            empty = [name for name, count in counts.items() if count == self.n_rows > 0]
            partly = [f"{name} in {count}" for name, count in counts.items() if 0 < count < self.n_rows]
            if quantity == "current" and empty == [*counts] != []:
                what = f"the currents of {self.name} are empty ({listed(empty)})"
                raise LogError("no-current", what, Where(file=self.name, column=empty[0]), "record the motor currents")
            texts = [f"column {listed(empty)} is empty: {of_all}"] if empty else []
            if partly:
                texts.append(f"there is no {quantity} in some of {self.n_rows} rows ({listed(partly)}): {of_part}")
            notes += [Note(f"{quantity}-absent", text, Where(file=self.name)) for text in texts]
        if self._ties.count:
            notes.append(self._tied_rows())
        if self._wraps:
            named = ", ".join(f"joint {joint + 1} ({self._wraps[joint].count} times)" for joint in sorted(self._wraps))
            joint = min(self._wraps, key=lambda joint: self._wraps[joint].first)
            where = Where(file=self.name, row=self._wraps[joint].first, joint=joint + 1)
            text = f"position jumps by a whole turn and is taken as continuous: {named}"
            notes.append(Note("position-wraps", text, where))
        return notes + self._uneven_times()

    def _bad_rows(self) -> list[Note]:
        if not self._bad:
            return []
        counts = [f"{name} in {bad.count} (first in row {bad.first})" for name, bad in self._bad.items()]
        text = f"{self._n_bad} of {self.n_rows} rows have no number or an absurd one: {listed(counts, separator='; ')}"
        row = min(bad.first for bad in self._bad.values())
        if self._n_bad <= MAX_BAD * self.n_rows:
            return [Note("bad-samples", f"{text}; these rows are left out", Where(file=self.name, row=row))]
        mend = (
            "check units and columns in the recipe's log block; where positions and currents stand in different rows,"
            " join them by time (pandas.merge_asof does it)"
        )
        column = max(self._bad, key=lambda name: self._bad[name].count)
        raise LogError("bad-samples", text, Where(file=self.name, row=row, column=column), mend)

    def _tied_rows(self) -> Note:
        count, n_changed = self._ties.count, self._ties.count - self._n_repeated
        where = Where(file=self.name, row=self._ties.first, column=self.columns.names[0])
        text = f"{count} of {self.n_rows} rows have the time of the row before (first in row {self._ties.first})"
        if n_changed > 0.5 * self.n_rows:
            what = f"{text}, so the samples cannot be told apart in time"
            raise LogError("clock-too-coarse", what, where, "write the time with more digits")
        more = f"; {n_changed} of them hold other values: the clock is coarser than the sampling" if n_changed else ""
        return Note("time-repeated", f"{text} and are left out{more}", where)

    def _uneven_times(self) -> list[Note]:
        """A note if times jitter, and one if there are gaps."""
        notes, median = [], self.interval
        limit = max(_GAP_INTERVALS * median, _GAP_SECONDS)
        even = self._steps[self._steps <= limit]
        jitter = float(np.sqrt(np.mean((even - median) ** 2))) if len(even) else 0.0
        if jitter > max(_JITTER_SECONDS, _JITTER_SHARE * median):
            text = f"times between samples vary by {1e3 * jitter:.2g} ms RMS about {1e3 * median:.3g} ms"
            more = "where the stamps and not the samples are uneven, speeds and friction come out wrong"
            notes.append(Note("clock-jitter", f"{text}: {more}", Where(file=self.name)))
        rows, starts, seconds = self._long[:, self._long[2] > limit]
        if len(rows):
            more = f" ... ({len(rows)} in all, the longest {seconds.max():.3g} s)" if len(rows) > 1 else ""
            text = f"samples are missing: {seconds[0]:.3g} s at {starts[0]:.6g} s{more}"
            about = f"the median interval is {median:.4g} s and no run crosses a gap"
            notes.append(Note("gaps", f"{text}; {about}", Where(file=self.name, row=int(rows[0]))))
        return notes
