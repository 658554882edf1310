"""The data: files, runs, and what was not used."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.runs import report_run_figure
from pumaid.reporting.figures.style import Drawing
from pumaid.reporting.run_tables import rejection_table, runs_by_joint_table
from pumaid.reporting.sections import Section
from pumaid.reporting.table import Table
from pumaid.reporting.text import data_sentence
from pumaid.units import number


class Data(Section):
    """What the logs contain."""

    order = 20
    title = "Data"

    def figures(self, context: ReportContext) -> Sequence[Drawing]:
        return [report_run_figure(context)] if context.dataset.runs else []

    def content(self, context: ReportContext, figures: Mapping[str, Drawing]) -> dict[str, object]:
        dataset = context.dataset
        rows = [
            [
                facts.name,
                f"{facts.rows:,}",
                f"{number(1e3 * facts.interval, 3)} ms",
                f"{number(facts.last_time - facts.first_time, 4)} s",
                facts.digest[:12],
            ]
            for facts in dataset.files
        ]
        header = ("file", "rows", "sample time", "duration", "SHA-256")
        tables = [rejection_table(dataset)] if dataset.rejects else []
        tables += [Table("Logs", header, rows, words=(0, 4))] if rows else []
        return {
            "sentence": data_sentence(context),
            "joints": runs_by_joint_table(dataset, context.robot, units=context.units),
            "picture": figures.get("segments"),
            "tables": tables,
        }
