"""Parts of large log files that can be read by themselves: row groups of Parquet, lines of text."""

from __future__ import annotations

import codecs
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, cast

import pyarrow as pa
import pyarrow.parquet as pq

from pumaid.io.remote import Remote

#: Rows from which a part is worth reading by itself: opening the file again is then nothing beside it, and the first
#: one tells the file's sampling interval.
PART_ROWS = 150_000
#: The same of a text, reckoned from its first lines: others may be twice as long.
TEXT_ROWS = 200_000
#: Bytes that numbers take as text for each that they take in Parquet.
TEXT_BYTES = 6
#: Bytes of a text from which it is told how it is written.
HEAD_BYTES = 1 << 16
#: First bytes of every Parquet file, and of every gzipped one.
MAGIC, GZIP = b"PAR1", b"\x1f\x8b"


@dataclass(frozen=True, slots=True)
class FilePart:
    """Row groups [first, stop) of a Parquet file, or the lines of a text that begin at bytes [first, stop).

    A line that begins at the first byte behind a line feed counts from there; the first part also tells the file's
    digest.
    """

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
    borders, here, ahead = [0], 0, sum(rows)
    for number, count in enumerate(rows, start=1):
        here, ahead = here + count, ahead - count
        if here >= PART_ROWS and ahead >= PART_ROWS:
            borders.append(number)
            here = 0
    return [range(low, high) for low, high in zip(borders, [*borders[1:], len(rows)], strict=True)]


def text_step(head: bytes) -> int:
    """Bytes from one part of a text to the next, which begins behind the next line feed; 0 where it is read at once.

    Parameters
    ----------
    head
        The file's first `HEAD_BYTES` bytes, or all of it.
    """
    lines = head.count(b"\n")
    if lines < 2 or head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return 0
    return TEXT_ROWS * len(head) // lines


def file_parts(path: Path | Remote, *, whole: int = 0) -> list[Path | Remote | FilePart]:
    """The parts of a log that may be read by themselves; the file itself where that is one, or where it is damaged.

    Parameters
    ----------
    path
        A log.
    whole
        Bytes of Parquet, and of as many rows as text, up to which a file is left whole.
    """
    try:
        with path.open("rb") as stream:
            head = stream.read(HEAD_BYTES)
            size = path.size if isinstance(path, Remote) else path.stat().st_size
            if size <= whole * (1 if head.startswith(MAGIC) else TEXT_BYTES):
                return [path]
            if head.startswith(MAGIC):
                parts = group_parts(pq.ParquetFile(stream).metadata)
            elif head.startswith(GZIP) or not path.is_file():
                # The first part's reader reads all of a text for its digest: from a store it would come twice.
                return [path]
            else:
                parts = _text_parts(size, text_step(head))
    except (OSError, pa.ArrowException):
        return [path]
    return [path] if len(parts) < 2 else [FilePart(path, part.start, part.stop) for part in parts]


def _text_parts(size: int, step: int) -> list[range]:
    """Bytes at whose multiples a text of some size is cut; a rest of less than half a part belongs to the last."""
    borders = [0, *(range(step, size - step // 2, step) if step else ())]
    return [range(low, high) for low, high in zip(borders, [*borders[1:], sys.maxsize], strict=True)]
