"""The parameters with their errors, and what is not identifiable."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.model import parameter_figures
from pumaid.reporting.figures.style import Drawing
from pumaid.reporting.sections import Section
from pumaid.reporting.tables import combination_table, parameter_table
from pumaid.reporting.text import parameters_sentence


class Parameters(Section):
    """The paper's Table I for this arm."""

    order = 30
    title = "Parameters"

    def figures(self, context: ReportContext) -> Sequence[Drawing]:
        return parameter_figures(context)

    def content(self, context: ReportContext, figures: Mapping[str, Drawing]) -> dict[str, object]:
        return {
            "sentence": parameters_sentence(context),
            "table": parameter_table(context.estimate, context.robot, context.units),
            "sums": combination_table(context.estimate, context.units),
            "figures": list(figures.values()),
        }
