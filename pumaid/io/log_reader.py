"""Logs of any format, read batch by batch as samples in SI: bad rows left out, time rising, positions without wraps.

No step holds a file.
"""

import hashlib
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np

from pumaid.dataset import FileFacts, Log
from pumaid.errors import LogError, Note, Where, listed
from pumaid.io.columns import Columns, resolve
from pumaid.io.formats import HEAD_BYTES, log_format
from pumaid.io.paths import STDIN, LogPath, is_remote, local_copy
from pumaid.maths import Counts, Flags, Floats
from pumaid.robot import Robot

Rows = Counts

#: No joint of an arm has a position, velocity or current beyond this (SI): what is, is garbage of the recorder.
ABSURD = 1e6
#: s; three thousand years, so that seconds since 1970 pass and nanoseconds taken for seconds do not.
ABSURD_TIME = 1e11
#: A log with a larger share of bad rows is not one with faults but a faulty one.
MAX_BAD = 0.05
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
#: The entry of the rows that have a fault in any column.
_ANY = ""


class RowFault(NamedTuple):
    """A kind of faulty rows: the note's slug, what they have, what becomes of them, and how to mend a log of which a
    larger share than `limit` has it.
    """

    slug: str
    what: str
    meaning: str
    limit: float = 1.0
    mend: str = ""


_KINDS = {
    "bad": RowFault(
        *("bad-samples", "no number or an absurd one", "these rows are left out", MAX_BAD),
        "check units and columns in the recipe's log block; where positions and currents stand in different rows, join"
        " them by time (pandas.merge_asof does it)",
    ),
    "repeated": RowFault("bad-samples", "the time and values of the row before", "these rows are left out"),
    "tied": RowFault(
        *("bad-samples", "the time of the row before and other values", "these rows are left out", 0.5),
        "write the time with more digits",
    ),
    "velocity": RowFault("column-absent", "no velocity", "speeds are taken from position there"),
    "current": RowFault(
        "column-absent", "no current", "these samples show nothing of their joints, and are not fitted"
    ),
    "wrapped": RowFault("position-wraps", "a jump of position by a whole turn", "it is taken as continuous"),
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
        Columns to read besides what the recipe names, as the files call them; they arrive as `Log.extra`.

    Raises
    ------
    LogError
        While iterating: [column-missing, not-a-log, file-not-readable, not-a-number, bad-samples, time-not-rising].
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

    def _samples(self, file: Path, name: str) -> Iterator[Log]:
        before = file.stat()
        with file.open("rb") as stream:
            source = log_format(stream.read(HEAD_BYTES), name)(file, name)
            stream.seek(0)
            digest = hashlib.file_digest(cast(Any, stream), "sha256").hexdigest()
        columns = resolve(source.schema(), self._robot, name, extra=self.extra)
        follows = next((facts.last_time for facts in reversed(self.files) if facts.rows), None)
        cleaner = Cleaner(self._robot, columns, name, follows=follows)
        for rows, values in source.batches(columns.names):
            log = cleaner.take(rows, values)
            if log is not None:
                yield log
        notes = [*columns.notes, *cleaner.notes(), *source.notes]
        if not cleaner.n_rows:
            notes.append(Note("empty-log", "the log has a header but no row", Where(file=name)))
        after = file.stat()
        # Else the digest is of another content.
        if (after.st_size, after.st_mtime_ns) != (before.st_size, before.st_mtime_ns):
            what, mend = f"{name} changed while it was read", "read it again when the recording has ended"
            raise LogError("file-not-readable", what, Where(file=name), mend)
        times = (cleaner.interval, cleaner.first_time, cleaner.last_time)
        self.files = (*self.files, FileFacts(name, digest, cleaner.n_rows, *times))
        self.notes = (*self.notes, *notes)


class Cleaner:
    """Turns the batches of one file into logs, and counts what is worth a note.

    `columns` say what the numbers mean. A first time beyond `follows`, the last time of the file before (s), continues
    that clock. `n_rows` counts bad rows, too; `first_time` and `last_time` (s) are of the samples so far.
    """

    def __init__(self, robot: Robot, columns: Columns, name: str, *, follows: float | None) -> None:
        self.robot, self.columns, self.name, self.follows = robot, columns, name, follows
        self.n_rows, self.first_time, self.last_time = 0, math.nan, math.nan
        self._last: Floats | None = None
        self._turns = np.zeros(robot.n_joints)
        self._faults: dict[str, dict[str, tuple[int, int]]] = {kind: {} for kind in _KINDS}
        self._steps = np.zeros(0)
        self._long = np.zeros((3, 0))

    @property
    def interval(self) -> float:
        """Median of the first times between samples, s."""
        return float(np.median(self._steps)) if len(self._steps) else math.nan

    def take(self, rows: Rows, table: Floats) -> Log | None:
        """The samples of the next batch: rows (N,), values (C, N) as the file holds them, which are changed in place.

        Of rows that share a time the first stays; None where no row does.

        Raises
        ------
        LogError [time-not-rising]
            Time goes back.
        """
        table *= self.columns.factors[:, None]
        rows, table = self._without_ties(*self._without_bad(rows, table))
        if not len(rows):
            return None
        before, self._last = self._last, table[:, -1].copy()
        self._count_steps(rows, table[0], before)
        self._unwrap(rows, table, before)
        starts_clock = before is None and self.follows is not None and not table[0, 0] > self.follows
        self.first_time = float(table[0, 0]) if before is None else self.first_time
        self.last_time = float(table[0, -1])
        quantities = {quantity: self._by_place(quantity, table) for quantity in self.columns.places}
        return Log(self.name, rows, table[0], starts_clock=starts_clock, **quantities)

    def _mark(self, kind: str, rows: Rows, faulty: Mapping[str, Flags]) -> Flags:
        """Count, by column, rows (N,) with a fault; (N,) whether they have it in any column."""
        is_faulty = np.logical_or.reduce([np.zeros(len(rows), bool), *faulty.values()])
        counts = self._faults[kind]
        for name, flags in {_ANY: is_faulty, **faulty}.items():
            if flags.any():
                count, first = counts.get(name, (0, int(rows[flags.argmax()])))
                counts[name] = (count + int(np.count_nonzero(flags)), first)
        return is_faulty

    def _without_bad(self, rows: Rows, table: Floats) -> tuple[Rows, Floats]:
        """Rows whose time, positions and measured velocities and currents are what an arm can have."""
        self.n_rows += len(rows)
        limits = np.full((len(table), 1), ABSURD)
        limits[0] = ABSURD_TIME
        if len(rows) and (table.min(axis=1) >= -limits[:, 0]).all() and (table.max(axis=1) <= limits[:, 0]).all():
            return rows, table
        places, names = self.columns.places, self.columns.names
        is_absent = np.isnan(table)
        good = np.abs(table) <= limits
        # Temperature and what was asked for besides are a help, not a need; a velocity only checks positions, and most
        # currents are of joints that do not move. Of these an absent one costs no row, but an absurd one marks garbage.
        for quantity in ("temperature", "extra"):
            at = places[quantity][:, 1]
            table[at] = np.where(np.isfinite(table[at]) & (good[at] | (quantity == "extra")), table[at], np.nan)
            good[at] = True
        for quantity in ("velocity", "current"):
            at = places[quantity][:, 1]
            self._mark(quantity, rows, {names[k]: is_absent[k] for k in at})
            good[at] |= is_absent[at]
        is_bad = self._mark(
            "bad", rows, {name: ~flags for name, flags in zip(names, good, strict=True) if not flags.all()}
        )
        return rows[~is_bad], table[:, ~is_bad]

    def _without_ties(self, rows: Rows, table: Floats) -> tuple[Rows, Floats]:
        if not len(rows):
            return rows, table
        steps = np.diff(table[0], prepend=table[0, 0] - 1.0 if self._last is None else self._last[0])
        if (steps > 0.0).all():
            return rows, table
        before = np.hstack([table[:, :1] if self._last is None else self._last[:, None], table[:, :-1]])
        name = self.columns.names[0]
        if (steps < 0.0).any():
            back = int(np.argmax(steps < 0.0))
            what = f"time goes back from {before[0, back]:.9g} s to {table[0, back]:.9g} s"
            mend = f"sort the file by {name}, or split it there if two recordings were joined"
            raise LogError("time-not-rising", what, Where(file=self.name, row=int(rows[back]), column=name), mend)
        measured = slice(len(table) - len(self.columns.places["extra"]))
        is_same = np.all((table[measured] == before[measured]) | np.isnan(table[measured]), axis=0)
        self._mark("repeated", rows, {name: (steps == 0.0) & is_same})
        self._mark("tied", rows, {name: (steps == 0.0) & ~is_same})
        return rows[steps > 0.0], table[:, steps > 0.0]

    def _count_steps(self, rows: Rows, time: Floats, before: Floats | None) -> None:
        """Take in the times between samples; those that may be gaps are held until the median stands."""
        steps = np.diff(time, prepend=time[0] if before is None else before[0])
        room = _PROBE - len(self._steps)
        self._steps = np.concatenate([self._steps, steps[before is None :][:room]])
        is_long = steps > _GAP_SECONDS
        if is_long.any():
            self._long = np.hstack([self._long, [rows[is_long], time[is_long] - steps[is_long], steps[is_long]]])

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
            self._mark("wrapped", rows, {f"joint {joint + 1}": is_wrap})
            total = self._turns[joint] - np.cumsum(np.where(is_wrap, turns, 0.0))
            table[column] += total * math.tau
            self._turns[joint] = total[-1]

    def _by_place(self, quantity: str, table: Floats) -> Any:
        """(N, J) of a quantity, or (N, E) of the extra columns, column after column, NaN where one is absent.

        None where there is no velocity, no temperature, or nothing extra was asked for.
        """
        places = self.columns.places[quantity]
        if not len(places) and quantity != "current":
            return None
        values = np.full((len(places) if quantity == "extra" else self.robot.n_joints, table.shape[1]), np.nan)
        values[places[:, 0]] = table[places[:, 1]]
        return values.T

    def notes(self) -> list[Note]:
        """What is worth a note about the file's rows.

        Raises
        ------
        LogError [bad-samples, column-missing]
            Too many rows are bad or share their time, or there is no current at all.
        """
        notes = []
        for kind, (slug, what, meaning, limit, mend) in _KINDS.items():
            counts = dict(self._faults[kind])
            total, row = counts.pop(_ANY, (0, 0))
            where = Where(file=self.name, row=row, column=max(counts, key=lambda name: counts[name], default=None))
            columns = [f"{name} in {count} (first in row {first})" for name, (count, first) in counts.items()]
            text = f"{total} of {self.n_rows} rows have {what}: {listed(columns, separator='; ')}"
            if total > limit * self.n_rows:
                raise LogError(slug, text, where, mend)
            notes += [Note(slug, f"{text}; {meaning}", where)] if total else []
        currents = [self.columns.names[k] for k in self.columns.places["current"][:, 1]]
        if all(self._faults["current"].get(name, (0, 0))[0] == self.n_rows > 0 for name in currents):
            what = f"the currents of {self.name} are empty ({listed(currents)})"
            raise LogError("column-missing", what, Where(file=self.name), "record the motor currents")
        return notes + self._uneven_times()

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
