"""Payload on the last link from an instant on."""

from pumaid.effects import Effect, Family, Parameter, Scope, Shape
from pumaid.robot import Robot


class Payload(Effect):
    """Weight and inertia of something taken up, or lost.

    gamma_p is what a unit of mass at the origin of the last link's frame asks of the moving joint, gamma_x .. gamma_z
    what a unit of first moment along that frame's axes does, moments of inertia of a point there among it. elapsed
    counts from the arm's first motion, through all recordings. A joint feels it by the ratio of its gain to the last
    joint's; where that is not known it is left out.
    """

    formula = "(elapsed > time) * (mass * gamma_p + x * gamma_x + y * gamma_y + z * gamma_z)"
    left_out = "it came at one instant: what is written is the arm without it"
    source = (
        "W. Khalil, M. Gautier and P. Lemoine, Identification of the payload inertial parameters of industrial"
        " manipulators, IEEE Int. Conf. Robotics and Automation 2007, 4943-4948"
    )
    scope = Scope.ARM
    family = Family.PAYLOAD
    seen_in = "the same runs with and without it"
    look_alikes = ("torque_constant_drift", "tilt")
    nonlinear = (Shape("time", "s", "when it came, counted from the arm's first motion", 0.0, 1e9, 600.0, False),)
    only_loaded = True

    def parameters(self, robot: Robot, number: int) -> tuple[Parameter, ...]:
        mass, moment = ("A s2/m2", "A s2/m") if robot.joints[-1].is_revolute else ("A s2/m", "A s2")
        felt = "in the last link's frame, times the last joint's gain"
        return (
            Parameter("mass", mass, "mass, times the last joint's gain", "m", 0.1),
            Parameter("x", moment, f"first moment along x {felt}", "mx", 0.005),
            Parameter("y", moment, f"first moment along y {felt}", "my", -0.003),
            Parameter("z", moment, f"first moment along z {felt}", "mz", 0.01),
        )
