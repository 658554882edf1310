"""A current that the drive, or the sensor, does not let through."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pumaid.effects.base import NO_SHAPE, Effect, Family, Floats, Parameter, Shape, Trace, loads_of
from pumaid.records import Extent, Samples
from pumaid.robot import Robot

#: Limits that a search begins with, as shares of the largest predicted current.
SHARES = (0.6, 0.7, 0.8, 0.88, 0.94, 0.97, 0.985)


class Saturation(Effect):
    """What is above the limit is missing, all of it with a = 1.

    i is the model's whole prediction for the joint (A).
    """

    title = "Current clipped at a limit"
    equation = "-a sign(i) max(|i| - i_lim, 0)"
    source = (
        "M. W. Spong, S. Hutchinson and M. Vidyasagar, Robot Modeling and Control, Wiley 2006, chapter 6 (saturation of"
        " the actuator)"
    )
    family = Family.CURRENT
    trace = (Trace.LOAD,)
    seen_in = "runs in which the current comes near its limit: fast, under much load"
    look_alikes = ("torque_droop", "stribeck", "viscous_power", "inertia")
    needs_loads = True

    def parameters(self, robot: Robot, number: int) -> tuple[Parameter, ...]:
        return (Parameter("a", "1", "share of what is above the limit that is missing", "a{n}", 1.0, -1.0, 2.0),)

    def shapes(self, robot: Robot, number: int) -> tuple[Shape, ...]:
        return (Shape("limit", "A", "i_lim: current above which it is clipped", 1e-4, 1000.0, 2.0),)

    def grid(self, robot: Robot, extent: Extent) -> tuple[Mapping[str, float], ...]:
        return tuple({"limit": float(np.clip(c * extent.current, 1e-4, 1000.0))} for c in SHARES)

    def columns(
        self, robot: Robot, samples: Samples, *, number: int | None = None, shape: Mapping[str, float] = NO_SHAPE
    ) -> Floats:
        drawn = loads_of(samples).drawn
        return -(np.sign(drawn) * np.maximum(np.abs(drawn) - shape["limit"], 0.0))[:, None]

    def signs(self, shape: Mapping[str, float]) -> tuple[int, ...]:
        return (1,)  # what is clipped is missing
