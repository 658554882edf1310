"""The data: files, runs, and what was not used."""

from __future__ import annotations

from dataclasses import replace

from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.runs import MOST_RUNS, beginning, run_figure
from pumaid.reporting.run_tables import file_table, rejection_table, runs_by_joint_table
from pumaid.reporting.sections import Content, Section


class Data(Section):
    """What the logs contain."""

    order, title = 20, "Data"

    def content(self, context: ReportContext) -> Content:
        dataset = context.dataset
        picture = run_figure(beginning(dataset), context.robot, context.units) if dataset.runs else None
        if picture and len(dataset.runs) > MOST_RUNS:
            first = f"The first {MOST_RUNS} of {len(dataset.runs)} runs. "
            picture = replace(picture, caption=first + picture.caption)
        return {
            "joints": runs_by_joint_table(dataset, context.robot, units=context.units),
            "picture": picture,
            "tables": [table for table in (rejection_table(dataset), file_table(dataset)) if table.rows],
        }
