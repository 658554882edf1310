"""Archives of NumPy's arrays (.npz); what is in them is in memory while they are read."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from pumaid.errors import LogError, Where, listed
from pumaid.io.formats import Batch, LogColumn, LogSource, refusing
from pumaid.io.formats.nested import element

_BATCH_ROWS = 65536
#: Columns of an array at most; one with more (an image) is no log.
_MOST_COLUMNS = 1000
_MEND = "save vectors and matrices of numbers: numpy.savez(file, t=t, q=q, i=i)"


class ArrayLog(LogSource):
    """Arrays by name; rows count as in the same table written as CSV, from 2.

    A vector is a column; a matrix has a row for each sample, or a column where it has more columns than rows.
    """

    endings = (".npz",)

    @classmethod
    def sniff(cls, head: bytes) -> bool:
        """By a zip archive whose first file is an array."""
        size = int.from_bytes(head[26:28], "little")
        return head.startswith(b"PK\x03\x04") and head[30 : 30 + size].endswith(b".npy")

    def schema(self) -> Sequence[LogColumn]:
        """The columns of all numeric arrays of one or two dimensions."""
        with refusing(self.name, mend=_MEND), self.path.open("rb") as stream:
            arrays = dict(np.load(stream, allow_pickle=False))
        arrays = {name: a for name, a in arrays.items() if a.ndim in (1, 2) and a.dtype.kind in "fiub"}
        self._columns: dict[str, Any] = {}
        for name, array in arrays.items():
            if array.ndim == 1:
                self._columns[name] = array
            else:
                columns = array.T if len(array) >= array.shape[1] else array
                self._columns |= {element(name, k): columns[k] for k in range(min(len(columns), _MOST_COLUMNS))}
        return [LogColumn(column) for column in self._columns]

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
