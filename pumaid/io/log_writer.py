"""Logs written as the recipe's `log` block names them: streamed, each file whole or not at all; simulated sessions."""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import chain, groupby
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray
from pyarrow import csv as arrow_csv

from pumaid.dataset import Log
from pumaid.errors import ModelError, ResultError, Where
from pumaid.io.columns import QUANTITIES, factor_of, time_factor
from pumaid.io.paths import STDIN, is_log
from pumaid.io.write import locked, replacing, write_file
from pumaid.robot import Robot

Floats = NDArray[np.float64]

#: Digits of a number in CSV: finer than any encoder or current sensor, half the size of all sixteen.
DIGITS = 9
TRUTH_NAME = "truth.json"
#: What simulated logs are called; a truth beside them proves that they are.
_SIMULATED = re.compile(r"session_\d+\.(csv|parquet)")


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
    first = next(parts)
    # The dictionary would cost time and space: floats hardly ever repeat.
    options = {"compression": "zstd", "use_dictionary": False, "write_page_checksum": True}
    with pq.ParquetWriter(sink, first.schema, **options) as writer:
        for part in chain([first], parts):
            writer.write_table(part)


def _write_csv(sink: BinaryIO, parts: Iterator[pa.Table]) -> None:
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
            progress(float(log.time[-1]))
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
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        reason, document = getattr(error, "strerror", None) or "it is no JSON", None
    else:
        reason = "it holds no JSON object"
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
