"""Logs of any format, read batch by batch as samples in SI: bad rows left out, time rising, positions without wraps.

A file's columns become the robot's quantities by the recipe's `log` block, which is guessed for a message where it does
not fit. No step holds a file.
"""

import hashlib
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

import numpy as np

from pumaid.dataset import FileFacts, Log
from pumaid.errors import LogError, Note, PumaidError, Where, listed, meant, refuse
from pumaid.io.column_names import EPISODE, clocks, factor_of, guessed, log_block, offered, spelt, stated_unit, unit_in
from pumaid.io.formats import HEAD_BYTES, LogColumn, LogSource, log_format
from pumaid.io.log_form import preset_formats
from pumaid.io.paths import STDIN, LogPath, is_remote, local_copy
from pumaid.maths import Counts, Flags, Floats
from pumaid.robot import QUANTITIES, Conversion, LogFormat, Robot
from pumaid.units import factor

#: What the absence of a quantity's column means.
_ABSENCE = {
    "current": "the runs of these joints show no current and are not identified",
    "velocity": "all velocities are derived from position",
    "temperature": "these temperatures are not known",
}

#: No joint of an arm has a position, velocity or current beyond this (SI): what is, is garbage of the recorder.
ABSURD = 1e6
#: s; what is later is no time, whatever its unit, and what is later than three thousand years is in a smaller one.
ABSURD_TIME, LATEST = 1e20, 1e11
#: s since 1970, as which times are taken for dates: of this century.
EPOCH = 9e8, 4e9
#: A log with a larger share of bad rows is not one with faults but a faulty one.
MAX_BAD = 0.05
#: A jump is a wrap if what remains of it without the turn is within this share of a turn, or within the joint's speed;
#: rad/s, taken as the fastest possible where the recipe gives no maximum: a turn within a quarter second.
_WRAP_SHARE, _FASTEST = 0.02, 8.0 * math.pi
#: Intervals from which the median is taken: enough for any jitter, few enough to hold.
_PROBE = 100_000
#: A gap is this many median intervals, one or two lost packets being jitter, and at least this long (s): shorter ones
#: are within what a ramp of an arm takes, and harm no mean.
_GAP_INTERVALS, _GAP_SECONDS = 5.0, 0.05
#: s, and share of the median: times between samples that vary by more (RMS) blur where an arm speeds up and slows down.
_JITTER_SECONDS, _JITTER_SHARE = 0.005, 0.1
#: Share by which another clock may go faster or slower than the one that is read.
_DRIFT = 0.02
#: Least steps of its position that a joint must move before and after a row for this not to stand by chance. Share of
#: rows below which a few that were read twice do no harm.
_SURELY_MOVES, _FEW = 3.0, 1.0 / 64.0
#: The entry of the rows that have a fault in any column.
_ANY = ""


#: Kinds of faulty rows: the note's slug, what they have, what becomes of them, the largest share of a log's rows that
#: may have it, and how to mend a log with more.
_KINDS = {
    "bad": (
        "bad-samples",
        "no number or one beyond a million",
        "these rows are left out",
        MAX_BAD,
        "of counts of an encoder say what one is (position: {column: ..., scale: rad a count, of motors over the gear"
        " ratio}); else check columns, units ({time: ns}, say) and encoding in the recipe's log block (4294967295 is -1"
        " as uint32-two-complement); where positions and currents stand in different rows, join"
        " them by time (pandas.merge_asof does it)",
    ),
    "foreign": (
        "rows-elsewhere",
        "neither position, velocity nor current, as rows of other messages",
        "they are passed over",
        0.999,
        "name the columns of the joints in the recipe's log block",
    ),
    "repeated": ("bad-samples", "the time and values of the row before", "these rows are left out", 1.0, ""),
    "tied": (
        "bad-samples",
        "the time of the row before and other values",
        "these rows are left out",
        0.5,
        "write the time with more digits",
    ),
    "stale": (
        "bad-samples",
        "all values of the row before amid motion, as if read twice",
        "they are left out",
        1.0,
        "",
    ),
    "velocity": ("column-absent", "no velocity", "speeds are taken from position there", 1.0, ""),
    "current": ("column-absent", "no current", "these samples show nothing of their joints", 1.0, ""),
    "wrapped": ("position-wraps", "a jump of position by a whole turn", "it is taken as continuous", 1.0, ""),
}


class LogReader:
    """The samples of a log, in SI, as `Log` batches; after a pass over them `files` and `notes` tell what was read.

    `robot` is then the one whose `log` was followed: that of the recipe, or what the names of the columns say.

    Parameters
    ----------
    path
        A file as `pumaid.io.paths.expand` gives it; ``-`` is standard input.
    robot
        Its `log` names the columns, their units and signs.
    extra
        Columns to read besides what the recipe names, as the file calls them; they arrive as `Log.extra`.

    Raises
    ------
    LogError
        While iterating: [column-missing, not-a-log, file-not-readable, not-a-number, bad-samples, time-not-rising].
    """

    def __init__(self, path: LogPath, robot: Robot, *, extra: Sequence[str] = ()) -> None:
        self._path, self.robot = path if is_remote(path) else Path(path), robot
        self.extra = tuple(dict.fromkeys(extra))
        self.files: tuple[FileFacts, ...] = ()
        self.notes: tuple[Note, ...] = ()

    def __iter__(self) -> Iterator[Log]:
        name = "<stdin>" if self._path == STDIN else str(self._path)
        with local_copy(self._path) as file:
            before = file.stat()
            with file.open("rb") as stream:
                source = log_format(stream.read(HEAD_BYTES), name)(file, name)
                stream.seek(0)
                digest = hashlib.file_digest(cast(Any, stream), "sha256").hexdigest()
            schema = source.schema()
            self.robot, naming = as_named(schema, self.robot)
            columns = Columns(schema, self.robot, name, extra=self.extra)
            columns.notes += _clocks_apart(source, [column.name for column in schema], self.robot.log)
            log = self.robot.log
            stated = [column.unit for column in schema if column.name == log.column("current", 1)]
            if word := stated_unit(stated[0] if stated else "", "current"):
                self.robot = replace(self.robot, log=replace(log, units={**log.units, "current": word}))
            cleaner = Cleaner(self.robot, columns, name)
            batches = (batch for batch in source.batches(columns.read) if len(batch.rows))
            parts = (part for batch in batches for part in columns.episodes(*batch))
            yield from filter(None, (cleaner.take(*part) for part in parts))
            after = file.stat()
        # Else the digest is of another content.
        if (after.st_size, after.st_mtime_ns) != (before.st_size, before.st_mtime_ns):
            raise LogError(
                "file-not-readable",
                f"{name} changed while it was read",
                Where(file=name),
                "read it again when the recording has ended",
            )
        self.notes = (
            *naming,
            *columns.notes,
            *cleaner.notes(),
            *source.notes,
            *([] if cleaner.n_rows else [Note("empty-log", "the log has a header but no row", Where(file=name))]),
        )
        self.files = (FileFacts(name, digest, cleaner.n_rows, cleaner.interval, cleaner.first_time, cleaner.last_time),)


class Columns:
    """Which of a file's columns (`schema`; `name` for messages) are read for a robot, and what each means.

    Attributes
    ----------
    names, factors
        (C,) column names in the file, time first, and what a number is multiplied by to be SI with the recipe's sign;
        those of `extra` are read without a factor. Before that
        `encoded` numbers (by index) are decoded, and (C,) `zeros` taken away.
    fraction
        A second column of the time and its unit (s), if there is one.
    places
        Quantity -> (k, 2) rows of (index of the joint from 0, index into `names`); ``extra`` the same with the index of
        the column asked for instead of the joint's. These stand last in `names`.
    read
        The columns to read of the file: `names`, then fractions of the time and the number of the recording, if any.
    notes
        What is absent and may be.

    Raises
    ------
    LogError [column-missing]
        Time, a position or a column of `extra` is absent, no current is there at all, or a needed name stands twice;
        with what the file has, the nearest name, or a `log` block to paste. Several are told together (`Faults`).
    """

    def __init__(self, schema: Sequence[LogColumn], robot: Robot, name: str, *, extra: Sequence[str] = ()) -> None:
        header = [column.name for column in schema]
        wanted = {q: [robot.log.column(q, joint.number) for joint in robot.joints] for q in QUANTITIES}
        wanted["extra"] = list(extra)
        refuse(_faults(schema, robot, wanted, name))
        log, units = robot.log, {column.name: column.unit for column in schema}
        unit = stated_unit(units[log.time], "time") or log.units.get("time", "s")
        self.names, factors, zeros = [log.time], [factor(unit)], [0.0]
        self.fraction = (log.fraction, factor(unit_in(log.fraction, "time") or "ns")) if log.fraction else None
        self.encoded: dict[int, Conversion] = {}
        self.places: dict[str, Counts] = {}
        self.notes: list[Note] = []
        for quantity, asked in wanted.items():
            present = {k: column for k, column in enumerate(asked) if column in header}
            lacking = [column for column in asked if column is not None and column not in header]
            # A velocity or temperature that nobody named is passed over in silence.
            usual = getattr(LogFormat(), quantity, None)
            is_asked = quantity == "current" or present or getattr(robot.log, quantity, None) != usual
            if lacking and is_asked and quantity in _ABSENCE:
                text = f"no column {listed(lacking)}: {_ABSENCE[quantity]}"
                self.notes.append(Note("column-absent", text, Where(file=name)))
            if quantity == "velocity" and lacking:
                present = {}
            meanings = {len(self.names) + count: log.conversion(quantity, k + 1) for count, k in enumerate(present)}
            self.encoded |= {k: meaning for k, meaning in meanings.items() if meaning.encoding != "float"}
            zeros += [meaning.zero for meaning in meanings.values()]
            self.places[quantity] = np.array(
                [(k, len(self.names) + count) for count, k in enumerate(present)], dtype=np.int64
            ).reshape(-1, 2)
            self.names += map(str, present.values())
            factors += [
                1.0
                if quantity == "extra"
                else factor_of(robot, quantity, robot.joints[k], unit=stated_unit(units[str(column)], quantity))
                for k, column in present.items()
            ]
        beyond = [
            template.format(joint=joint, joint0=joint - 1, name="")
            for joint in (0, robot.n_joints + 1)
            for template in (robot.log.position, robot.log.current)
            if "{joint" in template
        ]
        more = [column for column in beyond if column in header]
        if more:
            text = f"the log also has {listed(more)}, but {robot.name} has {robot.n_joints} joints: is it this robot's"
            text += " log, and joint 1 its first ({joint0} in the recipe's log block counts from 0)?"
            self.notes.append(Note("more-joints", text, Where(file=name)))
        self.factors, self.zeros = np.array(factors), np.array(zeros)
        self.episode = next(filter(EPISODE.fullmatch, header), "")
        self._counted = np.full((int(bool(self.episode)), 1), np.nan)
        self.read = [*self.names, *(self.fraction or ())[:1], *filter(None, [self.episode])]

    def episodes(self, rows: Counts, table: Floats) -> list[tuple[Counts, Floats, bool]]:
        """The parts of a batch (rows, and values without the number of the recording) that are of one recording each.

        With whether its clock starts anew.
        """
        cut = len(table) - bool(self.episode)
        begins: Flags = np.any(np.abs(np.diff(table[cut:], prepend=self._counted)) > 0.0, axis=0)
        self._counted = table[cut:, -1:]
        ends = pairwise([0, *np.flatnonzero(begins[1:]) + 1, len(rows)])
        return [(rows[start:stop], table[:cut, start:stop], bool(begins[start])) for start, stop in ends]


class Cleaner:
    """Turns the batches of one file into logs, and counts what is worth a note.

    `columns` say what the numbers mean. `n_rows` counts bad rows, too; `first_time` and `last_time` (s) are of the
    samples so far.
    """

    def __init__(self, robot: Robot, columns: Columns, name: str) -> None:
        self.robot, self.columns, self.name = robot, columns, name
        self.n_rows, self.first_time, self.last_time = 0, math.nan, math.nan
        self._last: Floats | None = None
        self._turns = np.zeros(robot.n_joints)
        self._begins = False
        self._faults: dict[str, dict[str, tuple[int, int]]] = {kind: {} for kind in _KINDS}
        self._steps = np.zeros(0)
        self._long = np.zeros((3, 0))

    @property
    def interval(self) -> float:
        """Median of the first times between samples, s."""
        return float(np.median(self._steps)) if len(self._steps) else math.nan

    def take(self, rows: Counts, table: Floats, starts_clock: bool = False) -> Log | None:
        """The samples of the next batch: rows (N,), values (C, N) as the file holds them, which are changed in place.

        Of rows that share a time the first stays; None where no row does. With `starts_clock` time begins anew.

        Raises
        ------
        LogError [time-not-rising]
            Time goes back.
        """
        if starts_clock:
            self._last, self._turns, self._begins = None, np.zeros(self.robot.n_joints), True
        table = self._in_si(table)
        rows, table = self._without_ties(*self._without_bad(rows, table))
        if not len(rows):
            return None
        is_stale = self._mark("stale", rows, {self.columns.names[0]: self._stale(table)})
        repeats = np.diff(np.flatnonzero(~is_stale), prepend=-1) - 1
        rows, table = rows[~is_stale], table[:, ~is_stale]
        before, self._last = self._last, table[:, -1].copy()
        steps = np.diff(table[0], prepend=table[0, 0] if before is None else before[0])
        self._steps = np.concatenate([self._steps, steps[before is None :][: _PROBE - len(self._steps)]])
        is_long = steps > _GAP_SECONDS
        if is_long.any():  # these are held until the median stands
            self._long = np.hstack([self._long, [rows[is_long], table[0, is_long] - steps[is_long], steps[is_long]]])
        self._unwrap(rows, table, before)
        self.first_time = float(table[0, 0]) if math.isnan(self.first_time) else self.first_time
        self.last_time = float(table[0, -1])
        quantities: dict[str, Any] = {"velocity": None, "repeats": repeats, "starts_clock": self._begins}
        self._begins = False
        for quantity, places in self.columns.places.items():
            if len(places) or quantity == "current":
                if len(places) < self.robot.n_joints and quantity != "extra":  # NaN where one is absent
                    values = np.full((self.robot.n_joints, len(rows)), np.nan)
                    values[places[:, 0]] = table[places[:, 1]]
                else:  # they stand side by side
                    values = table[places[0, 1] : places[-1, 1] + 1]
                quantities[quantity] = values.T
        return Log(self.name, rows, table[0], **quantities)

    def _in_si(self, table: Floats) -> Floats:
        """(C, N) values of (C, N) numbers of the file, below which stand fractions of a time that has two columns."""
        columns = self.columns
        fraction, table = table[len(columns.names) :], table[: len(columns.names)]
        for k, conversion in columns.encoded.items():
            table[k] = conversion.decoded(table[k])
        if columns.zeros.any():
            table -= columns.zeros[:, None]
        self._count_in_fractions(table[0])
        table *= columns.factors[:, None]
        if columns.fraction:
            table[0] += columns.fraction[1] * fraction[0]
        return table

    def _count_in_fractions(self, times: Floats) -> None:
        """Where times can only count thousandths or less of a second since 1970, say so; once, at the beginning."""
        first = times[np.isfinite(times)][:1] * self.columns.factors[0]
        if self.n_rows or not len(first) or abs(first[0]) < LATEST:
            return
        for unit in ("ms", "us", "ns"):
            if EPOCH[0] < first[0] * factor(unit) < EPOCH[1]:
                self.columns.factors[0] *= factor(unit)
                text = f"times are {unit} since 1970: no other unit gives a date"
                self.columns.notes.append(
                    Note("columns-named", text, Where(file=self.name, column=self.columns.names[0]))
                )

    def _mark(self, kind: str, rows: Counts, faulty: Mapping[str, Flags]) -> Flags:
        is_faulty = np.logical_or.reduce([np.zeros(len(rows), bool), *faulty.values()])
        counts = self._faults[kind]
        for name, flags in {_ANY: is_faulty, **faulty}.items():
            if flags.any():
                count, first = counts.get(name, (0, int(rows[flags.argmax()])))
                counts[name] = (count + int(np.count_nonzero(flags)), first)
        return is_faulty

    def _without_bad(self, rows: Counts, table: Floats) -> tuple[Counts, Floats]:
        self.n_rows += len(rows)
        limits = np.full((len(table), 1), ABSURD)
        limits[0] = ABSURD_TIME
        if len(rows) and (table.min(axis=1) >= -limits[:, 0]).all() and (table.max(axis=1) <= limits[:, 0]).all():
            return rows, table
        places, names = self.columns.places, self.columns.names
        is_absent = np.isnan(table)
        measured = np.concatenate([places[quantity][:, 1] for quantity in ("position", "velocity", "current")])
        is_foreign = is_absent[measured].all(axis=0)
        if is_foreign.any():
            self._mark("foreign", rows, {names[0]: is_foreign})
            rows, table, is_absent = rows[~is_foreign], table[:, ~is_foreign], is_absent[:, ~is_foreign]
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

    def _without_ties(self, rows: Counts, table: Floats) -> tuple[Counts, Floats]:
        if not len(rows):
            return rows, table
        steps = np.diff(table[0], prepend=table[0, 0] - 1.0 if self._last is None else self._last[0])
        if (steps > 0.0).all():
            return rows, table
        before = np.hstack([table[:, :1] if self._last is None else self._last[:, None], table[:, :-1]])
        name = self.columns.names[0]
        if (steps < 0.0).any():
            back = int(np.argmax(steps < 0.0))
            raise LogError(
                "time-not-rising",
                f"time goes back from {before[0, back]:.9g} s to {table[0, back]:.9g} s",
                Where(file=self.name, row=int(rows[back]), column=name),
                f"delete the row with a wrong time, sort the file by {name}, or, where recordings were joined, split"
                " it, or count them in a column called episode",
            )
        measured = slice(len(table) - len(self.columns.places["extra"]))
        is_same = np.all((table[measured] == before[measured]) | np.isnan(table[measured]), axis=0)
        self._mark("repeated", rows, {name: (steps == 0.0) & is_same})
        self._mark("tied", rows, {name: (steps == 0.0) & ~is_same})
        return rows[steps > 0.0], table[:, steps > 0.0]

    def _stale(self, table: Floats) -> Flags:
        """(N,) rows that repeat the row before while a joint moves on: nothing was measured anew."""
        position, out = table[self.columns.places["position"][:, 1]], np.zeros(table.shape[1], bool)
        out[1:] = (position[:, 1:] == position[:, :-1]).all(axis=0)
        if not out.any():
            return out
        measured = np.nan_to_num(table[1 : len(table) - len(self.columns.places["extra"])])
        out[1:] &= (measured[:, 1:] == measured[:, :-1]).all(axis=0)
        new = np.flatnonzero(~out)
        steps = np.abs(np.diff(position[:, new], prepend=position[:, :1], append=position[:, -1:]))
        least = _SURELY_MOVES * steps.min(axis=1, where=steps > 0.0, initial=np.inf, keepdims=True)
        repeats = np.diff(new, append=len(out)) - 1
        moves = (np.minimum(steps[:, 1:], steps[:, :-1]) > least).any(axis=0) & (repeats > 0)
        # As many as that stand where it turns round, too; at rest what is read may stay the same for long.
        usual = 2.0 * np.median(repeats[moves]) if moves.any() else 0.0
        out &= np.repeat(moves | (repeats <= usual), repeats + 1)
        return out & (out.mean() > _FEW)

    def _unwrap(self, rows: Counts, table: Floats, before: Floats | None) -> None:
        before = table[:, 0] if before is None else before
        seconds = np.diff(table[0], prepend=before[0])
        for joint, column in self.columns.places["position"]:
            if not self.robot.joints[joint].is_revolute:
                continue
            jump = np.diff(table[column], prepend=before[column])
            is_counted = (table[column] == np.round(table[column])).all()  # no rad, and to be refused as counts
            if is_counted or (self._turns[joint] == 0 and np.abs(jump).max() < math.pi):
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
            raise LogError(
                "column-missing",
                f"the currents of {self.name} are empty ({listed(currents)})",
                Where(file=self.name),
                "record the motor currents",
            )
        return notes + self._uneven_times()

    def _uneven_times(self) -> list[Note]:
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


def _clocks_apart(source: LogSource, header: Sequence[str], log: LogFormat) -> Iterator[Note]:
    """Columns that count time faster or slower than the one that is read, by more than `_DRIFT`, units apart."""
    for other in (name for name in clocks(header) if name not in (log.time, log.fraction)):
        ratio = math.nan
        with suppress(LogError, StopIteration):  # it holds texts, or nothing
            steps = np.diff(next(source.batches([log.time, other])).values)
            is_clock = len(steps[1]) > 0 and (steps[1] >= 0.0).all() and np.mean(steps[1] > 0.0) > 0.5
            ratio = float(np.divide(*steps[::-1, steps[0] > 0.0].sum(axis=1))) if is_clock else ratio
        rate = ratio / 1e3 ** round(math.log(ratio, 1e3)) if ratio > 0.0 else 1.0
        if abs(rate - 1.0) > _DRIFT:
            yield Note(
                "time-unit",
                f"{other} runs {rate:.4g} times as fast as {log.time}: if it is right, speeds are {rate:.3g} times too"
                f" large and viscous friction is as much too small; 'time: {other}' in the recipe's log block takes it",
                Where(file=source.name, column=other),
            )


def as_named(schema: Sequence[LogColumn], robot: Robot) -> tuple[Robot, list[Note]]:
    """The robot with the `log` that reads a file: as its names say without doubt, where the recipe says nothing.

    Raises
    ------
    LogError [joints-swapped]
        The file names its joints in another order than the recipe counts them.
    """
    header = [column.name for column in schema]
    log = replace(robot.log, names=spelt(robot.log.names, header))
    robot = replace(robot, log=log)
    positions = [str(log.column("position", joint.number)) for joint in robot.joints]
    is_silent = replace(log, units={}, signs={}, names=(), delay=0.0) == LogFormat()
    joints = {column.same_as: column.joint for column in schema if column.joint}
    naming, is_sure = guessed(header, robot)
    if {log.time, *positions} <= {*header}:
        of = [joints.get(column, "") for column in positions]
        names = [max((name for name in log.names if name in joint), key=len, default="") for joint in of]
        if naming and "{name}" in naming.position and sorted(names) == sorted(log.names) and names != [*log.names]:
            what = f"{log.position} is read for {listed(log.names)}, and in the log these columns are of {listed(of)}"
            mend = f"put this into the recipe, in place of its log block:\n{log_block(naming)}"
            raise LogError("joints-swapped", what, Where(column=positions[0]), mend)
        return robot, []
    if is_silent:  # columns of a device that writes SI
        plain = [
            other
            for other in preset_formats(robot).values()
            if not other.conversions and other.time in header
            if all(
                other.column(key, joint.number) in header for key in ("position", "current") for joint in robot.joints
            )
        ]
        naming, is_sure = (plain[0], True) if plain else (naming, is_sure)
    if naming is None or not is_sure or not is_silent or (joints and "{name}" not in naming.position):
        return robot, []
    velocity, temperature = (
        column if any(naming.column(key, joint.number) in header for joint in robot.joints) else None
        for key, column in (("velocity", naming.velocity), ("temperature", naming.temperature))
    )
    naming = replace(naming, velocity=velocity, temperature=temperature)
    text = f"columns are read by their names, as if the recipe said:\n{log_block(naming)}"
    return replace(robot, log=naming), [Note("columns-named", text)]


def _faults(
    schema: Sequence[LogColumn], robot: Robot, wanted: Mapping[str, list[str | None]], name: str
) -> list[PumaidError]:
    header = [column.name for column in schema]
    faults: list[PumaidError] = []
    currents = list(map(str, wanted["current"]))
    times = [robot.log.time, *([robot.log.fraction] if robot.log.fraction else [])]
    missing = [str(column) for column in [*times, *wanted["position"]] if column not in header]
    missing = missing or ([] if any(column in header for column in currents) else currents)
    where = Where(file=name, row=1)
    if missing:
        what = f"{name} has no column {listed(missing)}; it has {listed(header, 12)}"
        mend = offered(header, robot, missing)
        joints = [column.joint for column in schema if column.joint]
        if joints and not any(name in joint for name in robot.log.names for joint in joints):
            mend = (
                f"the log's joints are {listed([*dict.fromkeys(joints)])}: give each its log_name in the recipe; {mend}"
            )
        parts = (replace(robot, joints=robot.joints[:n], log=LogFormat()) for n in range(robot.n_joints - 1, 0, -1))
        fewer = next((part.n_joints for part in parts if not joints and guessed(header, part)[1]), 0)
        if fewer:
            what = f"{name} has columns of {fewer} of the {robot.n_joints} joints of the recipe"
            mend = "leave the others out of the recipe (a URDF's by --tip LINK), and hold them still while you log"
        faults.append(LogError("column-missing", what, where, mend))
    used = {*times, *(column for columns in wanted.values() for column in columns)}
    doubled = [column for column, times in Counter(header).items() if times > 1 and column in used]
    if doubled:
        what = f"{name} has column {listed(doubled)} more than once"
        faults.append(LogError("column-missing", what, where, "rename or remove all but one"))
    return faults + [
        LogError("column-missing", f"{name} has no column {column}", where, meant(column, header))
        if column not in header
        else LogError("column-missing", f"{column} is a current, which it would explain alone", where, "name another")
        for column in wanted["extra"]
        if column not in header or column in currents
    ]
