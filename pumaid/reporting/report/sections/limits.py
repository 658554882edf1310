"""Limits and notes: what the figures do not say."""

from __future__ import annotations

from collections.abc import Mapping

from pumaid.reporting.notes import merged
from pumaid.reporting.plots.style import Drawing
from pumaid.reporting.report.base import Section
from pumaid.reporting.story import Story

#: What the method cannot say, whatever the data.
LIMITS = (
    "All parameters are currents of each joint's own motor; torque constants and gears are neither known nor needed.",
    "Lengths a and d of a chain of turning joints are absorbed in the parameters: a wrong length in the recipe cannot"
    " be seen here, and does no harm to the predicted current.",
    "At constant speed there is no inertia in the current; only strokes, from rest to rest, carry it.",
    "Intervals count a run as one observation, since its samples share what is particular to it; with fewer than about"
    " ten runs a joint they are wide, and rightly so.",
    "A prediction is safe within the postures, speeds and directions that were fitted, and less so beyond.",
)


class Limits(Section):
    """Notes of this experiment, then limits of the method."""

    order = 80
    title = "Limits and notes"

    def content(self, story: Story, drawings: Mapping[str, Drawing]) -> dict[str, object]:
        notes = (*story.dataset.notes, *story.estimate.notes, *story.comparison.notes)
        return {"notes": merged(notes), "limits": LIMITS}
