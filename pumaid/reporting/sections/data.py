"""The data: files, runs, and what was not used."""

from __future__ import annotations

from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.runs import report_run_figure
from pumaid.reporting.figures.style import Drawing
from pumaid.reporting.run_tables import file_table, rejection_table, runs_by_joint_table
from pumaid.reporting.sections import Content, Figures, Section


class Data(Section):
    """What the logs contain."""

    order, title = 20, "Data"

    def figures(self, context: ReportContext) -> list[Drawing]:
        return [report_run_figure(context)] if context.dataset.runs else []

    def content(self, context: ReportContext, figures: Figures) -> Content:
        dataset = context.dataset
        return {
            "joints": runs_by_joint_table(dataset, context.robot, units=context.units),
            "picture": figures.get("segments"),
            "tables": [table for table in (rejection_table(dataset), file_table(dataset)) if table.rows],
        }
