"""Current logged later than position."""

from pumaid.effects import Effect, Family, Parameter, Trace


class Delay(Effect):
    """The current in a row of the log is the one of dt earlier than its position.

    load_rate is how fast the joint's load by the model changes (A/s); where all joints move, inertia is part of it. The
    load as logged lags behind the motion, so that it makes a loop between the directions, the wider the faster. A
    current that a drive filters lags alike. A negative dt is a position that lags behind the current.
    """

    formula = "-dt * load_rate"
    left_out = "it is of the log's clocks, not of the arm"
    source = (
        "J. Swevers, W. Verdonck and J. De Schutter, Dynamic model identification for industrial robots, IEEE Control"
        " Systems Magazine 27 (2007) 58-71 (processing of measured data); first order in the delay"
    )
    family = Family.MOTION
    trace = (Trace.POSITION, Trace.SPEED, Trace.DIRECTION)
    seen_in = "hasty motion, or runs both ways at several speeds over stretches on which the load changes steeply"
    look_alikes = ("position_friction",)
    linear = (Parameter("dt", "s", "how late the current is logged", "dt{n}", 0.01, -1.0, 1.0),)
    only_loaded = True
