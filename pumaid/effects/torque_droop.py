"""Motor gives less torque per ampere at high current."""

from pumaid.effects import RARE, Effect, Family, Parameter


class TorqueDroop(Effect):
    """The iron saturates, so a high torque needs more current than in proportion.

    drawn is the model's whole prediction for the joint (A). It is the first term that a loss which is even in the
    current can have: drawn (drawn / i_ref)^2, with the reference current i_ref = 1 A, so that a means the same in any
    data.
    """

    formula = "a * drawn ** 3"
    source = (
        "T. J. E. Miller, Brushless Permanent-Magnet and Reluctance Motor Drives, Oxford University Press 1989"
        " (saturation of the torque constant)"
    )
    family = Family.CURRENT
    prior_odds = RARE
    seen_in = "runs under much and little load, up to high currents"
    look_alikes = (
        "saturation",
        "load_friction",
        "viscous_power",
        "stribeck",
        "smooth_friction",
        "load_friction_square",
    )
    linear = (Parameter("a", "1/A2", "share of current added at 1 A", "a{n}", 0.01, sign=1),)
