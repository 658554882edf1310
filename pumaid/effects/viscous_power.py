"""Viscous friction with a power of speed."""

from collections.abc import Mapping

from pumaid.effects import USUAL, Effect, Family, Parameter, Shape


class ViscousPower(Effect):
    """Friction of a lubricant that thins under shear (exponent below 1), or that is churned (about 2).

    s is the sign of the motion, v the speed in rad/s or m/s, b the current at unit speed. Exponent 1 is the paper's own
    viscous friction and so nothing new.
    """

    formula = "s * b * v ** exponent"
    source = (
        "H. Olsson, K. J. Astrom, C. Canudas de Wit, M. Gafvert and P. Lischinsky, Friction models and friction"
        " compensation, European Journal of Control 4 (1998) 176-195, section 2 (classical models)"
    )
    family = Family.SPEED
    prior_odds = USUAL
    seen_in = "runs both ways at four speeds or more, up to the fastest allowed"
    look_alikes = ("stribeck", "smooth_friction", "torque_droop", "saturation")
    linear = (Parameter("b", "A", "current at unit speed (1 rad/s or 1 m/s)", "b{n}", 0.15),)
    nonlinear = (Shape("exponent", "1", "power of speed", 0.1, 4.0, 0.5, starts=(0.25, 0.5, 1.5, 2.0, 3.0)),)

    def signs(self, shape: Mapping[str, float]) -> tuple[int, ...]:
        return (1,) if shape["exponent"] < 1.0 else (0,)  # below one a negative b would pull at low speed
