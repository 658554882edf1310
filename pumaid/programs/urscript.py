"""A plan as a program in URScript, for controllers of Universal Robots."""

from __future__ import annotations

from collections.abc import Iterable

from pumaid import __version__
from pumaid.errors import ModelError, Where
from pumaid.programs.steps import told
from pumaid.records import Plan
from pumaid.robot import Robot
from pumaid.trajectory import REST, duration, trapezoids

#: rad/s and rad/s2 of the first move, from wherever the arm stands.
_APPROACH, _APPROACH_RAMP = 0.2, 0.5

_HEAD = """\
# {count} runs for {name}, about {minutes:.0f} min; pumaid {version}.
# Before you start it: set payload and TCP in the installation, clear the cell, start the recording of the log, and
# drive it through once with the speed slider low; for the measurement the slider must be at 100 %.
# It first drives slowly, all joints at once, to the posture of the first run: be near it, with the way free.
# movej with one moving joint is a trapezoid of speed: v in rad/s on the plateau, a in rad/s2 on the ramps.
def pumaid_plan():
"""


def script(plan: Plan, robot: Robot) -> str:
    """The text of a ``.script`` file: a move to each run's posture, a rest, the run, a rest.

    Parameters
    ----------
    plan, robot
        The plan and its arm: six joints that turn.

    Raises
    ------
    ModelError [program-other-robot]
        URScript moves six turning joints, and this arm has others.

    Source
    ------
    Universal Robots, The URScript Programming Language, module motion: movej(q, a, v) is straight in the joints' space,
    a and v being those of the leading axis; textmsg(s1, s2); sleep(t).
    """
    if robot.n_joints != 6 or not robot.is_revolute.all():
        turning = int(robot.is_revolute.sum())
        has = f"{robot.name} has {robot.n_joints} joints, {turning} of them turning"
        what = f"URScript moves six turning joints, and {has}"
        mend = "use the form ros2, yaml or csv for this arm"
        raise ModelError("program-other-robot", what, Where(file=robot.origin or None), mend)
    head = _HEAD.format(
        count=len(plan.motions), name=robot.name, minutes=duration(robot, plan) / 60.0, version=__version__
    )
    lines = []
    for trapezoid in trapezoids(robot, plan):
        if trapezoid.number == 1:
            lines.append(_movej(trapezoid.start, _APPROACH_RAMP, _APPROACH))
        if trapezoid.motion is not None:
            lines += [
                f"sleep({REST})",
                f"# {told(trapezoid.motion, robot)}",
                f'textmsg("pumaid run ", {trapezoid.number})',
            ]
        lines += [_movej(trapezoid.end, trapezoid.acceleration, trapezoid.speed), f"sleep({REST})"]
    lines.append('textmsg("pumaid plan done")')
    return head + "".join(f"  {line}\n" for line in lines) + "end\n"


def _movej(position: Iterable[float], acceleration: float, speed: float) -> str:
    listed = ", ".join(f"{value + 0.0:.7f}" for value in position)
    return f"movej([{listed}], a={acceleration:.6f}, v={speed:.6f})"
