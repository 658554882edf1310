"""The parameters with their errors, and what is not identifiable."""

from __future__ import annotations

from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.model import parameter_figures
from pumaid.reporting.sections import Content, Section
from pumaid.reporting.tables import combination_table, parameter_table


class Parameters(Section):
    """The paper's Table I for this arm."""

    order, title = 30, "Parameters"

    def content(self, context: ReportContext) -> Content:
        return {
            "table": parameter_table(context.estimate, context.robot, context.units),
            "sums": combination_table(context.estimate),
            "figures": parameter_figures(context),
        }
