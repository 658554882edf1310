"""The parameters with their errors, and what is not identifiable."""

from __future__ import annotations

from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.model import parameter_figures
from pumaid.reporting.figures.style import Drawing
from pumaid.reporting.sections import Content, Figures, Section
from pumaid.reporting.tables import combination_table, parameter_table


class Parameters(Section):
    """The paper's Table I for this arm."""

    order, title = 30, "Parameters"

    def figures(self, context: ReportContext) -> list[Drawing]:
        return parameter_figures(context)

    def content(self, context: ReportContext, figures: Figures) -> Content:
        return {
            "table": parameter_table(context.estimate, context.robot, context.units),
            "sums": combination_table(context.estimate),
            "figures": list(figures.values()),
        }
