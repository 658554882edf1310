"""What an effect sees: positions, velocities and the like at M instants of one moving joint; never the current."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def _empty() -> Floats:
    return np.zeros(0)


@dataclass(frozen=True, eq=False, slots=True)
class Samples:
    """M instants of joint `joint` (from 1) in motion.

    Attributes
    ----------
    position, velocity
        (M, J) rad or m and rad/s or m/s.
    acceleration
        (M,) rad/s2 or m/s2 of the moving joint.
    direction
        (M,) +1 or -1: sign of the motion that the run is in (not of a noisy velocity).
    time
        (M,) s since the joint's first motion in the campaign.
    travel
        (M,) rad or m since the motion began.
    temperature
        (M,) degC, NaN where not measured.
    load
        (M,) A: gravity's share by the model so far; zero where it is not known yet.
    run
        (M,) number of the run each instant belongs to.
    """

    joint: int
    position: Floats
    velocity: Floats
    acceleration: Floats = field(default_factory=_empty)
    direction: Floats = field(default_factory=_empty)
    time: Floats = field(default_factory=_empty)
    travel: Floats = field(default_factory=_empty)
    temperature: Floats = field(default_factory=_empty)
    load: Floats = field(default_factory=_empty)
    run: Floats = field(default_factory=_empty)

    def __len__(self) -> int:
        return len(self.position)
