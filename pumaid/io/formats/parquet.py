"""Parquet logs, read batch by batch and only the columns that are needed."""

import os
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from pumaid.errors import LogError, Where
from pumaid.io.formats import Batch, LogColumn, LogSource, floats, refusing
from pumaid.maths import Floats

#: Rows decoded at a time, and bytes that the reader of one column holds (else its whole chunk would be in memory).
_BATCH_ROWS, _BUFFER_BYTES = 65536, 1 << 18


class ParquetLog(LogSource):
    """A Parquet file; rows count as in the same table written as CSV, so the first is row 2."""

    endings = (".parquet",)

    @classmethod
    def sniff(cls, head: bytes) -> bool:
        """By the bytes with which every Parquet file begins."""
        return head.startswith(b"PAR1")

    def schema(self) -> Sequence[LogColumn]:
        """The names; time stamps and durations have a unit of their own."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        with refusing(self.name, (pa.ArrowException, OSError)):
            self._file = pq.ParquetFile(
                pa.OSFile(os.fsencode(self.path)),
                buffer_size=_BUFFER_BYTES,
                pre_buffer=False,
                page_checksum_verification=True,  # of pages that have a checksum
            )
        return [
            LogColumn(field.name, field.type.unit if _is_time(pa, field.type) else "")
            for field in self._file.schema_arrow
        ]

    def batches(self, names: Sequence[str]) -> Iterator[Batch]:
        """As `LogSource`."""
        import pyarrow as pa

        first = 2
        batches = self._file.iter_batches(_BATCH_ROWS, columns=list(dict.fromkeys(names)), use_threads=False)
        while True:
            with refusing(self.name, (pa.ArrowException, OSError)):
                batch = next(batches, None)
            if batch is None:
                return
            values = np.empty((len(names), batch.num_rows))
            for row, name in zip(values, names, strict=True):
                row[:] = self._numbers(batch.column(name), name)
            yield Batch(first + np.arange(batch.num_rows), values)
            first += batch.num_rows

    def _numbers(self, column: Any, name: str) -> Floats:
        import pyarrow as pa

        if _is_time(pa, column.type):
            column = column.view(pa.int64())
        try:
            return floats(column if pa.types.is_float64(column.type) else column.cast(pa.float64(), safe=False))
        except (pa.ArrowInvalid, pa.ArrowNotImplementedError) as error:
            what = f"column {name} holds {column.type}, not numbers: {str(error).splitlines()[0][:100]}"
            raise LogError(
                "not-a-number", what, Where(file=self.name, column=name), "write it as numbers, a column for each joint"
            ) from error


def _is_time(pa: Any, kind: Any) -> bool:
    return bool(pa.types.is_timestamp(kind) or pa.types.is_duration(kind))
