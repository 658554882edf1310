"""What an effect sees: positions, velocities and the like at M instants of one moving joint; never the current."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def _empty() -> Floats:
    return np.zeros(0)


@dataclass(frozen=True, eq=False, slots=True)
class Loads:
    """What the model fitted so far says at M instants of joint i in motion; all in A of the motor named.

    Attributes
    ----------
    own
        (M,) gravity's current in joint i.
    others
        (M, J) gravity's current in every joint k at this posture, in joint k's own motor; NaN where it is not known.
    slopes
        (M, J) A/rad or A/m: derivative of `own` by each joint's position.
    tilts
        (M, 2) A/rad: derivative of `own` by a turn of the arm's base about the base frame's x and y; of a joint whose
        ratio to those beyond it is not known, in the gain of the next joint outward whose is.
    across
        (M,) size of gravity's moment across joint i's axis, as the current that it would draw if it lay along it, in
        the same gain as `tilts`; zero for a prismatic joint.
    drawn
        (M,) the model's whole prediction in joint i.
    gains
        (J,) eta_i / eta_k: what joint k's current must be multiplied by to be in joint i's; NaN where not known.
    """

    own: Floats
    others: Floats
    slopes: Floats
    tilts: Floats
    across: Floats
    drawn: Floats
    gains: Floats


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
    elapsed
        (M,) s since the arm's first motion on the same clock.
    travel
        (M,) rad or m since the motion began.
    temperature
        (M,) degC, NaN where not measured.
    run
        (M,) number of the run each instant belongs to.
    loads
        What the model so far says of gravity here; none where it is not known yet.
    extra
        (M, E) columns of the logs that the user suspects, in the logs' own units; none where not asked for.
    """

    joint: int
    position: Floats
    velocity: Floats
    acceleration: Floats = field(default_factory=_empty)
    direction: Floats = field(default_factory=_empty)
    time: Floats = field(default_factory=_empty)
    elapsed: Floats = field(default_factory=_empty)
    travel: Floats = field(default_factory=_empty)
    temperature: Floats = field(default_factory=_empty)
    run: Floats = field(default_factory=_empty)
    loads: Loads | None = None
    extra: Floats | None = None

    def __len__(self) -> int:
        return len(self.position)


@dataclass(frozen=True, slots=True)
class Extent:
    """What the runs of one joint (or, for an effect of the whole arm, of all) cover: where a shape can be looked for.

    Attributes
    ----------
    joint
        From 1; None for the whole arm.
    speeds
        Distinct speeds, rising, rad/s or m/s.
    position
        Lowest and highest position of the moving joint, rad or m.
    finest
        Shortest wavelength that the bins can show, rad or m.
    travel
        Longest run, rad or m.
    starts
        s since the joint's first motion, of every run, rising.
    duration
        s from the first motion to the end of the last.
    current
        Largest absolute current that the model predicts, A.
    postures
        Distinct sets of held positions.
    """

    joint: int | None
    speeds: tuple[float, ...]
    position: tuple[float, float]
    finest: float
    travel: float
    starts: tuple[float, ...]
    duration: float
    current: float
    postures: int
