"""Stribeck friction: less at higher speed."""

import numpy as np

from pumaid.effects import USUAL, Effect, Extent, Family, Parameter, Shape
from pumaid.robot import Robot


class Stribeck(Effect):
    """Friction that falls from a at rest to nothing well above the speed `velocity`.

    s is the sign of the motion, v the speed (rad/s or m/s). Coulomb friction in each direction takes what does not
    change with speed, so a is the height of the fall. With exponent 1 the fall is Tustin's, with 2 Gaussian.
    """

    formula = "s * a * exp(-(v / velocity) ** exponent)"
    source = (
        "L. C. Bo and D. Pavelescu, The friction-speed relation and its influence on the critical velocity of"
        " stick-slip motion, Wear 82 (1982) 277-289; B. Armstrong-Helouvry, P. Dupont and C. Canudas de Wit, A survey"
        " of models, analysis tools and compensation methods for the control of machines with friction, Automatica 30"
        " (1994) 1083-1138, section 2"
    )
    family = Family.SPEED
    prior_odds = USUAL
    seen_in = "runs both ways at four speeds or more, down to the slowest that is smooth"
    look_alikes = ("viscous_power", "smooth_friction", "torque_droop", "saturation")
    linear = (Parameter("a", "A", "height of the fall, from rest to high speed", "a{n}", 0.1, sign=1),)
    nonlinear = (
        Shape("velocity", "{unit}/s", "speed at which the fall is down to 1/e", 1e-4, 20.0, 0.15),
        Shape("exponent", "1", "how sudden the fall is", 0.5, 2.0, 1.0),
    )

    def grid(self, robot: Robot, extent: Extent) -> tuple[dict[str, float], ...]:
        # From below the slowest run (where all but it are past the fall) to near the fastest.
        slow, fast = 0.5 * extent.speeds[0], 0.7 * extent.speeds[-1]
        speeds = np.clip(np.geomspace(slow, max(fast, 2.0 * slow), 6), 1e-4, 20.0)
        return tuple({"velocity": float(v), "exponent": d} for v in speeds for d in (1.0, 2.0))
