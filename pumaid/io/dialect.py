"""How a text log is written: delimiter, decimal mark, header, and where its numbers begin."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable
from dataclasses import dataclass

from pumaid.errors import LogError, Where

#: Numbers in groups of thousands (or with three decimals), those with two such marks, and numbers that need no mark.
_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}([.,])\d{3}(\1\d{3})*")
_GROUPED_TWICE = re.compile(r"[+-]?[1-9]\d{0,2}([.,])\d{3}(\1\d{3})+")
_SMALL = re.compile(r"[+-]?\d{1,3}")
#: Lines from which the dialect is read; a header and enough rows to see a decimal comma.
PROBE_LINES = 50

#: Spaces in any number stand for the delimiter.
SPACES = " "

_COMMA_NUMBER = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE)

#: First bytes of what is not text, with what it is; Parquet and gzip are told apart before.
_FOREIGN = {
    b"PK\x03\x04": ("a spreadsheet or zip archive", "save it as CSV or Parquet"),
    b"\xd0\xcf\x11\xe0": ("an old Excel workbook", "save it as CSV or Parquet"),
    b"\x89HDF": ("an HDF5 or MATLAB 7.3 file", "export it as CSV or Parquet"),
    b"MATLAB": ("a MATLAB file", "export it as CSV or Parquet"),
    b"#ROSBAG": ("a ROS bag", "export the joint states as CSV or Parquet"),
    b"\x89MCAP": ("an MCAP recording", "export the joint states as CSV or Parquet"),
    b"SQLite format": ("an SQLite database", "export it as CSV or Parquet"),
    b"\x28\xb5\x2f\xfd": ("compressed by zstd", "unpack it; gzip is read as it is"),
    b"\xfd7zXZ\x00": ("compressed by xz", "unpack it; gzip is read as it is"),
    b"BZh": ("compressed by bzip2", "unpack it; gzip is read as it is"),
    b"\x04\x22\x4d\x18": ("compressed by lz4", "unpack it; gzip is read as it is"),
    b"\x1f\x8b": ("compressed twice", "unpack it once; gzip is read as it is"),
    b"PAR1": ("Parquet inside gzip", "unpack it; Parquet is compressed inside"),
    b"ARROW1": ("an Arrow file", "write it as Parquet"),
    b"\x93NUMPY": ("a NumPy array", "write it as CSV with a header line, or as Parquet"),
    b"[{": ("JSON", "write it as CSV with a header line, or as Parquet"),
    b"{": ("JSON", "write it as CSV with a header line, or as Parquet"),
    b"<": ("XML or HTML", "write it as CSV with a header line, or as Parquet"),
}


@dataclass(frozen=True, slots=True)
class Dialect:
    """How a text log is written.

    Attributes
    ----------
    delimiter
        One character; `SPACES` for runs of spaces and tabs.
    decimal
        ``"."`` or ``","``.
    header
        Column names without quotes and spaces around.
    header_line
        Line of the header, from 1; the numbers begin on the next.
    """

    delimiter: str
    decimal: str
    header: tuple[str, ...]
    header_line: int


def detect(head: bytes, name: str) -> Dialect:
    """Read the dialect from a file's first bytes (whole lines, or the whole file).

    Raises
    ------
    LogError [not-a-log, empty-log, no-header]
        It is no text, has no line, or its first line holds numbers instead of names, or some text above the names.
    """
    for magic, (what, mend) in _FOREIGN.items():
        if head.startswith(magic):
            raise LogError("not-a-log", f"{name} is {what}, not CSV or Parquet", Where(file=name), mend)
    if b"\x00" in head:
        raise LogError(
            "not-a-log", f"{name} holds binary data, not CSV or Parquet", Where(file=name), "export it as CSV"
        )
    lines = text_of(head).splitlines()
    given, start = _header_start(lines)
    body = [line for line in lines[start + 1 :] if line.strip() and not line.startswith("#")][:PROBE_LINES]
    if start >= len(lines):
        raise LogError("empty-log", f"{name} has no line", Where(file=name), "record it again or leave it out")
    title = lines[start].lstrip("#% ") if _numeric_share(lines[start]) == 0 else lines[start]
    delimiter = given or _delimiter([title, *body])
    decimal = _decimal(body, delimiter)
    header = cells_of(title, delimiter)
    if all(_NUMBER.fullmatch(cell) for cell in header if cell) and any(header):
        what = f"line {start + 1} of {name} holds numbers ({', '.join(header[:3])} ...), not the names of columns"
        raise LogError("no-header", what, Where(file=name, line=start + 1), "put a header line on top: t,q1,...,i1,...")
    below = _header_below(lines, start)
    if below is not None:
        what = f"line {start + 1} of {name} ({lines[start].strip()[:40]}) names no columns; line {below + 1} does"
        mend = f"delete what is above line {below + 1}, or begin each line there with #"
        raise LogError("no-header", what, Where(file=name, line=start + 1), mend)
    # A delimiter at the end of each row, but not of the header, makes one nameless column more.
    if body and all(len(cells_of(line, delimiter)) == len(header) + 1 for line in body):
        header = (*header, "")
    return Dialect(delimiter, decimal, header, start + 1)


def refuse_thousands(head: bytes, dialect: Dialect, columns: Iterable[str], *, name: str) -> None:
    """Refuse numbers such as 1,068 beside 850: read with a decimal mark they would be a thousand times too small.

    Parameters
    ----------
    head
        The file's first bytes.
    dialect
        How it is written.
    columns
        Those whose numbers matter.
    name
        Of the file.

    Raises
    ------
    LogError [thousands]
        The first lines hold such numbers.
    """
    lines = [line for line in text_of(head).splitlines()[dialect.header_line :] if line.strip()][:PROBE_LINES]
    rows = [cells_of(line, dialect.delimiter) for line in lines]
    for column in columns:
        place = dialect.header.index(column)
        cells = [row[place] for row in rows if place < len(row) and row[place]]
        grouped = [cell for cell in cells if _GROUPED.fullmatch(cell)]
        is_sure = any(_GROUPED_TWICE.fullmatch(cell) for cell in grouped)
        others = {cell for cell in cells if not _GROUPED.fullmatch(cell)}
        if is_sure or (grouped and others and all(_SMALL.fullmatch(cell) for cell in others)):
            shown = grouped[0] + (f" beside {sorted(others)[0]}" if others else "")
            what = f"column {column} of {name} holds {shown}: separators of thousands, or decimals?"
            where = Where(file=name, column=column)
            raise LogError("thousands", what, where, "write numbers without separators of thousands: 1068 or 1068.0")


def text_of(raw: bytes) -> str:
    """Text of a few lines; what is not UTF-8 is taken for Latin-1, in which every byte is a letter."""
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def _header_start(lines: list[str]) -> tuple[str | None, int]:
    """Delimiter told by a line ``sep=;`` (Excel), and index of the header: a comment line if numbers follow it."""
    given, index = None, 0
    while index < len(lines) and not lines[index].strip():
        index += 1
    if index < len(lines) and (told := re.fullmatch(r"\"?sep=(.)\"?", lines[index].strip(), re.IGNORECASE)):
        given, index = told[1], index + 1
    first = index
    while index < len(lines) and (not lines[index].strip() or lines[index].startswith(("#", "%"))):
        index += 1
    commented = index > first and (index >= len(lines) or _numeric_share(lines[index]) > 0.5)
    return given, index - 1 if commented else index


def _header_below(lines: list[str], start: int) -> int | None:
    """Index of a line of names below the first one that is none: rows of as many numbers follow; None without."""
    below = [k for k in range(start + 1, len(lines)) if lines[k].strip() and not lines[k].startswith("#")]
    for place, k in enumerate(below[:PROBE_LINES]):
        rows = [lines[n] for n in below[place + 1 : place + 1 + PROBE_LINES]]
        if _numeric_share(lines[k]) > 0.0 or not rows or any(_numeric_share(row) <= 0.5 for row in rows[:2]):
            continue
        delimiter = _delimiter([lines[k], *rows])
        first, names, cells = (len(cells_of(line, delimiter)) for line in (lines[start], lines[k], rows[0]))
        return k if names > 1 and abs(names - cells) <= 1 < abs(names - first) else None
    return None


def _numeric_share(line: str) -> float:
    cells = [cell for cell in re.split(r"[;,\t| ]+", line.strip()) if cell]
    return sum(bool(_NUMBER.fullmatch(cell)) for cell in cells) / max(1, len(cells))


def _delimiter(lines: list[str]) -> str:
    """The delimiter by which header and rows have the same number of cells, the most of them; spaces come last."""
    best = (0, 0, ",")
    for candidate in (";", "\t", "|", ",", SPACES):
        counts = [len(cells_of(line, candidate)) for line in lines]
        agree = sum(abs(count - counts[0]) <= 1 for count in counts)
        if counts[0] > 1 and (agree, counts[0]) > best[:2]:
            best = (agree, counts[0], candidate)
    return best[2]


def _decimal(body: list[str], delimiter: str) -> str:
    cells = [cell for line in body for cell in cells_of(line, delimiter)]
    return "," if any(_COMMA_NUMBER.fullmatch(cell) for cell in cells) else "."


def cells_of(line: str, delimiter: str) -> tuple[str, ...]:
    """Cells of one line without quotes and spaces around."""
    if delimiter == SPACES:
        return tuple(line.split())
    try:
        row = next(csv.reader([line.rstrip("\r\n")], delimiter=delimiter, skipinitialspace=True), [])
    except csv.Error:
        # A cell of more than 128 KiB, as after a quote that is never closed.
        row = line.split(delimiter)
    return tuple(cell.strip() for cell in row)
