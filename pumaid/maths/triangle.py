"""The mergeable QR factor to which a run of any length is reduced."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: Share of a regressor's square beyond the others' that may be taken for its noise.
MOST_NOISE = 0.9


def _factor(rows: Floats) -> Floats:
    """Upper triangular R (p, p) with non-negative diagonal such that R'R = rows'rows."""
    width = rows.shape[1]
    if len(rows) < width:
        rows = np.vstack([rows, np.zeros((width - len(rows), width))])
    upper = np.linalg.qr(rows, mode="r")
    sign = np.where(np.diag(upper) < 0, -1.0, 1.0)
    return np.asarray(upper * sign[:, None])


@dataclass(frozen=True, eq=False, slots=True)
class Triangle:
    """The QR factor of ``[columns | target]``: all that least squares needs of the samples absorbed.

    Attributes
    ----------
    columns
        (p,) names of the regressors.
    factor
        (p+1, p+1) upper triangular, the target last; units of the columns.
    count
        Samples absorbed.

    Examples
    --------
    >>> t = np.linspace(0.0, 1.0, 50)
    >>> whole = Triangle.of(("one", "t"), np.column_stack([np.ones(50), t]), 2.0 + 3.0 * t)
    >>> parts = [Triangle.of(("one", "t"), np.column_stack([np.ones(25), x]), 2.0 + 3.0 * x) for x in (t[:25], t[25:])]
    >>> merged = parts[0] + parts[1]
    >>> bool(np.allclose(whole.factor, merged.factor)), merged.count
    (True, 50)
    """

    columns: tuple[str, ...]
    factor: Floats
    count: int

    def __post_init__(self) -> None:
        size = len(self.columns) + 1
        if self.factor.shape != (size, size):
            raise ValueError(f"factor is {self.factor.shape}, {len(self.columns)} columns need {(size, size)}")
        self.factor.setflags(write=False)

    @classmethod
    def of(cls, columns: Sequence[str], regressors: Floats, target: Floats) -> Triangle:
        """Factor `regressors` (N, p) and `target` (N,)."""
        # Column after column in memory, as LAPACK takes it.
        rows = np.empty((regressors.shape[1] + 1, len(target)))
        rows[:-1], rows[-1] = regressors.T, target
        return cls(tuple(columns), _factor(rows.T), len(target))

    def __add__(self, other: Triangle) -> Triangle:
        return self.merge([self, other])

    @classmethod
    def merge(cls, parts: Iterable[Triangle]) -> Triangle:
        """One triangle of all samples of `parts`, which must have the same columns."""
        all_parts = list(parts)
        names = {part.columns for part in all_parts}
        if len(names) != 1:
            raise ValueError(f"triangles over different columns cannot merge: {sorted(names)}")
        stacked = np.vstack([part.factor for part in all_parts])
        return cls(all_parts[0].columns, _factor(stacked), sum(part.count for part in all_parts))

    def without_noise(self, squares: float) -> Triangle:
        """The triangle that its last regressor would leave without noise of its own, of summed `squares`.

        Noise in a regressor makes its parameter too small, by the noise's share of what it has beyond the others; of
        that share more than `MOST_NOISE` is not given back. What the row then tells of the parameter has the variance
        that it has.

        Source
        ------
        W. A. Fuller, Measurement Error Models (1987), section 1.2: the reliability ratio.
        """
        factor, last = self.factor.copy(), len(self.columns) - 1
        own = float(factor[last, last])
        if own > 0.0:
            factor[last, last] = own * (1.0 - min(squares / own**2, MOST_NOISE))
        return Triangle(self.columns, factor, self.count)

    def leaving(self, rest: float, count: int) -> Triangle:
        """The same solution, of `count` samples that it leaves `rest`, the root of their summed squares."""
        factor = self.factor.copy()
        factor[-1, -1] = rest
        return Triangle(self.columns, factor, count)

    def rows(self) -> tuple[Floats, Floats]:
        """Rows (p+1, p) and target (p+1,) with the same normal equations as all the samples."""
        return self.factor[:, :-1], self.factor[:, -1]
