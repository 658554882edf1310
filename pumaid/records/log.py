"""A batch of samples as read from a log, in SI, by joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, slots=True)
class Log:
    """N consecutive samples of one file; a long file is a sequence of these.

    Attributes
    ----------
    origin
        The file's name as the user knows it.
    rows
        (N,) row of each sample as an editor counts lines of the file (header is row 1).
    time
        (N,) s, strictly rising within a file.
    position, velocity
        (N, J) rad or m and rad/s or m/s; `velocity` is None where the file has none, and NaN in samples without it.
    current
        (N, J) A; NaN in samples without it, and a whole column where the log lacks that joint.
    temperature
        (N, J) degC, or None.
    extra
        (N, E) columns that the user asked for besides, in the log's own units, NaN where not a number; or None.
    starts_clock
        Whether the clock starts anew here: samples before belong to another recording.
    """

    origin: str
    rows: NDArray[np.int64]
    time: Floats
    position: Floats
    velocity: Floats | None
    current: Floats
    temperature: Floats | None = None
    starts_clock: bool = False
    extra: Floats | None = None

    def __post_init__(self) -> None:
        n_samples, n_joints = self.position.shape
        for name in ("velocity", "current", "temperature"):
            values = getattr(self, name)
            if values is not None and values.shape != (n_samples, n_joints):
                raise ValueError(f"{name} is {values.shape}, position is {(n_samples, n_joints)}")
        if self.extra is not None and len(self.extra) != n_samples:
            raise ValueError(f"extra has {len(self.extra)} rows for {n_samples} samples")
        if self.time.shape != (n_samples,) or self.rows.shape != (n_samples,):
            raise ValueError(f"time is {self.time.shape} and rows {self.rows.shape} for {n_samples} samples")

    def __len__(self) -> int:
        return len(self.time)

    def part(self, index: slice | NDArray[np.int64]) -> Log:
        """Some of the samples, by their numbers."""

        def of(values: Floats | None) -> Floats | None:
            return None if values is None else values[index]

        return replace(
            self,
            rows=self.rows[index],
            time=self.time[index],
            position=self.position[index],
            velocity=of(self.velocity),
            current=self.current[index],
            temperature=of(self.temperature),
            extra=of(self.extra),
            starts_clock=False,
        )

    @classmethod
    def joined(cls, logs: Sequence[Log]) -> Log:
        """Consecutive batches of one file as one; a quantity that some of them lack is NaN there."""
        if len(logs) == 1:
            return logs[0]

        def together(name: str) -> Any:
            values = [getattr(log, name) for log in logs]
            width = next((value.shape[1:] for value in values if value is not None), None)
            if width is None:
                return None
            nothing = (np.full((len(log), *width), np.nan) for log in logs)
            return np.concatenate([n if v is None else v for n, v in zip(nothing, values, strict=True)])

        names = ("rows", "time", "position", "velocity", "current", "temperature", "extra")
        return replace(logs[0], **{name: together(name) for name in names})
