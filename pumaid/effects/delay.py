"""Position and current that are not stamped at the same instant."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pumaid.effects.base import NO_SHAPE, Effect, Family, Floats, Parameter, Trace, load_refusal, loads_of
from pumaid.records import Samples
from pumaid.robot import Robot


class Delay(Effect):
    """The current in a row of the log is the one of dt earlier than its position.

    tau is the joint's gravity load by the model (A), qd its signed velocity. The load as logged lags behind the
    position, so that it makes a loop between the directions, the wider the faster. A negative dt is a position that
    lags behind the current.
    """

    title = "Current logged later than position"
    equation = "-dt qd dtau/dq"
    source = (
        "J. Swevers, W. Verdonck and J. De Schutter, Dynamic model identification for industrial robots, IEEE Control"
        " Systems Magazine 27 (2007) 58-71 (processing of measured data); first order in the delay"
    )
    family = Family.MOTION
    trace = (Trace.POSITION, Trace.SPEED, Trace.DIRECTION)
    seen_in = "runs both ways at several speeds, over stretches on which the load changes steeply"
    look_alikes = ("position_friction",)
    needs_loads = True

    def parameters(self, robot: Robot, number: int) -> tuple[Parameter, ...]:
        return (Parameter("dt", "s", "how late the current is logged", "dt{n}", 0.01, -1.0, 1.0),)

    def columns(
        self, robot: Robot, samples: Samples, *, number: int | None = None, shape: Mapping[str, float] = NO_SHAPE
    ) -> Floats:
        own = samples.joint - 1
        return -(samples.velocity[:, own] * np.nan_to_num(loads_of(samples).slopes[:, own]))[:, None]

    def applies(self, robot: Robot, joint: int) -> str | None:
        if not robot.joint(joint).is_revolute:
            return f"joint {joint} slides: its load does not change with its own position"
        return load_refusal(robot, joint)
