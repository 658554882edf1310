"""Parquet logs, read batch by batch and only the columns that are needed."""

import os
from collections.abc import Iterator, Sequence

import numpy as np

from pumaid.io.formats import Batch, LogColumn, LogSource, refusing
from pumaid.io.formats.nested import leaves, log_column, table

#: Rows decoded at a time, and bytes that the reader of one column holds (else its whole chunk would be in memory).
_BATCH_ROWS, _BUFFER_BYTES = 65536, 1 << 18
#: Rows by which it is told how long lists are, and which joints they name.
_PROBE_ROWS = 100


class ParquetLog(LogSource):
    """A Parquet file; rows count as in the same table written as CSV, so the first is row 2."""

    endings = (".parquet",)

    @classmethod
    def sniff(cls, head: bytes) -> bool:
        """By the bytes with which every Parquet file begins."""
        return head.startswith(b"PAR1")

    def schema(self) -> Sequence[LogColumn]:
        """The names; of lists and structs those of their elements in the first rows."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        self._kinds = (pa.ArrowException, OSError, UnicodeDecodeError)
        with refusing(self.name, self._kinds):
            self._file = pq.ParquetFile(
                pa.OSFile(os.fsencode(self.path)),
                buffer_size=_BUFFER_BYTES,
                pre_buffer=False,
                page_checksum_verification=True,  # of pages that have a checksum
            )
            fields = self._file.schema_arrow
            nested = [field.name for field in fields if pa.types.is_nested(field.type)]
            batches = self._file.iter_batches(_PROBE_ROWS, columns=nested, use_threads=False) if nested else iter(())
            head = next(batches, None)
            inner = [*leaves({name: head.column(name) for name in nested})] if head is not None else []
            flat = [log_column(field.name, field.type) for field in fields if field.name not in nested]
        self._keys = {name: keys for name, keys, _ in inner} | {column.name: (column.name,) for column in flat}
        return [*flat, *(log_column(name, values.type) for name, _, values in inner)]

    def batches(self, names: Sequence[str]) -> Iterator[Batch]:
        """As `LogSource`."""
        first = 2
        columns = list(dict.fromkeys(key for name in names for key in self._keys[name]))
        batches = self._file.iter_batches(_BATCH_ROWS, columns=columns, use_threads=False)
        while True:
            with refusing(self.name, self._kinds):
                batch = next(batches, None)
                if batch is None:
                    return
                values = table({key: batch.column(key) for key in columns}, names, self.name)
            yield Batch(first + np.arange(batch.num_rows), values)
            first += batch.num_rows
