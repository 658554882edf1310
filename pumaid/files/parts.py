"""Parts of large log files that can be read by themselves: row groups of Parquet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, cast

import pyarrow as pa
import pyarrow.parquet as pq

from pumaid.files.remote import Remote

#: Rows from which a part is worth reading by itself: opening the file again is then nothing beside it, and the first
#: one tells the file's sampling interval.
PART_ROWS = 150_000
#: First bytes of every Parquet file.
MAGIC = b"PAR1"


@dataclass(frozen=True, slots=True)
class FilePart:
    """Row groups [first, stop) of a Parquet file; its first one also tells the file's digest."""

    path: Path | Remote
    first: int
    stop: int

    def __str__(self) -> str:
        return str(self.path)

    @property
    def name(self) -> str:
        """The file's last name."""
        return self.path.name

    def open(self, mode: str = "rb") -> BinaryIO:
        """The whole file's bytes.

        Raises
        ------
        OSError
            It cannot be read.
        """
        return cast(BinaryIO, self.path.open(mode))

    def is_file(self) -> bool:
        """Whether the system can open it by its name."""
        return self.path.is_file()

    def stat(self) -> Any:
        """What the system knows of the whole file."""
        return self.path.stat()


def group_parts(metadata: pq.FileMetaData) -> list[range]:
    """Row groups in parts of enough rows, in order; one part where there are too few.

    Parameters
    ----------
    metadata
        Of a Parquet file.
    """
    rows = [metadata.row_group(number).num_rows for number in range(metadata.num_row_groups)]
    return parts_of_rows(rows)


def parts_of_rows(rows: Sequence[int]) -> list[range]:
    """Row groups, given their rows, in parts of at least `PART_ROWS`; a smaller rest belongs to the last."""
    borders, first, ahead = [0], 0, sum(rows)
    for number, count in enumerate(rows, start=1):
        ahead -= count
        if sum(rows[first:number]) >= PART_ROWS and ahead >= PART_ROWS:
            borders.append(number)
            first = number
    return [range(low, high) for low, high in zip(borders, [*borders[1:], len(rows)], strict=True)]


def file_parts(path: Path | Remote) -> list[Path | Remote | FilePart]:
    """The parts of a log that may be read by themselves; the file itself where that is one, or where it is damaged.

    Parameters
    ----------
    path
        A log.
    """
    try:
        with path.open("rb") as stream:
            if stream.read(len(MAGIC)) != MAGIC:
                return [path]
            parts = group_parts(pq.ParquetFile(stream).metadata)
    except (OSError, pa.ArrowException):
        return [path]
    return [path] if len(parts) < 2 else [FilePart(path, part.start, part.stop) for part in parts]
