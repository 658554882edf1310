"""Inertia of the moving joint."""

from pumaid.effects import USUAL, Effect, Family, Parameter


class Inertia(Effect):
    """J qdd, with J the moment of inertia (or mass) of all that moves with the joint, its motor included, as current.

    J depends on how the outer joints are held; where joints accelerate, the rigid body takes its place.
    """

    formula = "J * qdd"
    left_out = "it needs the acceleration"
    source = "J. J. Craig, Introduction to Robotics, 3rd ed., section 6.7; one joint moving alone"
    family = Family.MOTION
    prior_odds = USUAL
    opposes_motion = True
    seen_in = "strokes from rest to rest, or runs whose speed wavers"
    look_alikes = ("presliding", "saturation")
    linear = (Parameter("J", "A s2/{unit}", "current per acceleration", "J{n}", 0.02, sign=1),)
