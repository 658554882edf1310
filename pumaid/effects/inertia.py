"""Inertia: the current that accelerates the moving joint."""

from __future__ import annotations

from collections.abc import Mapping

from pumaid.effects.base import Effect, Family, Parameter, Scope, Trace
from pumaid.robot import Robot


class Inertia(Effect):
    """J qdd, with J the moment of inertia (or mass) of all that moves with the joint, its motor included, as current.

    J depends on how the outer joints are held, so it is one parameter for each set of held positions.
    """

    title = "Inertia of the moving joint"
    formula = "J * qdd"
    left_out = "it needs the acceleration, and is known only where the other joints were held"
    source = "J. J. Craig, Introduction to Robotics, 3rd ed., section 6.7; one joint moving alone"
    scope = Scope.JOINT
    family = Family.MOTION
    opposes_motion = True
    trace = (Trace.POSITION,)
    seen_in = "strokes from rest to rest, or runs whose speed wavers"
    look_alikes = ("presliding", "saturation")
    per_posture = True

    def parameters(self, robot: Robot, number: int) -> tuple[Parameter, ...]:
        unit = f"A s2/{robot.joint(number).position_unit}"
        return (Parameter("J", unit, "current per acceleration", "J{n}", 0.02),)

    def signs(self, shape: Mapping[str, float]) -> tuple[int, ...]:
        return (1,)  # mass is positive
