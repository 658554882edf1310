"""A drive that gives way under the load, so that the link hangs lower than its sensor says."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pumaid.effects.base import NO_SHAPE, Effect, Floats, Parameter, Trace, load_refusal, loads_of
from pumaid.records import Robot, Samples


class Flexibility(Effect):
    """The link stands at q - c tau where the motor's sensor says q.

    tau is the joint's gravity load by the model (A), c the compliance in radians per ampere of it: positive where the
    load bends the drive downward and the motor's current counts along the joint, as the paper's signs have it.
    """

    title = "Flexible drive: the link sags under its load"
    equation = "-c tau dtau/dq"
    source = (
        "M. W. Spong, Modeling and control of elastic joint robots, ASME J. Dynamic Systems, Measurement, and Control"
        " 109 (1987) 310-319, at rest and linearised in the deflection"
    )
    family = "gravity"
    trace = (Trace.POSITION, Trace.LOAD)
    look_alikes = ("counterbalance", "zero_offset")
    needs_loads = True

    def parameters(self, robot: Robot, number: int) -> tuple[Parameter, ...]:
        return (Parameter("c", "rad/A", "deflection per current of the load", "c{n}", 0.01, -1.0, 1.0),)

    def columns(
        self, robot: Robot, samples: Samples, *, number: int | None = None, shape: Mapping[str, float] = NO_SHAPE
    ) -> Floats:
        loads = loads_of(samples)
        return -(np.nan_to_num(loads.slopes[:, samples.joint - 1]) * loads.own)[:, None]

    def applies(self, robot: Robot, joint: int) -> str | None:
        if not robot.joint(joint).is_revolute:
            return f"joint {joint} slides: its load does not change with its own position"
        return load_refusal(robot, joint)
