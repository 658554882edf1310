"""The arm: geometry as the recipe states it."""

from __future__ import annotations

from collections.abc import Mapping

from pumaid.reporting.grid import Cell, Grid, grid
from pumaid.reporting.numbers import in_unit
from pumaid.reporting.plots.style import Drawing
from pumaid.reporting.report.base import Section
from pumaid.reporting.story import Story
from pumaid.robot import Joint, Robot


class Arm(Section):
    """The DH table and the skeleton."""

    order = 10
    title = "The arm"

    def content(self, story: Story, drawings: Mapping[str, Drawing]) -> dict[str, object]:
        robot = story.robot
        return {
            "robot": robot,
            "gravity": "[" + ", ".join(f"{component:.6g}" for component in robot.gravity) + "]",
            "table": _table(robot, story.units),
            "skeleton": drawings["arm"],
        }


def _table(robot: Robot, units: str) -> Grid:
    angle = "deg" if units == "deg" else "rad"
    header = ("joint", "name", "type", f"theta ({angle})", f"alpha ({angle})", "a (m)", "d (m)", "limits")
    rows: list[list[str | Cell]] = [
        [
            str(joint.number),
            joint.name,
            joint.kind,
            _angle(joint.theta, units) + (" + q" if joint.is_revolute else ""),
            _angle(joint.alpha, units),
            f"{joint.a:.5g}",
            f"{joint.d:.5g}" + ("" if joint.is_revolute else " + q"),
            _limits(joint, units),
        ]
        for joint in robot.joints
    ]
    caption = "Modified Denavit-Hartenberg (Craig); q is the measured position."
    return grid("Geometry", header, rows, caption=caption, lefts=(0, 1, 2))


def _angle(value: float, units: str) -> str:
    return f"{value * in_unit('rad', units)[0]:.5g}"


def _limits(joint: Joint, units: str) -> str:
    if joint.limits is None:
        return "not told"
    low, high = (_angle(limit, units) if joint.is_revolute else f"{limit:.5g}" for limit in joint.limits)
    unit = "m" if not joint.is_revolute else "deg" if units == "deg" else "rad"
    return f"{low} to {high} {unit}"
