"""When the joints of a campaign first moved: from there effects of time count."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pumaid.records.run import Run

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Campaign:
    """First motion by recording: `begun` maps (joint from 1, or 0 for the whole arm; clock) to s on that clock."""

    begun: Mapping[tuple[int, int], float] = field(default_factory=dict)

    @classmethod
    def of(cls, runs: Iterable[Run]) -> Campaign:
        """Of all runs of the logs, held-out ones too."""
        begun: dict[tuple[int, int], float] = {}
        for run in runs:
            for key in ((run.joint, run.clock), (0, run.clock)):
                begun[key] = min(run.start, begun.get(key, run.start))
        return cls(begun)

    def since(self, joint: int, clock: int, time: Floats) -> Floats:
        """(M,) s since `joint` (0: any joint) first moved, at (M,) s on a clock; as they are where it never did."""
        return time - self.begun.get((joint, clock), 0.0)
