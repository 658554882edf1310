"""The table: the parameters with their errors, and what could not be told."""

from __future__ import annotations

from collections.abc import Mapping

from pumaid.reporting.plots.style import Drawing
from pumaid.reporting.report.base import Section
from pumaid.reporting.story import Story
from pumaid.reporting.tables import combinations_grid, joints_grid, parameter_grid
from pumaid.reporting.wording import parameters_sentence


class Parameters(Section):
    """The paper's Table I for this arm."""

    order = 30
    title = "The parameters"

    def content(self, story: Story, drawings: Mapping[str, Drawing]) -> dict[str, object]:
        return {
            "sentence": parameters_sentence(story),
            "table": parameter_grid(story.estimate, story.robot, story.units),
            "sums": combinations_grid(story.estimate, story.units),
            "joints": joints_grid(story.estimate, story.robot),
            "figures": [drawings[name] for name in ("parameters", "precision") if name in drawings],
        }
