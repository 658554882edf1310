"""Model against measurement: error by joint, and the curves themselves."""

from __future__ import annotations

from collections.abc import Mapping

from pumaid.reporting.plots.spent import sentence
from pumaid.reporting.plots.style import Drawing
from pumaid.reporting.report.base import Section
from pumaid.reporting.scores import comparison_grid
from pumaid.reporting.story import Story


class Prediction(Section):
    """The paper's Fig. 4 for every joint."""

    order = 40
    title = "Model against measurement"

    def content(self, story: Story, drawings: Mapping[str, Drawing]) -> dict[str, object]:
        ways = {(score.run.joint, score.run.direction) for score in story.comparison.runs}
        return {
            "both_ways": any((joint, -1) in ways and (joint, 1) in ways for joint in story.moving()),
            "table": comparison_grid(story.comparison, story.robot),
            "spent": [sentence(story, score) for score in story.comparison.joints if score.shares],
            "figures": [drawing for name, drawing in drawings.items() if name.startswith("current_")],
        }
