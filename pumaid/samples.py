"""What an effect sees: positions, velocities and the like at M instants of one moving joint; never the current."""

from dataclasses import dataclass, field, fields
from functools import partial
from typing import Any

import numpy as np

from pumaid.maths import Floats

_empty = partial(np.zeros, 0)


@dataclass(frozen=True, eq=False, slots=True)
class Loads:
    """What the model fitted so far says at M instants of joint i in motion; all in A of the motor named.

    `tilts` are, of a joint whose ratio to those beyond it is not known, in the gain of the next joint outward whose is.
    """

    moving: Floats  # (M,) gravity's current in joint i
    by_joint: Floats  # (M, J) gravity's current in every joint k at this posture, in its own motor; NaN where not known
    slopes: Floats  # (M, J) A/rad or A/m: derivative of `moving` by each joint's position
    tilts: Floats  # (M, 2) A/rad: derivative of `moving` by a turn of the base about the base frame's x and y
    # (M,) size of gravity's moment across joint i's axis, as the current that it would draw if it lay along it, in the
    # gain of `tilts`; zero for a prismatic joint
    across: Floats
    drawn: Floats  # (M,) the model's whole prediction in joint i
    gains: Floats  # (J,) eta_i / eta_k: joint k's current times this is joint i's; NaN where not known


@dataclass(frozen=True, eq=False, slots=True)
class Samples:
    """M instants of joint `joint` (from 1) in motion."""

    joint: int
    position: Floats  # (M, J) rad or m
    velocity: Floats  # (M, J) rad/s or m/s
    acceleration: Floats = field(default_factory=_empty)  # (M,) rad/s2 or m/s2 of the moving joint
    # (M,) +1 or -1: sign of the motion that the run is in (not of a noisy velocity)
    direction: Floats = field(default_factory=_empty)
    time: Floats = field(default_factory=_empty)  # (M,) s since the joint's first motion in the campaign
    elapsed: Floats = field(default_factory=_empty)  # (M,) s since the arm's first motion on the same clock
    travel: Floats = field(default_factory=_empty)  # (M,) rad or m since the motion began
    temperature: Floats = field(default_factory=_empty)  # (M,) degC, NaN where not measured
    run: Floats = field(default_factory=_empty)  # (M,) number of the run that each instant belongs to
    loads: Loads | None = None  # what the model so far says of gravity; none where it is not known yet
    # (M, E) columns of the logs that the user suspects, in the logs' own units; none where not asked for
    extra: Floats | None = None

    def __len__(self) -> int:
        return len(self.position)

    def series(self) -> dict[str, Any]:
        """The arrays that have a value an instant, by name; those that are not given left out."""
        named = {item.name: getattr(self, item.name) for item in fields(self) if item.name not in ("joint", "loads")}
        return {name: values for name, values in named.items() if values is not None and len(values) == len(self)}


@dataclass(frozen=True, slots=True)
class Extent:
    """What the runs of one joint (for an effect of the whole arm: of all) cover: where a shape can be looked for."""

    joint: int | None  # from 1; None for the whole arm
    speeds: tuple[float, ...]  # distinct speeds, rising, rad/s or m/s
    position: tuple[float, float]  # lowest and highest of the moving joint, rad or m
    finest: float  # shortest wavelength that the bins can show, rad or m
    travel: float  # longest run, rad or m
    starts: tuple[float, ...]  # s since the joint's first motion, of every run, rising
    duration: float  # s from the first motion to the end of the last
    current: float  # largest absolute current that the model predicts, A
    postures: int  # distinct sets of held positions
