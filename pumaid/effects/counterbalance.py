"""Counterbalance: a constant force on a lever."""

from math import pi

from pumaid.effects import RARE, Effect, Family, Parameter, Shape

#: Levers and angles (rad) at which a search begins.
LEVERS = (0.2, 0.5, 0.8)
ANGLES = tuple(k * pi / 4 for k in range(-4, 4))


class Counterbalance(Effect):
    """A cylinder with a constant force between link and base.

    length is the lever on the link over the distance of the cylinder's foot from the axis, angle the position at which
    cylinder and lever are in line, a the force times the lever, as current. length and 1/length give the same curve.
    """

    formula = "a * sin(q - angle) / sqrt(1 + length ** 2 - 2 * length * cos(q - angle))"
    source = (
        "A. Klimchik, Y. Wu, C. Dumas, S. Caro, B. Furet and A. Pashkevich, Identification of geometrical and"
        " elastostatic parameters of heavy industrial robots, IEEE Int. Conf. Robotics and Automation 2013,"
        " arXiv:1311.6810 (geometry of the gravity compensator, here with a constant force)"
    )
    family = Family.TORQUE
    prior_odds = RARE
    seen_in = "runs of its joint over the whole span, in postures that change the joint's load"
    look_alikes = ("spring", "tilt", "ripple", "flexibility", "backlash")
    linear = (Parameter("a", "A", "force times lever, as current", "a{n}", 0.3),)
    nonlinear = (
        Shape("length", "1", "lever over the distance of the foot from the axis", 0.02, 0.98, 0.4, starts=LEVERS),
        Shape("angle", "rad", "position at which cylinder and lever are in line", -pi, pi, 0.5, starts=ANGLES),
    )
    not_sliding = "a constant force along it is part of its Coulomb friction"
