"""After adding: how the error fell, model by model, toward the noise floor."""

from __future__ import annotations

from collections.abc import Mapping

from pumaid.reporting.ladder import joint_grids, ladder_grid, ladder_sentence
from pumaid.reporting.plots.style import Drawing
from pumaid.reporting.report.base import Section
from pumaid.reporting.story import Story


class Ladder(Section):
    """The models of the experiment, where there are several."""

    order = 70
    title = "After adding"

    def applies(self, story: Story) -> bool:
        return story.ladder is not None and len(story.ladder.rungs) > 1

    def content(self, story: Story, drawings: Mapping[str, Drawing]) -> dict[str, object]:
        ladder = story.ladder
        assert ladder is not None
        return {
            "sentence": ladder_sentence(ladder),
            "figure": drawings.get("ladder"),
            "tables": [ladder_grid(ladder), *joint_grids(ladder)],
        }
