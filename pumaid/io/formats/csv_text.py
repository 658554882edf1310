"""Text logs: CSV in any dialect, read by Arrow in blocks, so that memory does not grow with the file."""

import codecs
import csv
import io
import math
import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from pumaid.errors import LogError, Note, Where
from pumaid.io.column_names import has_foreign_words
from pumaid.io.formats import GZIP, HEAD_BYTES, Batch, LogColumn, LogSource, floats
from pumaid.io.formats.joint_columns import NUMBER, JointColumns
from pumaid.io.formats.tidy_columns import TidyColumns
from pumaid.maths import Floats

#: Words that mean "no number"; what C, MATLAB, Excel and pandas print for it.
_NO_NUMBER = ("", " ", "nan", "na", "n/a", "#n/a", "null", "none", "-nan", "-nan(ind)", "1.#qnan", "-1.#ind", "1.#inf")
_NULLS = sorted(
    {form for word in _NO_NUMBER for form in (word, word.upper(), word.capitalize())} | {"NaN", "-NaN", "N/A"}
)
#: Bytes that Arrow parses at a time; no line is longer.
_BLOCK_BYTES = 4 << 20
#: Bytes in which the header is looked for, and rows from which the dialect is told.
_MOST_HEAD, _PROBE_ROWS = 4 << 20, 50
#: Stands for runs of spaces and tabs between cells.
_SPACES = " "
_COMMENT = ("#", "%")
#: What begins lines that are no header; Excel keeps the delimiter in one.
_PREAMBLE = (*_COMMENT, "sep=", '"sep=')
_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)

#: A time stamp as ISO 8601 has it, and a cell of a line of units.
_ISO = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d\S*")
_UNIT = re.compile(
    r"[\[(]?((m|u|µ|n)?s|sec|m?rad|deg|°|m?m|ticks?|((rad|deg|°|m?m)/s(ec)?)"
    r"|rpm|U/min|1/min|m?A|N[ ·*]?m|V|°?C|%|-)?[\])]?"
)
_COMMA_NUMBER = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
#: Numbers in groups of three digits, and those that need no separator.
_GROUPED, _SMALL = re.compile(r"[+-]?[1-9]\d{0,2}(?:([.,])\d{3})(?:\1\d{3})*"), re.compile(r"[+-]?\d{1,3}")
_NUMBERS = (
    "write numbers as 1234.5 or 1.2e-3, without units, separators or dates (times in s, or as ISO 8601 has them); leave"
    " cells without a number empty, and have one header, and no line above the rows but units such as s, deg and mA"
)
_BAD_CELL = re.compile(r"CSV column #(\d+): (?:Row #(\d+): )?CSV conversion error to double: invalid value '(.*)", re.S)


class Dialect:
    """How a text log that begins with `text` is written: delimiter, decimal mark, column names, the first rows.

    The `header`, in line `header_line` (from 1), is the line above the first row of numbers that has as many cells;
    comments and other text may stand above it, and a line of `units` (by name) below it. `has_quotes` tells whether the
    first rows have quoted cells, each within a line of its own.

    Raises
    ------
    LogError [not-a-log]
        There is no line of names above the numbers.
    """

    def __init__(self, text: str, name: str) -> None:
        lines: list[str] = []
        numbers: list[int] = []
        for number, line in enumerate(io.StringIO(text, newline=None)):
            lines.append(line)
            words = re.split(r"[;,\t| \"\[\]()]+", line.strip(' "\r\n[]()'))
            is_numeric = sum(bool(NUMBER.fullmatch(word)) for word in words) > 0.5 * len(words)
            if is_numeric and not line.startswith(_COMMENT):
                numbers.append(number)
            if len(numbers) == _PROBE_ROWS:
                break
        first = numbers[0] if numbers else len(lines)
        above = [number for number in range(first) if lines[number].strip()]
        above = [number for number in above if not lines[number].lower().startswith(_PREAMBLE)] or above[-1:]
        body = [lines[number] for number in numbers]
        topic = _joint_states(cells(body[0], ",")) if body and not above else ()
        if not above and not topic:
            what = f"{name} has no line of names above its numbers ({body[0].strip()[:40] if body else 'it is empty'})"
            raise LogError(
                "not-a-log", what, Where(file=name, line=first + 1), "put a header line on top: t,q1,...,i1,..."
            )
        place = -1 if topic else above[-1] if body else above[0]
        delimiter = "," if topic else _delimiter([lines[place].lstrip("\ufeff#% "), *body])
        if body and len(above) > 1:  # what stands between names and numbers may be units, which no reader may pass over
            sizes = [len(cells(lines[number].lstrip("\ufeff#% "), delimiter)) for number in above[-2:]]
            place = above[-2] if sizes[0] == sizes[1] > 1 else place
        header = topic or cells(lines[place].lstrip("\ufeff#% "), delimiter)
        self.rows = [cells(line, delimiter) for line in body]
        if body and all(len(row) == len(header) + 1 for row in self.rows):
            header = (*header, "")  # a delimiter at the end of each row, but not of the header
        between = cells(lines[above[-1]].lstrip("\ufeff#% "), delimiter) if above and place in above[:-1] else ()
        are_units = any(between) and all(map(_UNIT.fullmatch, between))
        self.units = dict(zip(header, between, strict=False)) if are_units else {}
        self.delimiter, self.header, self.header_line = delimiter, header, (above[-1] if are_units else place) + 1
        n_quotes = [line.count('"') for line in body]
        self.has_quotes = any(n_quotes) and all(count % 2 == 0 for count in n_quotes)
        # Where no comma parts cells, one with a comma in it may be a number.
        has_commas = any(_COMMA_NUMBER.fullmatch(cell) for row in self.rows for cell in row)
        self.decimal = "," if has_commas and (delimiter != "," or self.has_quotes) else "."


class CsvLog(LogSource):
    """A text file with a header line; gzipped ones, UTF-16 and Latin-1 are read, too."""

    endings = (".csv", ".csv.gz")
    is_fallback = True

    @classmethod
    def sniff(cls, head: bytes) -> bool:
        """Text holds no zero bytes, unless it is UTF-16; what gzip holds is looked at when it is read."""
        return head.startswith((GZIP, *_UTF_16)) or b"\0" not in head

    def schema(self) -> Sequence[LogColumn]:
        """The names of the header line.

        Raises
        ------
        LogError [not-a-log]
            There is no line of names above the numbers, or it is no text.
        """
        with self.unpacked() as stream:
            head = stream.read(_MOST_HEAD)
        self._encoding = "utf-16" if head.startswith(_UTF_16) else "utf-8-sig"
        if b"\0" in head[:HEAD_BYTES] and self._encoding != "utf-16":
            raise LogError("not-a-log", f"{self.name} holds binary data", Where(file=self.name), "export it as CSV")
        try:
            text = codecs.getincrementaldecoder(self._encoding)().decode(head)
        except UnicodeDecodeError:
            texts = [head.decode(codec, "replace") for codec in ("latin-1", "gb18030", "shift_jis")]
            text = next(filter(has_foreign_words, texts), texts[0])  # in Latin-1 every byte is a letter
        self._dialect = Dialect(text, self.name)
        self._places = {name: k for k, name in reversed([*enumerate(self._dialect.header)])}
        table = self._dialect.header, self._dialect.rows
        place = TidyColumns.place_of(*table)
        self._joints = JointColumns(*table) if place < 0 else TidyColumns(*table, place)
        rows = [row for row in self._dialect.rows if len(row) == len(self._dialect.header)]
        self._stamps = {k for k in self._places.values() if rows and all(_ISO.fullmatch(row[k]) for row in rows)}
        units = {**self._dialect.units, **{self._dialect.header[k]: "ns" for k in self._stamps}}
        return [column._replace(unit=units.get(column.name, "")) for column in self._joints.schema()]

    def batches(self, names: Sequence[str]) -> Iterator[Batch]:
        """As `LogSource`; empty lines and comments are passed over, and a last row that is cut off is left out.

        Raises
        ------
        LogError [not-a-number, not-a-log]
            A cell holds text, numbers have separators of thousands, or a row inside the file has too few or too many
            cells.
        """
        _refuse_thousands(self._dialect, [self._places[name] for name in names if name in self._places], self.name)
        line, last_row = self._dialect.header_line + 1, 0
        self._ragged: list[tuple[int, int]] = []  # line and number of cells
        self._skipped: list[int] = []  # lines of comments and ragged rows
        for values in self._parsed(names):
            size = values.shape[1]
            skipped = [number for number in self._skipped if number >= line]
            rows = np.setdiff1d(np.arange(line, line + size + len(skipped)), skipped)[:size]
            line = int(rows[-1]) + 1 if size else line
            is_filled = ~np.isnan(values).all(axis=0)
            if is_filled.any():
                rows = rows[is_filled]
                last_row = int(rows[-1])
                yield Batch(rows, values[:, is_filled])
        self._judge(last_row)

    def _parsed(self, names: Sequence[str]) -> Iterator[Floats]:
        import pyarrow as pa
        from pyarrow import csv as arrow_csv

        def on_ragged(row: Any) -> str:
            self._skipped.append(row.number)
            if row.text.strip() and not row.text.startswith(_COMMENT):
                self._ragged.append((row.number, row.actual_columns))
            return "skip" if len(self._ragged) < 2 else "error"

        dialect = self._dialect
        needed = self._joints.needed([name for name in names if name not in self._places])
        texts = [str(index) for index in needed if index in self._joints.texts]
        numbers = [str(self._places[name]) for name in names if name in self._places]
        numbers += [str(index) for index in needed if index not in self._joints.texts]
        zoned = any(re.search(r"(Z|[+-]\d\d:?\d\d)$", row[k]) for row in dialect.rows[:1] for k in self._stamps)
        stamps = {str(k): pa.timestamp("ns", "UTC" if zoned else None) for k in self._stamps if str(k) in numbers}
        options = (
            arrow_csv.ReadOptions(
                column_names=[str(index) for index in range(len(dialect.header))],
                skip_rows=dialect.header_line,
                block_size=_BLOCK_BYTES,
                use_threads=False,  # threads would not tell the row of what cannot be read
            ),
            arrow_csv.ParseOptions(
                delimiter=dialect.delimiter,
                quote_char='"' if dialect.has_quotes else False,  # a lone quote in a text column would swallow lines
                ignore_empty_lines=False,
                invalid_row_handler=on_ragged,
            ),
            arrow_csv.ConvertOptions(
                include_columns=list(dict.fromkeys([*numbers, *texts])),
                column_types=dict.fromkeys(numbers, pa.float64()) | dict.fromkeys(texts, pa.string()) | stamps,
                decimal_point=dialect.decimal,
                null_values=_NULLS,
                check_utf8=False,
            ),
        )
        with self.unpacked() as stream:
            if self._encoding == "utf-16":
                stream = pa.transcoding_input_stream(stream, "utf-16", "utf-8")
            if dialect.delimiter == _SPACES:
                stream = _single_spaced(stream)
            try:
                yield from (self._values(batch, names) for batch in arrow_csv.open_csv(stream, *options))
            except pa.ArrowInvalid as error:
                if "Could not skip" not in str(error) and "Empty CSV" not in str(error):  # else there are no rows
                    self._judge(math.inf)
                    raise self._unreadable(str(error)) from error

    def _values(self, batch: Any, names: Sequence[str]) -> Floats:
        more = [name for name in names if name not in self._places]
        inner = self._joints.values({k: batch.column(str(k)) for k in self._joints.needed(more)}, more)
        plain = {name: batch.column(str(self._places[name])) for name in names if name not in inner}
        stamps = {name for name in plain if self._places[name] in self._stamps}
        plain |= {name: plain[name].cast("int64").cast("float64", safe=False) for name in stamps}
        rows = [inner[name] if name in inner else floats(plain[name]) for name in names]
        return np.array(rows).reshape(len(names), -1)

    def _judge(self, last_row: float) -> None:
        if not self._ragged:
            return
        size, (line, count) = len(self._dialect.header), self._ragged[0]
        where, text = Where(file=self.name, row=line), f"row {line} has {count} cells where the header has {size}"
        if len(self._ragged) > 1 or line < last_row or count > size:
            raise LogError(
                "not-a-log", text, where, "complete or remove such rows; a delimiter inside a cell needs quotes"
            )
        self.notes.append(Note("bad-samples", f"{text} (recording cut off) and is left out", where))

    def _unreadable(self, message: str) -> LogError:
        match = _BAD_CELL.search(message)
        if match is None:
            return LogError(
                "not-a-log",
                f"{self.name} is no table in lines: {message.splitlines()[0][:150]}",
                Where(file=self.name),
                "export it as CSV, a line a sample, or as Parquet",
            )
        column, text = self._dialect.header[int(match[1])], match[3].rstrip("'").strip()[:30]
        return LogError(
            "not-a-number",
            f"column {column} holds {text!r}, no number",
            Where(file=self.name, row=int(match[2]) if match[2] else None, column=column),
            _NUMBERS,
        )


def _single_spaced(stream: Any) -> Any:
    import pyarrow as pa

    rest = b""

    def shorten(block: Any) -> bytes:
        nonlocal rest
        # An empty block is the end of the file.
        text, end, rest = (rest + bytes(block)).rpartition(b"\n") if len(block) else (rest, b"", b"")
        return b"\n".join(b" ".join(line.split()) for line in text.split(b"\n")) + end

    return pa.TransformInputStream(stream, shorten)


def _joint_states(row: Sequence[str]) -> tuple[str, ...]:
    """Names for the columns of joint states as ``ros2 topic echo --csv`` prints them: stamp, frame, joints, numbers."""
    count = next((k for k, cell in enumerate(row[3:]) if NUMBER.fullmatch(cell)), 0)
    groups, rest = divmod(len(row) - 3 - count, count or 1)
    if not count or rest or not 0 < groups < 4 or not all(cell.isdecimal() for cell in row[:2]):
        return ()
    texts = [f"text{k}" for k in range(count)]
    numbers = [f"{name}/{what}" for what in ("position", "velocity", "effort")[:groups] for name in row[3 : 3 + count]]
    return ("sec", "nanosec", "frame", *texts, *numbers)


def _delimiter(lines: list[str]) -> str:
    """The delimiter by which header and rows have the same number of cells, the most of them; spaces come last."""

    def agreement(delimiter: str) -> tuple[int, int]:
        counts = [len(cells(line, delimiter)) for line in lines]
        return (sum(abs(count - counts[0]) <= 1 for count in counts), counts[0]) if counts[0] > 1 else (0, 0)

    return max((";", "\t", "|", ",", _SPACES), key=agreement)


def cells(line: str, delimiter: str) -> tuple[str, ...]:
    """Cells of one line without quotes and spaces around."""
    if delimiter == _SPACES:
        return tuple(line.split())
    try:
        row = next(csv.reader([line.rstrip("\r\n")], delimiter=delimiter, skipinitialspace=True), [])
    except csv.Error:  # a cell of more than 128 KiB, as after a quote that is never closed
        row = line.split(delimiter)
    return tuple(cell.strip() for cell in row)


def _refuse_thousands(dialect: Dialect, indices: Sequence[int], name: str) -> None:
    """Refuse numbers such as 1,068 beside 850: read with a decimal mark they would be a thousand times too small."""
    for index in indices:
        words = [row[index] for row in dialect.rows if index < len(row) and row[index]]
        grouped = [word for word in words if _GROUPED.fullmatch(word)]
        plain = sorted({*words} - {*grouped})
        is_sure = any(len(re.split("[.,]", word)) > 2 for word in grouped)
        if is_sure or (grouped and plain and all(map(_SMALL.fullmatch, plain))):
            column, shown = dialect.header[index], " beside ".join([*grouped[:1], *plain[:1]])
            raise LogError(
                "not-a-number",
                f"column {column} of {name} holds {shown}: separators of thousands, or decimals?",
                Where(file=name, column=column),
                _NUMBERS,
            )
