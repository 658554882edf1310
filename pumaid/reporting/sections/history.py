"""History: how the error fell from model to model."""

from __future__ import annotations

from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.model import PAGE_WIDTH, history_figure
from pumaid.reporting.sections import Content, Section
from pumaid.reporting.tables import history_joint_table, history_table


class HistorySection(Section):
    """The models of the experiment, if there are several."""

    order, title = 70, "History"

    def applies(self, context: ReportContext) -> bool:
        return context.ladder is not None and len(context.ladder.rungs) > 1

    def content(self, context: ReportContext) -> Content:
        ladder = context.ladder
        assert ladder is not None
        steps = history_figure(ladder, width=PAGE_WIDTH) if len(ladder.path) > 1 else None
        return {"steps": steps, "tables": [history_table(ladder), history_joint_table(ladder)]}
