"""Friction in proportion to the load (gear efficiency)."""

from pumaid.effects import USUAL, Effect, Family, Parameter, load_refusal
from pumaid.robot import Robot


class LoadFriction(Effect):
    """A share of the load is lost in the gear: one share where the motor lifts, another where it lowers.

    s is the sign of the motion, load gravity's current in the joint by the model (A); the motor lifts where
    s load > 0.
    A gear that passes a share e of the power on needs 1/e of the load to lift it, so drive = 1/e - 1; to lower it, it
    needs e of the load (if e is the same that way), so back = 1 - e. Where the motor's current counts against its
    joint, both are negative and change places.
    """

    formula = "s * (drive * max(s * load, 0) + back * max(-s * load, 0))"
    source = (
        "P. Hamon, M. Gautier and P. Garrec, Dynamic identification of robots with a dry friction model depending on"
        " load and velocity, IROS 2010, 6187-6193"
    )
    family = Family.LOAD
    prior_odds = USUAL
    seen_in = "runs both ways under much and little load: stretched and folded postures, a payload"
    look_alikes = (
        *("position_friction", "side_load_friction", "load_friction_square", "stribeck_load"),
        *("torque_droop", "saturation"),
    )
    linear = (  # a load never helps the motion
        Parameter("drive", "1", "friction per load while the motor lifts it", "drive{n}", 0.12, -5.0, 5.0, sign=1),
        Parameter("back", "1", "friction per load while the motor lowers it", "back{n}", 0.08, -5.0, 5.0, sign=1),
    )

    def applies(self, robot: Robot, joint: int, *, in_motion: bool = False) -> str | None:
        return None if in_motion else load_refusal(robot, joint, must_change=True)
