"""Presliding: friction that builds up at the start of a motion."""

import numpy as np

from pumaid.effects import Effect, Extent, Family, Parameter, Shape
from pumaid.robot import Robot


class Presliding(Effect):
    """Friction is a lower where the motion begins and has its full value after a few times `travel`.

    s is the sign of the motion, path what was travelled since it began. Asperities bend, or teeth take up their play,
    before the contact slides: Dahl's model with exponent 1, whose solution for one motion is this exponential.
    """

    formula = "-s * a * exp(-path / travel)"
    left_out = "it depends on the travel since the motion began: what is written is friction after it"
    source = (
        "P. R. Dahl, A solid friction model, The Aerospace Corporation, TOR-0158(3107-18)-1 (1968); C. Canudas de Wit,"
        " H. Olsson, K. J. Astrom and P. Lischinsky, A new model for control of systems with friction, IEEE Trans."
        " Automatic Control 40 (1995) 419-425"
    )
    family = Family.START
    seen_in = "slow runs both ways, each from rest"
    look_alikes = ("inertia",)
    linear = (Parameter("a", "A", "what friction lacks where the motion begins", "a{n}", 0.1, sign=1),)
    nonlinear = (Shape("travel", "{unit}", "travel over which what is lacking falls to 1/e", 1e-5, 0.4, 0.05),)

    def grid(self, robot: Robot, extent: Extent) -> tuple[dict[str, float], ...]:
        longest = max(extent.travel / 4.0, 1e-4)
        lengths = np.geomspace(min(extent.finest / 2.0, longest / 8.0), longest, 5)
        return tuple({"travel": float(x)} for x in np.clip(lengths, 1e-5, 0.4))
