"""The arm: its geometry as the recipe states it."""

from __future__ import annotations

from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.arm import skeleton_figure
from pumaid.reporting.run_tables import axes_table
from pumaid.reporting.sections import Content, Section


class ArmSection(Section):
    """The DH table and the skeleton."""

    order, title = 10, "Arm"

    def content(self, context: ReportContext) -> Content:
        gravity = ", ".join(f"{component:.6g}" for component in context.robot.gravity)
        table = axes_table(context.robot, context.units)
        return {"robot": context.robot, "gravity": gravity, "table": table, "skeleton": skeleton_figure(context)}
