"""Logs of any format, read batch by batch as samples in SI; no step holds a file."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, cast

from pumaid.dataset import FileFacts, Log
from pumaid.errors import LogError, Note, Where
from pumaid.io.clean import Cleaner
from pumaid.io.columns import check_extra, resolve
from pumaid.io.log_formats import HEAD_BYTES, LogSource, log_format
from pumaid.io.paths import STDIN, LogPath, local_copy
from pumaid.robot import Robot
from pumaid.units import UNITS


class LogReader:
    """The samples of some logs, in SI, as an iterable of `Log` batches in the order of the files.

    A file whose first time follows the last time of the file before shares its clock; else its first batch has
    `starts_clock` set. After the pass `files` and `notes` tell what was read.

    Parameters
    ----------
    paths
        Files as `pumaid.io.paths.expand` gives them; ``-`` is standard input.
    robot
        Its `log` names the columns, their units and signs.
    extra
        Columns to read besides what the recipe names, as the files call them; they arrive as `Log.extra`, unknown in a
        file that lacks them.

    Raises
    ------
    LogError
        While iterating: [column-missing, column-doubled, no-current, no-header, not-a-log, damaged-log, unreadable-log,
        not-a-number, ragged-row, bad-samples, time-not-rising, clock-too-coarse].
    """

    def __init__(self, paths: Iterable[LogPath | str], robot: Robot, *, extra: Sequence[str] = ()) -> None:
        self._paths = tuple(Path(path) if isinstance(path, str) else path for path in paths)
        self._robot = robot
        self.extra = tuple(dict.fromkeys(extra))
        self.files: tuple[FileFacts, ...] = ()
        self.notes: tuple[Note, ...] = ()

    def __iter__(self) -> Iterator[Log]:
        self.files, self.notes = (), ()
        for path in self._paths:
            name = "<stdin>" if path == STDIN else str(path)
            with local_copy(path) as file:
                yield from self._samples(file, name)

    def check_extra(self) -> None:
        """Look for the extra columns in the files' headers, but not in standard input, which can be read once.

        Raises
        ------
        LogError [column-missing]
            No file has one of them.
        """
        headers = {}
        for path in self._paths if self.extra and STDIN not in self._paths else ():
            with local_copy(path) as file:
                headers[str(path)] = [column.name for column in log_source(file, str(path)).schema()]
        check_extra(headers, self.extra)

    def _samples(self, file: Path, name: str) -> Iterator[Log]:
        before = file.stat()
        with file.open("rb") as stream:
            digest = hashlib.file_digest(cast(Any, stream), "sha256").hexdigest()
        source = log_source(file, name)
        schema = source.schema()
        columns = resolve([column.name for column in schema], self._robot, name, extra=self.extra)
        unit = next(column.unit for column in schema if column.name == columns.names[0])
        cleaner = Cleaner(
            self._robot,
            columns,
            name,
            n_extra=len(self.extra),
            time_factor=UNITS[unit][1] if unit else None,
            follows=next((facts.last_time for facts in reversed(self.files) if facts.rows), None),
        )
        for rows, values in source.batches(columns.names):
            yield from cleaner.take(rows, values)
        notes = [*columns.notes, *cleaner.notes(), *source.notes]
        if not cleaner.n_rows:
            notes.append(Note("empty-log", "the log has a header but no row", Where(file=name)))
        after = file.stat()
        if (after.st_size, after.st_mtime_ns) != (
            before.st_size,
            before.st_mtime_ns,
        ):  # the digest is of another content
            what, mend = f"{name} changed while it was read", "read it again when the recording has ended"
            raise LogError("unreadable-log", what, Where(file=name), mend)
        times = (cleaner.interval, cleaner.first_time, cleaner.last_time)
        self.files = (*self.files, FileFacts(name, digest, cleaner.n_rows, *times))
        self.notes = (*self.notes, *notes)


def log_source(file: Path, name: str) -> LogSource:
    """A file on this machine as a log of the format that its first bytes show; `name` is for messages.

    Raises
    ------
    LogError [not-a-log]
        It is of no format that is read.
    """
    with file.open("rb") as stream:
        head = stream.read(HEAD_BYTES)
    return log_format(head, name)(file, name)
