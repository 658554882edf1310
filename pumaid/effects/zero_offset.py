"""Joint's zero off by a little."""

import numpy as np

from pumaid.effects import RARE, Effect, Family, Parameter, Scope, load_refusal
from pumaid.effects.base import POSTURES, ROUNDING
from pumaid.robot import Robot


class ZeroOffset(Effect):
    """Joint m stands at q_m + delta where its sensor says q_m.

    It changes the load of joint m and of every other joint that feels what m moves. slope_owner is the slope of a
    joint's gravity load by m's position (A/rad), also where all joints move: the slope of inertia is as noisy as
    accelerations, and hid offsets that weight shows. Where no axis beyond joint m is at an angle to its own, as for the
    last joint, the offset turns the links' first moments and nothing else, and a slide's offset adds a constant lever:
    no current can show those.
    """

    formula = "delta * slope_owner"
    source = (
        "B. Siciliano, L. Sciavicco, L. Villani and G. Oriolo, Robotics: Modelling, Planning and Control, Springer"
        " 2009, section 2.11 (kinematic calibration), here from gravity's load"
    )
    scope = Scope.CAUSE
    family = Family.GRAVITY
    prior_odds = RARE
    seen_in = "runs of the joints before it while it is held at several positions, better with a payload"
    look_alikes = ("tilt", "coupling", "counterbalance", "flexibility")
    linear = (Parameter("delta", "rad", "true position less measured position", "delta{n}", 0.03, -0.5, 0.5),)

    def applies(self, robot: Robot, joint: int, *, in_motion: bool = False) -> str | None:
        if not robot.joint(joint).is_revolute:
            return f"a shift of joint {joint}'s zero adds a constant lever, which the links' first moments absorb"
        if (upright := load_refusal(robot, joint)) is not None:
            return upright
        # A turn that moves no axis beyond the joint is one of first moments alone.
        rng = np.random.default_rng(0)
        z = robot.rotations(rng.uniform(-np.pi, np.pi, (POSTURES, robot.n_joints)))[..., 2]
        if float(np.abs(np.cross(z[:, joint - 1, None], z[:, joint - 1 :])).max()) > ROUNDING:
            return None
        beyond = "it is the last" if joint == robot.n_joints else "all joints beyond it are parallel to it"
        return f"a shift of joint {joint}'s zero only turns first moments, which absorb it: {beyond}"
