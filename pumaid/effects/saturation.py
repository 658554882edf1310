"""Current clipped at a limit."""

from pumaid.effects import RARE, Effect, Family, Parameter, Shape


class Saturation(Effect):
    """What is above the limit is missing, all of it with a = 1.

    drawn is the model's whole prediction for the joint (A).
    """

    formula = "-a * sign(drawn) * max(abs(drawn) - limit, 0)"
    left_out = "the drive, or the sensor, clips by itself: what is written is the current that the motion needs"
    source = (
        "M. W. Spong, S. Hutchinson and M. Vidyasagar, Robot Modeling and Control, Wiley 2006, chapter 6 (saturation of"
        " the actuator)"
    )
    family = Family.CURRENT
    prior_odds = RARE
    seen_in = "runs in which the current comes near its limit: fast, under much load"
    look_alikes = ("torque_droop", "stribeck", "smooth_friction", "viscous_power", "inertia")
    linear = (Parameter("a", "1", "share of what is above the limit that is missing", "a{n}", 1.0, -1.0, 2.0, sign=1),)
    nonlinear = (
        Shape(
            "limit",
            "A",
            "current above which it is clipped",
            1e-4,
            1e3,
            2.0,
            starts=(0.6, 0.7, 0.8, 0.88, 0.94, 0.97, 0.985),
            of="current",
        ),
    )
