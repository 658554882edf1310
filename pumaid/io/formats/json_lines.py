"""Logs in lines of JSON, an object a sample, read by Arrow in blocks, so that memory does not grow with the file."""

import re
import zlib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from pumaid.errors import LogError, Note, Where
from pumaid.io.formats import Batch, LogColumn, LogSource
from pumaid.io.formats.nested import leaves, log_column, table

#: Bytes that are parsed at a time; a line of twice as many is refused.
_BLOCK_BYTES = 4 << 20
#: Lists and objects on a line at most: tens of thousands in each other end Arrow's parser, and with it the program.
_MOST_LISTS = 1000
_ROW = re.compile(r" in row (\d+)")
_MEND = "write an object on each line, its keys with values of the same kind on all of them"


class JsonLog(LogSource):
    """Lines of JSON; fields of objects and elements of lists are columns, and gzipped files are read, too."""

    endings = (".jsonl", ".jsonl.gz")

    @classmethod
    def sniff(cls, head: bytes) -> bool:
        """By a first line that is an object, or by its beginning where it is longer."""
        with suppress(zlib.error):  # not packed
            head = zlib.decompressobj(wbits=31).decompress(head, len(head))
        line, end, _ = head.removeprefix(b"\xef\xbb\xbf").lstrip().partition(b"\n")
        return line.startswith(b"{") and b"\0" not in line and (line.rstrip().endswith(b"}") or not end)

    def schema(self) -> Sequence[LogColumn]:
        """The keys of the first lines."""
        _, columns = next(self._blocks(), ((), {}))
        return [log_column(name, values.type) for name, _, values in leaves(columns)]

    def batches(self, names: Sequence[str]) -> Iterator[Batch]:
        """As `LogSource`; a last line that is cut off is left out.

        Raises
        ------
        LogError [not-a-log, not-a-number]
            A line is no object, or a key does not have the same kind of value everywhere.
        """
        yield from (Batch(np.array(rows), table(columns, names, self.name)) for rows, columns in self._blocks())

    def _blocks(self) -> Iterator[tuple[Sequence[int], dict[str, Any]]]:
        first, rest = 1, b""
        with self.unpacked() as stream:
            while block := bytes(stream.read(_BLOCK_BYTES)):
                text, end, rest = (rest + block).rpartition(b"\n")
                if len(rest) > _BLOCK_BYTES:
                    raise LogError("not-a-log", f"a line of {self.name} is too long", Where(file=self.name), _MEND)
                lines = text.split(b"\n") if end else []
                yield from self._parsed(first, lines)
                first += len(lines)
        try:
            yield from self._parsed(first, [rest])
        except LogError:
            where = Where(file=self.name, row=first)
            self.notes = [Note("bad-samples", f"row {first} is cut off (recording stopped) and is left out", where)]

    def _parsed(self, first: int, lines: Sequence[bytes]) -> Iterator[tuple[Sequence[int], dict[str, Any]]]:
        import pyarrow as pa
        from pyarrow import json as arrow_json

        rows = [row for row, line in enumerate(lines, start=first) if line.strip(b"\r \t\xef\xbb\xbf")]
        filled = [lines[row - first] for row in rows]
        text = b"\n".join(filled).removeprefix(b"\xef\xbb\xbf")
        try:
            if crowded := [k for k, line in enumerate(filled) if line.count(b"[") + line.count(b"{") > _MOST_LISTS]:
                raise ValueError(f"it has more than {_MOST_LISTS} lists and objects in row {crowded[0]}")
            text.decode()
            options = arrow_json.ReadOptions(use_threads=False, block_size=len(text) + 1)
            read = arrow_json.read_json(pa.BufferReader(text), options) if filled else pa.table({})
            if read.num_rows != len(rows):
                raise ValueError("objects do not end where lines end")
        except ValueError as error:  # Arrow's and the decoder's are of this kind, too
            match = _ROW.search(str(error))
            row = rows[min(int(match[1]), len(rows) - 1)] if match else None
            raise LogError(
                "not-a-log",
                f"a line of {self.name} is no sample: {_ROW.sub('', str(error))[:150]}",
                Where(file=self.name, row=row),
                _MEND,
            ) from error
        if rows:
            yield rows, {name: read.column(name).combine_chunks() for name in read.column_names}
