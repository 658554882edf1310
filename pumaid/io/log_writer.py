"""Logs written as the recipe's `log` block names them: streamed, whole or not at all, same data same bytes."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray
from pyarrow import csv as arrow_csv

from pumaid.dataset import Log
from pumaid.errors import ResultError, Where
from pumaid.io.columns import QUANTITIES, factor_of, time_factor
from pumaid.io.paths import STDIN
from pumaid.io.write import replacing
from pumaid.robot import Robot

Floats = NDArray[np.float64]

#: Rows of a row group; fixed, so that the bytes do not depend on how the logs were cut.
GROUP_ROWS = 65536
#: Digits of a number in CSV: finer than any encoder or current sensor, half the size of all sixteen.
DIGITS = 9


def write_log(path: Path, logs: Iterable[Log], robot: Robot) -> None:
    """Write samples as one log file in the recipe's columns, units and signs.

    The ending decides: ``.parquet`` keeps every bit, ``.csv`` nine digits (and the time to the nanosecond). ``-``
    writes CSV to standard output. Velocity, temperature and joints without a current are left out where the first log
    has none.

    Parameters
    ----------
    path
        The file; it appears when all is written.
    logs
        In order of time; taken one by one.
    robot
        Names the columns.

    Raises
    ------
    ResultError [cannot-write, unknown-ending]
        The disk refuses, or the ending is neither ``.csv`` nor ``.parquet``.
    """
    path = Path(path)
    parts = iter(_tables(logs, robot))
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
    with ExitStack() as stack:
        writer: Any = None
        for part in parts:
            if writer is None:
                # The dictionary would cost time and space: floats hardly ever repeat.
                writer = pq.ParquetWriter(
                    sink, part.schema, compression="zstd", use_dictionary=False, write_page_checksum=True
                )
                stack.enter_context(writer)
            writer.write_table(part, row_group_size=GROUP_ROWS)


def _write_csv(sink: BinaryIO, parts: Iterator[pa.Table]) -> None:
    options = arrow_csv.WriteOptions(include_header=False, quoting_style="needed")
    for number, part in enumerate(parts):
        if number == 0:
            sink.write((",".join(_quoted(name) for name in part.schema.names) + "\n").encode())
        rounded = [
            pa.array(_to_billionths(part.column(0).to_numpy())),
            *(_nulls(_short(c.to_numpy(), DIGITS)) for c in part.columns[1:]),
        ]
        arrow_csv.write_csv(pa.table(rounded, names=_numbered(rounded)), sink, options)


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"' if set(name) & set(',"\n\r ') else name


def _numbered(columns: list[Any]) -> list[str]:
    return [str(k) for k in range(len(columns))]


def _nulls(values: Floats) -> pa.Array:
    """Not-a-number becomes an empty cell."""
    return pa.array(values, from_pandas=True)


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
    """Tables of `GROUP_ROWS` rows (the last may be shorter), cut independently of the logs."""
    names: list[tuple[str, int | None, str]] = []
    pending: list[Floats] = []
    held = 0
    for log in logs:
        names = names or _columns(log, robot)
        pending.append(_table(log, robot, names))
        held += len(log)
        while held >= GROUP_ROWS:
            whole = np.concatenate(pending, axis=1)
            yield pa.table(list(whole[:, :GROUP_ROWS]), names=[name for _, _, name in names])
            pending, held = [whole[:, GROUP_ROWS:]], held - GROUP_ROWS
    if held or not names:
        names = names or _columns(_nothing(robot), robot)
        whole = np.concatenate(pending, axis=1) if pending else np.zeros((len(names), 0))
        yield pa.table(list(whole), names=[name for _, _, name in names])


def _nothing(robot: Robot) -> Log:
    empty = np.zeros((0, robot.n_joints))
    return Log("", np.zeros(0, dtype=np.int64), np.zeros(0), empty, empty, empty)


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
