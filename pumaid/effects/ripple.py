"""Ripple: cogging, torque ripple, gear mesh."""

import numpy as np

from pumaid.effects import USUAL, Effect, Extent, Family, Parameter, Shape
from pumaid.robot import Robot


class Ripple(Effect):
    """One line of the current's spectrum against position.

    q is the joint's position, frequency the radians of phase per radian (or m) of it: a whole multiple of the gear
    ratio for what repeats with the motor's turn, the count of teeth for the mesh of a gear. It does not change its sign
    with the direction. Two lines are two ripples at the joint.

    The search begins at such multiples of the gear ratio, where the recipe gives it, and on an even grid with a step
    of pi / (2 span): a line half way between two of its frequencies is out of phase by pi/8 at the ends of the span,
    where 95 % of its power is still found. The shortest wavelength is the one that the cells can show.
    """

    formula = "cos * cos(frequency * q) + sin * sin(frequency * q)"
    source = (
        "D. C. Hanselman, Brushless Permanent-Magnet Motor Design, 2nd ed., Writers' Collective 2003 (cogging torque);"
        " T. D. Tuttle and W. P. Seering, A nonlinear model of a harmonic drive gear transmission, IEEE Trans. Robotics"
        " and Automation 12 (1996) 368-374"
    )
    family = Family.RIPPLE
    look_alikes = ("load_ripple",)
    prior_odds = USUAL
    seen_in = "slow runs over a wide span, sampled fast"
    is_repeatable = True
    periodic = "frequency"
    linear = (
        Parameter("cos", "A", "ripple in phase with the cosine of frequency q", "r{n}c", 0.03),
        Parameter("sin", "A", "ripple in phase with the sine of frequency q", "r{n}s", 0.02),
    )
    nonlinear = (Shape("frequency", "rad/{unit}", "radians of phase per rad or m of the joint", 0.5, 1e5, 50.0),)

    def grid(self, robot: Robot, extent: Extent) -> tuple[dict[str, float], ...]:
        span = max(extent.position[1] - extent.position[0], extent.finest)
        # Of fewer than one and a half periods it is no ripple but a slow effect of position.
        highest, lowest = 2.0 * np.pi / extent.finest, max(1.5 * 2.0 * np.pi / span, 0.5)
        gear = robot.joint(extent.joint).gear_ratio if extent.joint else None
        # Periods a turn of the motor: its eccentricity, a wave generator's two lobes, usual counts of poles and slots.
        meant = [abs(gear) * turns for turns in (1, 2, 6, 12) if lowest <= abs(gear) * turns <= highest] if gear else []
        count = max(int(np.ceil((highest - lowest) / (np.pi / (2.0 * span)))) + 1, 1)
        return tuple({"frequency": float(f)} for f in (*meant, *np.linspace(lowest, max(highest, lowest), count)))
