"""The arm: its geometry as the recipe states it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.arm import skeleton_figure
from pumaid.reporting.figures.style import Drawing
from pumaid.reporting.run_tables import axes_table
from pumaid.reporting.sections import Section


class ArmSection(Section):
    """The DH table and the skeleton."""

    order = 10
    title = "Arm"

    def figures(self, context: ReportContext) -> Sequence[Drawing]:
        return [skeleton_figure(context)]

    def content(self, context: ReportContext, figures: Mapping[str, Drawing]) -> dict[str, object]:
        gravity = ", ".join(f"{component:.6g}" for component in context.robot.gravity)
        table = axes_table(context.robot, context.units)
        return {"robot": context.robot, "gravity": gravity, "table": table, "skeleton": figures["arm"]}
