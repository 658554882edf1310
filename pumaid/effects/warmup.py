"""Warm-up: friction that fades with time."""

from pumaid.effects import Effect, Family, Parameter, Shape


class Warmup(Effect):
    """Friction is a higher at the joint's first motion and has lost it after a few time constants.

    s is the sign of the motion, t the time since the joint's first motion. Grease thins as the gear warms; a room that
    warms, or a joint that was warm, gives a negative a.
    """

    formula = "s * a * exp(-t / time_constant)"
    left_out = "it fades with time: what is written is the warm joint"
    source = (
        "L. Simoni, M. Beschi, G. Legnani and A. Visioli, Friction modeling with temperature effects for industrial"
        " robot manipulators, IROS 2015, 3524-3529"
    )
    family = Family.TIME
    seen_in = "runs both ways, repeated over one long recording from a cold start"
    look_alikes = ("torque_constant_drift", "thermal_friction", "friction_step")
    linear = (Parameter("a", "A", "friction that is gone when the joint is warm", "a{n}", 0.1, sign=1),)
    nonlinear = (Shape("time_constant", "s", "time in which the excess falls to 1/e", 1.0, 1e6, 600.0),)
