"""Model against measurement: errors by joint, and the currents themselves."""

from __future__ import annotations

from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.residuals import current_figures
from pumaid.reporting.sections import Content, Section
from pumaid.reporting.tables import comparison_table


class Prediction(Section):
    """The paper's Fig. 4 for each joint."""

    order, title = 40, "Model against measurement"

    def content(self, context: ReportContext) -> Content:
        ways = {(score.run.joint, score.run.direction) for score in context.comparison.runs}
        return {
            "both_ways": any((joint, -1) in ways and (joint, 1) in ways for joint in context.moving()),
            "table": comparison_table(context.comparison, context.robot),
            "figures": current_figures(context),
        }
