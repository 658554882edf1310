"""Friction that grows with the square of the load."""

from pumaid.effects import RARE, Effect, Family, Parameter


class LoadFrictionSquare(Effect):
    """Friction of rolling contacts, which grows faster than the load that flattens them.

    s is the sign of the motion, load gravity's current by the model (A). Measured powers of the load lie between 1.3
    and 2; load_friction is the first term of a series in the load, this the second.
    """

    formula = "s * a * load ** 2"
    source = (
        "T. A. Harris and M. N. Kotzalas, Essential Concepts of Bearing Technology, 5th ed., CRC Press 2006, chapter 10"
        " (friction torque of an applied load)"
    )
    family = Family.LOAD
    seen_in = "runs both ways under much and little load: stretched and folded postures, a payload"
    look_alikes = ("load_friction", "torque_droop", "saturation")
    prior_odds = RARE
    only_loaded = True
    linear = (Parameter("a", "1/A", "friction at a load of 1 A", "a{n}", 0.05, sign=1),)
