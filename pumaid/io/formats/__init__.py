"""Log formats, a module each: what a format is to the reader, and how the format of a file is found."""

import importlib
import pkgutil
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from pumaid.errors import LogError, Note, PumaidError, Where
from pumaid.maths import Counts, Floats

#: Bytes of a file's beginning by which its format is recognised.
HEAD_BYTES = 1 << 16
#: First bytes of what gzip packed.
GZIP = b"\x1f\x8b"
#: First bytes of what is read by no format, and what it is.
_FOREIGN = {
    b"PK\x03\x04": "a spreadsheet or zip archive",
    b"\xd0\xcf\x11\xe0": "an old Excel workbook",
    b"\x89HDF": "an HDF5 file",
    b"MATLAB": "a MATLAB 7.3 file (save -v7 makes one that is read)",
    b"\x28\xb5\x2f\xfd": "compressed by zstd (gzip is read as it is)",
    b"\xfd7zXZ\x00": "compressed by xz (gzip is read as it is)",
    b"BZh": "compressed by bzip2 (gzip is read as it is)",
    b"\x04\x22\x4d\x18": "compressed by lz4 (gzip is read as it is)",
    b"ARROW1": "an Arrow file",
    b"\x93NUMPY": "a NumPy array without a name (numpy.savez makes a file that is read)",
    b"[{": "JSON",
    b"{": "JSON",
    b"<": "XML or HTML",
}
#: How to mend what cannot be read.
_MEND = (
    "check path, permissions and disk; copy or export a damaged file again; a store may need a package of its own (pip"
    " install 'pumaid[dask]')"
)


class LogColumn(NamedTuple):
    """A column of a log: its name, and the unit of time (s, ms, us, ns) where the file itself states one.

    Where the file says that a column is of joint `joint`, a second name of it says so, and `same_as` is the first.
    """

    name: str
    unit: str = ""
    same_as: str = ""
    joint: str = ""


class Batch(NamedTuple):
    """Consecutive rows: (N,) numbers, counted as an editor counts lines, and (C, N) values, NaN where there is none."""

    rows: Counts
    values: Floats


class LogSource(ABC):
    """A log file (`path`, on this machine) as columns of numbers; a format is a subclass in a module
    of this package.

    Attributes
    ----------
    endings
        Of files of this format; such files are found in folders.
    is_fallback
        Whether the format is tried only where no other one recognises a file.
    notes
        What is worth a note, complete after the last batch.
    """

    endings: ClassVar[tuple[str, ...]]
    is_fallback: ClassVar[bool] = False

    def __init__(self, path: Path, name: str) -> None:
        self.path, self.name = path, name
        self.notes: list[Note] = []

    @contextmanager
    def unpacked(self) -> Iterator[Any]:
        """The bytes of a text file, which gzip may have packed.

        Raises
        ------
        LogError [file-not-readable]
            It is cut off, or cannot be read.
        """
        import pyarrow as pa

        with self.path.open("rb") as stream, refusing(self.name, (pa.ArrowException, OSError, EOFError)):
            is_packed = stream.read(len(GZIP)) == GZIP
            stream.seek(0)
            yield pa.input_stream(stream, compression="gzip" if is_packed else None)

    @classmethod
    @abstractmethod
    def sniff(cls, head: bytes) -> bool:
        """Whether a file with these first `HEAD_BYTES` bytes is of this format."""

    @abstractmethod
    def schema(self) -> Sequence[LogColumn]:
        """The columns in the file's order."""

    @abstractmethod
    def batches(self, names: Sequence[str]) -> Iterator[Batch]:
        """The values of the named columns, in the order of `names`, batch by batch.

        Raises
        ------
        LogError
            A column holds no numbers, or the file is damaged.
        """


def floats(column: Any) -> Floats:
    """A column of float64 (``pyarrow.Array``) as (N,) numbers, NaN where it has none.

    Arrow's own ``to_numpy`` loads pandas, which takes longer than a million rows: so the numbers are taken as they lie
    in memory.
    """
    if not len(column):
        return np.zeros(0)
    validity, numbers = column.buffers()
    values = np.frombuffer(numbers, dtype=np.float64, count=len(column), offset=8 * column.offset)
    if not column.null_count:
        return values
    bits = np.unpackbits(np.frombuffer(validity, dtype=np.uint8), bitorder="little")
    return np.where(bits[column.offset : column.offset + len(column)], values, np.nan)


@contextmanager
def refusing(name: str, kinds: tuple[type[Exception], ...] = (Exception,), *, mend: str = _MEND) -> Iterator[None]:
    """Whatever of some kinds the system, Arrow or a store's own library raises, as a refusal; but not a lack of memory.

    Raises
    ------
    LogError [file-not-readable]
        It is not there, refused, cut off or altered.
    """
    try:
        yield
    except (PumaidError, MemoryError):
        raise
    except kinds as error:
        reason = getattr(error, "strerror", None) or f"{str(error)[:200]} ({type(error).__name__})"
        raise LogError("file-not-readable", f"{name} cannot be read: {reason}", Where(file=name), mend) from error


@cache
def log_formats() -> tuple[type[LogSource], ...]:
    """All formats, those that recognise files by themselves first."""
    for module in pkgutil.iter_modules(__path__):
        importlib.import_module(f"{__name__}.{module.name}")
    return tuple(sorted(LogSource.__subclasses__(), key=lambda item: item.is_fallback))


def endings() -> tuple[str, ...]:
    """Endings of the logs that are found in folders, in lower case."""
    return tuple(ending for item in log_formats() for ending in item.endings)


def log_format(head: bytes, name: str) -> type[LogSource]:
    """The format of a file with these first `HEAD_BYTES` bytes.

    Raises
    ------
    LogError [not-a-log]
        There is none.
    """
    sure = [item for item in log_formats() if not item.is_fallback and item.sniff(head)]
    foreign = next((what for magic, what in _FOREIGN.items() if head.startswith(magic)), None)
    fitting = sure or ([] if foreign else [item for item in log_formats() if item.sniff(head)])
    if not fitting:
        raise LogError(
            "not-a-log",
            f"{name} is {foreign or 'binary data'}, no log of a kind that is read",
            Where(file=name),
            "export it as CSV or Parquet",
        )
    return fitting[0]
