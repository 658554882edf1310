"""Columns of Arrow as numpy's numbers."""

from __future__ import annotations

import math

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray


def floats(column: pa.Array) -> NDArray[np.float64]:
    """A column of float64 as (N,) numbers, NaN where it has none.

    Arrow's own ``to_numpy`` loads pandas, which takes longer than a million rows, and its functions on columns another
    20 ms; so neither is used where a column is whole.

    Parameters
    ----------
    column
        Of type ``float64``.
    """
    if column.null_count:
        column = column.fill_null(math.nan)
    if not len(column):
        return np.zeros(0)
    return np.frombuffer(column.buffers()[1], dtype=np.float64, count=len(column), offset=8 * column.offset)
