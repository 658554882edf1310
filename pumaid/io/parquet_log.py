"""Parquet logs, read batch by batch and only the columns that are needed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pumaid.errors import LogError, Note, Where
from pumaid.io.arrow import floats
from pumaid.io.parts import group_parts

#: Rows decoded at a time.
BATCH_ROWS = 65536
#: Bytes that one column's reader holds; without it a row group's whole column chunk would be in memory.
_BUFFER_BYTES = 1 << 18

_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}

Chunk = tuple[NDArray[np.int64], NDArray[np.float64]]


@dataclass(eq=False, slots=True)
class ParquetSource:
    """A Parquet log as chunks of numbers; rows count as in the same table written as CSV (the first is row 2).

    Attributes
    ----------
    stream
        Binary and seekable; a file opened by Arrow itself is read without Python's lock.
    name
        For messages.
    groups
        Row groups to read; None for all.
    notes, n_lines
        Nothing so far is worth a note, and rows are known wherever a part begins; the twin of the text log has them.
    """

    stream: BinaryIO | pa.NativeFile
    name: str
    groups: range | None = None
    notes: list[Note] = field(init=False, default_factory=list)
    n_lines: int = field(init=False, default=0)
    _file: pq.ParquetFile = field(init=False)
    _parts: dict[int, range] = field(init=False, default_factory=dict)  # by their first rows

    def __post_init__(self) -> None:
        try:
            self._file = pq.ParquetFile(
                self.stream, buffer_size=_BUFFER_BYTES, pre_buffer=False, page_checksum_verification=True
            )
        except (pa.ArrowException, OSError) as error:
            raise self._damaged(error) from error
        about = self._file.metadata
        for groups in group_parts(about) if self.groups is None else [self.groups]:
            self._parts[2 + sum(about.row_group(number).num_rows for number in range(groups.start))] = groups

    @property
    def header(self) -> tuple[str, ...]:
        """Column names."""
        return tuple(self._file.schema_arrow.names)

    def time_unit(self, column: str) -> float | None:
        """Seconds in one unit of a time stamp or duration column; None for plain numbers."""
        kind = self._file.schema_arrow.field(column).type
        return _SECONDS[kind.unit] if pa.types.is_timestamp(kind) or pa.types.is_duration(kind) else None

    def chunks(self, names: tuple[str, ...]) -> Iterator[Chunk]:
        """Rows and values (C, N) of the named columns, batch by batch; none reaches from a part into the next.

        Raises
        ------
        LogError [not-a-number, damaged-log]
            A column holds no numbers, or the file's bytes are damaged.
        """
        self._check_types(names)
        for first, groups in self._parts.items():
            yield from self._part(groups, names, first)

    def begins_part(self, row: int) -> bool:
        """Whether a part that may be read by itself begins with this row."""
        return row in self._parts

    def _part(self, groups: range, names: tuple[str, ...], first: int) -> Iterator[Chunk]:
        columns = list(dict.fromkeys(names))
        batches = self._file.iter_batches(BATCH_ROWS, row_groups=list(groups), columns=columns, use_threads=False)
        while True:
            try:
                batch = next(batches, None)
            except (pa.ArrowException, OSError) as error:
                raise self._damaged(error) from error
            if batch is None:
                return
            rows = first + np.arange(batch.num_rows)
            first += batch.num_rows
            table = np.empty((len(names), batch.num_rows))
            for row, name in zip(table, names, strict=True):
                row[:] = self._numbers(batch.column(name), name, rows)
            yield rows, table

    def _check_types(self, names: tuple[str, ...]) -> None:
        for name in names:
            kind = self._file.schema_arrow.field(name).type
            if pa.types.is_nested(kind) or pa.types.is_binary(kind):
                what = f"column {name} holds {kind}, not numbers"
                mend = "write one column of numbers a joint"
                raise LogError("not-a-number", what, Where(file=self.name, column=name), mend)

    def _numbers(self, column: pa.Array, name: str, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        if pa.types.is_dictionary(column.type):
            column = column.dictionary_decode()
        if pa.types.is_timestamp(column.type) or pa.types.is_duration(column.type):
            column = column.view(pa.int64())
        if pa.types.is_string(column.type) or pa.types.is_large_string(column.type):
            return self._from_text(column, name, rows)
        if pa.types.is_float64(column.type):
            return floats(column)
        try:
            # Rounding 64-bit integers to the nearest float64 is what SI numbers are made of anyway.
            return floats(column.cast(pa.float64(), safe=False))
        except (pa.ArrowInvalid, pa.ArrowNotImplementedError) as error:
            what = f"column {name} holds {column.type}, not numbers"
            raise LogError("not-a-number", what, Where(file=self.name, column=name), "write it as numbers") from error

    def _from_text(self, column: pa.Array, name: str, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        import pyarrow.compute as pc

        trimmed = pc.utf8_trim_whitespace(column)
        blank = pc.is_in(pc.utf8_lower(trimmed), pa.array(["", "nan", "na", "null", "none"], type=trimmed.type))
        try:
            return floats(pc.if_else(blank, None, trimmed).cast(pa.float64()))
        except pa.ArrowInvalid as error:
            bad = [(row, text) for row, text in zip(rows.tolist(), trimmed.to_pylist(), strict=True) if _is_text(text)]
            shown = "; ".join(f"row {row}, column {name}: {text[:30]!r}" for row, text in bad[:3])
            more = f" and {len(bad) - 3} more nearby" if len(bad) > 3 else ""
            where = Where(file=self.name, row=bad[0][0] if bad else None, column=name)
            what = f"text where a number belongs: {shown}{more}"
            raise LogError("not-a-number", what, where, "write the column as numbers") from error

    def _damaged(self, error: Exception) -> LogError:
        reason = str(error).splitlines()[0][:200] if str(error) else type(error).__name__
        if isinstance(error, MemoryError):
            what = f"the system has no memory for what {self.name} asks for: {reason}"
            mend = (
                "end other programs or raise the limit (ulimit -v); if that is far more than the file: export it again"
            )
            return LogError("no-memory", what, Where(file=self.name), mend)
        mend = "the file was cut off or altered: record, copy or export it again"
        return LogError(
            "damaged-log", f"{self.name} is not a whole Parquet file: {reason}", Where(file=self.name), mend
        )


def _is_text(text: str | None) -> bool:
    try:
        return (
            text is not None and text.lower() not in ("", "na", "null", "none") and not isinstance(float(text), float)
        )
    except ValueError:
        return True
