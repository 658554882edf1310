"""Columns of Arrow as numpy's numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pyarrow as pa


def floats(column: pa.Array) -> NDArray[np.float64]:
    """A column of float64 as (N,) numbers, NaN where it has none.

    Arrow's own ``to_numpy`` loads pandas, which takes longer than a million rows, and its functions on columns another
    20 ms: so the numbers are taken as they lie in memory, and what lacks by its bits.

    Parameters
    ----------
    column
        Of type ``float64``.
    """
    if not len(column):
        return np.zeros(0)
    there, numbers = column.buffers()
    values = np.frombuffer(numbers, dtype=np.float64, count=len(column), offset=8 * column.offset)
    if not column.null_count:
        return values
    bits = np.unpackbits(np.frombuffer(there, dtype=np.uint8), bitorder="little")
    return np.where(bits[column.offset : column.offset + len(column)], values, np.nan)
