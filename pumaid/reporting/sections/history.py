"""History: how the error fell from model to model."""

from __future__ import annotations

from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.model import PAGE_WIDTH, history_figure
from pumaid.reporting.figures.style import Drawing
from pumaid.reporting.sections import Content, Figures, Section
from pumaid.reporting.tables import history_joint_table, history_table


class HistorySection(Section):
    """The models of the experiment, if there are several."""

    order, title = 70, "History"

    def applies(self, context: ReportContext) -> bool:
        return context.ladder is not None and len(context.ladder.rungs) > 1

    def figures(self, context: ReportContext) -> list[Drawing]:
        ladder = context.ladder
        return [history_figure(ladder, width=PAGE_WIDTH)] if ladder is not None and len(ladder.path) > 1 else []

    def content(self, context: ReportContext, figures: Figures) -> Content:
        assert context.ladder is not None
        tables = [history_table(context.ladder), history_joint_table(context.ladder)]
        return {"steps": figures.get("ladder"), "tables": tables}
