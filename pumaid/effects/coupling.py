"""Gear coupling: a joint's load and friction on another's motor."""

from pumaid.effects import Effect, Family, Parameter, Scope, Shape, Trace
from pumaid.robot import Robot


class Coupling(Effect):
    """Part of joint m's load is carried by the motor of joint i, and joint i turns the motor of joint m.

    In a wrist whose drives pass through each other, joint i's motor carries c times m's load, and of m's friction what
    sits beyond those gears; and i turns m's motor, so that drag by m's viscous friction is its turns for a turn of i
    (as long as it turns the way of its joint: the recipe's `coupling` holds always). m owns the parameters, the shape
    `on` says which joint i is. load_owner (without inertia) and friction_owner are m's by the model, in ampere of m's
    own motor, zero where not known, shaft_on is i's velocity.
    """

    formula = "(c * load_owner + friction * friction_owner) * (joint == on) + drag * shaft_on * (joint == owner)"
    source = (
        "S.-K. Lin, Identification of a Class of Nonlinear Deterministic Systems with Application to Manipulators,"
        " eq. (38)-(40) (coupled wrist of the PUMA 560)"
    )
    scope = Scope.CAUSE
    family = Family.GRAVITY
    trace = (Trace.POSITION, Trace.LOAD)
    seen_in = "motion of both joints, or runs in other postures"
    look_alikes = ("zero_offset", "tilt", "counterbalance")
    linear = (
        Parameter("c", "1", "current of the other joint per load of this one", "c{n}", 0.1, -20.0, 20.0),
        Parameter("friction", "1", "the same per friction of this one", "f{n}", 0.1, -20.0, 20.0),
        Parameter("drag", "A s/{unit}", "current per speed of that other joint", "d{n}", 0.02),
    )
    only_loaded = True

    def shapes(self, robot: Robot, number: int) -> tuple[Shape, ...]:
        return (
            Shape(
                "on",
                "1",
                "number of the joint whose current changes",
                low=1.0,
                high=float(max(robot.n_joints, 2)),
                example=1.0 if number != 1 else 2.0,
                is_searched=False,
                # A drive passes through the joints before its own: those are the motors that can carry it.
                starts=tuple(float(i) for i in reversed(range(1, number))),
            ),
        )

    def applies(self, robot: Robot, joint: int, *, in_motion: bool = False) -> str | None:
        first = "joint 1 has no joint before it whose motor could carry its load"
        return first if joint == 1 else super().applies(robot, joint)
