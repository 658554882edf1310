"""When the joints of a campaign first moved, and where its runs began: from there effects count."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Reject, Run

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Campaign:
    """What only all runs together tell.

    Attributes
    ----------
    begun
        (joint from 1, or 0 for the whole arm; clock) -> s on that clock at which it first moved.
    leads
        (file, first row) of a run -> rad or m that its joint had travelled before, while it sped up.
    """

    begun: Mapping[tuple[int, int], float] = field(default_factory=dict)
    leads: Mapping[tuple[str, int], float] = field(default_factory=dict)

    @classmethod
    def of(cls, runs: Iterable[Run], rejects: Iterable[Reject] = ()) -> Campaign:
        """Of all runs of the logs, held-out ones too, and of what is no run."""
        runs = tuple(runs)
        begun: dict[tuple[int, int], float] = {}
        for run in runs:
            for key in ((run.joint, run.clock), (0, run.clock)):
                begun[key] = min(run.start, begun.get(key, run.start))
        before = {(reject.origin, reject.last_row + 1): reject for reject in rejects}
        ramps = [(run, before.get((run.origin, run.first_row))) for run in runs]
        leads = {(run.origin, run.first_row): _lead(run, ramp) for run, ramp in ramps if ramp is not None}
        return cls(begun, leads)

    def since(self, joint: int, clock: int, time: Floats) -> Floats:
        """(M,) s since `joint` (0: any joint) first moved, at (M,) s on a clock; as they are where it never did."""
        return time - self.begun.get((joint, clock), 0.0)

    def lead(self, run: Run) -> float:
        """What the joint had travelled (rad or m) since it last stood or turned back when `run` began; 0 if unknown."""
        return self.leads.get((run.origin, run.first_row), 0.0)


def _lead(run: Run, ramp: Reject) -> float:
    """From the farthest that a ramp reaches back."""
    if ramp.joints != (run.joint,) or ramp.bins is None:
        return 0.0
    back = run.direction * (run.span[0] - ramp.bins.position[:, run.joint - 1])
    return max(float(back.max()), 0.0)
