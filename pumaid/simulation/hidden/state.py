"""What hidden physics can depend on: an arm at N instants, and one of its joints there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.simulation.weight import Weight

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, slots=True)
class Instants:
    """The whole arm at N instants.

    Attributes
    ----------
    time
        (N,) s of the session.
    first
        (J,) s of the session at which each joint's first run begins.
    position, velocity, acceleration
        (N, J) rad or m and their derivatives.
    travel
        (N, J) rad or m since each joint left its last rest.
    temperature
        (N, J) degC of the motors; NaN where nobody looks.
    """

    time: Floats
    first: Floats
    position: Floats
    velocity: Floats
    acceleration: Floats
    travel: Floats
    temperature: Floats


@dataclass(frozen=True, eq=False, slots=True)
class State:
    """One joint at N instants.

    Attributes
    ----------
    joint
        From 1.
    arm
        All joints.
    load
        (N, J) A of gravity in every joint, without anything hidden.
    weight
        The arm's masses, for loads at other postures.
    friction
        Joint (from 1) and its velocity (N,) -> (N,) A of Coulomb and viscous friction.
    sides
        (J,) +1 where a joint's motor counts its current along the joint's motion, else -1.
    """

    joint: int
    arm: Instants
    load: Floats
    weight: Weight
    friction: Callable[[int, Floats], Floats]
    sides: Floats

    @property
    def time(self) -> Floats:
        """(N,) s since the joint's first run began."""
        return np.asarray(self.arm.time - self.arm.first[self.joint - 1])

    @property
    def elapsed(self) -> Floats:
        """(N,) s since the arm's first run began."""
        return np.asarray(self.arm.time - np.min(self.arm.first))

    @property
    def position(self) -> Floats:
        """(N,) rad or m of the joint."""
        return self.arm.position[:, self.joint - 1]

    @property
    def velocity(self) -> Floats:
        """(N,) rad/s or m/s of the joint."""
        return self.arm.velocity[:, self.joint - 1]

    @property
    def own(self) -> Floats:
        """(N,) A of gravity in the joint."""
        return self.load[:, self.joint - 1]

    @property
    def side(self) -> float:
        """+1 where the motor's current counts along the joint's motion, else -1."""
        return float(self.sides[self.joint - 1])

    @property
    def opposing(self) -> Floats:
        """(N,) direction of a current that overcomes friction: +1, -1, 0 at rest."""
        return np.asarray(self.side * np.sign(self.velocity))
