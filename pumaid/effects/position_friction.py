"""Friction that varies with position."""

from collections.abc import Mapping

import numpy as np

from pumaid.effects import Effect, Extent, Family, Parameter, Shape
from pumaid.robot import Robot

#: Harmonics that a search begins with.
HARMONICS = (1, 2, 3)


class PositionFriction(Effect):
    """An eccentric gear or a bent guide is stiffer at some positions than at others.

    s is the sign of the motion, q the joint's position. harmonic is whole for a joint that turns, since the friction of
    a gear wheel on the joint's axis repeats with each turn; for a slide it is in rad/m.
    """

    formula = "s * (cos * cos(harmonic * q) + sin * sin(harmonic * q))"
    source = (
        "B. Armstrong, Friction: experimental determination, modeling and compensation, IEEE Int. Conf. Robotics and"
        " Automation 1988, 1422-1427 (position-dependent friction of a PUMA 560)"
    )
    family = Family.POSITION
    seen_in = "runs both ways over the joint's whole span"
    look_alikes = ("load_friction", "side_load_friction")
    is_repeatable = True
    linear = (
        Parameter("cos", "A", "friction in phase with the cosine of harmonic q", "f{n}c", 0.06),
        Parameter("sin", "A", "friction in phase with the sine of harmonic q", "f{n}s", -0.04),
    )

    def shapes(self, robot: Robot, number: int) -> tuple[Shape, ...]:
        if robot.joint(number).is_revolute:
            return (Shape("harmonic", "1", "periods a turn", 1.0, 6.0, 2.0, is_searched=False),)
        return (Shape("harmonic", "rad/m", "2 pi over the wavelength", 0.1, 1000.0, 10.0),)

    def grid(self, robot: Robot, extent: Extent) -> tuple[Mapping[str, float], ...]:
        if extent.joint is None or robot.joint(extent.joint).is_revolute:
            return tuple({"harmonic": float(k)} for k in HARMONICS)
        span = max(extent.position[1] - extent.position[0], 0.01)
        return tuple({"harmonic": float(np.clip(k * np.pi / span, 0.1, 1000.0))} for k in HARMONICS)
