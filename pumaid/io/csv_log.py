"""Text logs, read in blocks of whole lines: memory does not grow with the file, and a pipe will do."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import BinaryIO

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import csv as arrow_csv

from pumaid.errors import LogError, Note, Where
from pumaid.io.arrow import floats
from pumaid.io.dialect import SPACES, Dialect, cells_of, detect, refuse_thousands, text_of
from pumaid.io.text_blocks import TextBlocks

#: Cells that mean "no number"; what C, MATLAB, Excel and pandas print for it, with and without spaces around.
NO_NUMBER = (
    "",
    "nan",
    "na",
    "n/a",
    "#n/a",
    "null",
    "none",
    "-nan",
    "-nan(ind)",
    "1.#qnan",
    "-1.#ind",
    "1.#inf",
    "-1.#inf",
)
_NULLS = sorted(
    {form for word in NO_NUMBER for form in (word, word.upper(), word.capitalize(), "NaN", "N/A", "-NaN", " ")}
)

Chunk = tuple[NDArray[np.int64], NDArray[np.float64]]


@dataclass(eq=False, slots=True)
class CsvSource:
    """A text log as chunks of numbers.

    Attributes
    ----------
    stream
        Binary, at the file's beginning; read once, and sought only for a part that lies behind.
    name
        For messages.
    part
        Bytes at which the lines begin that are read, borders of parts as `file_parts` gives them; None for all lines.
        Rows are then counted from the part's first line.
    dialect
        Known after construction.
    notes, n_lines
        Known after iteration.
    """

    stream: BinaryIO
    name: str
    part: range | None = None
    dialect: Dialect = field(init=False)
    notes: list[Note] = field(init=False, default_factory=list)
    n_lines: int = field(init=False, default=0)
    _blocks: TextBlocks = field(init=False)
    _firsts: set[int] = field(init=False, default_factory=set)  # rows with which parts begin

    def __post_init__(self) -> None:
        self._blocks = TextBlocks(self.stream, self.name, self.part)
        self.dialect = detect(self._blocks.head, self.name)

    @property
    def header(self) -> tuple[str, ...]:
        """Column names."""
        return self.dialect.header

    def begins_part(self, row: int) -> bool:
        """Whether a part that may be read by itself begins with this row."""
        return row in self._firsts

    def chunks(self, names: tuple[str, ...]) -> Iterator[Chunk]:
        """Rows (line numbers) and values (C, N) of the named columns; no block reaches from a part into the next.

        Raises
        ------
        LogError [thousands]
            Numbers have separators of thousands.
        LogError [not-a-number, ragged-row]
            A cell holds text, or a row inside the file has too few or too many cells: the first three and the count.
        """
        indices = [self.header.index(name) for name in names]
        if self.part is None or not self.part.start:
            refuse_thousands(self._blocks.head, self.dialect, names, name=self.name)
        line, is_new = 1, False
        header = 0 if self.part is not None and self.part.start else self.dialect.header_line
        for block, begins_part, is_last in self._blocks:
            n_lines, is_new = _n_lines(block), is_new or begins_part
            if line <= header:
                skipped = min(n_lines, header - line + 1)
                block = block.split(b"\n", skipped)[-1] if block.count(b"\n") >= skipped else b""
                line, n_lines = line + skipped, n_lines - skipped
            if block and not block.isspace():
                rows, table = self._numbers(block, range(line, line + n_lines), indices, is_last)
                if is_new and len(rows):
                    self._firsts.add(int(rows[0]))
                    is_new = False
                yield rows, table
            line += n_lines
            self.n_lines = line - 1

    def _numbers(self, block: bytes, lines: range, indices: list[int], is_last: bool) -> Chunk:
        squeezed = _squeezed(block) if self.dialect.delimiter == SPACES else block
        table = self._fast(squeezed, indices)
        if table is not None and table.shape[1] == len(lines):
            return np.arange(lines.start, lines.stop), table
        block = squeezed
        # Some line is empty, a comment, cut, or holds what Arrow does not read.
        block, rows = _without_blanks(block, lines.start)
        table = self._fast(block, indices)
        # Where a quoted cell holds line feeds Arrow makes one row of several lines, which then have no numbers.
        is_read = table is not None and table.shape[1] == len(rows)
        return (rows, table) if table is not None and is_read else self._slow(block, rows, indices, is_last)

    def _fast(self, block: bytes, indices: list[int]) -> NDArray[np.float64] | None:
        """By Arrow; None if a cell or row is out of the ordinary."""
        columns = [str(k) for k in range(len(self.header))]
        chosen = [str(k) for k in indices]
        try:
            table = arrow_csv.read_csv(
                pa.py_buffer(block),
                # Its threads may outlive the program's last line, and then they end it with an abort.
                arrow_csv.ReadOptions(column_names=columns, block_size=1 << 20, use_threads=False),
                arrow_csv.ParseOptions(delimiter=self.dialect.delimiter, ignore_empty_lines=True),
                arrow_csv.ConvertOptions(
                    include_columns=list(dict.fromkeys(chosen)),
                    column_types=dict.fromkeys(chosen, pa.float64()),
                    decimal_point=self.dialect.decimal,
                    null_values=_NULLS,
                    check_utf8=False,
                ),
            )
        except pa.ArrowInvalid:
            return None
        out = np.empty((len(chosen), table.num_rows))
        for row, name in zip(out, chosen, strict=True):
            at = 0
            for part in table.column(name).chunks:
                row[at : at + len(part)] = floats(part)
                at += len(part)
        return out

    def _slow(self, block: bytes, lines: NDArray[np.int64], indices: list[int], is_last: bool) -> Chunk:
        """Cell by cell: reads what Arrow refuses (a plus sign), and names what cannot be read."""
        rows: list[int] = []
        values: list[list[float]] = []
        ragged: list[tuple[int, int]] = []
        bad: list[tuple[int, str, str]] = []
        is_quoted = False
        for line, text in zip(lines.tolist(), text_of(block).split("\n"), strict=False):
            row = cells_of(text, self.dialect.delimiter)
            if len(row) < len(self.header) or any(row[len(self.header) :]):
                ragged.append((line, len(row)))
                is_quoted = is_quoted or text.count('"') % 2 == 1
                continue
            read = [self._cell(row[index]) for index in indices]
            bad += [(line, self.header[i], row[i]) for i, value in zip(indices, read, strict=True) if value is None]
            rows.append(line)
            values.append([math.nan if value is None else value for value in read])
        self._judge_ragged(ragged, int(lines[-1]) if len(lines) else 0, is_last, is_quoted=is_quoted)
        if bad:
            raise self._not_numbers(bad)
        return np.array(rows, dtype=np.int64), np.array(values, dtype=np.float64).reshape(-1, len(indices)).T

    def _cell(self, text: str) -> float | None:
        text = text.strip()
        if text.lower() in NO_NUMBER:
            return math.nan
        try:
            # Python reads 1_000, which no log means.
            return None if "_" in text else float(text.replace(",", ".") if self.dialect.decimal == "," else text)
        except ValueError:
            return None

    def _judge_ragged(self, ragged: list[tuple[int, int]], last_line: int, is_last: bool, *, is_quoted: bool) -> None:
        """A cut last row is a recording that was stopped; any other is a damaged file."""
        if is_last and ragged and ragged[-1][0] == last_line and ragged[-1][1] <= len(self.header):
            line, count = ragged.pop()
            text = f"the last row has {count} of {len(self.header)} cells (recording cut off) and is left out"
            self.notes.append(Note("last-row-cut", text, Where(file=self.name, row=line)))
        if ragged:
            first = "; ".join(f"row {line} has {count}" for line, count in ragged[:3])
            more = f" and {len(ragged) - 3} more nearby" if len(ragged) > 3 else ""
            what = f"{first}{more} cells where the header has {len(self.header)}"
            mend = "complete or remove these rows; a delimiter inside a cell needs quotes"
            if is_quoted:
                mend = "a quote opens there and closes in another line: write each sample in one line"
            raise LogError("ragged-row", what, Where(file=self.name, row=ragged[0][0]), mend)

    def _not_numbers(self, bad: list[tuple[int, str, str]]) -> LogError:
        shown = "; ".join(f"row {line}, column {column}: {text.strip()[:30]!r}" for line, column, text in bad[:3])
        more = f" and {len(bad) - 3} more nearby" if len(bad) > 3 else ""
        mend = "leave cells empty where there is no number"
        if bad[0][0] == self.dialect.header_line + 1 and {row for row, _, _ in bad} == {bad[0][0]}:
            mend = f"row {bad[0][0]} looks like units: delete it and name the units in the recipe's log block"
        elif sum(text.strip() in self.header for row, _, text in bad if row == bad[0][0]) > 1:
            mend = f"row {bad[0][0]} is a header: another recording begins there; split the file before it"
        elif re.match(r"\d{4}-\d\d-\d\d|\d\d?:\d\d", bad[0][2].strip()):
            mend = "write times as seconds, not as dates"
        elif re.search(r"\d", bad[0][2]):
            mend = "write numbers as 1234.5 or 1.2e-3, without units, separators of thousands, or other signs"
        where = Where(file=self.name, row=bad[0][0], column=bad[0][1])
        return LogError("not-a-number", f"text where a number belongs: {shown}{more}", where, mend)


def _n_lines(block: bytes) -> int:
    """Lines of a block, the last with or without its line feed."""
    feeds = np.count_nonzero(np.frombuffer(block, dtype=np.uint8) == ord("\n"))
    return int(feeds) + (not block.endswith(b"\n"))


def _squeezed(block: bytes) -> bytes:
    """Runs of spaces and tabs become one space, those at the ends of lines none."""
    block = block.replace(b"\t", b" ")
    while b"  " in block:
        block = block.replace(b"  ", b" ")
    return block.replace(b"\n ", b"\n").replace(b" \n", b"\n").strip(b" ")


def _without_blanks(block: bytes, line: int) -> tuple[bytes, NDArray[np.int64]]:
    """A block without empty and comment lines, and the line numbers of the rest."""
    lines = block.split(b"\n")
    kept = [k for k, text in enumerate(lines) if text.strip() and not text.startswith(b"#")]
    return b"\n".join(lines[k] for k in kept) + b"\n", line + np.array(kept, dtype=np.int64)
