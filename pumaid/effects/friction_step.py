"""Friction that changed at one instant."""

from pumaid.effects import RARE, Effect, Family, Parameter, Shape


class FrictionStep(Effect):
    """Friction is a higher after the instant `time` than before.

    s is the sign of the motion, t the time since the joint's first motion. Which instant between two runs it was, no
    run can tell.
    """

    formula = "s * a * (t > time)"
    left_out = "it came at one instant: what is written is the friction before it"
    source = (
        "A. C. Bittencourt, P. Axelsson, Y. Jung and T. Brogardh, Modeling and identification of wear in a robot joint"
        " under temperature uncertainties, IFAC World Congress 2011; M. Basseville and I. V. Nikiforov, Detection of"
        " Abrupt Changes, Prentice Hall 1993, chapter 2 (change of a mean)"
    )
    family = Family.TIME
    prior_odds = RARE
    seen_in = "runs both ways that are repeated before and after"
    look_alikes = ("warmup", "torque_constant_drift", "thermal_friction")
    is_repeatable = True
    linear = (Parameter("a", "A", "friction that came at that instant", "a{n}", 0.08),)
    nonlinear = (Shape("time", "s", "when it came, counted from the first motion", 0.0, 1e9, 600.0, False),)
