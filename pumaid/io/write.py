"""Files written atomically: a reader sees the old content or all of the new one, never a part; logs and sessions."""

from __future__ import annotations

import errno
import importlib
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

#: Digits of a number in CSV: finer than any encoder or current sensor, half the size of all sixteen.
DIGITS = 9
TRUTH_NAME = "truth.json"
#: What simulated logs are called; a truth beside them proves that they are.
_SIMULATED = re.compile(r"session_\d+\.(csv|parquet)")
#: Longest wait for another process that writes to the same folder, and how often the lock is tried, s.
PATIENCE, PAUSE = 20.0, 0.02

_ELSEWHERE = "write elsewhere with -o"
_MENDS = {
    errno.ENOSPC: f"free some space on that disk, or {_ELSEWHERE}",
    errno.EDQUOT: f"your disk quota is used up: free some space, or {_ELSEWHERE}",
    errno.EROFS: f"that disk is read-only: {_ELSEWHERE}",
    errno.EACCES: f"you may not write there: change the folder's permissions, or {_ELSEWHERE}",
    errno.EISDIR: "a folder of that name is in the way: give a file name with -o",
    errno.ENOTDIR: f"a file stands where a folder is needed: {_ELSEWHERE}",
    errno.EEXIST: f"a file stands where a folder is needed: {_ELSEWHERE}",
    errno.ENAMETOOLONG: "give a shorter name with -o",
}


def write_file(path: Path, data: bytes | str) -> None:
    """Write a file atomically, missing folders with it; a device or a pipe (``/dev/stdout``) directly.

    Text is encoded as UTF-8; surrogates (bytes of a file name that are not UTF-8) become backslash escapes.

    Raises
    ------
    ResultError [cannot-write]
        The system refuses; the old content is unchanged.
    """
    content = data.encode("utf-8", "backslashreplace") if isinstance(data, str) else data
    if _is_stream(Path(path)):
        try:
            Path(path).write_bytes(content)
        except OSError as error:
            raise _refusal(Path(path), error) from error
        return
    with replacing(path) as temporary:
        temporary.write_bytes(content)


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
    folders are made.

    Raises
    ------
    ResultError [cannot-write]
        The system refuses, in the block or at its end.
    """
    path = Path(path)
    target = Path(os.path.realpath(path))
    temporary = target.with_name(f".{target.name[:80]}.{secrets.token_hex(6)}.part")
    try:
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
        raise _refusal(path, error) from error
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
        while not _locks(fcntl, handle):
            if time.monotonic() > end:
                what = f"another run of pumaid has been writing to {folder} for {patience:g} s"
                mend = "wait until it is over, or write elsewhere with --results"
                raise ResultError("results-busy", what, Where(file=str(folder)), mend)
            time.sleep(PAUSE)
        yield
    finally:
        os.close(handle)


def _locks(fcntl: object, handle: int) -> bool:
    """Whether the lock was taken, or the file system has none."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)  # type: ignore[attr-defined]
    except BlockingIOError:
        return False
    except OSError:
        return True
    return True


def _is_stream(path: Path) -> bool:
    """Whether it is a device or a pipe; /dev/stdout may be a plain file that the shell holds open."""
    with suppress(OSError):
        mode = path.stat().st_mode
        return path.parts[:2] == ("/", "dev") or not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))
    return False


def _refusal(path: Path, error: OSError) -> ResultError:
    shown = path.name if len(path.name) <= 80 else path.name[:77] + "..."
    what = f"cannot write {shown}: {error.strerror or error}"
    mend = _MENDS.get(error.errno or 0, "write elsewhere with -o")
    return ResultError("cannot-write", what, Where(file=str(path)[:300]), mend)


def write_log(path: Path, logs: Iterable[Log], robot: Robot) -> None:
    """Write samples, in order of time, as one log file in the recipe's columns, units and signs.

    The ending decides: ``.parquet`` keeps every bit, ``.csv`` nine digits (and the time to the nanosecond). ``-``
    writes CSV to standard output. Velocity, temperature and joints without a current are left out where the first log
    has none.

    Raises
    ------
    ResultError [cannot-write, unknown-ending]
        The disk refuses, or the ending is neither ``.csv`` nor ``.parquet``.
    """
    path = Path(path)
    parts = _tables(logs, robot)
    if path == STDIN:
        _write_csv(sys.stdout.buffer, parts)
    elif path.suffix.lower() not in (".csv", ".parquet"):
        what = f"{path.name} ends in {path.suffix or 'nothing'}, which is no log format"
        raise ResultError("unknown-ending", what, Where(file=str(path)), "name it .csv or .parquet")
    else:
        write = _write_csv if path.suffix.lower() == ".csv" else _write_parquet
        with replacing(path) as temporary, temporary.open("wb") as sink:
            write(sink, parts)


def _write_parquet(sink: BinaryIO, parts: Iterator[pa.Table]) -> None:
    import pyarrow.parquet as pq

    first = next(parts)
    # The dictionary would cost time and space: floats hardly ever repeat.
    options = {"compression": "zstd", "use_dictionary": False, "write_page_checksum": True}
    with pq.ParquetWriter(sink, first.schema, **options) as writer:
        for part in chain([first], parts):
            writer.write_table(part)


def _write_csv(sink: BinaryIO, parts: Iterator[pa.Table]) -> None:
    import pyarrow as pa
    from pyarrow import csv as arrow_csv

    options = arrow_csv.WriteOptions(include_header=False, quoting_style="needed")
    for number, part in enumerate(parts):
        if number == 0:
            sink.write((",".join(_quoted(name) for name in part.schema.names) + "\n").encode())
        time, *columns = (column.to_numpy() for column in part.columns)
        # Not-a-number becomes an empty cell.
        rounded = [pa.array(_to_billionths(time)), *(pa.array(_short(v, DIGITS), from_pandas=True) for v in columns)]
        arrow_csv.write_csv(pa.table(rounded, names=[str(k) for k in range(len(rounded))]), sink, options)


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"' if set(name) & set(',"\n\r ') else name


def _to_billionths(time: Floats) -> Floats:
    """Times to the ninth decimal, where a float64 can tell that."""
    finer = np.abs(time) < 2.0**53 / 1e9
    return np.where(finer, np.round(np.where(finer, time, 0.0) * 1e9) / 1e9, time)


def _short(values: Floats, digits: int) -> Floats:
    """Rounded to so many significant digits; the shortest text of the result then has no more."""
    with np.errstate(divide="ignore", invalid="ignore"):
        power = digits - 1 - np.floor(np.log10(np.abs(values)))
    # Powers of ten beyond 22 are not exact in binary; numbers that small or large stay as they are.
    usable = np.isfinite(power) & (np.abs(power) <= 22)
    scale = 10.0 ** np.where(usable, np.abs(power), 0.0)
    shrunk = np.where(power >= 0, np.round(values * scale) / scale, np.round(values / scale) * scale)
    return np.where(usable, shrunk, values)


def _tables(logs: Iterable[Log], robot: Robot) -> Iterator[pa.Table]:
    """A table a log; without logs one without rows."""
    import pyarrow as pa

    nothing = np.zeros((0, robot.n_joints))
    names: list[tuple[str, int | None, str]] = []
    for log in logs:
        names = names or _columns(log, robot)
        yield pa.table(list(_table(log, robot, names)), names=[name for _, _, name in names])
    if not names:
        yield from _tables([Log("", np.zeros(0, dtype=np.int64), np.zeros(0), nothing, nothing, nothing)], robot)


def _columns(log: Log, robot: Robot) -> list[tuple[str, int | None, str]]:
    """(quantity, joint, column name) of every column; time has no joint."""
    columns: list[tuple[str, int | None, str]] = [("time", None, robot.log.time)]
    for quantity in QUANTITIES:
        values = getattr(log, quantity)
        for joint in robot.joints:
            name = robot.log.column(quantity, joint.number)
            absent = values is None or (len(log) and bool(np.isnan(values[:, joint.number - 1]).all()))
            if name is not None and not absent:
                columns.append((quantity, joint.number, name))
    return columns


def _table(log: Log, robot: Robot, columns: list[tuple[str, int | None, str]]) -> Floats:
    """(C, N) in the log's units and signs."""
    table = np.empty((len(columns), len(log)))
    for row, (quantity, joint, _) in zip(table, columns, strict=True):
        if joint is None:
            row[:] = log.time / time_factor(robot)
        else:
            values = getattr(log, quantity)
            row[:] = np.nan if values is None else values[:, joint - 1] / factor_of(robot, quantity, robot.joint(joint))
    return table


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
    parts: list[tuple[int, float, float]] = []

    def watched(batches: Iterable[Log]) -> Iterator[Log]:
        for log in batches:
            parts.append((len(log), float(log.time[0]), float(log.time[-1])))
            progress(parts[-1][2])
            yield log

    if folder == STDIN:
        write_log(folder, watched(logs), robot)
        return []
    files = []
    with locked(folder):
        for path in _replaced(folder, force):
            path.unlink()
        write_file(folder / TRUTH_NAME, json.dumps(truth, indent=2) + "\n")
        for origin, batches in groupby(logs, key=lambda log: log.origin):
            parts.clear()
            write_log(folder / f"{origin}.{form}", watched(batches), robot)
            files.append((f"{origin}.{form}", sum(part[0] for part in parts), parts[0][1], parts[-1][2]))
    return files


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
    if not folder.is_dir():
        return []
    truth = folder / TRUTH_NAME
    try:
        is_simulated = read_truth(truth).get("kind") == "truth"
    except ModelError:
        is_simulated = False
    there = sorted(path for path in folder.rglob("*") if is_log(str(path.relative_to(folder))))
    simulated = [
        path
        for path in there
        if is_simulated and path.parent == folder and _SIMULATED.fullmatch(path.name) and path.is_file()
    ]
    foreign = [path for path in there if path not in simulated]
    if not is_simulated and os.path.lexists(truth):
        foreign.append(truth)
    if foreign or (there and not force):
        first = (foreign or there)[0]
        why = "; no truth.json beside it says that it was simulated" if foreign else ""
        what = f"{folder} holds logs already ({max(len(there), 1)}, such as {first.name}){why}"
        mend = "write to another folder with -o" + ("" if foreign else ", or replace them with --force")
        raise ResultError("logs-in-the-way", what, Where(file=str(first)), mend)
    return [*simulated, *([truth] if is_simulated else [])]
