"""Stribeck friction of a loaded gear."""

from pumaid.effects import RARE, Effect, Family, Parameter, Shape


class StribeckLoad(Effect):
    """Friction that falls with speed, by a height in proportion to the size of the load.

    s is the sign of the motion, v the speed, load gravity's current by the model (A). A film of oil that carries more
    is thinner, and builds up at a higher speed. The exponent is the measured one of the source; what does not change
    with speed is load_friction.
    """

    formula = "s * a * abs(load) * exp(-(v / velocity) ** 1.3)"
    source = (
        "A. C. Bittencourt and S. Gunnarsson, Static friction in a robot joint: modeling and identification of load and"
        " temperature effects, ASME J. Dynamic Systems, Measurement, and Control 134 (2012) 051013"
    )
    family = Family.LOAD
    prior_odds = RARE / 4.0  # it refines load_friction
    seen_in = "runs both ways at four speeds or more, under much and little load"
    look_alikes = ("load_friction",)
    only_loaded = True
    linear = (Parameter("a", "1", "height of the fall per load", "a{n}", 0.1, -5.0, 5.0, sign=1),)
    nonlinear = (
        Shape(
            "velocity",
            "{unit}/s",
            "speed at which the fall is down to 1/e",
            1e-4,
            20.0,
            0.15,
            starts=(0.06, 0.15, 0.35, 0.7),
            of="fastest",
        ),
    )
