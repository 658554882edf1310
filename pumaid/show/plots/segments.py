"""The segments picture as a figure of the report; it is drawn elsewhere."""

from __future__ import annotations

from collections.abc import Iterator

from pumaid.show.plots.style import Drawing
from pumaid.show.segments import draw
from pumaid.show.story import Story

#: Where it stands among the figures of a report.
ORDER = 5


def drawings(story: Story) -> Iterator[Drawing]:
    """One figure of all logs."""
    if story.evidence.runs:
        yield Drawing(
            "segments",
            "Runs found in the logs",
            "Velocity and position against time; runs in their joint's colour, what was left out hatched.",
            lambda: draw(story.evidence, story.robot, units=story.units),
        )
