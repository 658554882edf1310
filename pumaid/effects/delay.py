"""Current logged later than position."""

from pumaid.effects import Effect, Family, Parameter, Trace


class Delay(Effect):
    """The current in a row of the log is the one of dt earlier than its position.

    slope_owner is the slope of the joint's gravity load by the model (A/rad), qd its signed velocity. The load as
    logged lags behind the position, so that it makes a loop between the directions, the wider the faster. A negative dt
    is a position that lags behind the current.
    """

    formula = "-dt * qd * slope_owner"
    left_out = "it is of the log's clocks, not of the arm"
    source = (
        "J. Swevers, W. Verdonck and J. De Schutter, Dynamic model identification for industrial robots, IEEE Control"
        " Systems Magazine 27 (2007) 58-71 (processing of measured data); first order in the delay"
    )
    family = Family.MOTION
    trace = (Trace.POSITION, Trace.SPEED, Trace.DIRECTION)
    seen_in = "runs both ways at several speeds, over stretches on which the load changes steeply"
    look_alikes = ("position_friction",)
    linear = (Parameter("dt", "s", "how late the current is logged", "dt{n}", 0.01, -1.0, 1.0),)
    not_sliding = "its load does not change with its own position"
    only_loaded = True
