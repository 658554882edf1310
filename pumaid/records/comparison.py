"""A model held against measurements, per joint and per run."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import Note
from pumaid.records.run import Run

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, slots=True)
class RunScore:
    """One run: RMSE over samples, bias (mean of measured minus predicted), largest cell residual (A).

    `predicted` is (M,) A at the run's cells; `undetermined` says that the prediction leans on directions which the
    fitted data did not determine, with `reason`.
    """

    run: Run
    rmse: float
    bias: float
    largest: float
    predicted: Floats
    undetermined: bool = False
    reason: str | None = None

    @property
    def residual(self) -> Floats:
        """(M,) measured minus predicted at the run's cells, A."""
        return self.run.cells.current[:, self.run.joint - 1] - self.predicted


@dataclass(frozen=True, slots=True)
class JointScore:
    """One joint over all its runs: RMSE, bias, share of the current's variance explained, noise floor (A or None)."""

    joint: int
    runs: int
    samples: int
    rmse: float | None
    bias: float | None
    explained: float | None
    noise_floor: float | None
    noise_floor_reason: str | None = None


@dataclass(frozen=True, slots=True)
class OutsideScore:
    """One joint outside runs (ramps, several joints moving): inertia is missing there by design. A."""

    joint: int
    reason: str
    samples: int
    rmse: float
    bias: float


@dataclass(frozen=True, eq=False, slots=True)
class Comparison:
    """A model against measurement on some logs; `rmse` over all samples of all runs (A)."""

    robot: str
    joints: tuple[JointScore, ...]
    runs: tuple[RunScore, ...]
    outside: tuple[OutsideScore, ...] = ()
    rmse: float | None = None
    logs: dict[str, str] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()
