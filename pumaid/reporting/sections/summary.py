"""Summary: the results in sentences, and where the currents go."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.model import share_figure
from pumaid.reporting.figures.style import Drawing
from pumaid.reporting.sections import Section
from pumaid.reporting.text import data_sentence, joint_sentence, noise_sentence, parameters_sentence, still_sentence


class Summary(Section):
    """The page's first screen."""

    order = 0
    title = "Summary"

    def figures(self, context: ReportContext) -> Sequence[Drawing]:
        return [share_figure(context)] if any(score.shares for score in context.comparison.joints) else []

    def content(self, context: ReportContext, figures: Mapping[str, Drawing]) -> dict[str, object]:
        more = [sentence for sentence in (still_sentence(context), noise_sentence(context)) if sentence]
        return {
            "sentences": [data_sentence(context), parameters_sentence(context), *more],
            "joints": [joint_sentence(context, score) for score in context.comparison.joints if score.runs],
            "shares": figures.get("spent"),
        }
