"""Archives of arrays, NumPy's (.npz) and MATLAB's (.mat); what is in them is in memory while they are read."""

import io
import struct
import zlib
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from pumaid.errors import LogError, Where, listed
from pumaid.io.formats import Batch, LogColumn, LogSource, refusing
from pumaid.io.formats.nested import element

_BATCH_ROWS = 65536
#: Columns of an array at most; one with more (an image) is no log.
_MOST_COLUMNS = 1000
_MEND = "save vectors and matrices of numbers: numpy.savez(file, t=t, q=q, i=i), or save -v7 in MATLAB"
#: Types of numbers in MATLAB's files.
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
#: Kinds of elements: a matrix, and one that is packed; classes of a matrix: a struct, and numbers that are real.
_MATRIX, _PACKED, _STRUCT, _REAL = 14, 15, 2, range(6, 16)


class ArrayLog(LogSource):
    """Arrays by name, those of a struct as ``struct.field``; rows count as in the same table written as CSV, from 2.

    A vector is a column; a matrix has a row for each sample, or a column where it has more columns than rows.
    """

    endings = (".npz", ".mat")

    @classmethod
    def sniff(cls, head: bytes) -> bool:
        """By a zip archive whose first file is an array, or MATLAB's first words and order of bytes."""
        size = int.from_bytes(head[26:28], "little")
        is_archive = head.startswith(b"PK\x03\x04") and head[30 : 30 + size].endswith(b".npy")
        return is_archive or (head.startswith(b"MATLAB 5.0") and head[126:128] == b"IM")

    def schema(self) -> Sequence[LogColumn]:
        """The columns of all numeric arrays of one or two dimensions."""
        with refusing(self.name, mend=_MEND):
            data = self.path.read_bytes()
            matrices = (content for kind, content in _elements(data[128:]) if kind == _MATRIX)
            of_matlab = (item for matrix in matrices for item in _arrays(matrix))
            arrays = dict(of_matlab if data[:2] == b"MA" else np.load(io.BytesIO(data), allow_pickle=False))
        arrays = {name: a for name, a in arrays.items() if a.ndim in (1, 2) and a.dtype.kind in "fiub"}
        self._columns: dict[str, Any] = {}
        for name, array in arrays.items():
            columns = array.T if array.ndim == 2 and len(array) >= array.shape[1] else array
            count = min(len(columns), _MOST_COLUMNS)
            self._columns |= {element(name, k): columns[k] for k in range(count)} if array.ndim == 2 else {name: array}
        return [*map(LogColumn, self._columns)]

    def batches(self, names: Sequence[str]) -> Iterator[Batch]:
        """As `LogSource`.

        Raises
        ------
        LogError [not-a-log]
            Arrays have different numbers of samples.
        """
        columns = [self._columns[name] for name in names]
        if len({*map(len, columns)}) > 1:
            text = listed([f"{name} has {len(column)}" for name, column in zip(names, columns, strict=True)])
            what = f"the arrays of {self.name} have different numbers of samples: {text}"
            raise LogError("not-a-log", what, Where(file=self.name), "save arrays with a row for each sample")
        for start in range(0, len(columns[0]), _BATCH_ROWS):
            values = np.array([column[start : start + _BATCH_ROWS] for column in columns], dtype=float)
            yield Batch(start + 2 + np.arange(values.shape[1]), values)


def _elements(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Kinds and contents of elements of a MATLAB file that follow one another, those that are packed unpacked.

    `scipy.io.loadmat` ends the program on some damaged ones. Source: MathWorks, MAT-File Format, chapter 1 (level 5).
    """
    place = 0
    while place < len(data):
        kind, size = struct.unpack_from("<2I", data, place)
        # A small one has kind, size and content in eight bytes.
        start, size, kind = (place + 4, kind >> 16, kind & 0xFFFF) if kind >> 16 else (place + 8, size, kind)
        content = data[start : start + size]
        yield from _elements(zlib.decompress(content)) if kind == _PACKED else [(kind, content)]
        place = start + size + (0 if kind == _PACKED else -(start + size) % 8)


def _arrays(matrix: bytes, name: str = "") -> Iterator[tuple[str, Any]]:
    (_, flags), (_, dimensions), (_, title), *parts = _elements(matrix)
    name = name or title.decode()
    shape = np.frombuffer(dimensions, "<i4").tolist()
    if flags[0] == _STRUCT and {*shape} == {1}:
        (_, width), (_, text), *fields = parts
        keys = np.frombuffer(text, f"S{int.from_bytes(width, 'little')}").astype(str)
        for key, (_, field) in zip(keys, fields, strict=True):
            yield from _arrays(field, f"{name}.{key}") if field else ()
    elif flags[0] in _REAL and not flags[1] & 8:  # by this bit numbers are complex
        yield name, np.frombuffer(parts[0][1], f"<{_NUMBERS[parts[0][0]]}").reshape(shape, order="F").squeeze()
