"""A joint's position counts from another zero than the recipe says."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pumaid.effects.base import NO_SHAPE, Effect, Floats, Parameter, Scope, Trace, load_refusal, loads_of
from pumaid.records import Robot, Samples


class ZeroOffset(Effect):
    """delta dtau/dq_m: joint m stands at q_m + delta where its sensor says q_m.

    It changes the load of joint m and of every other joint that feels what m moves. tau is a joint's gravity load by
    the model (A). The last joint's offset turns its link's first moments and nothing else, and a slide's offset adds a
    constant lever: no current can show those.
    """

    title = "Joint's zero off by a little"
    equation = "delta dtau/dq_m in every joint"
    source = (
        "B. Siciliano, L. Sciavicco, L. Villani and G. Oriolo, Robotics: Modelling, Planning and Control, Springer"
        " 2009, section 2.11 (kinematic calibration), here from gravity's load"
    )
    scope = Scope.CAUSE
    family = "gravity"
    trace = (Trace.POSITION,)
    look_alikes = ("tilt", "flexibility", "payload")
    needs_loads = True

    def parameters(self, robot: Robot, number: int) -> tuple[Parameter, ...]:
        return (Parameter("delta", "rad", "true position less measured position", "delta{n}", 0.03, -0.5, 0.5),)

    def columns(
        self, robot: Robot, samples: Samples, *, number: int | None = None, shape: Mapping[str, float] = NO_SHAPE
    ) -> Floats:
        slope = loads_of(samples).slopes[:, (number or samples.joint) - 1]
        return np.nan_to_num(slope)[:, None]

    def applies(self, robot: Robot, joint: int) -> str | None:
        if not robot.joint(joint).is_revolute:
            return f"a shift of joint {joint}'s zero adds a constant lever, which the links' first moments absorb"
        if joint == robot.n_joints:
            return f"a shift of joint {joint}'s zero only turns the first moment of the last link, which absorbs it"
        return load_refusal(robot, joint)
