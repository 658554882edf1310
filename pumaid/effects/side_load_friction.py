"""Friction of bearings under a side load."""

from pumaid.effects import RARE, Effect, Family, Parameter


class SideLoadFriction(Effect):
    """Friction of the joint's bearings under gravity's moment M across its axis.

    across is M, counted as the current (A) that it would draw if it lay along the axis; s is the sign of the motion. It
    needs no weight about the axis itself, so a waist that turns about the vertical can have it.

    M is made from the first moments that currents can show. Those that they cannot, along the axis itself and of the
    first link under an upright waist, are left out of it.
    """

    formula = "s * mu * across"
    source = (
        "A. C. Bittencourt and S. Gunnarsson, Static friction in a robot joint: modeling and identification of load and"
        " temperature effects, ASME J. Dynamic Systems, Measurement, and Control 134 (2012) 051013 (perpendicular load)"
    )
    family = Family.LOAD
    prior_odds = RARE
    seen_in = "runs both ways in postures in which gravity bends the joint's axis much and little"
    look_alikes = ("load_friction", "position_friction")
    linear = (Parameter("mu", "1", "friction per moment across the axis", "mu{n}", 0.03, -5.0, 5.0, sign=1),)
    not_sliding = "how its guide is loaded cannot be known from its weight alone"
