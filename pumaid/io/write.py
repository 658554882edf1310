"""Files written atomically: a reader sees the old content or all of the new one, never a part; logs and sessions."""

from __future__ import annotations

import csv
import errno
import importlib
import io
import json
import os
import re
import secrets
import stat
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from itertools import chain, groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Log
from pumaid.errors import ModelError, ResultError, Where
from pumaid.io.columns import QUANTITIES, factor_of, time_factor
from pumaid.io.paths import STDIN, is_log
from pumaid.robot import Robot

if TYPE_CHECKING:
    import pyarrow as pa

Floats = NDArray[np.float64]

#: Decimals of a number in CSV: finer than any encoder, current sensor or clock.
DECIMALS = 9
TRUTH_NAME = "truth.json"
#: What simulated logs are called; a truth beside them proves that they are.
_SIMULATED = re.compile(r"session_\d+\.(csv|parquet)")
#: Longest wait for another process that writes to the same folder, and how often the lock is tried, s.
PATIENCE, PAUSE = 20.0, 0.02

_ELSEWHERE = "write elsewhere with -o"
_MENDS = {
    errno.ENOSPC: f"free some space on that disk, or {_ELSEWHERE}",
    errno.EDQUOT: f"your disk quota is used up: free some space, or {_ELSEWHERE}",
    errno.EACCES: f"you may not write there: change the folder's permissions, or {_ELSEWHERE}",
    errno.ENAMETOOLONG: "give a shorter name with -o",
}


def write_file(path: Path, data: bytes | str) -> None:
    """Write a file as `replacing` does.

    Text is encoded as UTF-8; surrogates (bytes of a file name that are not UTF-8) become backslash escapes.
    """
    with replacing(path) as temporary:
        temporary.write_bytes(data.encode("utf-8", "backslashreplace") if isinstance(data, str) else data)


def refuse_to_replace(path: Path) -> None:
    """Refuse to write a file where one stands that a user may have edited.

    Raises
    ------
    ResultError [file-exists]
        There is a file of that name.
    """
    if str(path) != "-" and path.exists():
        mend = "replace it with --force, or write to another file with -o"
        raise ResultError("file-exists", f"{path} is there already", Where(file=str(path)), mend)


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path beside `path` that is renamed to it when the block ends without an error.

    An error in the block leaves nothing behind. A symbolic link stays; the file that it points to is replaced. Missing
    folders are made. A device or a pipe (``/dev/stdout``) is written directly.

    Raises
    ------
    ResultError [cannot-write]
        The system refuses, in the block or at its end; the old content is unchanged.
    """
    path = Path(path)
    target = Path(os.path.realpath(path))
    temporary = target.with_name(f".{target.name[:80]}.{secrets.token_hex(6)}.part")
    try:
        # /dev/stdout may be a plain file that the shell holds open.
        is_file = not path.exists() or stat.S_ISREG(path.stat().st_mode) or path.is_dir()
        if not is_file or path.parts[:2] == ("/", "dev"):
            yield path
            return
        if target.is_symlink():
            raise OSError(errno.ELOOP, "links that lead to one another")
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, "is a folder")
        yield temporary
        with temporary.open("rb+") as file:  # without this a power cut could leave an empty file under the new name
            os.fsync(file.fileno())
        with suppress(FileNotFoundError):
            temporary.chmod(target.stat().st_mode & 0o7777)
        temporary.replace(target)
    except OSError as error:
        shown = path.name if len(path.name) <= 80 else path.name[:77] + "..."
        what = f"cannot write {shown}: {error.strerror or error}"
        mend = _MENDS.get(error.errno or 0, _ELSEWHERE)
        raise ResultError("cannot-write", what, Where(file=str(path)[:300]), mend) from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


@contextmanager
def locked(folder: Path, *, patience: float = PATIENCE) -> Iterator[None]:
    """Keep other processes of this program out of a folder during the block.

    The folder itself, made if it is missing, is locked (flock), so no lock file remains, and the system releases the
    lock when a process ends. Where there are no such locks the block runs without one.

    Raises
    ------
    ResultError [results-busy]
        Another process holds the lock for longer than `patience` (s).
    """
    try:
        fcntl = importlib.import_module("fcntl")
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(folder, os.O_RDONLY)
    except (ImportError, OSError):
        yield
        return
    try:
        end = time.monotonic() + patience
        while _is_busy(fcntl, handle):
            if time.monotonic() > end:
                what = f"another run of pumaid has been writing to {folder} for {patience:g} s"
                mend = "wait until it is over, or write elsewhere with --results"
                raise ResultError("results-busy", what, Where(file=str(folder)), mend)
            time.sleep(PAUSE)
        yield
    finally:
        os.close(handle)


def _is_busy(fcntl: Any, handle: int) -> bool:
    """Whether another process has the lock; where the file system has none, nobody has."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return isinstance(error, BlockingIOError)
    return False


def write_log(path: Path, logs: Iterable[Log], robot: Robot) -> None:
    """Write samples (at least one batch, in order of time) as one log file in the recipe's columns, units and signs.

    The ending decides: ``.parquet`` keeps every bit, ``.csv`` nine decimals. ``-`` writes CSV to standard output.
    Velocity, temperature and joints without a current are left out where the first log has none.

    Raises
    ------
    ResultError [cannot-write, unknown-ending]
        The disk refuses, or the ending is neither ``.csv`` nor ``.parquet``.
    """
    path = Path(path)
    tables = _tables(logs, robot)
    if path == STDIN:
        _write_csv(sys.stdout.buffer, tables)
        return
    write = {".csv": _write_csv, ".parquet": _write_parquet}.get(path.suffix.lower())
    if write is None:
        what = f"{path.name} ends in {path.suffix or 'nothing'}, which is no log format"
        raise ResultError("unknown-ending", what, Where(file=str(path)), "name it .csv or .parquet")
    with replacing(path) as temporary, temporary.open("wb") as sink:
        write(sink, tables)


def _tables(logs: Iterable[Log], robot: Robot) -> Iterator[pa.Table]:
    """A table a log, in the log's units and signs."""
    import pyarrow as pa

    columns: dict[str, tuple[str, int, float]] = {}
    for log in logs:
        columns = columns or _columns(log, robot)
        names, arrays = [robot.log.time], [log.time / time_factor(robot)]
        for name, (quantity, joint, factor) in columns.items():
            values = getattr(log, quantity)
            names.append(name)
            arrays.append(np.full(len(log), np.nan) if values is None else values[:, joint] / factor)
        yield pa.table(arrays, names=names)


def _columns(log: Log, robot: Robot) -> dict[str, tuple[str, int, float]]:
    """Column name -> quantity, index of the joint and factor to SI of what a log has, but for the time."""
    columns = {}
    for quantity in QUANTITIES:
        values = getattr(log, quantity)
        for index, joint in enumerate(robot.joints):
            name = robot.log.column(quantity, joint.number)
            absent = values is None or (len(log) and bool(np.isnan(values[:, index]).all()))
            if name is not None and not absent:
                columns[name] = (quantity, index, factor_of(robot, quantity, joint))
    return columns


def _write_parquet(sink: BinaryIO, tables: Iterator[pa.Table]) -> None:
    import pyarrow.parquet as pq

    first = next(tables)
    # The dictionary would cost time and space: floats hardly ever repeat.
    options = {"compression": "zstd", "use_dictionary": False, "write_page_checksum": True}
    with pq.ParquetWriter(sink, first.schema, **options) as writer:
        for table in chain([first], tables):
            writer.write_table(table)


def _write_csv(sink: BinaryIO, tables: Iterator[pa.Table]) -> None:
    import pyarrow as pa
    from pyarrow import csv as arrow_csv

    options = arrow_csv.WriteOptions(include_header=False, quoting_style="needed")
    for number, table in enumerate(tables):
        if number == 0:  # Arrow would quote every name
            header = io.StringIO()
            csv.writer(header, lineterminator="\n").writerow(table.column_names)
            sink.write(header.getvalue().encode())
        values = np.array([column.to_numpy() for column in table.columns])
        # Where a float64 has no more than these decimals, rounding would only disturb it.
        is_fine = np.abs(values) < 2.0**53 / 10.0**DECIMALS
        values[is_fine] = np.round(values[is_fine], DECIMALS)
        # Not-a-number becomes an empty cell.
        arrays = [pa.array(column, from_pandas=True) for column in values]
        arrow_csv.write_csv(pa.table(arrays, names=table.column_names), sink, options)


def write_session(
    folder: Path,
    logs: Iterable[Log],
    robot: Robot,
    *,
    truth: Mapping[str, Any],
    form: str = "parquet",
    force: bool = False,
    progress: Callable[[float], None] = lambda seconds: None,
) -> list[tuple[str, int, float, float]]:
    """Write a virtual robot's logs, a file for each `origin`, and beside them in ``truth.json`` what the robot was.

    Each file is written atomically; a session that is interrupted leaves the files written so far and the truth. ``-``
    as folder writes all logs as one CSV to standard output, without the truth. With `force`, logs of an earlier
    simulation in the folder (``session_*`` beside a ``truth.json``) are replaced. `progress` is called with the time
    (s) up to which is written. The files are returned with their names, samples, first and last time (s).

    Raises
    ------
    ResultError [logs-in-the-way, cannot-write, results-busy]
        The folder holds logs already (measured and simulated ones must not mix), the disk refuses, or another run does
        not let go of the folder.
    """
    files: dict[str, tuple[int, float, float]] = {}

    def watched(batches: Iterable[Log]) -> Iterator[Log]:
        for log in batches:
            count, first, _ = files.get(log.origin, (0, float(log.time[0]), 0.0))
            files[log.origin] = (count + len(log), first, float(log.time[-1]))
            progress(float(log.time[-1]))
            yield log

    if folder == STDIN:
        write_log(folder, watched(logs), robot)
        return []
    with locked(folder):
        for path in _replaced(folder, force):
            path.unlink()
        write_file(folder / TRUTH_NAME, json.dumps(truth, indent=2) + "\n")
        for origin, batches in groupby(watched(logs), key=lambda log: log.origin):
            write_log(folder / f"{origin}.{form}", batches, robot)
    return [(f"{origin}.{form}", *facts) for origin, facts in files.items()]


def read_truth(path: Path) -> dict[str, Any]:
    """The document of a ``truth.json``.

    Raises
    ------
    ModelError [file-not-readable]
        There is no such file, or it is no JSON object.
    """
    document, reason = None, "it holds no JSON object"
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it is no JSON"
    if not isinstance(document, dict):
        raise ModelError("file-not-readable", f"{path} cannot be read: {reason}", Where(str(path)), "give a truth.json")
    return document


def _replaced(folder: Path, force: bool) -> list[Path]:
    """Files of an earlier simulation whose place a new one takes, the truth last.

    Raises
    ------
    ResultError [logs-in-the-way]
        There are others, or these may not be replaced.
    """
    truth, is_simulated = folder / TRUTH_NAME, False
    with suppress(ModelError):
        is_simulated = read_truth(truth).get("kind") == "truth"
    there = [path for path in sorted(folder.rglob("*")) if is_log(str(path.relative_to(folder)))]
    there += [truth] if os.path.lexists(truth) else []
    foreign = [path for path in there if path.parent != folder or not _SIMULATED.fullmatch(path.name)]
    foreign = [path for path in foreign if path != truth] if is_simulated else there
    if foreign or (there and not force):
        first = (foreign or there)[0]
        why = "; no truth.json beside it says that it was simulated" if foreign else ""
        what = f"{folder} holds logs already ({len(there)} files, such as {first.name}){why}"
        mend = "write to another folder with -o" + ("" if foreign else ", or replace them with --force")
        raise ResultError("logs-in-the-way", what, Where(file=str(first)), mend)
    return there
