"""Torque constant that falls as the motor warms."""

from pumaid.effects import RARE, Effect, Family, Parameter, Shape, Trace


class TorqueConstantDrift(Effect):
    """The motor needs a share a more current for the same torque when it is warm.

    drawn is the model's whole prediction for the joint (A), t the time since its first motion. Magnets lose about a
    tenth of a percent of their flux per degree.
    """

    formula = "a * (1 - exp(-t / time_constant)) * drawn"
    left_out = "it grows with time: what is written is the cold motor"
    source = (
        "T. Sebastian, Temperature effects on torque production and efficiency of PM motors using NdFeB magnets, IEEE"
        " Trans. Industry Applications 31 (1995) 353-357"
    )
    family = Family.TIME
    prior_odds = RARE
    trace = (Trace.TIME, Trace.LOAD)
    seen_in = "runs under much load, repeated over one long recording from a cold start"
    look_alikes = ("warmup", "thermal_friction", "friction_step", "payload")
    linear = (Parameter("a", "1", "share of current that is added when warm", "a{n}", 0.05, -1.0, 1.0),)
    nonlinear = (Shape("time_constant", "s", "time in which the change is down to 1/e", 1.0, 1e6, 900.0),)
