"""The joints of an arm as a table: how each axis stands to the one before, and how far and fast it goes."""

from __future__ import annotations

from rich import box
from rich.table import Table
from rich.text import Text

from pumaid.robot import Joint, Robot
from pumaid.units import factor, number


def axes_table(robot: Robot) -> Table:
    """Modified DH parameters, limits and speeds joint by joint, for the terminal; angles in deg."""
    table = Table(title=Text(robot.name, style="table.title"), title_justify="left", box=box.SIMPLE_HEAD)
    table.add_column("joint")
    table.add_column("type")
    for name in ("theta", "alpha", "a (m)", "d (m)", "limits", "speed"):
        table.add_column(name, justify="right")
    for joint in robot.joints:
        theta, alpha = (_angle(value) for value in (joint.theta, joint.alpha))
        length, shift = (f"{value:.5g}" for value in (joint.a, joint.d))
        table.add_row(Text(joint.name), joint.kind, theta, alpha, length, shift, _limits(joint), _speed(joint))
    return table


def _angle(value: float) -> str:
    return f"{round(value / factor('deg'), 4) + 0.0:.6g} deg"


def _limits(joint: Joint) -> str:
    if joint.limits is None:
        return "none"
    scale, unit = (factor("deg"), "deg") if joint.is_revolute else (1.0, "m")
    low, high = (f"{value / scale:.4g}" for value in joint.limits)
    return f"{low} to {high} {unit}"


def _speed(joint: Joint) -> str:
    if joint.max_velocity is None:
        return "none"
    scale, unit = (factor("deg"), "deg/s") if joint.is_revolute else (1.0, "m/s")
    return f"{number(joint.max_velocity / scale)} {unit}"
