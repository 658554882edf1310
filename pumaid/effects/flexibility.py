"""Flexible drive: the link sags under its load."""

from pumaid.effects import Effect, Family, Parameter, Scope, Trace


class Flexibility(Effect):
    """The link of joint m stands at q - c load where the motor's sensor says q, whichever joint moves.

    load_owner is the gravity load of joint m by the model (A, of its own motor), c its compliance in radians per ampere
    of it: positive where the load bends the drive downward and the motor's current counts along the joint, as the
    paper's signs have it. Every joint that feels m's position feels the deflection: slope_owner is the slope of its own
    load by m's position.
    """

    formula = "-c * slope_owner * load_owner"
    source = (
        "M. W. Spong, Modeling and control of elastic joint robots, ASME J. Dynamic Systems, Measurement, and Control"
        " 109 (1987) 310-319, at rest and linearised in the deflection"
    )
    scope = Scope.CAUSE
    family = Family.GRAVITY
    trace = (Trace.POSITION, Trace.LOAD)
    seen_in = "runs under much and little load: stretched and folded postures, a payload"
    look_alikes = ("counterbalance", "zero_offset", "spring", "backlash")
    linear = (Parameter("c", "rad/A", "deflection per current of the load", "c{n}", 0.01, -1.0, 1.0),)
    not_sliding = "its load does not change with its own position"
    only_loaded = True
