"""What is odd about the rows of a file, or of a part of one, and what is told of it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import LogError, Note, Where
from pumaid.io.intervals import Intervals

Rows = NDArray[np.int64]

#: A log with a larger share of bad rows is not one with faults but a faulty one.
MOST_BAD = 0.05
#: Rows of a kind that are named; the others are counted.
_NAMED = 3
#: Columns that are named where many have bad numbers.
_NAMED_COLUMNS = 6


@dataclass(eq=False, slots=True)
class Oddities:
    """Bad rows, times that repeat, gaps, wraps and restarts; those of consecutive parts of a file can be joined.

    Attributes
    ----------
    name, time_column, currents
        The file's and the columns' names, for messages.
    n_rows
        Rows read, bad ones included.
    n_lines
        Lines of a text that was read in parts; the rows of the next part count from its own first line.
    intervals
        The times between samples.
    restarts, ends
        Notes on recordings that begin anew, and on the file's last row.
    """

    name: str
    time_column: str
    currents: tuple[str, ...] = ()
    n_rows: int = 0
    n_lines: int = 0
    intervals: Intervals = field(default_factory=Intervals)
    restarts: list[Note] = field(default_factory=list)
    ends: list[Note] = field(default_factory=list)
    _bad: dict[str, list[int]] = field(default_factory=dict)
    _bad_counts: dict[str, int] = field(default_factory=dict)
    _n_bad: int = 0
    _unknown: dict[str, dict[str, int]] = field(default_factory=dict)  # by quantity and column
    _same: list[int] = field(default_factory=list)
    _n_same: int = 0
    _n_ties: int = 0
    _wraps: dict[int, int] = field(default_factory=dict)
    _first_wrap: dict[int, int] = field(default_factory=dict)

    def bad(self, column: str, rows: Rows) -> None:
        """Rows (N,) in which a column has no number, or an absurd one."""
        self._name_some(self._bad.setdefault(column, []), rows)
        self._bad_counts[column] = self._bad_counts.get(column, 0) + len(rows)

    def unknown(self, quantity: str, column: str, count: int) -> None:
        """So many rows lack the number of a column, and are kept all the same."""
        if count:
            counts = self._unknown.setdefault(quantity, {})
            counts[column] = counts.get(column, 0) + count

    def left_out(self, count: int) -> None:
        """So many rows are left out for that."""
        self._n_bad += count

    def tied(self, rows: Rows, *, repeated: int) -> None:
        """Rows (N,) that have the time of the row before; so many of them hold the same values, too."""
        self._name_some(self._same, rows)
        self._n_same += repeated
        self._n_ties += len(rows) - repeated

    def wrapped(self, joint: int, rows: Rows) -> None:
        """Rows (N,) at which a joint (from 0) jumps by whole turns."""
        self._wraps[joint] = self._wraps.get(joint, 0) + len(rows)
        self._first_wrap.setdefault(joint, int(rows[0]))

    def restart(self, row: int, time: float, before: float) -> None:
        """A recording that begins anew."""
        text = f"time starts anew at {time:.6g} s after {before:.6g} s: taken for another recording"
        self.restarts.append(Note("clock-restarts", text, Where(file=self.name, row=row)))

    @property
    def can_join(self) -> bool:
        """Whether a part with them is what it would be if the whole file were read."""
        return not self.restarts and not self._wraps

    def fit(self, following: Oddities) -> bool:
        """Whether those of the next part mean the same beside these: its gaps do not hang on its own median."""
        return following.can_join and self.intervals.fit(following.intervals)

    def join(self, following: Oddities, *, border: tuple[float, float]) -> None:
        """Take those of the next part of the file, which `fit`.

        Parameters
        ----------
        following
            Rows count from the part's own first line.
        border
            Times (s) of the last sample before it and of its first.
        """
        above = self.n_lines
        for column, rows in following._bad.items():
            self._name_some(self._bad.setdefault(column, []), np.array(rows, dtype=np.int64) + above)
            self._bad_counts[column] = self._bad_counts.get(column, 0) + following._bad_counts[column]
        for quantity, counts in following._unknown.items():
            for column, count in counts.items():
                self.unknown(quantity, column, count)
        self._name_some(self._same, np.array(following._same, dtype=np.int64) + above)
        self._n_bad += following._n_bad
        self._n_same += following._n_same
        self._n_ties += following._n_ties
        self.intervals.join(following.intervals, above, border=border)
        self.ends += [
            replace(note, where=replace(note.where, row=(note.where.row or 0) + above)) for note in following.ends
        ]
        self.n_rows += following.n_rows
        self.n_lines += following.n_lines

    def notes(self) -> list[Note]:
        """What a user is told.

        Raises
        ------
        LogError [no-current, bad-samples, clock-too-coarse]
            There is no current at all, too many rows are bad, or time stands still.
        """
        self._check_currents()
        found = [*self.restarts, *self._bad_note(), *self._unknown_notes(), *self._tie_note(), *self._wrap_note()]
        return [*found, *self.intervals.notes(self.name), *self.ends]

    def _name_some(self, named: list[int], rows: Rows) -> None:
        named += rows[: _NAMED - len(named)].tolist()

    def _bad_note(self) -> list[Note]:
        if not self._n_bad:
            return []
        parts = [
            f"{name} in {count} (row{'s' if count > 1 else ''} {', '.join(map(str, self._bad[name]))}"
            f"{' ...' if count > _NAMED else ''})"
            for name, count in list(self._bad_counts.items())[:_NAMED_COLUMNS]
        ]
        n_more = len(self._bad_counts) - _NAMED_COLUMNS
        more = f" and {n_more} more columns" if n_more > 0 else ""
        text = f"{self._n_bad} of {self.n_rows} rows have no number or an absurd one: {'; '.join(parts)}{more}"
        row = min(min(first) for first in self._bad.values())
        if self._n_bad > MOST_BAD * self.n_rows:
            mend = "check units and columns in the recipe's log block; leave out what was not measured"
            without = max(self._unknown.get("current", {}).values(), default=0)
            if self._n_bad + without >= (1.0 - MOST_BAD) * self.n_rows and without > MOST_BAD * self.n_rows:
                mend = "positions and currents stand in different rows: join them by time (pandas.merge_asof does it)"
            column = max(self._bad_counts, key=lambda name: self._bad_counts[name])
            raise LogError("bad-samples", text, Where(file=self.name, row=row, column=column), mend)
        return [Note("bad-samples", f"{text}; these rows are left out", Where(file=self.name, row=row))]

    def _empty(self, quantity: str) -> list[str]:
        """Columns without any number."""
        return [name for name, count in self._unknown.get(quantity, {}).items() if count == self.n_rows]

    def _check_currents(self) -> None:
        empty = self._empty("current")
        if empty and set(empty) >= set(self.currents):
            what = f"the currents of {self.name} are empty ({', '.join(empty[:_NAMED_COLUMNS])})"
            raise LogError("no-current", what, Where(file=self.name, column=empty[0]), "record the motor currents")

    def _unknown_notes(self) -> list[Note]:
        notes, where = [], Where(file=self.name)
        for quantity, so in (
            ("velocity", "speeds are taken from position there"),
            ("current", "these samples show nothing of their joints, and are not fitted"),
        ):
            if empty := self._empty(quantity):
                named = ", ".join(empty[:_NAMED_COLUMNS]) + (" ..." if len(empty) > _NAMED_COLUMNS else "")
                left = "the runs of these joints show no current and are not identified"
                left = left if quantity == "current" else "these velocities are derived from position"
                notes.append(Note(f"{quantity}-absent", f"column {named} is empty: {left}", where))
            some = {name: n for name, n in self._unknown.get(quantity, {}).items() if n != self.n_rows}
            if some:
                parts = [f"{name} in {count}" for name, count in list(some.items())[:_NAMED_COLUMNS]]
                n_more = len(some) - _NAMED_COLUMNS
                more = f" and {n_more} more columns" if n_more > 0 else ""
                text = f"there is no {quantity} in some of {self.n_rows} rows ({', '.join(parts)}{more})"
                notes.append(Note(f"{quantity}-absent", f"{text}: {so}", where))
        return notes

    def _tie_note(self) -> list[Note]:
        ties = self._n_same + self._n_ties
        if not ties:
            return []
        first = ", ".join(map(str, self._same))
        where = Where(file=self.name, row=self._same[0], column=self.time_column)
        if self._n_ties > 0.5 * self.n_rows:
            share = f"{ties} of {self.n_rows} rows have the time of the row before (rows {first} ...)"
            mend = "write the time with more digits"
            raise LogError("clock-too-coarse", f"{share}, so the samples cannot be told apart in time", where, mend)
        text = (
            f"{ties} rows have the time of the row before and are left out"
            f" (rows {first}{' ...' if ties > _NAMED else ''})"
        )
        if self._n_ties:
            text += f"; {self._n_ties} of them hold other values: the clock is coarser than the sampling"
        return [Note("time-repeated", text, where)]

    def _wrap_note(self) -> list[Note]:
        if not self._wraps:
            return []
        joints = sorted(self._wraps)
        told = ", ".join(f"joint {joint + 1} ({self._wraps[joint]} times)" for joint in joints)
        first = min(joints, key=lambda joint: self._first_wrap[joint])
        where = Where(file=self.name, row=self._first_wrap[first], joint=first + 1)
        return [Note("position-wraps", f"position jumps by a whole turn and is taken as continuous: {told}", where)]
