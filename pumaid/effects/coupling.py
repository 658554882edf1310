"""Gear coupling: a joint's load on another's motor."""

from pumaid.effects import Effect, Family, Parameter, Scope, Shape, Trace
from pumaid.robot import Robot


class Coupling(Effect):
    """Part of joint m's load is carried by the motor of joint i.

    In a wrist whose drives pass through each other, a turn of joint i's motor also turns joint m, so i's motor carries
    c times m's load: m owns c, the shape `on` says which joint i it is. load_owner is m's gravity load by the model, in
    ampere of m's own motor; where m's load is not known the column is zero.
    """

    formula = "c * load_owner * (joint == on)"
    source = (
        "S.-K. Lin, Identification of a Class of Nonlinear Deterministic Systems with Application to Manipulators,"
        " eq. (38)-(40) (coupled wrist of the PUMA 560)"
    )
    scope = Scope.CAUSE
    family = Family.GRAVITY
    trace = (Trace.POSITION, Trace.LOAD)
    seen_in = "runs in which the load of the joint that causes it changes: other postures, or a payload"
    look_alikes = ("zero_offset", "tilt", "counterbalance")
    linear = (Parameter("c", "1", "current of the other joint per load of this one", "c{n}", 0.1, -20.0, 20.0),)
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

    def applies(self, robot: Robot, joint: int) -> str | None:
        first = "joint 1 has no joint before it whose motor could carry its load"
        return first if joint == 1 else super().applies(robot, joint)
