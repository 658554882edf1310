"""What is worth a note about the rows of a file: bad ones, repeated times, wraps, restarts, gaps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import LogError, Note, Where
from pumaid.io.columns import Columns

Floats = NDArray[np.float64]
Rows = NDArray[np.int64]

#: A log with a larger share of bad rows is not one with faults but a faulty one.
MOST_BAD = 0.05
#: Rows of a kind, and columns, that a note names; the others are counted.
_NAMED, _NAMED_COLUMNS = 3, 6
#: Intervals from which the median is taken: enough for any jitter, few enough to keep (800 kB).
_PROBE = 100_000
#: A gap is this many median intervals: one or two lost packets are jitter, five are a hole ...
_GAP_INTERVALS = 5.0
#: ... and at least this long (s): shorter ones are within what a ramp of an arm takes, and harm no mean.
_GAP_SECONDS = 0.05
#: s, and share of the median: times between samples that vary by more (RMS) blur where an arm speeds up and slows down.
_JITTER_SECONDS, _JITTER_SHARE = 0.005, 0.1
#: What the absence of a quantity means where some of its numbers, and where all are absent.
_ABSENCE = {
    "velocity": ("speeds are taken from position there", "these velocities are derived from position"),
    "current": (
        "these samples show nothing of their joints, and are not fitted",
        "the runs of these joints show no current and are not identified",
    ),
}


@dataclass(eq=False, slots=True)
class Count:
    """How many rows have a fault, and the first of them."""

    number: int = 0
    first: list[int] = field(default_factory=list)

    def add(self, rows: Rows) -> None:
        """Count (N,) rows."""
        self.number += len(rows)
        self.first += rows[: _NAMED - len(self.first)].tolist()

    def __str__(self) -> str:
        rows = ", ".join(map(str, self.first)) + (" ..." if self.number > _NAMED else "")
        return f"row{'s' if self.number > 1 else ''} {rows}"


@dataclass(eq=False, slots=True)
class RowFaults:
    """Faults of the rows of one file.

    Attributes
    ----------
    name, columns
        The file's, for messages.
    n_rows
        Rows read, bad ones included.
    """

    name: str
    columns: Columns
    n_rows: int = 0
    _restarts: list[Note] = field(default_factory=list)
    _bad: dict[str, Count] = field(default_factory=dict)
    _n_bad: int = 0
    _unknown: dict[str, dict[str, int]] = field(default_factory=dict)
    _ties: Count = field(default_factory=Count)
    _n_repeated: int = 0
    _wraps: dict[int, Count] = field(default_factory=dict)

    def left_out(self, rows: Rows, good: NDArray[np.bool_]) -> None:
        """Rows (N,) are left out where not all of their numbers are `good` (C, N)."""
        self._n_bad += int(np.count_nonzero(~good.all(axis=0)))
        for index in np.flatnonzero(~good.all(axis=1)):
            self._bad.setdefault(self.columns.names[index], Count()).add(rows[~good[index]])

    def unknown(self, quantity: str, index: int, count: int) -> None:
        """So many rows have no number in a column, and stay."""
        if count:
            counts, name = self._unknown.setdefault(quantity, {}), self.columns.names[index]
            counts[name] = counts.get(name, 0) + count

    def tied(self, rows: Rows, *, n_repeated: int) -> None:
        """Rows (N,) have the time of the row before; so many of them hold the same values, too."""
        self._ties.add(rows)
        self._n_repeated += n_repeated

    def wrapped(self, joint: int, rows: Rows) -> None:
        """At rows (N,) a joint (from 0) jumps by whole turns."""
        self._wraps.setdefault(joint, Count()).add(rows)

    def restart(self, row: int, time: float, before: float) -> None:
        """A recording begins anew."""
        text = f"time starts anew at {time:.6g} s after {before:.6g} s: taken for another recording"
        self._restarts.append(Note("clock-restarts", text, Where(file=self.name, row=row)))

    def notes(self) -> list[Note]:
        """What a user is told.

        Raises
        ------
        LogError [no-current, bad-samples, clock-too-coarse]
            There is no current at all, too many rows are bad, or time stands still.
        """
        currents = [self.columns.names[index] for index in self.columns.places["current"][:, 1]]
        empty = self._empty("current")
        if empty and set(empty) >= set(currents):
            what = f"the currents of {self.name} are empty ({_listed(empty)})"
            raise LogError("no-current", what, Where(file=self.name, column=empty[0]), "record the motor currents")
        return [*self._restarts, *self._bad_rows(), *self._absent(), *self._tied_rows(), *self._wrapped_joints()]

    def _bad_rows(self) -> list[Note]:
        if not self._n_bad:
            return []
        named = _listed([f"{name} in {count.number} ({count})" for name, count in self._bad.items()], "; ")
        text = f"{self._n_bad} of {self.n_rows} rows have no number or an absurd one: {named}"
        row = min(count.first[0] for count in self._bad.values())
        if self._n_bad <= MOST_BAD * self.n_rows:
            return [Note("bad-samples", f"{text}; these rows are left out", Where(file=self.name, row=row))]
        mend = "check units and columns in the recipe's log block; leave out what was not measured"
        without = max(self._unknown.get("current", {}).values(), default=0)
        if self._n_bad + without >= (1.0 - MOST_BAD) * self.n_rows and without > MOST_BAD * self.n_rows:
            mend = "positions and currents stand in different rows: join them by time (pandas.merge_asof does it)"
        column = max(self._bad, key=lambda name: self._bad[name].number)
        raise LogError("bad-samples", text, Where(file=self.name, row=row, column=column), mend)

    def _empty(self, quantity: str) -> list[str]:
        """Columns without any number."""
        return [name for name, count in self._unknown.get(quantity, {}).items() if count == self.n_rows]

    def _absent(self) -> list[Note]:
        notes, where = [], Where(file=self.name)
        for quantity, (of_some, of_all) in _ABSENCE.items():
            empty = self._empty(quantity)
            if empty:
                notes.append(Note(f"{quantity}-absent", f"column {_listed(empty)} is empty: {of_all}", where))
            counts = self._unknown.get(quantity, {})
            partly = [f"{name} in {count}" for name, count in counts.items() if name not in empty]
            if partly:
                text = f"there is no {quantity} in some of {self.n_rows} rows ({_listed(partly)}): {of_some}"
                notes.append(Note(f"{quantity}-absent", text, where))
        return notes

    def _tied_rows(self) -> list[Note]:
        count, others = self._ties.number, self._ties.number - self._n_repeated
        if not count:
            return []
        where = Where(file=self.name, row=self._ties.first[0], column=self.columns.names[0])
        text = f"{count} of {self.n_rows} rows have the time of the row before ({self._ties})"
        if others > 0.5 * self.n_rows:
            what = f"{text}, so the samples cannot be told apart in time"
            raise LogError("clock-too-coarse", what, where, "write the time with more digits")
        more = f"; {others} of them hold other values: the clock is coarser than the sampling" if others else ""
        return [Note("time-repeated", f"{text} and are left out{more}", where)]

    def _wrapped_joints(self) -> list[Note]:
        if not self._wraps:
            return []
        named = ", ".join(f"joint {joint + 1} ({self._wraps[joint].number} times)" for joint in sorted(self._wraps))
        first = min(self._wraps, key=lambda joint: self._wraps[joint].first)
        where = Where(file=self.name, row=self._wraps[first].first[0], joint=first + 1)
        return [Note("position-wraps", f"position jumps by a whole turn and is taken as continuous: {named}", where)]


@dataclass(eq=False, slots=True)
class Intervals:
    """Statistics of the times between samples.

    Attributes
    ----------
    median, jitter
        s: of the first intervals, and the RMS by which they differ from it, gaps apart.
    """

    median: float = float("nan")
    jitter: float = 0.0
    _first: list[tuple[Rows, Floats, Floats]] = field(default_factory=list)
    _n_first: int = 0
    _gaps: list[tuple[int, float, float]] = field(default_factory=list)  # row, start (s) and length (s) of the first
    _n_gaps: int = 0
    _longest: float = 0.0

    def take(self, rows: Rows, time: Floats, before: float | None) -> None:
        """Rows (N,) and times (N,) of the next samples, and the time before them (s) where there is one."""
        steps = np.diff(time, prepend=time[0] if before is None else before)
        skip = before is None
        rows, time, steps = rows[skip:], time[skip:], steps[skip:]
        if self._n_first >= _PROBE:
            self._count(rows, time, steps)
            return
        self._first.append((rows, time, steps))
        self._n_first += len(steps)
        if self._n_first >= _PROBE:
            self.settle()

    def settle(self) -> None:
        """Take the median, and count the gaps among what was kept for it."""
        kept, self._first = self._first, []
        if not kept or not self._n_first:
            return
        first = np.concatenate([steps for _, _, steps in kept])[:_PROBE]
        self.median = float(np.median(first))
        even = first[first <= self._limit]
        self.jitter = float(np.sqrt(np.mean((even - self.median) ** 2))) if len(even) else 0.0
        for rows, time, steps in kept:
            self._count(rows, time, steps)

    @property
    def _limit(self) -> float:
        return max(_GAP_INTERVALS * self.median, _GAP_SECONDS)

    def _count(self, rows: Rows, time: Floats, steps: Floats) -> None:
        gaps = np.flatnonzero(steps > self._limit)
        self._n_gaps += len(gaps)
        self._longest = max(self._longest, float(steps[gaps].max(initial=0.0)))
        for k in gaps[: _NAMED - len(self._gaps)]:
            self._gaps.append((int(rows[k]), float(time[k] - steps[k]), float(steps[k])))

    def notes(self, name: str) -> list[Note]:
        """A note if times jitter, and one if there are gaps."""
        self.settle()
        notes = []
        if self.jitter > max(_JITTER_SECONDS, _JITTER_SHARE * self.median):
            text = (
                f"times between samples vary by {1e3 * self.jitter:.2g} ms RMS about {1e3 * self.median:.3g} ms: where"
                " the stamps and not the samples are uneven, speeds and friction come out wrong"
            )
            notes.append(Note("clock-jitter", text, Where(file=name)))
        if self._n_gaps:
            shown = ", ".join(f"{seconds:.3g} s at {start:.6g} s" for _, start, seconds in self._gaps)
            more = f" ... ({self._n_gaps} in all, the longest {self._longest:.3g} s)" if self._n_gaps > _NAMED else ""
            text = (
                f"samples are missing: {shown}{more}; the median interval is {self.median:.4g} s and no run crosses a"
                " gap"
            )
            notes.append(Note("gaps", text, Where(file=name, row=self._gaps[0][0])))
        return notes


def _listed(words: Sequence[str], separator: str = ", ") -> str:
    more = len(words) - _NAMED_COLUMNS
    return separator.join(words[:_NAMED_COLUMNS]) + (f" and {more} more columns" if more > 0 else "")
