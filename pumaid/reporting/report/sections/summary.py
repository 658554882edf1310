"""In short: what was learnt, in sentences, and where the currents go."""

from __future__ import annotations

from collections.abc import Mapping

from pumaid.reporting.plots.style import Drawing
from pumaid.reporting.report.base import Section
from pumaid.reporting.story import Story
from pumaid.reporting.wording import data_sentence, joint_sentence, noise_sentence, parameters_sentence, still_sentence


class Summary(Section):
    """The page's first screen."""

    order = 0
    title = "In short"

    def content(self, story: Story, drawings: Mapping[str, Drawing]) -> dict[str, object]:
        more = [sentence for sentence in (still_sentence(story), noise_sentence(story)) if sentence]
        return {
            "sentences": [data_sentence(story), parameters_sentence(story), *more],
            "joints": [joint_sentence(story, score) for score in story.comparison.joints if score.runs],
            "spent": drawings.get("spent"),
        }
