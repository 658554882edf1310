"""Files written atomically: a reader sees the old content or all of the new one, never a part; logs and sessions."""

import csv
import errno
import json
import os
import re
import secrets
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from io import TextIOWrapper
from itertools import chain, groupby, product
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from pumaid.dataset import Log
from pumaid.errors import ResultError, Where
from pumaid.io.column_names import factor_of
from pumaid.io.paths import is_log
from pumaid.robot import QUANTITIES, Joint, Robot
from pumaid.units import factor

#: Decimals of a number in CSV: finer than any encoder, current sensor or clock.
DECIMALS = 9
TRUTH_NAME = "truth.json"
#: What simulated logs are called; a truth beside them proves that they are.
_SIMULATED = re.compile(r"session_\d+\.(csv|parquet)")

_ELSEWHERE = "check the disk's space and your permissions, shorten the name, or write elsewhere with -o"


def write_file(path: Path, data: bytes | str) -> None:
    """Write a file as `replacing` does.

    Text is encoded as UTF-8; surrogates (bytes of a file name that are not UTF-8) become backslash escapes.
    """
    with replacing(path) as temporary:
        temporary.write_bytes(data.encode("utf-8", "backslashreplace") if isinstance(data, str) else data)


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
    path, target = Path(path), Path(os.path.realpath(path))
    temporary = target.with_name(f".{target.name[:80]}.{secrets.token_hex(6)}.part")
    try:
        # /dev/stdout may be a plain file that the shell holds open.
        if path.parts[:2] == ("/", "dev") or not (path.is_file() or path.is_dir() or not path.exists()):
            yield path
            return
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
        raise ResultError(
            "cannot-write",
            f"cannot write {path.name[:80]}: {error.strerror or error}",
            Where(file=str(path)[:300]),
            _ELSEWHERE,
        ) from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep other processes of this program out of a folder during the block; they wait for its end.

    The folder itself, made if it is missing, is locked (flock), so no lock file remains, and the system releases the
    lock when a process ends. Where there are no such locks the block runs without one.
    """
    with ExitStack() as stack:
        with suppress(ImportError, OSError):
            import fcntl

            folder.mkdir(parents=True, exist_ok=True)
            handle = os.open(folder, os.O_RDONLY)
            stack.callback(os.close, handle)
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield


def write_log(path: Path, logs: Iterable[Log], robot: Robot) -> None:
    """Write samples (at least one batch, in order of time) as one log file in the recipe's columns, units and signs.

    The ending decides: ``.parquet`` keeps every bit, ``.csv`` nine decimals.
    Velocity and temperature are left out where the first log has none.
    """
    tables = _tables(logs, robot)
    write = _write_parquet if Path(path).suffix.lower() == ".parquet" else _write_csv
    with replacing(path) as temporary, temporary.open("wb") as sink:
        write(sink, tables)


def _tables(logs: Iterable[Log], robot: Robot) -> Iterator[Any]:
    import pyarrow as pa

    columns: list[tuple[str, str, Joint]] = []
    for log in logs:
        columns = columns or [
            (name, quantity, joint)
            for quantity, joint in product(QUANTITIES, robot.joints)
            if (name := robot.log.column(quantity, joint.number)) and getattr(log, quantity) is not None
        ]
        table = {robot.log.time: log.time / factor(robot.log.units.get("time", "s"))}
        if robot.log.fraction:  # the first column has all of the time
            table[robot.log.fraction] = np.zeros(len(log))
        for name, quantity, joint in columns:
            values = getattr(log, quantity)[:, joint.number - 1] / factor_of(robot, quantity, joint)
            table[name] = values + robot.log.conversion(quantity, joint.number).zero
        yield pa.table(table)


def _write_parquet(sink: BinaryIO, tables: Iterator[Any]) -> None:
    import pyarrow.parquet as pq

    first = next(tables)
    # The dictionary would cost time and space: floats hardly ever repeat.
    with pq.ParquetWriter(
        sink, first.schema, compression="zstd", use_dictionary=False, write_page_checksum=True
    ) as writer:
        for table in chain([first], tables):
            writer.write_table(table)


def _write_csv(sink: BinaryIO, tables: Iterator[Any]) -> None:
    import pyarrow as pa
    from pyarrow import csv as arrow_csv

    options = arrow_csv.WriteOptions(include_header=False, quoting_style="needed")
    for number, table in enumerate(tables):
        if number == 0:  # Arrow would quote every name
            text = TextIOWrapper(sink, encoding="utf-8", newline="", write_through=True)
            csv.writer(text, lineterminator="\n").writerow(table.column_names)
            text.detach()
        values = np.array([column.to_numpy() for column in table.columns])
        # Where a float64 has no more than these decimals, rounding would only disturb it.
        is_fine = np.abs(values) < 2.0**53 / 10.0**DECIMALS
        values[is_fine] = np.round(values[is_fine], DECIMALS)
        # Not-a-number becomes an empty cell.
        arrow_csv.write_csv(
            pa.table([pa.array(column, from_pandas=True) for column in values], names=table.column_names), sink, options
        )


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

    Each file is written atomically; a session that is interrupted leaves the files written so far and the truth. With
    `force`, logs of an earlier simulation in the folder (``session_*`` beside a ``truth.json``) are replaced.
    `progress` is called with the time (s) up to which is written. The files are returned with their names, samples,
    first and last time (s).

    Raises
    ------
    ResultError [file-exists, cannot-write]
        The folder holds logs already (measured and simulated ones must not mix), or the disk refuses.
    """
    files: dict[str, tuple[int, float, float]] = {}

    def watched() -> Iterator[Log]:
        for log in logs:
            count, first, _ = files.get(log.origin, (0, float(log.time[0]), 0.0))
            files[log.origin] = (count + len(log), first, float(log.time[-1]))
            progress(float(log.time[-1]))
            yield log

    with locked(folder):
        for path in _replaced(folder, force):
            path.unlink()
        write_file(folder / TRUTH_NAME, json.dumps(truth, indent=2) + "\n")
        for origin, batches in groupby(watched(), key=lambda log: log.origin):
            write_log(folder / f"{origin}.{form}", batches, robot)
    return [(f"{origin}.{form}", *facts) for origin, facts in files.items()]


def read_truth(path: Path) -> dict[str, Any]:
    """The document of a ``truth.json``."""
    return dict(json.loads(path.read_text(encoding="utf-8")))


def _replaced(folder: Path, force: bool) -> list[Path]:
    """Files of an earlier simulation whose place a new one takes, the truth last; others are refused (file-exists)."""
    truth, is_simulated = folder / TRUTH_NAME, False
    with suppress(OSError, ValueError, TypeError):  # there is none, or it is no JSON object
        is_simulated = read_truth(truth).get("kind") == "truth"
    there = [path for path in sorted(folder.rglob("*")) if is_log(str(path.relative_to(folder))) or path == truth]
    ours = {path for path in folder.glob("session_*") if _SIMULATED.fullmatch(path.name)} | {truth}
    if there and not (force and is_simulated and ours.issuperset(there)):
        raise ResultError(
            "file-exists",
            f"{folder} holds logs already ({len(there)} files, such as {there[0].name})",
            Where(file=str(there[0])),
            "write to another folder with -o; --force replaces only what an earlier simulation wrote",
        )
    return sorted(there, key=truth.__eq__)
