"""Summary: the results in sentences, and where the currents go."""

from __future__ import annotations

from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.model import share_figure
from pumaid.reporting.sections import Content, Section
from pumaid.reporting.text import data_sentence, joint_sentence, parameters_sentence


class Summary(Section):
    """The page's first screen."""

    order, title = 0, "Summary"

    def content(self, context: ReportContext) -> Content:
        scores = context.comparison.joints
        return {
            "sentences": [data_sentence(context.dataset), parameters_sentence(context.estimate)],
            "joints": [joint_sentence(score, context.robot) for score in scores],
            "shares": share_figure(context) if any(score.shares for score in scores) else None,
        }
