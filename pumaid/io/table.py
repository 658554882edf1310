"""Logs, CSV or Parquet, read batch by batch into records and written whole; no step holds a file."""

from __future__ import annotations

import gzip
import hashlib
import io
import os
import sys
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO, cast

import pyarrow as pa

from pumaid.dataset import FileFacts
from pumaid.errors import LogError, Note, Where
from pumaid.io.clean import Cleaner
from pumaid.io.columns import check_extra, resolve
from pumaid.io.csv_log import CsvSource
from pumaid.io.log_writer import write_log
from pumaid.io.oddities import Oddities
from pumaid.io.parquet_log import ParquetSource
from pumaid.io.parts import GZIP, MAGIC, FilePart
from pumaid.io.paths import STDIN, expand, unreadable
from pumaid.io.remote import Remote
from pumaid.records import Log
from pumaid.robot import Robot

__all__ = ["LogReader", "expand", "write_log"]

#: A log on this machine, or in a store; or a part of one.
LogPath = Path | Remote | FilePart

#: Notes of one kind that are told in full; a campaign of a thousand files may have one in each.
MOST_ALIKE = 3


class LogReader:
    """The samples of some logs, in SI, as an iterable of `Log` batches in the order of the files.

    One pass reads everything; memory stays that of a batch. After the pass `files` and `notes` tell what was read. A
    file whose first time follows the last time of the file before shares its clock; else its first batch has
    `starts_clock` set.

    Parameters
    ----------
    paths
        Files as `expand` gives them; ``-`` is standard input.
    robot
        Says by `robot.log` how the columns are named, their units and signs.
    batch_rows
        Most samples of one batch; the samples do not depend on it.
    extra
        Columns to read besides what the recipe names, as the files call them; they arrive as `Log.extra`.
    is_part
        Whether these are some of the files of an experiment: what only all of them can show is then not refused.

    Attributes
    ----------
    odd
        What is odd about a part of a file, by itself; it is not among the notes.

    Raises
    ------
    LogError
        While iterating: [column-missing, column-doubled, no-current, no-header, not-a-log, damaged-log, unreadable-log,
        not-a-number, ragged-row, bad-samples, time-not-rising, clock-too-coarse, empty-log]. A column `extra` that no
        file has is told before any is read; in a file that alone lacks it it is unknown.

    Examples
    --------
    >>> reader = LogReader(expand(["logs/"]), robot)  # doctest: +SKIP
    >>> dataset = segment(reader, robot)  # doctest: +SKIP
    >>> [facts.rows for facts in reader.files]  # doctest: +SKIP
    [120000, 120000]
    """

    def __init__(
        self,
        paths: Iterable[LogPath],
        robot: Robot,
        *,
        batch_rows: int = 65536,
        extra: Sequence[str] = (),
        is_part: bool = False,
    ) -> None:
        if batch_rows < 1:
            raise ValueError(f"batch_rows is {batch_rows}; a batch has at least one row")
        self._paths = tuple(path if isinstance(path, Remote | FilePart) else Path(path) for path in paths)
        self._robot, self._batch_rows, self._is_part = robot, batch_rows, is_part
        self.extra = tuple(dict.fromkeys(extra))
        self._files: list[FileFacts] = []
        self._notes: list[Note] = []
        self.odd: Oddities | None = None

    @property
    def files(self) -> tuple[FileFacts, ...]:
        """Facts of the files read to their end so far, in order."""
        return tuple(self._files)

    @property
    def notes(self) -> tuple[Note, ...]:
        """Notes of the files read so far; what many files share is told once."""
        return tuple(merged_notes(self._notes))

    @property
    def raw_notes(self) -> tuple[Note, ...]:
        """Notes of the files read so far, one by one."""
        return tuple(self._notes)

    def __iter__(self) -> Iterator[Log]:
        self._files, self._notes = [], []
        if not self._is_part:
            self.check_extra()
        for path in self._paths:
            yield from self._one(path)
        if self._paths and not self._is_part and not any(facts.rows for facts in self._files):
            what = f"no log has a row of numbers ({', '.join(facts.name for facts in self._files[:3])})"
            raise LogError("empty-log", what, Where(file=self._files[0].name), "record again, or name other files")

    def check_extra(self) -> None:
        """Look for the columns to read besides in all files.

        Raises
        ------
        LogError [no-such-column]
            No file has one of them.
        """
        if self.extra:
            check_extra(dict(self._headers()), self.extra)

    def _headers(self) -> Iterator[tuple[str, tuple[str, ...]]]:
        """Names and columns of the files; nothing where standard input is one, which cannot be looked at twice."""
        for path in () if STDIN in self._paths else self._paths:
            with _opened(path, str(path)) as (source, _):
                yield str(path), source.header

    def _one(self, path: LogPath) -> Iterator[Log]:
        name = "<stdin>" if path == STDIN else str(path)
        with _opened(path, name) as (source, digest):
            if path == STDIN:
                check_extra({name: source.header}, self.extra)
            columns = resolve(source.header, self._robot, name, extra=self.extra)
            before = [facts.last_time for facts in self._files if facts.rows]
            follows = before[-1] if before else None
            cleaner = Cleaner(self._robot, columns, name, follows=follows, n_extra=len(self.extra))
            if isinstance(source, ParquetSource):
                cleaner.time_factor = source.time_unit(columns.names[0])
            begins_part = False
            for rows, table in source.chunks(columns.names):
                # Of a chunk in which all is left out the next one takes the mark.
                begins_part = begins_part or (len(rows) > 0 and source.begins_part(int(rows[0])))
                for log in cleaner.take(rows, table):
                    yield from self._cut(replace(log, begins_part=True) if begins_part else log)
                    begins_part = False
            for log in cleaner.finish():
                yield from self._cut(log)
            sha256 = digest() if not isinstance(path, FilePart) or path.first == 0 else ""
        odd = cleaner.odd
        odd.ends, odd.n_lines = source.notes, source.n_lines
        self._notes += cleaner.columns.notes
        if isinstance(path, FilePart):
            self.odd = odd
        else:
            self._notes += odd.notes()
            if not odd.n_rows:
                self._notes.append(Note("empty-log", "the log has a header but no row", Where(file=name)))
        times = (odd.intervals.median, cleaner.first_time, cleaner.last_time)
        self._files.append(FileFacts(name, sha256, odd.n_rows, *times))

    def _cut(self, log: Log) -> Iterator[Log]:
        if len(log) <= self._batch_rows:
            yield log
            return
        for start in range(0, len(log), self._batch_rows):
            part = slice(start, start + self._batch_rows)
            yield replace(
                log,
                rows=log.rows[part],
                time=log.time[part],
                position=log.position[part],
                velocity=None if log.velocity is None else log.velocity[part],
                current=log.current[part],
                temperature=None if log.temperature is None else log.temperature[part],
                starts_clock=log.starts_clock and start == 0,
                begins_part=log.begins_part and start == 0,
                extra=None if log.extra is None else log.extra[part],
            )


class _Hashing(io.RawIOBase):
    """A stream that remembers the SHA-256 of what passed."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream, self.hash = stream, hashlib.sha256()

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        count = cast(io.BufferedReader, self._stream).readinto(buffer)
        self.hash.update(memoryview(buffer)[:count])
        return count


@contextmanager
def _opened(path: LogPath, name: str) -> Iterator[tuple[CsvSource | ParquetSource, Callable[[], str]]]:
    """The source for a file by its first bytes, and a function that gives the digest once all is read."""
    try:
        with nullcontext(sys.stdin.buffer) if path == STDIN else path.open("rb") as stream:
            buffered = io.BufferedReader(_Hashing(stream), buffer_size=1 << 18)
            if buffered.peek(len(MAGIC)).startswith(MAGIC):
                yield _parquet(path, stream, buffered)
            else:
                yield _text(path, name, stream, buffered)
    except (EOFError, gzip.BadGzipFile, zlib.error) as error:
        what = f"{name} is not a whole gzip file: {error}"
        raise LogError("damaged-log", what, Where(file=name), "compress it again") from error
    except OSError as error:
        raise unreadable(path.path if isinstance(path, FilePart) else path, error) from error


def _text(
    path: LogPath, name: str, stream: BinaryIO, buffered: io.BufferedReader[_Hashing]
) -> tuple[CsvSource, Callable[[], str]]:
    """A part that lies behind the first one tells no digest."""
    part = range(path.first, path.stop) if isinstance(path, FilePart) else None
    if part is not None and part.start:
        stream.seek(0)
        return CsvSource(stream, name, part), str
    text: Any = gzip.GzipFile(fileobj=buffered) if buffered.peek(len(GZIP)).startswith(GZIP) else buffered
    return CsvSource(text, name, part), lambda: _digest_to_end(buffered)


def _parquet(
    path: LogPath, stream: BinaryIO, buffered: io.BufferedReader[_Hashing]
) -> tuple[ParquetSource, Callable[[], str]]:
    """From a pipe the whole file must be held: Parquet's index is at its end."""
    groups = range(path.first, path.stop) if isinstance(path, FilePart) else None
    if groups is not None or (path != STDIN and path.is_file()):
        stream.seek(0)
        opened = pa.OSFile(os.fsencode(str(path))) if path.is_file() else path.open()
        return ParquetSource(opened, str(path), groups), lambda: _digest(stream)
    data = buffered.read()
    source = ParquetSource(io.BytesIO(data), "<stdin>" if path == STDIN else str(path))
    return source, lambda: hashlib.sha256(data).hexdigest()


def _digest(stream: BinaryIO) -> str:
    return hashlib.file_digest(cast(io.BufferedReader, stream), "sha256").hexdigest()


def _digest_to_end(buffered: io.BufferedReader[_Hashing]) -> str:
    while buffered.read(1 << 20):
        pass
    return buffered.raw.hash.hexdigest()


def merged_notes(notes: Iterable[Note]) -> Iterator[Note]:
    """What several files share word for word once; of each kind the first `MOST_ALIKE`, and how many more there are."""
    groups: dict[tuple[str, str], list[Note]] = {}
    for note in notes:
        groups.setdefault((note.slug, note.text), []).append(note)
    by_slug: dict[str, list[Note]] = {}
    for (slug, text), alike in groups.items():
        more = f"; the same in {len(alike) - 1} more files" if len(alike) > 1 else ""
        by_slug.setdefault(slug, []).append(Note(slug, text + more, alike[0].where))
    for slug, told in by_slug.items():
        yield from told[:MOST_ALIKE]
        if rest := told[MOST_ALIKE:]:
            files = list(dict.fromkeys(str(note.where.file) for note in rest))
            named = ", ".join(files[:MOST_ALIKE]) + (" ..." if len(files) > MOST_ALIKE else "")
            yield Note(slug, f"{len(rest)} more notes of this kind, on {named}")
