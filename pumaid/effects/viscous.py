"""Viscous friction: a current proportional to velocity, its own in each direction."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pumaid.effects.base import NO_SHAPE, Effect, Family, Floats, Parameter, Trace, friction_velocity
from pumaid.records import Samples
from pumaid.robot import Robot


class Viscous(Effect):
    """lambda_2+ qd while the joint moves forward, lambda_2- qd while it moves back (qd signed)."""

    title = "Viscous friction, each direction its own"
    equation = "lambda_2+ qd where qd > 0, lambda_2- qd where qd < 0"
    source = "S.-K. Lin, Identification of a Class of Nonlinear Deterministic Systems, eq. (20), Table I"
    family = Family.SPEED
    trace = (Trace.SPEED,)
    base = True
    in_triangle = True

    def parameters(self, robot: Robot, number: int) -> tuple[Parameter, ...]:
        unit = f"A s/{robot.joint(number).position_unit}"
        return (
            Parameter("plus", unit, "current per speed, forward", "lambda2+", 0.2),
            Parameter("minus", unit, "current per speed, backward", "lambda2-", 0.15),
        )

    def columns(
        self, robot: Robot, samples: Samples, *, number: int | None = None, shape: Mapping[str, float] = NO_SHAPE
    ) -> Floats:
        velocity = friction_velocity(robot, samples)
        forward = samples.direction > 0
        return np.column_stack([np.where(forward, velocity, 0.0), np.where(forward, 0.0, velocity)])
