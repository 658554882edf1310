"""Coulomb friction, each direction its own."""

from pumaid.effects import Effect, Family, Parameter


class Coulomb(Effect):
    """lambda_1+ while the joint moves forward, lambda_1- while it moves back.

    Both are signed currents, as in the paper's Table I; a constant offset of the current sensor is their asymmetry.
    """

    formula = "plus * (s > 0) + minus * (s < 0)"
    source = "S.-K. Lin, Identification of a Class of Nonlinear Deterministic Systems, eq. (20), Table I"
    family = Family.DIRECTION
    base = True
    linear = (
        Parameter("plus", "A", "current at zero speed, forward", "lambda1+", 0.4),
        Parameter("minus", "A", "current at zero speed, backward", "lambda1-", -0.3),
    )
