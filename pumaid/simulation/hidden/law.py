"""What a hidden effect is, and what a law of it states."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from pumaid.simulation.hidden.state import State

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Hidden:
    """One hidden effect: its name in the catalogue of effects, its joint (from 1; None for all), its values (SI, A)."""

    effect: str
    joint: int | None = None
    values: Mapping[str, float] = field(default_factory=dict)

    def __getitem__(self, key: str) -> float:
        return self.values[key]


@dataclass(frozen=True, slots=True)
class Typical:
    """What is usual of one joint of a virtual arm, so that an effect can be given a size that shows.

    Attributes
    ----------
    joint
        From 1.
    coulomb
        A, mean of both directions.
    speed, acceleration
        The highest that a plan uses, rad/s or m/s and rad/s2 or m/s2.
    half_span
        Half of what a plan lets it travel, rad or m.
    load, most
        A of gravity: root mean square and greatest over many postures.
    across
        A: the same root mean square of the moment across the axis; NaN where masses are not known.
    before
        A: Coulomb friction of the joint before it (of joint 2 for joint 1).
    last_mass, reach
        kg of the last link (NaN where not known), m of the whole arm.
    """

    joint: int
    coulomb: float
    speed: float
    acceleration: float
    half_span: float
    load: float
    most: float
    across: float
    before: float
    last_mass: float
    reach: float


class Reach(Enum):
    """Whose effect it is, and which currents it changes."""

    JOINT = "joint"  # a joint's, in its own current
    CAUSE = "cause"  # a joint's, in any current
    ARM = "arm"  # the whole arm's


@dataclass(frozen=True, slots=True)
class Law:
    """One law.

    Attributes
    ----------
    keys
        Names of its values, those of the catalogue's parameters and shapes.
    usual
        Values, in the order of `keys`, that show at a joint like that but do not rule it.
    adds
        (N,) A that it adds to the joint's current; none for a law of the whole current.
    bends
        What becomes of the joint's whole current (N,) A; none for a law that adds.
    reach
        Whose it is.
    letters
        Other names of the keys: the letters of the catalogue's equations.
    needs_masses
        Whether constants in amperes do not do.
    opposes
        Whether what it adds is friction: against the motion, or against what would move a joint at rest.
    is_slow
        Whether it asks for the weight of the whole arm, which takes time and changes no faster than the arm moves.
    """

    keys: tuple[str, ...]
    usual: Callable[[Typical], tuple[float, ...]]
    adds: Callable[[State, Hidden], Floats] | None = None
    bends: Callable[[State, Hidden, Floats], Floats] | None = None
    reach: Reach = Reach.JOINT
    letters: Mapping[str, str] = field(default_factory=dict)
    needs_masses: bool = False
    opposes: bool = False
    is_slow: bool = False
