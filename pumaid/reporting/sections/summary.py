"""Summary: the results in sentences, and where the currents go."""

from __future__ import annotations

from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.model import share_figure
from pumaid.reporting.figures.style import Drawing
from pumaid.reporting.sections import Content, Figures, Section
from pumaid.reporting.text import data_sentence, joint_sentence, parameters_sentence


class Summary(Section):
    """The page's first screen."""

    order, title = 0, "Summary"

    def figures(self, context: ReportContext) -> list[Drawing]:
        return [share_figure(context)] if any(score.shares for score in context.comparison.joints) else []

    def content(self, context: ReportContext, figures: Figures) -> Content:
        return {
            "sentences": [data_sentence(context.dataset), parameters_sentence(context.estimate)],
            "joints": [joint_sentence(score, context.robot) for score in context.comparison.joints],
            "shares": figures.get("spent"),
        }
