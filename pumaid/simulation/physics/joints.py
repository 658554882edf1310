"""The built-in physics: every joint by itself, with its motor's inertia, friction by direction, stiction and load."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pumaid.simulation.links import swung
from pumaid.simulation.ranges import anywhere
from pumaid.simulation.shafts import shafts
from pumaid.simulation.truth import Truth
from pumaid.trajectory import accelerations

Floats = NDArray[np.float64]

#: A joint whose truth has no inertia gets one that draws this share of its Coulomb friction in a ramp.
LEAST_INERTIA = 0.3
#: Postures, and the seed of their drawing, over which what a joint moves of the links is averaged.
POSTURES, POSTURE_SEED = 200, 5
#: s: longest step of the plant.
LONGEST_STEP = 0.002


def motor_inertia(truth: Truth) -> Floats:
    """(J,) A s2/rad or A s2/m of the motors, signed as they count, what is hidden of it included; never none."""
    own = truth.inertia
    sides = np.where(truth.friction.coulomb_plus < 0, -1.0, 1.0)
    least = sides * LEAST_INERTIA * np.maximum(truth.coulomb, 0.1) / accelerations(truth.robot)
    found = np.where(own == 0, least, own)
    for one in truth.hidden:
        if one.effect == "inertia":
            joints = slice(None) if one.joint is None else one.joint - 1
            found[joints] += np.sign(found[joints]) * one["J"]
    return found


def inertia(truth: Truth) -> Floats:
    """(J,) A s2/rad or A s2/m that the motors move: their own, and the links' where their masses are known.

    A joint by itself has the mean of what it moves over many postures. Without it a heavy arm on a light motor swings
    faster than anything that falls, and its controller cannot keep a speed.
    """
    found = motor_inertia(truth)
    if truth.links is None or truth.gain is None:
        return found
    postures = anywhere(truth.robot, POSTURES, np.random.default_rng(POSTURE_SEED))
    links = truth.gain * np.mean(swung(truth.robot, truth.links, postures), axis=0)
    # The last digits of a sum differ between machines, a robot must not.
    return np.array([float(f"{value:.9g}") for value in found + links])


class Joints:
    """S arms at work, joint by joint; J each.

    Friction is dry plus viscous, by direction. A joint that comes to rest within a step rests; it starts when its
    motor's surplus passes its dry friction times `Truth.breakaway`. Where gears couple joints, all this is told of the
    motors' shafts (`pumaid.simulation.shafts`), which the joints follow.

    Parameters
    ----------
    truth
        The robot.
    step
        s of a period of the controller, which is cut into steps of at most `LONGEST_STEP`.
    """

    def __init__(self, truth: Truth, *, step: float) -> None:
        friction = truth.friction
        self.inertia = inertia(truth)
        self._breakaway = truth.breakaway
        self._shafts = shafts(truth.robot) if truth.robot.coupling else None
        self._parts = max(1, int(np.ceil(step / LONGEST_STEP - 1e-9)))
        self._step = step / self._parts
        self._up, self._down = friction.coulomb_plus / self.inertia, -friction.coulomb_minus / self.inertia
        self._faster, self._slower = friction.viscous_plus / self.inertia, friction.viscous_minus / self.inertia
        self.position = self.velocity = self.push = self._turning = np.zeros((0, truth.robot.n_joints))

    def start(self, position: Floats) -> None:
        """Arms at rest at `position` (S, J)."""
        self.position, self._turning = position.copy(), np.zeros_like(position)
        self.velocity, self.push = np.zeros_like(position), np.zeros_like(position)

    def move(self, velocity: Floats) -> None:
        """Let the motors' shafts turn at `velocity` (S, J), geared to their joints."""
        self._turning = velocity.copy()

    def advance(self, current: Floats, load: Floats, opposing: Floats | None) -> None:
        """The first m arms under `current` (m, J) A for one period of the controller.

        Parameters
        ----------
        current
            (m, J) A of the motors.
        load
            (m, J) A that weight, springs and the like take of it.
        opposing
            (m, J) A of friction beyond Coulomb and viscous, in the direction in which the joint moves or is pushed.
        """
        m, h = len(current), self._step
        push = (current - load) / self.inertia
        q, shaft = self.position[:m], self._turning[:m]
        for _ in range(self._parts):
            resting = shaft == 0.0
            ahead = np.where(resting, push, shaft) > 0.0
            direction = np.where(ahead, 1.0, -1.0)
            dry = np.where(ahead, self._up, self._down)
            if opposing is not None:
                dry = np.maximum(dry + direction * opposing / self.inertia, 0.0)
            held = resting & (np.abs(push) <= self._breakaway * dry)
            lost = direction * dry + np.where(ahead, self._faster, self._slower) * shaft
            change = h * (push - lost)
            # What would turn round within the step stops first.
            change = np.where(~resting & ((shaft + change) * direction <= 0.0), -shaft, change)
            change[held] = 0.0
            shaft += change
            v = shaft if self._shafts is None else np.linalg.solve(self._shafts, shaft.T).T
            q += h * v
        self.velocity[:m] = v
        self.push[:m] = push
