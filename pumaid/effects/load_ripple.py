"""Ripple of a loaded gear's mesh."""

from pumaid.effects import RARE, Effect, Family, Parameter, Shape, ripple


class LoadRipple(Effect):
    """A line of the current's spectrum against position whose height is in proportion to the size of the load.

    q is the joint's position, load gravity's current by the model (A). Teeth bend under load, most where fewest are in
    mesh, and what a wave generator transmits wavers likewise. It is tried at the frequencies at which a ripple is
    found.
    """

    formula = "abs(load) * (cos * cos(frequency * q) + sin * sin(frequency * q))"
    source = (
        "H. N. Ozguven and D. R. Houser, Mathematical models used in gear dynamics: a review, J. Sound and Vibration"
        " 121 (1988) 383-411; T. D. Tuttle and W. P. Seering, A nonlinear model of a harmonic drive gear transmission,"
        " IEEE Trans. Robotics and Automation 12 (1996) 368-374"
    )
    family = Family.RIPPLE
    seen_in = "slow runs over a wide span, sampled fast, under much and little load"
    look_alikes = ("ripple",)
    prior_odds = RARE / 4.0  # it refines ripple
    is_repeatable = True
    periodic = "frequency"
    only_loaded = True
    linear = (
        Parameter("cos", "1", "ripple per load in phase with the cosine of frequency q", "g{n}c", 0.03, -5.0, 5.0),
        Parameter("sin", "1", "ripple per load in phase with the sine of frequency q", "g{n}s", 0.02, -5.0, 5.0),
    )
    nonlinear = (Shape("frequency", "rad/{unit}", "radians of phase per rad or m of the joint", 0.5, 1e5, 50.0),)
    grid = ripple.Ripple.grid
