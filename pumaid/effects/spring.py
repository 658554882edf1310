"""Spring: a current in proportion to position."""

from pumaid.effects import RARE, Effect, Family, Parameter


class Spring(Effect):
    """The current that holds a linear spring, such as a hose package or a torsion bar.

    q is the joint's position; where the spring is slack cannot be told from Coulomb friction's asymmetry and so is
    part of it. A positive a pulls the joint back to its zero.
    """

    formula = "a * q"
    source = (
        "Y. Wang, R. Gondokaryono, A. Munawar and G. S. Fischer, A convex optimization-based dynamic model"
        " identification package for the da Vinci Research Kit, IEEE Robotics and Automation Letters 4 (2019) 3657-3664"
    )
    family = Family.TORQUE
    prior_odds = RARE
    seen_in = "runs over the joint's whole span, in postures of much and little load"
    look_alikes = ("counterbalance", "tilt", "ripple", "presliding", "flexibility", "backlash")
    linear = (Parameter("a", "A/{unit}", "stiffness, as current", "a{n}", 0.1),)
