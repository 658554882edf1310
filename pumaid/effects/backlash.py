"""Backlash: the link rests on the side to which its load pushes it."""

from pumaid.effects import Effect, Family, Parameter, Scope, Shape


class Backlash(Effect):
    """The link of joint m stands half of the play behind where the motor's sensor says, away from how the gear presses.

    It presses by gravity's load and by the `share` of friction beyond it, which goes with the motion. Every joint that
    feels m's position feels it. Where the press never changes its sign, this is a shifted zero.
    """

    formula = "-0.5 * play * slope_owner * sign(load_owner + share * friction_owner)"
    source = (
        "M. Nordin and P.-O. Gutman, Controlling mechanical systems with backlash - a survey, Automatica 38 (2002)"
        " 1633-1649, stiff teeth"
    )
    scope = Scope.CAUSE
    family = Family.GRAVITY
    seen_in = "runs both ways through positions at which the load changes its sign"
    look_alikes = ("flexibility", "zero_offset", "counterbalance", "spring")
    opposes_motion = True
    linear = (Parameter("play", "rad", "way of the link between its stops", "b{n}", 0.01, 0.0, 0.2, sign=1),)
    nonlinear = (
        Shape("share", "1", "share of friction beyond the gear", 0.0, 1.0, 0.0, is_searched=False, starts=(0.0, 0.5)),
    )
    not_sliding = "its load does not change with its own position"
    only_loaded = True
