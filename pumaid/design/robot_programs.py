"""A plan as a program that a robot's own controller runs: URScript, or a ROS 2 trajectory."""

import json
from collections.abc import Callable

import numpy as np

from pumaid import __version__
from pumaid.errors import ModelError, Where
from pumaid.maths import Floats
from pumaid.robot import Robot
from pumaid.trajectory import (
    REST,
    Motion,
    Plan,
    duration,
    trapezoids,
)
from pumaid.units import factor

#: rad/s and rad/s2 of URScript's first move, from wherever the arm stands.
_APPROACH, _APPROACH_RAMP = 0.2, 0.5
#: s in which a ROS 2 controller takes the arm to the first posture from where it stands, which must be near it.
LEAD_IN = 5.0

_URSCRIPT = """\
# {count} runs for {name}, about {minutes:.0f} min; pumaid {version}.
# Before you start it: set payload and TCP in the installation, clear the cell, start the recording of the log, and
# drive it through once with the speed slider low; for the measurement the slider must be at 100 %.
# It first drives slowly, all joints at once, to the posture of the first run: be near it, with the way free.
# movej with one moving joint is a trapezoid of speed: v in rad/s on the plateau, a in rad/s2 on the ramps.
def pumaid_plan():
{body}
end
"""

_ROS2 = """\
# {count} runs for {name} as one trajectory_msgs/msg/JointTrajectory (rad, m, s); pumaid {version}.
# The names of joints must be those of your controller. The first point is reached in {lead:g} s from wherever the arm
# is: bring it there before you send this. To drive it slowly once, multiply all times and divide all velocities by 5.
header: {{stamp: {{sec: 0, nanosec: 0}}, frame_id: ''}}
joint_names: [{joints}]
points:{points}
"""


def urscript(plan: Plan, robot: Robot) -> str:
    """The text of a ``.script`` file: a move to each run's posture, a rest, the run, a rest.

    Raises
    ------
    ModelError [program-other-robot]
        URScript moves six revolute joints, and this arm has others.

    Source
    ------
    Universal Robots, The URScript Programming Language, module motion: movej(q, a, v) is straight in the joints' space,
    a and v being those of the leading axis; textmsg(s1, s2); sleep(t).
    """
    if robot.n_joints != 6 or not robot.is_revolute.all():
        raise ModelError(
            "program-other-robot",
            f"URScript moves six revolute joints; {robot.name} has {int(robot.is_revolute.sum())} of {robot.n_joints}",
            Where(file=robot.origin or None),
            "use the form ros2, yaml or csv for this arm",
        )
    lines: list[str] = []

    def move(position: Floats, acceleration: float, speed: float) -> None:
        listed = ", ".join(f"{value + 0.0:.7f}" for value in position)
        lines.append(f"movej([{listed}], a={acceleration:.6f}, v={speed:.6f})")

    for step in trapezoids(robot, plan):
        if not lines:
            move(step.start, _APPROACH_RAMP, _APPROACH)
        if step.motion is None:
            move(step.end, step.acceleration, step.speed)
            continue
        lines += [f"sleep({REST})", f"# {_comment(step.motion, robot)}", f'textmsg("pumaid run ", {step.number})']
        move(step.end, step.acceleration, step.speed)
        lines.append(f"sleep({REST})")
    body = "\n".join(f"  {line}" for line in [*lines, 'textmsg("pumaid plan done")'])
    return _URSCRIPT.format(
        count=len(plan.motions), name=robot.name, minutes=duration(robot, plan) / 60.0, version=__version__, body=body
    )


def ros2_trajectory(plan: Plan, robot: Robot) -> str:
    """A trajectory_msgs/JointTrajectory as YAML: every corner of the trapezoids of speed is a point.

    A controller that interpolates positions and velocities by cubics drives exact trapezoids; one that interpolates by
    quintics rounds the ramps; the plateau is at constant speed either way.

    Source
    ------
    trajectory_msgs/msg/JointTrajectory and JointTrajectoryPoint (docs.ros.org); interpolation: the documentation of
    joint_trajectory_controller (control.ros.org).
    """
    still, clock, lines = np.zeros(robot.n_joints), LEAD_IN, list[str]()

    def point(time: float, position: Floats, velocity: Floats) -> None:
        seconds, nanoseconds = divmod(round(1e9 * time), 10**9)
        lines.append(
            f"- {{positions: {_listed(position)}, velocities: {_listed(velocity)}, accelerations: {_listed(still)},"
            f" time_from_start: {{sec: {seconds}, nanosec: {nanoseconds}}}}}"
        )

    for step in trapezoids(robot, plan):
        if not lines:
            point(clock, step.start, still)
        if step.motion is not None:
            lines.append(f"# run {step.number}: {_comment(step.motion, robot)}")
            point(clock + REST, step.start, still)
        clock += step.lead
        ends = np.array([step.ramp, step.duration - step.ramp, step.duration])
        times = ends if ends[1] - ends[0] > 1e-9 else ends[[0, 2]]
        for time, position, velocity in zip(times.tolist(), *step.at(times), strict=True):
            point(clock + time, position, velocity)
        clock += step.duration
        if step.motion is not None:
            clock += REST
            point(clock, step.end, still)
    joints, points = ", ".join(json.dumps(joint.name) for joint in robot.joints), "".join(f"\n{x}" for x in lines)
    return _ROS2.format(
        count=len(plan.motions),
        name=robot.name,
        version=__version__,
        lead=LEAD_IN,
        joints=joints,
        points=points or " []",
    )


def _listed(values: Floats) -> str:
    """With a point and no exponent: YAML 1.1 would read 1 as an integer and 1e-9 as text."""
    decimals = [f"{round(value, 9) + 0.0:.9f}".rstrip("0") for value in values]
    return "[" + ", ".join(text + "0" if text.endswith(".") else text for text in decimals) + "]"


def _comment(motion: Motion, robot: Robot) -> str:
    """A run in a comment: ``joint 3 (elbow) from -125 to 125 deg at 30 deg/s, fit``."""
    joint = robot.joint(motion.joint)
    scale, unit = (factor("deg"), "deg") if joint.is_revolute else (1.0, "m")
    start, end, speed = (f"{value / scale + 0.0:.6g}" for value in (motion.start, motion.end, motion.velocity))
    return f"joint {joint.number} ({joint.name}) from {start} to {end} {unit} at {speed} {unit}/s, {motion.purpose}"


#: Form -> (suffix of its files, what writes it).
PROGRAMS: dict[str, tuple[str, Callable[[Plan, Robot], str]]] = {
    "urscript": (".script", urscript),
    "ros2": (".ros2.yaml", ros2_trajectory),
}
