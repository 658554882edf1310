"""Friction that varies with position."""

from pumaid.effects import Effect, Family, Parameter, Shape
from pumaid.robot import Robot

#: Harmonics that a search begins with, of a turn or of half a wave over all positions.
HARMONICS = (1.0, 2.0, 3.0)


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
            return (Shape("harmonic", "1", "periods a turn", 1.0, 6.0, 2.0, is_searched=False, starts=HARMONICS),)
        return (
            Shape("harmonic", "rad/m", "2 pi over the wavelength", 0.1, 1e3, 10.0, starts=HARMONICS, of="half_wave"),
        )
