"""The data: files, runs, and what was not used."""

from __future__ import annotations

from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.runs import report_run_figure
from pumaid.reporting.run_tables import file_table, rejection_table, runs_by_joint_table
from pumaid.reporting.sections import Content, Section


class Data(Section):
    """What the logs contain."""

    order, title = 20, "Data"

    def content(self, context: ReportContext) -> Content:
        dataset = context.dataset
        return {
            "joints": runs_by_joint_table(dataset, context.robot, units=context.units),
            "picture": report_run_figure(context) if dataset.runs else None,
            "tables": [table for table in (rejection_table(dataset), file_table(dataset)) if table.rows],
        }
