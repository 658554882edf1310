"""Viscous friction, each direction its own."""

from pumaid.effects import Effect, Family, Parameter, Trace


class Viscous(Effect):
    """lambda_2+ qd while the joint moves forward, lambda_2- qd while it moves back (qd signed, of the motor shaft)."""

    formula = "(plus * (s > 0) + minus * (s < 0)) * shaft"
    source = "S.-K. Lin, Identification of a Class of Nonlinear Deterministic Systems, eq. (20), Table I"
    family = Family.SPEED
    trace = (Trace.SPEED,)
    base = True
    linear = (
        Parameter("plus", "A s/{unit}", "current per speed, forward", "lambda2+", 0.2),
        Parameter("minus", "A s/{unit}", "current per speed, backward", "lambda2-", 0.15),
    )
