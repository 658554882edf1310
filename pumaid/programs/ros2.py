"""A plan as a ROS 2 message trajectory_msgs/JointTrajectory, in YAML."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from pumaid import __version__
from pumaid.programs.steps import told
from pumaid.records import Plan
from pumaid.robot import Robot
from pumaid.trajectory import REST, trapezoids

Floats = NDArray[np.float64]

#: s in which a controller takes the arm to the first posture from where it stands, which must be near it.
LEAD_IN = 5.0

_HEAD = """\
# {count} runs for {name} as one trajectory_msgs/msg/JointTrajectory (rad, m, s); pumaid {version}.
# The names of joints must be those of your controller. The first point is reached in {lead:g} s from wherever the arm
# is: bring it there before you send this. To drive it slowly once, multiply all times and divide all velocities by 5.
"""


def trajectory(plan: Plan, robot: Robot) -> str:
    """The message as YAML: every corner of the trapezoids of speed is a point.

    Parameters
    ----------
    plan, robot
        The plan and the arm that it is for.

    Notes
    -----
    Accelerations are zero at every point. A controller that interpolates positions and velocities by cubics drives
    exact trapezoids; one that interpolates by quintics rounds the ramps, whose acceleration then peaks at 1.5 times
    that of the trapezoid; the plateau is at constant speed either way.

    Source
    ------
    trajectory_msgs/msg/JointTrajectory and JointTrajectoryPoint (docs.ros.org); interpolation: the documentation of
    joint_trajectory_controller (control.ros.org).
    """
    head = _HEAD.format(count=len(plan.motions), name=robot.name, version=__version__, lead=LEAD_IN)
    names = ", ".join(json.dumps(joint.name) for joint in robot.joints)
    opening = ["header: {stamp: {sec: 0, nanosec: 0}, frame_id: ''}", f"joint_names: [{names}]", "points:"]
    return head + "\n".join([*opening, *_points(plan, robot)]) + ("\n" if plan.motions else " []\n")


def _points(plan: Plan, robot: Robot) -> Iterator[str]:
    still = np.zeros(robot.n_joints)
    clock = LEAD_IN
    for trapezoid in trapezoids(robot, plan):
        if trapezoid.number == 1:
            yield _point(clock, trapezoid.start, still)
        if trapezoid.motion is not None:
            clock += REST
            yield f"# run {trapezoid.number}: {told(trapezoid.motion, robot)}"
            yield _point(clock, trapezoid.start, still)
        for time, position, velocity in trapezoid.corners():
            yield _point(clock + time, position, velocity)
        clock += time + REST
        yield _point(clock, trapezoid.end, still)


def _point(time: float, position: Floats, velocity: Floats) -> str:
    nanoseconds = round(1e9 * time)
    since = f"{{sec: {nanoseconds // 10**9}, nanosec: {nanoseconds % 10**9}}}"
    still = _listed(np.zeros(len(position)))
    return (
        f"- {{positions: {_listed(position)}, velocities: {_listed(velocity)}, accelerations: {still},"
        f" time_from_start: {since}}}"
    )


def _listed(values: Iterable[float]) -> str:
    return "[" + ", ".join(_decimal(value) for value in values) + "]"


def _decimal(value: float) -> str:
    """With a point and no exponent: YAML 1.1 would read 1 as an integer and 1e-9 as text."""
    text = f"{round(value, 9) + 0.0:.9f}".rstrip("0")
    return text + "0" if text.endswith(".") else text
